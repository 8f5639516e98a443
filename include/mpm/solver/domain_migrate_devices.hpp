// Domain: the sort of one rank of several on devices. Particles go to the rank that owns the block
// they are sorted into: who goes is listed where it was, and the rank that it goes to fetches it,
// or is sent it where it reaches no list of others. Within a cell the order is that of the ids,
// whoever they come from.
#pragma once

#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_blocks.hpp"
#include "mpm/solver/rank_checks.hpp"
#include "mpm/solver/rank_scene.hpp"

namespace mpm {

template <int D>
struct FindOwners {
    BlockTableView<D> table;
    RowCuts<D> cuts;
    std::int32_t* owner;
    MPM_INLINE void operator()(std::int64_t slot) const {
        owner[slot] = cuts.owner(table.keys_of, table.keys[slot]);
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
    std::uint32_t behind;  // the last cell of the present table
    std::uint32_t* cell;
    const std::int32_t* owner;
    const std::uint64_t* keys;
    std::int32_t me;
    std::uint32_t* next;   // (ranks,)
    std::uint32_t* place;  // where it is stored
    std::uint64_t* key;    // of the block it stands in
    std::uint32_t* in;     // the cell of that
    MPM_INLINE void operator()(std::int64_t p) const {
        const std::uint32_t c = cell[p];
        if (c == ~0u) return;
        const std::int32_t r = owner[c / block_cells];
        if (r == me) return;
        const std::uint32_t k = X::fetch_add(next + r, 1);
        place[k] = std::uint32_t(p);
        key[k] = keys[c / block_cells];
        in[k] = c % block_cells;
        cell[p] = behind;
    }
};
/// Cells of those who have come, in the new table.
struct CellsOfArrived {
    const std::uint64_t* keys;
    std::int32_t slots;
    const std::uint64_t* key;
    const std::uint32_t* in;
    std::uint32_t* cell;
    MPM_INLINE void operator()(std::int64_t k) const {
        cell[k] = std::uint32_t(find_key(keys, slots, key[k])) * block_cells + in[k];
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

template <class X, class T, int D>
void Domain<X, T, D>::find_owners() {
    owner_.reserve_discard(std::size_t(table_.slots));
    exec_.for_each(table_.slots,
                   FindOwners<D>{table_, RowCuts<D>(share_->partition), owner_.data()});
}

/// As `rebalance`, by where particles were at the last sort. Whether there are new cuts.
template <class X, class T, int D>
bool Domain<X, T, D>::deal_devices() {
    Buffer<X, std::uint32_t> load(exec_);
    load.reserve_discard(std::size_t(table_.slots));
    load.zero();
    for (const Body& body : bodies_)
        exec_.for_each(table_.slots, AddLoad{body.cell_start.data(), load.data()});
    const auto loads = load.host();
    const auto keys = blocks_.keys().host();
    std::vector<BlockWeight> blocks;
    for (std::size_t k = 0; k < loads.size(); ++k)
        if (loads[k] > 0) blocks.push_back({keys[k], loads[k] + weight_of_block});
    const auto before = share_->partition.cuts();
    deal_anew(blocks, imbalance(share_->loads));
    return share_->partition.cuts() != before;
}

/// `counts`: for each body one number that is not touched, then its emigrants to each rank.
template <class X, class T, int D>
void Domain<X, T, D>::count_emigrants(const std::vector<Buffer<X, std::uint32_t>>& cells,
                                      Buffer<X, std::uint32_t>& counts) {
    const std::size_t row = 1 + std::size_t(share_->ranks());
    for (std::size_t b = 0; b < bodies_.size(); ++b)
        exec_.for_each(bodies_[b].count,
                       CountEmigrants<X>{cells[b].data(), owner_.data(), share_->rank(),
                                         counts.data() + b * row + 1});
}

/// Particles of a body that go to other ranks, which fetch them: in lists on this device, by rank.
/// In `cell` they are from here on behind the table. `count`: of each rank.
template <class X, class T, int D>
typename Domain<X, T, D>::Emigrating Domain<X, T, D>::list_emigrants(const Body& body,
                                                                     Buffer<X, std::uint32_t>& cell,
                                                                     const std::uint32_t* count) {
    const RankShare<D>& s = *share_;
    Emigrating go(exec_);
    go.count.assign(count, count + s.ranks());
    for (std::uint32_t n : go.count) {
        go.first.push_back(go.all);
        go.all += n;
    }
    if (go.all == 0) return go;
    const std::size_t columns = body.offset.size() + body.state.size();
    Buffer<X, std::uint32_t> next(exec_), place(exec_);
    next.assign(go.first);
    for (auto* list : {&place, &go.in, &go.id}) list->reserve_discard(go.all);
    go.key.reserve_discard(go.all);
    go.column.reserve_discard(go.all * columns);
    exec_.for_each(body.count,
                   ListEmigrants<X>{std::uint32_t(table_.slots) * block_cells, cell.data(),
                                    owner_.data(), table_.keys, s.rank(), next.data(), place.data(),
                                    go.key.data(), go.in.data()});
    const std::int64_t n = std::int64_t(go.all);
    exec_.for_each(n, Take<std::uint32_t>{place.data(), body.id.data(), go.id.data()});
    T* to = go.column.data();
    for (int a = 0; a < D; ++a, to += n)
        exec_.for_each(n, TakeOffsets<T>{place.data(), body.offset[std::size_t(a)].data(), to,
                                         body.home_moves(), a});
    for (const auto& column : body.state) {
        exec_.for_each(n, Take<T>{place.data(), column.data(), to});
        to += n;
    }
    return go;
}

/// All that ranks tell each other before they know what the sort will do: who goes, and a word of
/// each, which becomes that of all. Returns who comes, of each body: where their lists are, which
/// `landed` keeps where they had to be sent.
template <class X, class T, int D>
std::vector<std::vector<typename Domain<X, T, D>::Coming>> Domain<X, T, D>::tell_emigrants(
    const std::vector<Emigrating>& go, SortWord& word, std::vector<Emigrating>& landed) {
    const auto& comm = share_->comm;
    exec_.wait();
    std::vector<Bytes> out(std::size_t(share_->ranks()));
    for (int r : comm->others()) {
        std::vector<Coming> told;
        for (const Emigrating& g : go)
            told.push_back({g.key.data(), g.in.data(), g.id.data(), g.column.data(),
                            g.first[std::size_t(r)], g.count[std::size_t(r)], g.all,
                            share_->rank()});
        Packer packer;
        packer.put(&word, 1);
        packer.put(told);
        out[std::size_t(r)] = packer.take();
    }
    std::vector<SortWord> words(out.size());
    std::vector<std::vector<Coming>> told(out.size());
    comm->exchange_and_read(
        std::move(out), comm->others(), "who comes", [&](int r, Unpacker& from) {
            SortWord theirs{};
            from.get(&theirs, 1);
            auto list = from.list<Coming>();
            if (list.size() != go.size())
                checks::refuse("of " + std::to_string(list.size()) + " bodies");
            for (std::size_t b = 0; b < list.size(); ++b) {
                const Coming& c = list[b];
                if (c.rank != r || c.all > ids_of(spec_.bodies[b]) || c.first > c.all ||
                    c.count > c.all - c.first)
                    checks::refuse("with " + std::to_string(c.count) + " of " +
                                   std::to_string(c.all) + " particles of rank " +
                                   std::to_string(c.rank));
            }
            words[std::size_t(r)] = theirs;
            told[std::size_t(r)] = std::move(list);
        });
    std::vector<std::vector<Coming>> come(go.size());
    for (int r : comm->others()) {
        word.stops |= words[std::size_t(r)].stops;
        word.lacks |= words[std::size_t(r)].lacks;
        for (std::size_t b = 0; b < go.size(); ++b)
            if (told[std::size_t(r)][b].count > 0) come[b].push_back(told[std::size_t(r)][b]);
    }
    if (!word.stops && !reaches()) fetch_emigrants(go, come, landed);
    return come;
}

/// Sums of blocks that are new to this rank's table, from the first who held them: whoever holds a
/// block has all of its sums. `before`, `after`: what ranks held, and hold in their new tables.
template <class X, class T, int D>
void Domain<X, T, D>::adopt_table_of_devices(Buffer<X, std::uint64_t>& keys,
                                             const std::vector<std::vector<HeldBlock>>& before,
                                             const std::vector<std::vector<HeldBlock>>& after) {
    const RankShare<D>& s = *share_;
    const int me = s.rank();
    const std::int64_t block = std::int64_t(plan_.sum_channels) * block_cells;
    const NewBlocks mine(me, before, after);
    struct Piece {
        Buffer<X, std::int32_t> slot;
        Buffer<X, Sum> sums;
        std::int64_t size;
        int rank;
        Parcel parcel() const { return {sums.data(), std::size_t(size) * sizeof(Sum), rank}; }
    };
    const auto add = [&](std::vector<Piece>& to, int r, const std::vector<std::int32_t>& slots) {
        if (slots.empty()) return false;
        to.push_back({Buffer<X, std::int32_t>(exec_), Buffer<X, Sum>(exec_),
                      std::int64_t(slots.size()) * block, r});
        to.back().slot.assign(slots);
        to.back().sums.reserve_discard(std::size_t(to.back().size));
        return true;
    };
    const auto pack = [&](Piece& p, const Sum* from) {
        exec_.for_each(p.size, PackBlocks<Sum>{from, p.slot.data(), block, p.sums.data()});
    };
    std::vector<Piece> pieces, given;
    std::vector<Parcel> out, in;
    for (int r : s.comm->others()) {
        if (add(pieces, r, mine.from[std::size_t(r)])) {
            if (reaches())
                pack(pieces.back(), sums_of_[std::size_t(r)][std::size_t(parity())]);
            else
                in.push_back(pieces.back().parcel());
        }
        if (reaches()) continue;
        if (add(given, r, NewBlocks(r, before, after).from[std::size_t(me)])) {
            pack(given.back(), sums_[parity()].data());
            out.push_back(given.back().parcel());
        }
    }
    if (!reaches()) meeting_->swap(out, in);
    meet_hosts();  // theirs may go from here on
    adopt_table(keys);
    for (Piece& p : pieces) {
        p.slot.assign(mine.to[std::size_t(p.rank)]);
        exec_.for_each(
            p.size, UnpackBlocks<Sum>{sums_[parity()].data(), p.slot.data(), block, p.sums.data()});
    }
    exec_.wait();
}

/// Where no rank needs a new block and none has new cuts, all keep their tables, what they know of
/// each other's, and their sums: then particles change their ranks, and nothing else is told but
/// how many homes there are.
template <class X, class T, int D>
bool Domain<X, T, D>::sort_among_devices() {
    const double began = now();
    RankShare<D>& s = *share_;
    const std::size_t bodies = bodies_.size(), row = 1 + std::size_t(s.ranks());
    const std::int64_t slots = table_.slots;
    // Of each body: particles that have left, and those in blocks of each rank; then whether any
    // stands in a block that is not ready for it.
    Buffer<X, std::uint32_t> occupied(exec_), counts(exec_);
    occupied.reserve_discard(std::size_t(slots));
    occupied.zero();
    counts.reserve_discard(bodies * row + 1);
    counts.zero();
    std::vector<Buffer<X, std::uint32_t>> cells;
    for (std::size_t b = 0; b < bodies; ++b) {
        Body& body = bodies_[b];
        auto& cell = cells.emplace_back(exec_);
        // As much as the columns have, so that who comes mostly fits.
        cell.reserve_discard(std::max(std::size_t(body.count) + column_padding, body.id.size()));
        find_cells(body, occupied.data(), cell.data(), counts.data() + b * row);
    }
    count_emigrants(cells, counts);
    exec_.for_each(slots,
                   FindNewHomes<X>{occupied.data(), ready_.data(), counts.data() + bodies * row});
    auto counted = counts.host();
    std::vector<std::uint32_t> left;
    for (std::size_t b = 0; b < bodies; ++b) left.push_back(counted[b * row]);
    const bool stops = stops_here(left, cells);
    SortWord word{stops, counted.back()};

    // By what all told at the last sort: that costs nothing where all is even.
    bool dealt = false;
    std::vector<std::vector<HeldBlock>> all_before;
    if (imbalance(s.loads) > s.rebalance_above) {
        if (anyone_stops(left, cells)) return false;
        dealt = deal_devices();
    }
    if (dealt) {
        // Only what lies beside a cut concerns others, as long as the cuts stay.
        all_before = gather_held(blocks_.keys(), true);
        find_owners();
        counts.zero();
        count_emigrants(cells, counts);
        counted = counts.host();
    }
    std::vector<Emigrating> go;
    std::vector<std::uint32_t> gone = left;
    for (std::size_t b = 0; b < bodies; ++b) {
        go.push_back(list_emigrants(bodies_[b], cells[b], counted.data() + b * row + 1));
        gone[b] += go[b].all;
    }
    std::vector<Emigrating> landed;
    const auto come = tell_emigrants(go, word, landed);
    if (word.stops) return refuse_to_sort(stops, left, cells);
    remove_left(left, cells);
    for (const Emigrating& g : go) s.migrated += g.all;

    if (dealt || word.lacks || inflow_.arrives() || ++sorts_of_table_ >= 16) {
        const double at = now();
        sort_into_new_table(come, gone, cells, occupied, dealt ? &all_before : nullptr);
        timings_["tables"] += now() - at;
        sorts_of_table_ = 0;
    } else {
        const std::uint32_t behind = std::uint32_t(slots * block_cells);
        for (std::size_t b = 0; b < bodies; ++b) {
            if (left[b] > 0)
                exec_.for_each(bodies_[b].count,
                               RenumberCells{cells[b].data(), nullptr, behind, behind});
            admit_arrived(int(b), come[b], gone[b], cells[b], table_);
            cells[b] = Buffer<X, std::uint32_t>(exec_);
        }
        list_homes(find_homes());  // after which nobody reads our lists any more
    }
    link_meshes(false);
    return end_of_sort(began);
}

/// The table of the blocks that this rank now has particles in, and all that follows from it.
/// `all_before`: what ranks held, where there are new cuts.
template <class X, class T, int D>
void Domain<X, T, D>::sort_into_new_table(const std::vector<std::vector<Coming>>& come,
                                          const std::vector<std::uint32_t>& gone,
                                          std::vector<Buffer<X, std::uint32_t>>& cells,
                                          Buffer<X, std::uint32_t>& occupied,
                                          const std::vector<std::vector<HeldBlock>>* all_before) {
    RankShare<D>& s = *share_;
    const std::int64_t slots = table_.slots;
    exec_.for_each(slots, KeepOwned{owner_.data(), s.rank(), occupied.data()});
    std::vector<std::uint64_t> supplied;
    inflow_.keep_own(spec_, share_->partition, share_->rank(), table_.keys_of, supplied);
    std::uint64_t all = 0;
    for (const auto& of_body : come)
        for (const Coming& c : of_body) all += c.count;
    Buffer<X, std::uint64_t> more(exec_), keys(exec_);
    Buffer<X, std::int32_t> map(exec_);
    more.reserve_discard(all + supplied.size());
    if (!supplied.empty())
        exec_.upload(more.data() + all, supplied.data(), supplied.size() * sizeof supplied[0]);
    std::uint64_t at = 0;
    for (const auto& of_body : come) {
        for (const Coming& c : of_body) {
            exec_.copy(more.data() + at, c.key + c.first, c.count * sizeof(std::uint64_t));
            at += c.count;
        }
    }
    more.shrink(std::size_t(
        exec_.sort_unique(more.data(), std::int64_t(more.size()), table_.keys_of.bits())));
    blocks_.rebuild(occupied, more, keys, map);
    if (spec_.contact.any()) {
        hold_fields_of_devices(keys);
        blocks_.map_to(keys, map);
    }
    const BlockTableView<D> table = blocks_.view_of(keys);
    auto after = gather_held(keys, all_before != nullptr);
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        exec_.for_each(bodies_[b].count, RenumberCells{cells[b].data(), map.data(),
                                                       std::uint32_t(slots * block_cells),
                                                       std::uint32_t(table.slots) * block_cells});
        admit_arrived(int(b), come[b], gone[b], cells[b], table);
        cells[b] = Buffer<X, std::uint32_t>(exec_);
    }
    adopt_table_of_devices(keys, all_before ? *all_before : s.held, after);
    if (all_before) after = gather_held(blocks_.keys(), false);
    link_devices(std::move(after));
    list_homes(find_homes());
    link_sums();
}

/// Particles that stay, those that come from other ranks and those of inlets, into the order of the
/// cells of a table, behind which those stand who are `gone`.
template <class X, class T, int D>
void Domain<X, T, D>::admit_arrived(int number, const std::vector<Coming>& come, std::uint32_t gone,
                                    Buffer<X, std::uint32_t>& cell,
                                    const BlockTableView<D>& table) {
    Body& body = bodies_[std::size_t(number)];
    const std::uint32_t before = body.count, supplied = inflow_.arriving(std::size_t(number));
    const std::int64_t range = std::int64_t(table.slots) * block_cells;
    std::size_t rows = std::size_t(before) + supplied;
    for (const Coming& c : come) rows += c.count;
    if (rows >= (std::size_t(1) << 32) - 256)
        throw CapacityError("body '" + body.plan.name +
                            "' has more than 4294967039 particles on one rank; split it into "
                            "several bodies");
    if (rows > before) {
        const std::size_t needed = rows + column_padding;
        const auto widen = [&]<class E>(Buffer<X, E>& column, std::size_t room) {
            if (needed <= column.size()) return;
            Buffer<X, E> wider(exec_);
            wider.reserve_discard(room);
            exec_.copy(wider.data(), column.data(), before * sizeof(E));
            column.swap(wider);
        };
        widen(cell, needed);
        const std::size_t room = needed + needed / 32;
        for (auto& column : body.offset) widen(column, room);
        for (auto& column : body.state) widen(column, room);
        widen(body.id, room);
        body.cell.reserve_discard(body.id.size());
        for (const Coming& c : come) {
            const std::uint32_t to = body.count;
            exec_.for_each(c.count, CellsOfArrived{table.keys, table.slots, c.key + c.first,
                                                   c.in + c.first, cell.data() + to});
            exec_.copy(body.id.data() + to, c.id + c.first, c.count * sizeof(std::uint32_t));
            const T* from = c.column + c.first;
            const auto take = [&](Buffer<X, T>& column) {
                exec_.copy(column.data() + to, from, c.count * sizeof(T));
                from += c.all;
            };
            for (auto& column : body.offset) take(column);
            for (auto& column : body.state) take(column);
            body.count += c.count;
        }
        if (supplied > 0) append_arrivals(number, cell, table);
    }
    cell.shrink(rows);
    body.cell_start.reserve_discard(std::size_t(range) + 2);
    arrange(exec_, cell, range, body.id.data(), body.cell_start.data(), body.cell.data(),
            body.order);
    body.count = std::uint32_t(rows) - gone;
    permute(body, cell.data());
}

}  // namespace mpm
