// Domain: sums over particles, for the sensors that are made of them.
#pragma once

#include "mpm/solver/domain.hpp"

namespace mpm {

template <class X, class T, int D>
void Domain<X, T, D>::make_tallies() {
    using Law = LawOf<X, D>;
    const SceneSizes sizes = sizes_of(spec_, plan_);
    constexpr std::size_t no_places = ~std::size_t(0);
    std::vector<double> places;
    std::vector<std::size_t> place_of;
    for (int k = 0; k < sensors_.count(); ++k) {
        const SensorSpec& sensor = sensors_.at(k).spec;
        if (sensor.kind != SensorKind::tally) continue;
        tallies_.asking_list.push_back(k);
        std::size_t first_places = no_places;
        for (std::size_t t = 0; t < sensor.tallies.size(); ++t) {
            const TallySpec& s = sensor.tallies[t];
            const Body& body = bodies_.at(std::size_t(s.body));
            const std::string& law = spec_.bodies[std::size_t(s.body)].material;
            TallyTask<D> task{};
            task.sensor = k;
            const auto at = std::find(tallies_.seen.begin(), tallies_.seen.end(), s.body);
            task.body = std::int32_t(at - tallies_.seen.begin());
            if (at == tallies_.seen.end()) {
                tallies_.seen.push_back(s.body);
                tallies_.spans.emplace_back(exec_);
                tallies_.in_part.push_back(0);
            }
            task.first = std::uint32_t(s.first - body.first_id);
            task.ids = std::uint32_t(s.count);
            if (s.count < ids_of(spec_.bodies[std::size_t(s.body)]))
                tallies_.in_part[std::size_t(task.body)] = 1;
            task.of = TallyOf(s.of);
            if (of_law(task.of) && !Law::knows(law))
                throw SceneError("sensor '" + sensor.name + "': material '" + law +
                                 "' is not built for sums on devices; use device=\"cpu\"");
            task.part = s.part;
            task.axis = s.axis;
            task.sign = s.sign;
            task.boxed = !s.lower.empty();
            task.row = std::int64_t(t) * TallyRow::size;
            for (int a = 0; a < D; ++a) {
                task.lower[a] = task.boxed ? s.lower[std::size_t(a)] : 0;
                task.upper[a] = task.boxed ? s.upper[std::size_t(a)] : 0;
                task.origin[a] = s.origin.at(std::size_t(a));
                task.up[a] = s.up.at(std::size_t(a));
                task.reference[a] = s.reference.at(std::size_t(a));
            }
            scale_tally(task, sizes, body.particle_mass, body.particle_volume);
            // Places stand beside the first of a body's tallies that asks for them.
            if (!s.places.empty()) {
                first_places = places.size();
                for (int a = 0; a < D; ++a)
                    for (std::size_t q = 0; q < s.count; ++q) {
                        // As a particle stores it (kernels/placing.hpp).
                        const double x = s.places[q * D + std::size_t(a)] / spec_.cell_size,
                                     low = std::floor(x), offset = double(T(x - low - 0.5));
                        places.push_back((low + 0.5 + offset) * spec_.cell_size -
                                         task.reference[a]);
                    }
            }
            place_of.push_back(needs_places(task.of) ? first_places : no_places);
            tallies_.task_list.push_back(task);
        }
    }
    if (!tallies_.any()) return;
    tallies_.places.assign(places);
    for (std::size_t t = 0; t < place_of.size(); ++t)
        if (place_of[t] != no_places)
            tallies_.task_list[t].places = tallies_.places.data() + place_of[t];
    for (int k = 0; k < sensors_.count(); ++k)
        for (TallySpec& t : sensors_.at(k).spec.tallies) t.places = {};
    for (SensorSpec& sensor : spec_.sensors)
        for (TallySpec& t : sensor.tallies) t.places = {};
    tallies_.tasks.assign(tallies_.task_list);
    tallies_.asking.assign(tallies_.asking_list);
}

/// Where particles are now.
template <class X, class T, int D>
void Domain<X, T, D>::list_tallied() {
    if (!std::exchange(tallies_.stale, false)) return;
    std::vector<TallyBody<T, D, typename LawOf<X, D>::type>> bodies;
    for (std::size_t k = 0; k < tallies_.seen.size(); ++k) {
        const int b = tallies_.seen[k];
        const Body& body = bodies_[std::size_t(b)];
        const auto law = LawOf<X, D>::make(body.ops, spec_.bodies[std::size_t(b)].material);
        auto& seen = bodies.emplace_back(tally_body(body, law));
        seen.view = body.view();
        if (tallies_.in_part[k]) {
            auto& spans = tallies_.spans[k];
            const std::uint64_t all = ~std::uint64_t(0);
            spans.assign(std::vector<IdSpan>(std::size_t(body.homes), {all, all}));
            using Find = FindIdSpans<X, T, D>;
            exec_.for_each(std::int64_t(body.homes) * Find::lanes, Find{seen.view, spans.data()});
            seen.ids = spans.data();
        }
    }
    std::vector<SumSet> sets;
    std::int32_t places = 0;
    // Of very many sets each has few parts.
    const std::int64_t most =
        std::max<std::int64_t>(1, 4096 / std::int64_t(tallies_.task_list.size()));
    for (const TallyTask<D>& task : tallies_.task_list) {
        const std::int64_t items = std::int64_t(bodies[std::size_t(task.body)].view.homes) *
                                   MeasureTallies<X, T, D, typename LawOf<X, D>::type>::lanes;
        const std::int64_t parts = std::min<std::int64_t>(exec_.sum_parts(items), most);
        sets.push_back({0, items, places, std::int32_t(parts)});
        places += sets.back().parts;
    }
    tallies_.bodies.assign(bodies);
    tallies_.sets.assign(sets);
    if (tallies_.parts.size() < std::size_t(places)) {
        tallies_.parts.reserve_discard(std::size_t(places));
        // Devices add to totals that are zeros between samples (kernels/cuda/tally_sums.cuh).
        if constexpr (X::is_device) tallies_.parts.zero();
    }
    tallies_.part_count = places;
}

template <class X, class T, int D>
void Domain<X, T, D>::run_tallies() {
    if (!tallies_.any()) return;
    const auto count = std::int32_t(tallies_.asking_list.size());
    MeasureTallies<X, T, D, typename LawOf<X, D>::type> measure{
        tallies_.tasks.data(),
        sensors_.records(),
        tallies_.asking.data(),
        count,
        nullptr,
        table_,
        velocity_.data(),
        plan_.velocity_channels,
        sums_[parity()].data(),
        plan_.sum_channels,
        kernel_width(spec_.kernel.kernel) != 3,
        spec_.cell_size};
    if constexpr (!X::is_device) {
        if (measure.idle()) return;
    }
    list_tallied();
    measure.bodies = tallies_.bodies.data();
    exec_.template sum_each<1>(
        SumSets{tallies_.sets.data(), int(tallies_.task_list.size()), tallies_.part_count}, measure,
        TakeTallies<D>{clock_buffer_.data(), sensors_.records(), tallies_.tasks.data(),
                       tallies_.asking.data(), count},
        tallies_.parts.data(), 0, Nothing{});
}

}  // namespace mpm
