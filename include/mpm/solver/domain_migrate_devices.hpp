// Domain: the sort of one rank of several on devices. Particles go to the rank that owns the block
// they are in now; those who go travel by way of the host, those who stay do not leave the device.
// Within a cell the order is that of the ids, whoever they come from.
#pragma once

#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_scene.hpp"

namespace mpm {

/// Which rank owns each block of a table.
template <int D>
struct FindOwners {
    BlockTableView<D> table;
    int axis, bits, cuts;
    std::uint64_t cut[most_devices];  // where each rank but the first begins
    std::int32_t* owner;
    MPM_INLINE void operator()(std::int64_t slot) const {
        const std::uint64_t place = place_in_row(table.keys_of, table.keys[slot], axis, bits);
        int r = 0;
        while (r < cuts && cut[r] <= place) ++r;
        owner[slot] = r;
    }
};

/// Only what is this rank's.
struct KeepOwned {
    const std::int32_t* owner;
    std::int32_t me;
    std::uint32_t* flag;
    MPM_INLINE void operator()(std::int64_t slot) const {
        if (owner[slot] != me) flag[slot] = 0;
    }
};

/// How many particles stand in blocks of each other rank.
template <class X>
struct CountEmigrants {
    const std::uint32_t* cell;
    const std::int32_t* owner;
    std::int32_t me;
    std::uint32_t* count;  // (ranks,)
    MPM_INLINE void operator()(std::int64_t p) const {
        if (cell[p] == ~0u) return;
        const std::int32_t r = owner[cell[p] / block_cells];
        if (r != me) X::fetch_add(count + r, 1);
    }
};
/// Lists them, by rank, and takes them out.
template <class X>
struct ListEmigrants {
    std::uint32_t* cell;
    const std::int32_t* owner;
    std::int32_t me;
    std::uint32_t* next;  // (ranks,)
    std::uint32_t* place;
    std::uint32_t* to;  // the cell it stands in
    MPM_INLINE void operator()(std::int64_t p) const {
        const std::uint32_t c = cell[p];
        if (c == ~0u) return;
        const std::int32_t r = owner[c / block_cells];
        if (r == me) return;
        const std::uint32_t k = X::fetch_add(next + r, 1);
        place[k] = std::uint32_t(p);
        to[k] = c;
        cell[p] = ~0u;
    }
};
struct KeysOfCells {
    const std::uint64_t* keys;
    const std::uint32_t* cell;
    std::uint64_t* out;
    MPM_INLINE void operator()(std::int64_t k) const { out[k] = keys[cell[k] / block_cells]; }
};

/// Sums of chosen blocks into one piece, and back.
template <class Sum>
struct PackBlocks {
    const Sum* sums;
    const std::int32_t* slot;
    std::int64_t size;  // of a block
    Sum* out;
    MPM_INLINE void operator()(std::int64_t i) const {
        out[i] = sums[slot[i / size] * size + i % size];
    }
};
template <class Sum>
struct UnpackBlocks {
    Sum* sums;
    const std::int32_t* slot;
    std::int64_t size;
    const Sum* in;
    MPM_INLINE void operator()(std::int64_t i) const {
        sums[slot[i / size] * size + i % size] = in[i];
    }
};

/// Adds the particles of each slot.
struct AddLoad {
    const std::uint32_t* cell_start;
    std::uint32_t* load;
    MPM_INLINE void operator()(std::int64_t slot) const {
        load[slot] += cell_start[(slot + 1) * block_cells] - cell_start[slot * block_cells];
    }
};

/// As `rebalance`, by where particles were at the last sort: that costs nothing where all is even.
template <class X, class T, int D>
void Domain<X, T, D>::rebalance_devices(const std::vector<std::uint32_t>& left) {
    RankShare<D>& s = *share_;
    std::uint64_t own = 0;
    for (std::size_t b = 0; b < bodies_.size(); ++b)
        own += bodies_[b].count - left[b] + weight_of_block * std::uint64_t(bodies_[b].homes);
    s.loads.clear();
    for (const auto& theirs : s.comm->all_gather(std::vector<std::uint64_t>{own}))
        s.loads.push_back(theirs.at(0));
    const double was = imbalance(s.loads);
    if (was <= s.rebalance_above) return;
    Buffer<X, std::uint32_t> load(exec_);
    load.reserve_discard(std::size_t(table_.slots));
    load.zero();
    for (const Body& body : bodies_)
        exec_.for_each(table_.slots, AddLoad{body.cell_start.data(), load.data()});
    const auto loads = load.host();
    const auto& keys = s.keys[std::size_t(s.rank())];
    std::vector<BlockWeight> blocks;
    for (std::size_t k = 0; k < loads.size(); ++k)
        if (loads[k] > 0) blocks.push_back({keys[k], loads[k] + weight_of_block});
    deal_anew(blocks, was);
}

/// Those of others out, and in. In `cells` they are as particles that have left.
template <class X, class T, int D>
std::vector<detail::Emigrants<T>> Domain<X, T, D>::exchange_emigrants(
    std::vector<Buffer<X, std::uint32_t>>& cells, const Buffer<X, std::int32_t>& owner) {
    RankShare<D>& s = *share_;
    const int me = s.rank();
    const std::size_t ranks = std::size_t(s.ranks()), bodies = bodies_.size();
    Buffer<X, std::uint32_t> counts(exec_);
    counts.assign(std::vector<std::uint32_t>(ranks * bodies, 0));
    for (std::size_t b = 0; b < bodies; ++b) {
        exec_.for_each(bodies_[b].count, CountEmigrants<X>{cells[b].data(), owner.data(), me,
                                                           counts.data() + b * ranks});
    }
    const auto counted = counts.host();
    std::vector<Packer> packers(ranks);
    for (std::size_t b = 0; b < bodies; ++b) {
        const Body& body = bodies_[b];
        std::vector<std::uint32_t> first(ranks + 1, 0);
        for (std::size_t r = 0; r < ranks; ++r) first[r + 1] = first[r] + counted[b * ranks + r];
        const std::size_t all = first[ranks];
        std::vector<std::uint64_t> key(all);
        std::vector<std::uint32_t> to(all), id(all);
        std::vector<std::vector<T>> columns;
        if (all > 0) {
            Buffer<X, std::uint32_t> next(exec_), place(exec_), cell(exec_), number(exec_);
            Buffer<X, std::uint64_t> keys(exec_);
            Buffer<X, T> row(exec_);
            next.assign(std::vector<std::uint32_t>(first.begin(), first.end() - 1));
            for (auto* list : {&place, &cell, &number}) list->reserve_discard(all);
            keys.reserve_discard(all);
            row.reserve_discard(all);
            exec_.for_each(body.count, ListEmigrants<X>{cells[b].data(), owner.data(), me,
                                                        next.data(), place.data(), cell.data()});
            const std::int64_t n = std::int64_t(all);
            exec_.for_each(n, KeysOfCells{table_.keys, cell.data(), keys.data()});
            exec_.for_each(n, Take<std::uint32_t>{place.data(), body.id.data(), number.data()});
            key = keys.host();
            to = cell.host();
            id = number.host();
            const auto take = [&](const Buffer<X, T>& column) {
                exec_.for_each(n, Take<T>{place.data(), column.data(), row.data()});
                columns.push_back(row.host());
            };
            for (const auto& column : body.offset) take(column);
            for (const auto& column : body.state) take(column);
            s.migrated += all;
        } else {
            columns.resize(body.offset.size() + body.state.size());
        }
        for (std::size_t r = 0; r < ranks; ++r) {
            if (int(r) == me) continue;
            detail::Emigrants<T> go;
            const auto part = [&](const auto& list) {
                return std::decay_t<decltype(list)>(list.begin() + first[r],
                                                    list.begin() + first[r + 1]);
            };
            go.to = part(key);
            go.cell = part(to);
            for (std::uint32_t& c : go.cell) c %= block_cells;
            go.id = part(id);
            for (const auto& column : columns) go.column.push_back(part(column));
            go.pack(packers[r]);
        }
    }
    std::vector<Bytes> out;
    for (Packer& packer : packers) out.push_back(packer.take());
    const auto in = s.comm->exchange(std::move(out), s.comm->others());
    std::vector<detail::Emigrants<T>> come(bodies);
    for (int r : s.comm->others()) {
        Unpacker unpacker(in[std::size_t(r)]);
        for (std::size_t b = 0; b < bodies; ++b)
            come[b].unpack(unpacker, bodies_[b].offset.size() + bodies_[b].state.size());
    }
    return come;
}

/// The present table's sums into the new one, `keys`, with those of blocks that only others held.
template <class X, class T, int D>
void Domain<X, T, D>::exchange_sums(Buffer<X, std::uint64_t>& keys,
                                    const std::vector<std::vector<std::uint64_t>>& after) {
    const RankShare<D>& s = *share_;
    const int me = s.rank(), ranks = s.ranks();
    const std::int64_t block = std::int64_t(plan_.sum_channels) * block_cells;
    // Blocks of a rank's new table that it did not hold, and of these those whose sums one rank
    // hands on: whoever holds a block has all of them, and the first who does tells.
    const auto told_by = [&](int r, int by) {
        std::vector<std::uint64_t> fresh, told;
        std::set_difference(after[std::size_t(r)].begin(), after[std::size_t(r)].end(),
                            s.keys[std::size_t(r)].begin(), s.keys[std::size_t(r)].end(),
                            std::back_inserter(fresh));
        for (std::uint64_t key : fresh) {
            for (int p = 0; p < ranks; ++p) {
                if (!detail::holds(s.keys[std::size_t(p)], key)) continue;
                if (p == by) told.push_back(key);
                break;
            }
        }
        return told;
    };
    const auto slots_of = [](const std::vector<std::uint64_t>& some,
                             const std::vector<std::uint64_t>& all) {
        std::vector<std::int32_t> slots;
        for (std::uint64_t key : some)
            slots.push_back(
                std::int32_t(std::lower_bound(all.begin(), all.end(), key) - all.begin()));
        return slots;
    };
    std::vector<Bytes> out(std::size_t(ranks), Bytes{});
    for (int r : s.comm->others()) {
        const auto told = told_by(r, me);
        if (told.empty()) continue;
        Buffer<X, std::int32_t> slots(exec_);
        Buffer<X, Sum> piece(exec_);
        slots.assign(slots_of(told, s.keys[std::size_t(me)]));
        const std::int64_t n = std::int64_t(told.size()) * block;
        piece.reserve_discard(std::size_t(n));
        exec_.for_each(n,
                       PackBlocks<Sum>{sums_[parity()].data(), slots.data(), block, piece.data()});
        Bytes& bytes = out[std::size_t(r)];
        bytes.resize(std::size_t(n) * sizeof(Sum));
        exec_.download(bytes.data(), piece.data(), bytes.size());
    }
    const auto in = s.comm->exchange(std::move(out), s.comm->others());
    adopt_table(keys);
    for (int r : s.comm->others()) {
        const auto told = told_by(me, r);
        const Bytes& bytes = in[std::size_t(r)];
        const std::int64_t n = std::int64_t(told.size()) * block;
        if (bytes.size() != std::size_t(n) * sizeof(Sum))
            throw Error("sums of " + std::to_string(told.size()) + " blocks were due from rank " +
                        std::to_string(r) + " and " + std::to_string(bytes.size()) +
                        " bytes have come");
        if (told.empty()) continue;
        Buffer<X, std::int32_t> slots(exec_);
        Buffer<X, Sum> piece(exec_);
        slots.assign(slots_of(told, after[std::size_t(me)]));
        piece.reserve_discard(std::size_t(n));
        exec_.upload(piece.data(), bytes.data(), bytes.size());
        exec_.for_each(
            n, UnpackBlocks<Sum>{sums_[parity()].data(), slots.data(), block, piece.data()});
    }
}

template <class X, class T, int D>
bool Domain<X, T, D>::sort_among_devices() {
    const double began = now();
    RankShare<D>& s = *share_;
    const int me = s.rank();
    const std::int64_t slots = table_.slots;
    const std::size_t bodies = bodies_.size();
    Buffer<X, std::uint32_t> occupied(exec_), counts(exec_);
    occupied.reserve_discard(std::size_t(slots));
    occupied.zero();
    counts.assign(std::vector<std::uint32_t>(bodies, 0));
    std::vector<Buffer<X, std::uint32_t>> cells;
    for (std::size_t b = 0; b < bodies; ++b) {
        Body& body = bodies_[b];
        auto& cell = cells.emplace_back(exec_);
        cell.reserve_discard(std::size_t(body.count) + column_padding);
        cell.shrink(body.count);
        FindCells<X, T, D> find{table_,          body.view(), {},
                                occupied.data(), cell.data(), counts.data() + b};
        for (int a = 0; a < D; ++a) find.cells[a] = std::int32_t(spec_.cells[a]);
        exec_.for_each(std::int64_t(body.homes) * find.lanes, find);
    }
    const auto left = counts.host();
    if (anyone_stops(left, cells)) return false;
    remove_left(left, cells);

    rebalance_devices(left);
    Buffer<X, std::int32_t> owner(exec_);
    owner.reserve_discard(std::size_t(slots));
    FindOwners<D> owners{
        table_, s.partition.axis(), s.partition.bits(), int(s.partition.cuts().size()),
        {},     owner.data()};
    std::copy(s.partition.cuts().begin(), s.partition.cuts().end(), owners.cut);
    exec_.for_each(slots, owners);
    exec_.for_each(slots, KeepOwned{owner.data(), me, occupied.data()});
    const auto come = exchange_emigrants(cells, owner);

    // The table of the blocks that this rank now has particles in.
    std::vector<std::uint64_t> more;
    for (const auto& c : come) more.insert(more.end(), c.to.begin(), c.to.end());
    keep_own_arrivals(more);
    std::sort(more.begin(), more.end());
    more.erase(std::unique(more.begin(), more.end()), more.end());
    Buffer<X, std::uint64_t> more_keys(exec_), keys(exec_);
    Buffer<X, std::int32_t> map(exec_);
    more_keys.assign(more);
    rebuild_table(occupied, more_keys, keys, map);
    auto after = s.comm->all_gather(keys.host());
    BlockTableView<D> table = table_;
    table.keys = keys.data();
    table.slots = std::int32_t(keys.size());
    for (std::size_t b = 0; b < bodies; ++b) {
        admit_arrived(int(b), come[b], cells[b], map, table, after[std::size_t(me)]);
        cells[b] = Buffer<X, std::uint32_t>(exec_);
    }
    exchange_sums(keys, after);
    list_homes(find_homes());
    link_ranks(std::move(after));
    link_sums();
    meet_hosts();
    clock_.drift = 0;
    clock_.strays = 0;
    ++sorts_;
    sort_interval_ = clock_.step - last_sort_;
    last_sort_ = clock_.step;
    timings_["sort"] += now() - began;
    return true;
}

/// Particles that stay, those that came from other ranks and those of inlets, into the order of the
/// cells of the new table.
template <class X, class T, int D>
void Domain<X, T, D>::admit_arrived(int number, const detail::Emigrants<T>& come,
                                    Buffer<X, std::uint32_t>& cell,
                                    const Buffer<X, std::int32_t>& map,
                                    const BlockTableView<D>& table,
                                    const std::vector<std::uint64_t>& keys) {
    Body& body = bodies_[std::size_t(number)];
    const std::uint32_t before = body.count, more = std::uint32_t(come.id.size());
    const std::int64_t range = std::int64_t(table.slots) * block_cells;
    exec_.for_each(before, RenumberCells{cell.data(), map.data(), std::uint32_t(range)});
    const std::uint32_t supplied = arriving(std::size_t(number));
    const std::size_t rows = std::size_t(before) + more + supplied;
    if (rows + column_padding >= (std::size_t(1) << 32) - 256)
        throw CapacityError("body '" + body.plan.name +
                            "' has more than 4294967039 particles on "
                            "one rank; split it into several bodies");
    if (rows > before) {
        Buffer<X, std::uint32_t> larger(exec_);
        larger.reserve_discard(rows + column_padding);
        larger.shrink(rows);
        exec_.copy(larger.data(), cell.data(), before * sizeof(std::uint32_t));
        cell.swap(larger);
        const auto append = [&]<class E>(Buffer<X, E>& column, const std::vector<E>& tail) {
            const std::size_t needed = rows + column_padding;
            if (needed > column.size()) {
                Buffer<X, E> wider(exec_);
                wider.reserve_discard(needed + needed / 32);
                exec_.copy(wider.data(), column.data(), before * sizeof(E));
                column.swap(wider);
            }
            if (more > 0) exec_.upload(column.data() + before, tail.data(), more * sizeof(E));
        };
        std::size_t c = 0;
        for (auto& column : body.offset) append(column, come.column[c++]);
        for (auto& column : body.state) append(column, come.column[c++]);
        append(body.id, come.id);
        if constexpr (X::is_device) body.cell.reserve_discard(body.id.size());
        std::vector<std::uint32_t> to(more);
        for (std::uint32_t k = 0; k < more; ++k) {
            const auto slot = std::lower_bound(keys.begin(), keys.end(), come.to[k]) - keys.begin();
            to[k] = std::uint32_t(slot) * block_cells + come.cell[k];
        }
        if (more > 0) exec_.upload(cell.data() + before, to.data(), more * sizeof to[0]);
        body.count = before + more;
        if (supplied > 0) append_arrivals(number, cell, table);
    }
    body.cell_start.reserve_discard(std::size_t(range) + 2);
    arrange(exec_, cell, range, body.id.data(), body.cell_start.data(), body.cell.data());
    // Behind the last cell are those who have left, for other ranks or altogether.
    exec_.download(&body.count, body.cell_start.data() + range, sizeof body.count);
    permute(body, cell.data());
}

}  // namespace mpm
