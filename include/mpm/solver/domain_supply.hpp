// Domain: inlets. Layers of particles come in through a face of the domain, each when the water
// before it has moved on by the distance between two layers. The clock halts for it; the particles
// join their body in the sort that follows, and the sums get what they would have deposited.
#pragma once

#include "mpm/solver/domain.hpp"

namespace mpm {

template <class X, class T, int D>
void Domain<X, T, D>::set_supplies() {
    if (spec_.inlets.empty()) return;
    next_id_.assign(spec_.bodies.size(), 0);
    for (std::size_t b = 0; b < next_id_.size(); ++b) next_id_[b] = spec_.bodies[b].count;
    std::vector<SupplyRecord> records;
    for (const InletSpec& s : spec_.inlets) {
        records.push_back({upload_table(s.velocity, 1), 0, s.spacing, 0});
        auto& next = next_id_.at(std::size_t(s.body));
        next = std::max(next, s.next_id);
        // Points of a layer in any cell of the face, each with the largest weight in a node's
        // cells.
        std::map<std::vector<std::int64_t>, int> in_cell;
        int most = 0;
        for (std::size_t k = 0; k < s.points.size(); k += D) {
            std::vector<std::int64_t> cell;
            for (int a = 0; a < D; ++a)
                cell.push_back(std::int64_t(std::floor(s.points[k + a] / spec_.cell_size)));
            most = std::max(most, ++in_cell[cell]);
        }
        double fastest = 0;
        for (double v : s.velocity.value) fastest = std::max(fastest, v);
        const double layers = std::ceil(fastest * clock_.dt_stable / s.spacing);
        const double width = bodies_[std::size_t(s.body)].plan.any_transfer()
                                 ? kernel_width(spec_.kernel.kernel)
                                 : std::pow(double(stencil_nodes<D>), 1.0 / D) * 0.75;
        supplied_mass_ += bodies_[std::size_t(s.body)].particle_mass * most *
                          std::max(layers, 1.0) * std::pow(width, D - 1);
    }
    supplies_.assign(records);
    supplied_.assign(records.size(), 0);
}

/// The rows of all layers that are due, and what the inlets' counters are with them.
template <class X, class T, int D>
std::vector<typename Domain<X, T, D>::Arrival> Domain<X, T, D>::due_layers(
    std::vector<SupplyRecord>& records, std::vector<std::uint64_t>& layers,
    std::vector<std::uint64_t>& next_id, std::vector<Flow>& flows) const {
    std::vector<Arrival> arrivals;
    for (std::size_t k = 0; k < records.size(); ++k) {
        const InletSpec& inlet = spec_.inlets[k];
        SupplyRecord& record = records[k];
        if (!(record.moved >= record.due)) continue;
        const std::size_t b = std::size_t(inlet.body), n = inlet.points.size() / D;
        const int axis = inlet.face / 2;
        const double into = inlet.face % 2 == 0 ? 1 : -1;
        std::vector<double> position, pressure, speed(D, 0.0);
        std::vector<std::uint32_t> ids;
        while (record.moved >= record.due) {
            const double further = record.moved - record.due;
            for (std::size_t p = 0; p < n; ++p) {
                for (int a = 0; a < D; ++a)
                    position.push_back(inlet.points[p * D + a] + (a == axis ? into * further : 0));
                if (!inlet.pressure.empty()) pressure.push_back(inlet.pressure[p]);
                ids.push_back(std::uint32_t(next_id[b]++));
            }
            // Not a sum of spacings: it would drift from the water's way.
            record.due = double(++layers[k] + 1) * inlet.spacing;
        }
        const std::uint64_t room = ids_of(spec_.bodies[b]);
        if (next_id[b] > room)
            throw CapacityError("inlet '" + inlet.name + "': body '" + bodies_[b].plan.name +
                                "' has had all its " + std::to_string(room) +
                                " particles; give the inlet a larger max_particles");
        // The same table at the same time as the nodes of its zone.
        std::vector<double> time = inlet.velocity.time, value = inlet.velocity.value;
        const TimeTableView table{time.data(), value.data(), std::int32_t(time.size()), 1,
                                  inlet.velocity.end};
        double u = 0;
        table.at(clock_.time, &u);
        speed[std::size_t(axis)] = into * u;

        Arrival& arrival = arrivals.emplace_back();
        arrival.body = inlet.body;
        BodySpec& rows = arrival.rows;
        rows.name = bodies_[b].plan.name;
        rows.parameters = bodies_[b].parameters;
        rows.count = ids.size();
        rows.position = rows_of(std::move(position), D);
        if (!pressure.empty()) rows.pressure = rows_of(std::move(pressure), 1);
        rows.velocity = std::move(speed);
        rows.ids = std::move(ids);
        const double added = double(rows.count);
        flows.push_back({true, int(k), clock_.time, clock_.step, rows.count,
                         added * bodies_[b].particle_mass, added * bodies_[b].particle_volume});
    }
    return arrivals;
}

/// Returns false when particles have left the domain and the policy is to stop; the state is then
/// untouched.
template <class X, class T, int D>
bool Domain<X, T, D>::supply() {
    auto records = supplies_.host();
    auto layers = supplied_;
    auto next_id = next_id_;
    std::vector<Flow> flows;
    arrivals_ = due_layers(records, layers, next_id, flows);
    const bool sorted = sort();
    if (sorted) {
        supplies_.assign(records);
        supplied_ = std::move(layers);
        next_id_ = std::move(next_id);
        // All ranks know of whole layers; one tells.
        if (!share_ || share_->rank() == 0) flows_.insert(flows_.end(), flows.begin(), flows.end());
        deposit_arrivals();
    }
    arrivals_.clear();
    return sorted;
}

/// How many particles are about to join a body.
template <class X, class T, int D>
std::uint32_t Domain<X, T, D>::arriving(std::size_t body) const {
    std::uint32_t n = 0;
    for (const Arrival& a : arrivals_)
        if (std::size_t(a.body) == body) n += std::uint32_t(a.rows.count);
    return n;
}

/// Their blocks are occupied too; `keys` gets them, `found` is raised where the table lacks one.
template <class X, class T, int D>
void Domain<X, T, D>::mark_arrivals(Buffer<X, std::uint32_t>& occupied, std::uint32_t* found,
                                    Buffer<X, std::uint64_t>& keys) {
    std::vector<std::uint64_t> all;
    for (const Arrival& arrival : arrivals_) {
        std::vector<double> x(arrival.rows.count * D);
        arrival.rows.position(0, arrival.rows.count, x.data());
        for (std::size_t p = 0; p < x.size(); p += D) {
            std::int64_t block[D];
            for (int a = 0; a < D; ++a)
                block[a] = std::int64_t(std::floor(x[p + a] / spec_.cell_size)) / Block<D>::edge;
            all.push_back(table_.keys_of.key(block));
        }
    }
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    keys.assign(all);
    exec_.for_each(std::int64_t(all.size()),
                   MarkArrivals<X, D>{table_, keys.data(), occupied.data(), found});
}

/// Rows behind those that a body has, and their cells in a table that has their blocks.
template <class X, class T, int D>
void Domain<X, T, D>::append_arrivals(int number, Buffer<X, std::uint32_t>& cell,
                                      const BlockTableView<D>& table) {
    Body& body = bodies_[std::size_t(number)];
    const std::uint32_t more = arriving(std::size_t(number));
    const std::size_t needed = std::size_t(body.count) + more + column_padding;
    const std::size_t room = needed <= body.id.size() ? body.id.size() : needed + needed / 4;
    const auto grow = [&]<class E>(Buffer<X, E>& column) {
        if (room <= column.size()) return;
        Buffer<X, E> larger(exec_);
        larger.reserve_discard(room);
        exec_.copy(larger.data(), column.data(), body.count * sizeof(E));
        column.swap(larger);
    };
    for (auto& column : body.offset) grow(column);
    for (auto& column : body.state) grow(column);
    grow(body.id);
    if constexpr (X::is_device) body.cell.reserve_discard(room);
    for (const Arrival& arrival : arrivals_) {
        if (arrival.body != number) continue;
        const BodySpec& rows = arrival.rows;
        const std::uint32_t at = body.count;
        const std::int64_t n = std::int64_t(rows.count);
        std::vector<double> x(rows.count * D);
        rows.position(0, rows.count, x.data());
        Buffer<X, double> position(exec_);
        position.assign(x);
        PlaceParticles<T, D> place{position.data(),  spec_.cell_size,     {}, table, {},
                                   cell.data() + at, body.id.data() + at, 0};
        for (int a = 0; a < D; ++a) {
            place.cells[a] = spec_.cells[a];
            place.offset[a] = body.offset[a].data() + at;
        }
        exec_.for_each(n, place);
        exec_.upload(body.id.data() + at, rows.ids.data(), rows.count * sizeof rows.ids[0]);
        for (auto& column : body.state) exec_.for_each(n, Constant<T>{T(0), column.data() + at});
        set_pressure(body, rows, at);
        for (int a = 0; a < D && body.plan.phase.velocity >= 0; ++a)
            exec_.for_each(n, Constant<T>{T(rows.velocity[a]),
                                          body.state[body.plan.phase.velocity + a].data() + at});
        body.count += std::uint32_t(rows.count);
        exec_.wait();
    }
}

/// The sums as if the new particles had been there in the step before: they hold their stress for
/// the step to come.
template <class X, class T, int D>
void Domain<X, T, D>::deposit_arrivals() {
    std::vector<BodyNumbers> numbers;
    for (const BodyConstants& body : constants_.host())
        numbers.push_back(body_numbers(body, spec_.cell_size, clock_.dt, clock_.dt));
    numbers_.assign(numbers);
    const Clock kept = clock_;
    clock_.halt = Halt::none;
    for (int q = 0; q < quantities; ++q) clock_.scale_write[q] = 1 / clock_.unit_read[q];
    push_clock();
    if constexpr (X::is_device) meet_hosts();
    // Complete sums are there already: what ranks have yet to tell each other is kept apart.
    const bool apart = X::is_device && share_;
    const int to = apart ? 1 - parity() : parity();
    if (apart) sums_[to].zero();
    for (Arrival& arrival : arrivals_) {
        const Body& body = bodies_[std::size_t(arrival.body)];
        Body fresh(exec_);
        fresh.plan = body.plan;
        fresh.ops = body.ops;
        fresh.material = body.material;
        fresh.parameters = body.parameters;
        fresh.first_id = body.first_id;
        fresh.particle_mass = body.particle_mass;
        fresh.particle_volume = body.particle_volume;
        place_body(fresh, arrival.rows);
        Homes homes;
        Buffer<X, std::uint32_t> count(exec_);
        count.reserve_discard(1);
        add_homes(homes, count.data(), [&](Buffer<X, std::uint32_t>& flag) {
            exec_.for_each(table_.slots, FlagHomes{fresh.cell_start.data(), flag.data()});
        });
        fresh.homes = fresh.full_homes = std::int32_t(count.host()[0]);
        fresh.home.reserve_discard(fresh.homes);
        exec_.for_each(table_.slots, ListHomes{homes.flag[0].data(), homes.position[0].data(),
                                               fresh.home.data()});
        if constexpr (!X::is_device) sort_by_colour(fresh);
        deposit_body(fresh, arrival.body, arrival.rows.velocity, {}, false, to);
        if constexpr (!X::is_device) {
            if (share_) end_of_sums(parity(), Added::at_rest);
        } else {
            if (!apart) meet_hosts();
        }
    }
    if constexpr (X::is_device) {
        if (apart) {
            share_deposits(to);
            exec_.for_each(std::int64_t(sums_[to].size()),
                           AddSums<Sum>{sums_[1 - to].data(), sums_[to].data()});
        }
    }
    fetch_clock();
    for (int q = 0; q < quantities; ++q) clock_.scale_write[q] = kept.scale_write[q];
    clock_.strays = kept.strays;
    clock_.numbers_dt = -1;
}

/// How many steps there probably are before the next layer is due.
template <class X, class T, int D>
std::int64_t Domain<X, T, D>::steps_to_supply() const {
    double n = double(X::batch);
    for (const SupplyRecord& record : supplies_.host())
        if (record.last > 0) n = std::min(n, std::ceil((record.due - record.moved) / record.last));
    return std::int64_t(std::max(n, 0.0)) + 1;
}

}  // namespace mpm
