// Domain: sorting and the table of blocks.
#pragma once

#include <numeric>

#include "mpm/kernels/home_pairs.hpp"
#include "mpm/kernels/put_before.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

/// Neighbours, boundary flags and room for nodal values of the present table.
template <class X, class T, int D>
void Domain<X, T, D>::link_table() {
    const std::int64_t slots = table_.slots;
    blocks_.link();
    boundaries_.touch(table_);
    if (boundaries_.lists()) {
        const std::size_t nodes = boundaries_.blocks().size() * block_cells;
        const auto any = [&](WallPass pass) { return boundaries_.nodes_of(pass).size() > 0; };
        if (X::is_device || any(WallPass::held) || any(WallPass::all)) {
            wall_velocity_.reserve_discard(nodes * D);
            wall_changed_.reserve_discard(nodes);
        }
        if (any(WallPass::all)) wall_seats_.reserve_discard(nodes * (D + 1));
        if (uplift_.any()) uplift_.list(table_, boundaries_);
    }
    velocity_.reserve_discard(slots * plan_.velocity_channels * block_cells);
    velocity_.zero();
    if (share_) return;  // `link_ranks` does when it is known who counts what
    list_measured();
    list_contacts();
    list_rigid();
}

template <class X, class T, int D>
Homes<typename Domain<X, T, D>::Base> Domain<X, T, D>::find_homes() {
    Homes<Base> homes;
    Buffer<X, std::uint32_t> counts(exec_);
    counts.reserve_discard(bodies_.size());
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        homes.add(exec_, table_.slots, counts.data() + b, [&](Buffer<X, std::uint32_t>& flag) {
            exec_.for_each(table_.slots, FlagHomes{bodies_[b].cell_start.data(), flag.data()});
        });
    }
    homes.count = counts.host();
    return homes;
}

/// Slots that hold particles of any body.
template <class X, class T, int D>
void Domain<X, T, D>::join_homes(const Homes<Base>& homes, Buffer<X, std::uint32_t>& any) {
    const std::int64_t slots = table_.slots;
    any.reserve_discard(slots);
    exec_.copy(any.data(), homes.flag[0].data(), std::size_t(slots) * sizeof(std::uint32_t));
    for (std::size_t b = 1; b < homes.flag.size(); ++b)
        exec_.for_each(slots, JoinHomes{homes.flag[b].data(), any.data()});
}

/// Lists the blocks that hold particles, of each body; on the CPU also by colour, on a device full
/// ones, those beside a cut and heavy ones first. Several devices know by then who shares what.
template <class X, class T, int D>
void Domain<X, T, D>::list_homes(const Homes<Base>& homes) {
    const std::int64_t slots = table_.slots;
    tallies_.stale = true;
    join_homes(homes, blocks_.occupied());
    // Homes and particles of each body on all ranks: what changes bits is decided by these.
    const std::size_t bodies = bodies_.size();
    std::vector<std::uint64_t> all(homes.count.begin(), homes.count.end());
    for (const Body& body : bodies_) all.push_back(body.count);
    sum_of_homes(all);
    bool any_sparse = false;
    for (std::size_t b = 0; b < bodies; ++b) {
        Body& body = bodies_[b];
        const std::uint32_t count = homes.count[b];
        body.homes = body.full_homes = std::int32_t(count);
        body.count_of_all = all[bodies + b];
        body.lone_count = 0;
        body.home.reserve_discard(count);
        const bool sparse = body.ops.lone && body.plan.pipeline == Pipeline::fused &&
                            all[b] >= least_of_sparse &&
                            all[bodies + b] < 4 * least_of_block * all[b];
        any_sparse = any_sparse || sparse;
        if (X::is_device && sparse) {
            list_by_kind(body, homes.position[b]);
        } else {
            exec_.for_each(
                slots, ListHomes{homes.flag[b].data(), homes.position[b].data(), body.home.data()});
        }
        if constexpr (X::is_device) {
            heavy_first(body);
            list_pairs(body, sparse ? least_of_block : 1);
        } else {
            sort_by_colour(body);
        }
    }
    if constexpr (X::is_device) {
        clock_.stray_limit = X::stray_limit(
            std::accumulate(all.begin() + std::ptrdiff_t(bodies), all.end(), std::uint64_t(0)));
        if (any_sparse) {  // else all homes are full
            for (std::size_t b = 0; b < bodies; ++b) all[b] = std::uint64_t(bodies_[b].full_homes);
            all.resize(bodies);
            sum_of_devices(all);
        }
        for (std::size_t b = 0; b < bodies; ++b)
            bodies_[b].all_full_homes = std::int32_t(
                std::min<std::uint64_t>(all[b], std::numeric_limits<std::int32_t>::max()));
    }
}

