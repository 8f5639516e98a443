// Domain: sums over particles, for the sensors that are made of them.
#pragma once

#include "mpm/solver/domain.hpp"

namespace mpm {

template <class X, class T, int D>
void Domain<X, T, D>::make_tallies() {
    using Law = LawOf<X, D>;
    const SceneSizes sizes = sizes_of(spec_, plan_);
    std::vector<double> places;
    std::vector<std::size_t> place_of;
    for (int k = 0; k < sensors_.count(); ++k) {
        const SensorSpec& sensor = sensors_.at(k).spec;
        if (sensor.kind != SensorKind::tally) continue;
        tallies_.asking_list.push_back(k);
        for (std::size_t t = 0; t < sensor.tallies.size(); ++t) {
            const TallySpec& s = sensor.tallies[t];
            const Body& body = bodies_.at(std::size_t(s.body));
            const std::string& law = spec_.bodies[std::size_t(s.body)].material;
            TallyTask<D> task{};
            task.sensor = k;
            const auto at = std::find(tallies_.seen.begin(), tallies_.seen.end(), s.body);
            task.body = std::int32_t(at - tallies_.seen.begin());
            if (at == tallies_.seen.end()) tallies_.seen.push_back(s.body);
            task.first = std::uint32_t(s.first - body.first_id);
            task.ids = std::uint32_t(s.count);
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
            place_of.push_back(s.places.empty() ? ~std::size_t(0) : places.size());
            for (int a = 0; a < D && !s.places.empty(); ++a)
                for (std::size_t q = 0; q < s.count; ++q)
                    places.push_back(s.places[q * D + std::size_t(a)] - task.reference[a]);
            tallies_.task_list.push_back(task);
        }
    }
    if (!tallies_.any()) return;
    tallies_.places.assign(places);
    for (std::size_t t = 0; t < place_of.size(); ++t)
        if (place_of[t] != ~std::size_t(0))
            tallies_.task_list[t].places = tallies_.places.data() + place_of[t];
    tallies_.tasks.assign(tallies_.task_list);
    tallies_.asking.assign(tallies_.asking_list);
}

/// Where particles are now.
template <class X, class T, int D>
void Domain<X, T, D>::list_tallied() {
    if (!std::exchange(tallies_.stale, false)) return;
    std::vector<TallyBody<T, D, typename LawOf<X, D>::type>> bodies;
    for (const int b : tallies_.seen) {
        const Body& body = bodies_[std::size_t(b)];
        auto& seen = bodies.emplace_back();
        seen.view = body.view();
        seen.n = body.plan.phase;
        seen.law = LawOf<X, D>::make(body.ops, spec_.bodies[std::size_t(b)].material);
        for (std::size_t k = 0; k < body.parameters.size(); ++k)
            seen.parameters[k] = body.parameters[k];
        seen.reals = body.material->reals(D);
        seen.columns = body.plan.state_columns;
        seen.two_volumes = body.plan.smoothing == Smoothing::two_volumes;
        seen.volumetric = body.material->volumetric;
    }
    std::vector<SumSet> sets;
    std::int32_t places = 0;
    // Each set has blocks of threads of its own; of very many sets each has few.
    const std::int64_t most =
        std::max<std::int64_t>(1, 4096 / std::int64_t(tallies_.task_list.size()));
    for (const TallyTask<D>& task : tallies_.task_list) {
        const std::int64_t items =
            std::int64_t(bodies[std::size_t(task.body)].view.homes) * home_lanes<X>;
        std::int64_t parts = exec_.sum_parts(items);
        if constexpr (X::is_device) parts = std::min(parts, most);
        sets.push_back({0, items, places, std::int32_t(parts)});
        places += sets.back().parts;
    }
    tallies_.bodies.assign(bodies);
    tallies_.sets.assign(sets);
    tallies_.parts.reserve_discard(std::size_t(places));
    tallies_.part_count = places;
}

template <class X, class T, int D>
void Domain<X, T, D>::run_tallies() {
    if (!tallies_.any()) return;
    const auto count = std::int32_t(tallies_.asking_list.size());
    list_tallied();
    const MeasureTallies<X, T, D, typename LawOf<X, D>::type> measure{
        tallies_.tasks.data(),
        sensors_.records(),
        tallies_.asking.data(),
        count,
        tallies_.bodies.data(),
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
    exec_.template sum_each<1>(
        SumSets{tallies_.sets.data(), int(tallies_.task_list.size()), tallies_.part_count}, measure,
        TakeTallies<D>{clock_buffer_.data(), sensors_.records(), tallies_.tasks.data(),
                       tallies_.asking.data(), count},
        tallies_.parts.data(), 0, Nothing{});
}

}  // namespace mpm
