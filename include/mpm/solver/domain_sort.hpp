// Domain: sorting and the table of blocks.
#pragma once

#include "mpm/solver/domain.hpp"

namespace mpm {

/// Neighbours, boundary flags and room for nodal values of the present table.
template <class X, class T, int D>
void Domain<X, T, D>::link_table() {
    const std::int64_t slots = table_.slots;
    neighbours_.reserve_discard(slots * Block<D>::neighbours);
    exec_.for_each(slots * Block<D>::neighbours, LinkBlocks<D>{table_, neighbours_.data()});
    table_.neighbours = neighbours_.data();
    touched_.reserve_discard(slots);
    exec_.for_each(slots, TouchBoundaries<D>{table_, boundary_records_.data(),
                                             int(spec_.boundaries.size()), touched_.data()});
    velocity_.reserve_discard(slots * plan_.velocity_channels * block_cells);
    velocity_.zero();
    if (load_count_ > 0) {
        measured_.reserve_discard(slots);
        exec_.for_each(slots, TouchBoundaries<D>{table_, measured_boundaries_.data(),
                                                 measured_boundary_count_, measured_.data()});
        Buffer<X, std::uint32_t> position(exec_);
        position.reserve_discard(slots + 1);
        exec_.exclusive_scan(measured_.data(), position.data(), slots);
        std::uint32_t n = 0;
        exec_.download(&n, position.data() + slots, sizeof n);
        measured_count_ = std::int32_t(n);
        measured_slots_.reserve_discard(n);
        exec_.for_each(slots, ListHomes{measured_.data(), position.data(), measured_slots_.data()});
        load_partial_.reserve_discard(std::size_t(n) * load_count_ * load_columns<D>);
        exec_.wait();
    }
}

/// Blocks of the body that hold particles; on the CPU also by colour.
template <class X, class T, int D>
void Domain<X, T, D>::list_homes(Body& body) {
    const std::int64_t slots = table_.slots;
    Buffer<X, std::uint32_t> flag(exec_), position(exec_);
    flag.reserve_discard(slots);
    position.reserve_discard(slots + 1);
    exec_.for_each(slots, FlagHomes{body.cell_start.data(), flag.data()});
    exec_.exclusive_scan(flag.data(), position.data(), slots);
    std::uint32_t n = 0;
    exec_.download(&n, position.data() + slots, sizeof n);
    body.homes = std::int32_t(n);
    body.home.reserve_discard(n);
    exec_.for_each(slots, ListHomes{flag.data(), position.data(), body.home.data()});
    exec_.wait();
    if constexpr (!X::is_device) {
        std::vector<std::vector<std::int32_t>> by_colour(1 << D);
        for (std::int32_t h = 0; h < body.homes; ++h) {
            std::int64_t b[D];
            table_.keys_of.block(table_.keys[body.home.data()[h]], b);
            int colour = 0;
            for (int a = 0; a < D; ++a) colour = colour * 2 + int(b[a] & 1);
            by_colour[colour].push_back(body.home.data()[h]);
        }
        std::vector<std::int32_t> all;
        body.colour_start.assign(1, 0);
        for (auto& list : by_colour) {
            all.insert(all.end(), list.begin(), list.end());
            body.colour_start.push_back(std::int32_t(all.size()));
        }
        body.coloured.assign(all);
    }
}

/// Returns false when particles have left the domain and the policy is to stop; the state is then
/// untouched.
template <class X, class T, int D>
bool Domain<X, T, D>::sort() {
    const double began = now();
    const std::int64_t slots = table_.slots;
    Buffer<X, std::uint32_t> occupied(exec_), position(exec_), left(exec_);
    occupied.reserve_discard(slots);
    occupied.zero();
    left.assign(std::vector<std::uint32_t>(bodies_.size(), 0));
    std::vector<Buffer<X, std::uint32_t>> cells;
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        cells.emplace_back(exec_);
        cells.back().reserve_discard(body.count);
        FindCells<X, T, D> find{table_,          body.view(),         {},
                                occupied.data(), cells.back().data(), left.data() + b};
        for (int a = 0; a < D; ++a) find.cells[a] = spec_.cells[a];
        exec_.for_each(slots * block_cells, find);
    }
    const auto left_host = left.host();
    std::uint32_t all_left = 0;
    for (auto n : left_host) all_left += n;
    if (all_left > 0) {
        for (std::size_t b = 0; b < bodies_.size(); ++b) {
            if (left_host[b] == 0) continue;
            Body& body = bodies_[b];
            const auto cell = cells[b].host();
            const auto id = body.id.host();
            Removed r;
            r.body = int(b);
            r.step = clock_.step;
            r.policy = spec_.leaving == Leaving::freeze
                           ? "freeze"
                           : (spec_.leaving == Leaving::remove ? "delete" : "stop");
            std::vector<std::size_t> rows;
            for (std::size_t k = 0; k < body.count; ++k)
                if (cell[k] == ~0u) rows.push_back(k);
            const Array where = positions(body);
            for (std::size_t k : rows) {
                r.ids.push_back(body.first_id + id[k]);
                for (int a = 0; a < D; ++a) r.position.data.push_back(where.data[k * D + a]);
            }
            r.position.shape = {rows.size(), std::size_t(D)};
            if (spec_.leaving == Leaving::stop) {
                fault_ = Fault{"left-domain",
                               body.plan.name,
                               r.ids,
                               clock_.step,
                               clock_.time,
                               double(r.ids.size()),
                               clock_.speed,
                               growth_start(),
                               std::to_string(r.ids.size()) +
                                   " particles left the domain, the first at step " +
                                   std::to_string(clock_.step)};
                return false;
            }
            if (spec_.leaving == Leaving::freeze) {
                std::vector<std::vector<T>> state;
                for (auto& s : body.state) state.push_back(s.host());
                for (std::size_t n = 0; n < rows.size(); ++n) {
                    body.frozen_id.push_back(id[rows[n]]);
                    for (int a = 0; a < D; ++a)
                        body.frozen_position.push_back(r.position.data[n * D + a]);
                    for (auto& s : state) body.frozen_state.push_back(double(s[rows[n]]));
                }
            }
            removed_.push_back(std::move(r));
        }
    }

