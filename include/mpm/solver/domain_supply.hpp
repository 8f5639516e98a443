// Domain: inlets. Layers of particles come in through a face of the domain, each when the water
// before it has moved on by the distance between two layers. The clock halts for it; the particles
// join their body in the sort that follows, and the sums get what they would have deposited.
#pragma once

#include "mpm/solver/domain.hpp"

namespace mpm {

/// Returns false when particles have left the domain and the policy is to stop; the state is then
/// untouched.
template <class X, class T, int D>
bool Domain<X, T, D>::supply() {
    inflow_.begin(clock_);
    const bool sorted = sort();
    if (sorted) {
        const std::vector<Flow> flows = inflow_.take();
        // All ranks know of whole layers; one tells.
        if (!share_ || share_->rank() == 0) flows_.insert(flows_.end(), flows.begin(), flows.end());
        deposit_arrivals();
    }
    inflow_.end();
    return sorted;
}

/// Rows behind those that a body has, and their cells in a table that has their blocks.
template <class X, class T, int D>
void Domain<X, T, D>::append_arrivals(int number, Buffer<X, std::uint32_t>& cell,
                                      const BlockTableView<D>& table) {
    Body& body = bodies_[std::size_t(number)];
    const std::uint32_t more = inflow_.arriving(std::size_t(number));
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
    for (const Arrival& arrival : inflow_.arrivals()) {
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
    for (Arrival& arrival : inflow_.arrivals()) {
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
        Homes<Base> homes;
        Buffer<X, std::uint32_t> count(exec_);
        count.reserve_discard(1);
        homes.add(exec_, table_.slots, count.data(), [&](Buffer<X, std::uint32_t>& flag) {
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

}  // namespace mpm