/// Devices: full homes first; the particles of the others one by one.
template <class X, class T, int D>
void Domain<X, T, D>::list_by_kind(Body& body, const Buffer<X, std::uint32_t>& position) {
    const std::int64_t slots = table_.slots;
    const std::uint32_t* start = body.cell_start.data();
    Buffer<X, std::uint32_t> full(exec_), lone(exec_), full_position(exec_), lone_position(exec_);
    for (auto* flag : {&full, &lone}) flag->reserve_discard(slots);
    for (auto* scan : {&full_position, &lone_position}) scan->reserve_discard(slots + 1);
    exec_.for_each(slots, FlagFull{start, least_of_block, full.data(), lone.data()});
    exec_.exclusive_scan(full.data(), full_position.data(), slots);
    exec_.exclusive_scan(lone.data(), lone_position.data(), slots);
    std::uint32_t full_homes = 0;
    exec_.download(&full_homes, full_position.data() + slots, sizeof full_homes);
    exec_.download(&body.lone_count, lone_position.data() + slots, sizeof body.lone_count);
    body.full_homes = std::int32_t(full_homes);
    body.lone.reserve_discard(body.lone_count);
    body.lone_slot.reserve_discard(body.lone_count);
    exec_.for_each(
        slots, ListByKind{start, position.data(), full_position.data(), lone_position.data(),
                          full_homes, body.home.data(), body.lone.data(), body.lone_slot.data()});
}

/// Devices: with less than a few blocks for every multiprocessor all run at once anyway.
template <class X, class T, int D>
void Domain<X, T, D>::heavy_first(Body& body) {
    if constexpr (X::is_device) {
        if (body.full_homes < 4 * exec_.multiprocessors()) return;
        const std::uint32_t mean = (body.count - body.lone_count) / std::uint32_t(body.full_homes);
        Buffer<X, std::uint32_t> weight(exec_);
        weight.reserve_discard(body.full_homes);
        exec_.for_each(body.full_homes,
                       WeighHomes{body.home.data(), body.cell_start.data(), std::max(mean, 1u),
                                  weight.data(), blocks_.neighbours().data(), Block<D>::neighbours,
                                  share_ ? shared_.data() : nullptr});
        exec_.sort_by_key(weight.data(), body.home.data(), body.full_homes, WeighHomes::bits);
    }
}

/// Devices: full homes two by two, where there are more than run at once. `least`: particles of a
/// full one.
template <class X, class T, int D>
void Domain<X, T, D>::list_pairs(Body& body, std::uint32_t least) {
    body.pairs = 0;
    if constexpr (X::is_device) {
        if (body.order != HomeOrder::by_chunk || !body.ops.pairs ||
            body.full_homes < pairs_from * exec_.multiprocessors())
            return;
        const FullHomes<D> full{body.cell_start.data(), blocks_.neighbours().data(),
                                blocks_.corners().data(), least};
        const std::int64_t homes = body.full_homes;
        Buffer<X, std::uint32_t> flag(exec_), position(exec_);
        flag.reserve_discard(homes);
        position.reserve_discard(homes + 1);
        body.pair.reserve_discard(2 * homes);
        exec_.for_each(homes, FlagPairs<D>{full, body.home.data(), flag.data()});
        exec_.exclusive_scan(flag.data(), position.data(), homes);
        exec_.for_each(homes,
                       ListPairs<D>{full, body.home.data(), position.data(), body.pair.data()});
        std::uint32_t pairs = 0;
        exec_.download(&pairs, position.data() + homes, sizeof pairs);
        body.pairs = std::int32_t(pairs);
    }
}