    // The new table: occupied blocks and all their neighbours.
    position.reserve_discard(slots + 1);
    exec_.exclusive_scan(occupied.data(), position.data(), slots);
    std::uint32_t homes = 0;
    exec_.download(&homes, position.data() + slots, sizeof homes);
    Buffer<X, std::uint64_t> keys(exec_);
    keys.reserve_discard(std::size_t(homes) * Block<D>::neighbours);
    exec_.for_each(slots * Block<D>::neighbours,
                   ListNeighbours<D>{table_.keys_of, keys_.data(), position.data(), occupied.data(),
                                     keys.data()});
    const auto new_slots =
        std::int32_t(exec_.sort_unique(keys.data(), std::int64_t(homes) * Block<D>::neighbours));
    keys.shrink(new_slots);
    if (std::int64_t(new_slots) * block_cells >= std::int64_t(~0u)) {
        throw CapacityError(
            "the scene needs " + std::to_string(new_slots) +
            " blocks of 64 cells; one device holds at most 67108863. Use a larger cell_size");
    }
    Buffer<X, std::int32_t> map(exec_);
    map.reserve_discard(slots);
    exec_.for_each(slots, MapSlots{keys_.data(), keys.data(), new_slots, map.data()});

    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        const std::int64_t n = body.count, range = std::int64_t(new_slots) * block_cells;
        exec_.for_each(n, RenumberCells{cells[b].data(), map.data(), std::uint32_t(range)});
        Buffer<X, std::uint32_t> order(exec_);
        order.reserve_discard(n);
        body.cell_start.reserve_discard(range + 2);
        exec_.stable_order(cells[b].data(), n, range + 1, order.data(), body.cell_start.data());
        body.count -= left_host[b];
        const std::int64_t kept = body.count;
        Buffer<X, T> spare(exec_);
        for (auto& column : body.offset) {
            spare.reserve_discard(column.size());
            exec_.for_each(kept, PermuteOffset<T>{order.data(), column.data(), spare.data()});
            column.swap(spare);
        }
        for (auto& column : body.state) {
            spare.reserve_discard(column.size());
            exec_.for_each(kept, Permute<T>{order.data(), column.data(), spare.data()});
            column.swap(spare);
        }
        Buffer<X, std::uint32_t> ids(exec_);
        ids.reserve_discard(body.id.size());
        exec_.for_each(kept, Permute<std::uint32_t>{order.data(), body.id.data(), ids.data()});
        body.id.swap(ids);
        exec_.wait();
    }

    const int now_reading = parity();
    Buffer<X, Sum> moved(exec_);
    moved.reserve_discard(std::size_t(new_slots) * plan_.sum_channels * block_cells);
    map.reserve_discard(new_slots);
    exec_.for_each(new_slots, MapSlots{keys.data(), keys_.data(), std::int32_t(slots), map.data()});
    exec_.for_each(
        std::int64_t(new_slots) * block_cells,
        MoveSums<Sum>{sums_[now_reading].data(), moved.data(), map.data(), plan_.sum_channels});
    sums_[now_reading].swap(moved);
    sums_[1 - now_reading].reserve_discard(std::size_t(new_slots) * plan_.sum_channels *
                                           block_cells);
    exec_.wait();

    keys_.swap(keys);
    table_.keys = keys_.data();
    table_.slots = new_slots;
    link_table();
    for (auto& body : bodies_) list_homes(body);
    clock_.drift = 0;
    ++sorts_;
    timings_["sort"] += now() - began;
    return true;
}

}  // namespace mpm