/// CPU: blocks of one colour share no node.
template <class X, class T, int D>
void Domain<X, T, D>::sort_by_colour(Body& body) {
    // The phased step reaches a whole block further on each side.
    const bool phased = body.plan.pipeline == Pipeline::phased;
    const int apart = phased ? 3 : 2;
    std::vector<std::vector<std::int32_t>> by_colour(phased ? Block<D>::neighbours : 1 << D);
    for (std::int32_t h = 0; h < body.homes; ++h) {
        std::int64_t b[D];
        table_.keys_of.block(table_.keys[body.home.data()[h]], b);
        int colour = 0;
        for (int a = 0; a < D; ++a)
            colour = colour * apart + int((b[a] + BlockKeys<D>::rim) % apart);
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

/// Particles of a body that are outside, as they are stored.
template <class X, class T, int D>
std::vector<Leaver<D>> Domain<X, T, D>::list_left(const Body& body, std::uint32_t count,
                                                  const Buffer<X, std::uint32_t>& cell) {
    Buffer<X, std::uint32_t> found(exec_);
    Buffer<X, Leaver<D>> list(exec_);
    found.assign({0});
    list.reserve_discard(count);
    using List = ListLeavers<X, T, D>;
    exec_.for_each(
        std::int64_t(body.homes) * List::lanes,
        List{table_, body.view(), spec_.cell_size, cell.data(), found.data(), list.data()});
    auto out = list.host();
    std::sort(out.begin(), out.end(),
              [](const auto& a, const auto& b) { return a.place < b.place; });
    return out;
}

/// The fault of a run that particles of a body, `who`, have left. Returns false.
template <class X, class T, int D>
bool Domain<X, T, D>::stop_for_left(const Body& body, const std::vector<std::uint64_t>& ids,
                                    const std::string& who, const std::string& why) {
    fault_ = Fault{"left-domain",
                   body.plan.name,
                   ids,
                   clock_.step,
                   clock_.time,
                   double(ids.size()),
                   clock_.speed,
                   growth_start(clock_),
                   std::to_string(ids.size()) + " " + who + " left the domain, the first at step " +
                       std::to_string(clock_.step) + why};
    return false;
}

/// Takes particles that have left out of the computation: through outlets, and elsewhere as the
/// policy has it. Returns false when the policy is to stop; nothing has changed then.
template <class X, class T, int D>
bool Domain<X, T, D>::remove_left(const std::vector<std::uint32_t>& left,
                                  const std::vector<Buffer<X, std::uint32_t>>& cells) {
    using Way = typename Outflow<D>::Way;
    std::vector<Way> ways;
    std::vector<std::array<double, 2>> mass_and_volume;
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        mass_and_volume.push_back({body.particle_mass, body.particle_volume});
        if (left[b] == 0) continue;
        const std::vector<Leaver<D>> leavers = list_left(body, left[b], cells[b]);
        if (body.mesh || body.rigid >= 0) {  // stays whole, whatever the policy
            std::vector<std::uint64_t> ids;
            for (const Leaver<D>& who : leavers) ids.push_back(body.first_id + who.id);
            return body.mesh ? stop_for_left(body, ids, "vertices",
                                             "; a body of elements stays whole, so that no policy "
                                             "takes them out")
                             : stop_for_left(body, ids, "particles of a rigid body",
                                             "; it stays whole, so that no policy takes them out");
        }
        for (Way& way : outflow_.ways(int(b), body.first_id, clock_.step, leavers))
            ways.push_back(std::move(way));
        const auto& ids = ways.back().removed.ids;
        if (outflow_.stops() && !ids.empty()) return stop_for_left(body, ids, "particles");
    }
    for (const Way& way : ways) {
        if (!outflow_.freezes(way) || way.id.empty()) continue;
        Body& body = bodies_[std::size_t(way.removed.body)];
        const auto& position = way.removed.position.data;
        std::vector<std::vector<T>> state;
        for (auto& s : body.state) state.push_back(s.host(body.count));
        body.frozen_id.insert(body.frozen_id.end(), way.id.begin(), way.id.end());
        body.frozen_position.insert(body.frozen_position.end(), position.begin(), position.end());
        for (std::uint32_t p : way.place)
            for (auto& s : state) body.frozen_state.push_back(double(s[p]));
    }
    for (const Flow& flow :
         outflow_.take(std::move(ways), clock_.time, clock_.step, mass_and_volume))
        flows_.push_back(flow);
    return true;
}

/// Sums follow their blocks into a new table, which then is the table.
template <class X, class T, int D>
void Domain<X, T, D>::adopt_table(Buffer<X, std::uint64_t>& keys) {
    const auto new_slots = std::int32_t(keys.size());
    const std::size_t size = std::size_t(new_slots) * plan_.sum_channels * block_cells;
    const int reading = parity();
    // A larger grid asks for memory of sizes that fit nothing that is free: what is gives way
    // first, and what the grid has outgrown afterwards.
    const bool grows = size * sizeof(Sum) > sums_[reading].bytes();
    if (grows) exec_.trim();
    Buffer<X, std::int32_t> map(exec_);
    blocks_.slots_of(keys, map);
    // The other set holds nothing between steps.
    sums_[1 - reading].reserve_discard(size);
    exec_.for_each(std::int64_t(new_slots) * block_cells,
                   MoveSums<Sum>{sums_[reading].data(), sums_[1 - reading].data(), map.data(),
                                 plan_.sum_channels});
    sums_[0].swap(sums_[1]);
    sums_[1 - reading].reserve_discard(size);
    blocks_.adopt(keys);
    ++tables_;
    link_table();
    if (grows) exec_.trim();
}

/// Columns of a body into their new order.
template <class X, class T, int D>
void Domain<X, T, D>::permute(Body& body, const std::uint32_t* order) {
    std::vector<Buffer<X, T>*> columns;
    for (auto& c : body.offset) columns.push_back(&c);
    for (auto& c : body.state) columns.push_back(&c);
    const std::size_t together = std::size_t(permuted_together(body.count));
    std::vector<Buffer<X, T>> spare;
    for (std::size_t k = 0; k < together; ++k) spare.emplace_back(exec_);
    for (std::size_t first = 0; first < columns.size(); first += together) {
        Permute<T> p{order, {}, {}, 0, 0, int(first), body.home_moves()};
        for (std::size_t c = first; c < std::min(first + together, columns.size()); ++c) {
            spare[c - first].reserve_discard(columns[c]->size());
            p.from[p.columns] = columns[c]->data();
            p.to[p.columns] = spare[c - first].data();
            ++p.columns;
            p.offsets += c < std::size_t(D);
        }
        exec_.for_each(body.count, p);
        for (int c = 0; c < p.columns; ++c) columns[first + c]->swap(spare[c]);
    }
    spare.clear();
    Buffer<X, std::uint32_t> ids(exec_);
    ids.reserve_discard(body.id.size());
    exec_.for_each(body.count, Take<std::uint32_t>{order, body.id.data(), ids.data()});
    body.id.swap(ids);
    body.moves = Buffer<X, std::uint8_t>(exec_);
    body.looks_ahead = false;
}

/// Into which cell of the present table each particle of a body is to be sorted.
template <class X, class T, int D>
void Domain<X, T, D>::find_cells(Body& body, std::uint32_t* occupied, std::uint32_t* cell,
                                 std::uint32_t* left) {
    // A solid may be held where it reaches into a bed.
    if (boundaries_.has_linear_surfaces() && body.material->volumetric) {
        const PutBeforeSurfaces<X, T, D> put{table_, body.view(), boundaries_.view(),
                                             boundaries_.touched().data()};
        exec_.for_each(std::int64_t(body.homes) * put.lanes, put);
    }
    FindCells<X, T, D> find{table_, body.view(), {}, occupied, cell, left};
    for (int a = 0; a < D; ++a) find.cells[a] = std::int32_t(spec_.cells[a]);
    body.moves = Buffer<X, std::uint8_t>(exec_);
    body.looks_ahead = clock_.ahead > 0;
    if (body.looks_ahead) {
        body.moves.reserve_discard(body.count);
        find.moves = body.moves.data();
        find.velocity = velocity_.data();
        find.velocity_channels = plan_.velocity_channels;
        // Finite where all are nearly at rest.
        find.time = T(std::min(clock_.ahead / clock_.speed, double(std::numeric_limits<T>::max())));
        find.ahead = T(clock_.ahead);
    }
    exec_.for_each(std::int64_t(body.homes) * find.lanes, find);
}

/// All particles stand in their cells again. True: the state is that of a sort.
template <class X, class T, int D>
bool Domain<X, T, D>::end_of_sort(double began) {
    clock_.drift = clock_.ahead;
    clock_.strays = 0;
    ++sorts_;
    sort_interval_ = clock_.step - last_sort_;
    last_sort_ = clock_.step;
    timings_["sort"] += now() - began;
    return true;
}

/// Returns false when particles have left the domain and the policy is to stop; the state is then
/// untouched.
template <class X, class T, int D>
bool Domain<X, T, D>::sort() {
    if constexpr (X::is_device) {
        if (share_) return sort_among_devices();
    } else {
        if (share_) return sort_among_ranks();
    }
    const double began = now();
    const std::int64_t slots = table_.slots;
    // Per body: particles that have left, homes; then whether the table lacks a block.
    const std::size_t bodies = bodies_.size();
    Buffer<X, std::uint32_t> occupied(exec_), counts(exec_);
    counts.reserve_discard(2 * bodies + 1);
    counts.zero();
    Homes<Base> homes;
    std::vector<Buffer<X, std::uint32_t>> cells;
    for (std::size_t b = 0; b < bodies; ++b) {
        Body& body = bodies_[b];
        cells.emplace_back(exec_);
        const std::size_t rows = std::size_t(body.count) + inflow_.arriving(b);
        cells.back().reserve_discard(rows + column_padding);
        cells.back().shrink(rows);
        homes.add(exec_, table_.slots, counts.data() + 2 * b + 1,
                  [&](Buffer<X, std::uint32_t>& flag) {
                      flag.zero();
                      find_cells(body, flag.data(), cells.back().data(), counts.data() + 2 * b);
                  });
    }
    join_homes(homes, occupied);
    Buffer<X, std::uint64_t> keys_to_come(exec_);
    if (inflow_.arrives()) inflow_.mark(table_, occupied, counts.data() + 2 * bodies, keys_to_come);
    exec_.for_each(slots, FindNewHomes<X>{occupied.data(), blocks_.occupied().data(),
                                          counts.data() + 2 * bodies});
    const auto counted = counts.host();
    std::vector<std::uint32_t> left;
    for (std::size_t b = 0; b < bodies; ++b) {
        left.push_back(counted[2 * b]);
        homes.count.push_back(counted[2 * b + 1]);
    }
    if (!remove_left(left, cells)) return false;
    // A table that still has all it needs is kept for a while, with the blocks that emptied.
    const bool rebuild = counted.back() != 0 || ++sorts_of_table_ >= 16;
    Buffer<X, std::uint64_t> keys(exec_);
    Buffer<X, std::int32_t> map(exec_);
    if (rebuild) blocks_.rebuild(occupied, keys_to_come, keys, map);
    const std::int64_t range = (rebuild ? std::int64_t(keys.size()) : slots) * block_cells;

    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        if (rebuild || left[b] > 0) {
            exec_.for_each(body.count,
                           RenumberCells{cells[b].data(), rebuild ? map.data() : nullptr,
                                         std::uint32_t(slots * block_cells), std::uint32_t(range)});
        }
        if (inflow_.arriving(b) > 0) {
            append_arrivals(int(b), cells[b], rebuild ? blocks_.view_of(keys) : table_);
        }
        body.cell_start.reserve_discard(range + 2);
        arrange(exec_, cells[b], range, body.id.data(), body.cell_start.data(), body.cell.data(),
                body.order);
        body.count -= left[b];
        permute(body, cells[b].data());
        cells[b] = Buffer<X, std::uint32_t>(exec_);
    }
    if (rebuild) {
        adopt_table(keys);
        sorts_of_table_ = 0;
    }
    if (rebuild || inflow_.arrives()) homes = find_homes();
    list_homes(homes);
    return end_of_sort(began);
}

}  // namespace mpm
