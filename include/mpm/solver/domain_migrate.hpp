// Domain: the sort of one rank of several. Particles go to the rank that owns the block they are
// sorted into. Their order is that of one rank: by cell, and in a cell by the block and place that
// they come from, whichever rank that was.
#pragma once

#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_checks.hpp"
#include "mpm/solver/rank_fields.hpp"
#include "mpm/solver/rank_scene.hpp"

namespace mpm {

namespace detail {

/// Particles of one body on their way to another rank, in the order in which they were stored.
template <class T>
struct Emigrants {
    std::vector<std::uint64_t> from, to;  // keys of their blocks, before and now
    std::vector<std::uint32_t> cell;      // in the block of now
    std::vector<std::uint32_t> id;
    std::vector<std::vector<T>> column;  // offsets from that cell, then state

    void pack(Packer& packer) const {
        packer.put(from);
        packer.put(to);
        packer.put(cell);
        packer.put(id);
        for (const auto& c : column) packer.put(c);
    }
    Emigrants() = default;
    Emigrants(Unpacker& unpacker, std::size_t columns)
        : from(unpacker.list<std::uint64_t>()),
          to(unpacker.list<std::uint64_t>()),
          cell(unpacker.list<std::uint32_t>()),
          id(unpacker.list<std::uint32_t>()) {
        for (std::size_t c = 0; c < columns; ++c) column.push_back(unpacker.list<T>());
    }
    /// Those of another rank behind these.
    void append(const Emigrants& more) {
        const auto add = [](auto& to, const auto& tail) {
            to.insert(to.end(), tail.begin(), tail.end());
        };
        column.resize(more.column.size());
        add(from, more.from);
        add(to, more.to);
        add(cell, more.cell);
        add(id, more.id);
        for (std::size_t c = 0; c < column.size(); ++c) add(column[c], more.column[c]);
    }
};

}  // namespace detail

/// Whether particles of this rank have left where the policy is to stop.
template <class X, class T, int D>
bool Domain<X, T, D>::stops_here(const std::vector<std::uint32_t>& left,
                                 const std::vector<Buffer<X, std::uint32_t>>& cells) {
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        if (left[b] == 0) continue;
        if (bodies_[b].mesh) return true;  // it stays whole, whatever the policy
        if (!outflow_.stops()) continue;
        for (const Leaver<D>& who : list_left(bodies_[b], left[b], cells[b]))
            if (outflow_.outlet_of(who) < 0) return true;
    }
    return false;
}

/// Where particles of any rank have left so: nothing changes. `stops`: of this one.
template <class X, class T, int D>
bool Domain<X, T, D>::refuse_to_sort(bool stops, const std::vector<std::uint32_t>& left,
                                     const std::vector<Buffer<X, std::uint32_t>>& cells) {
    fault_ = {};
    if (stops) remove_left(left, cells);  // says who, and changes nothing
    return false;
}

/// Whether particles of any rank have left where the policy is to stop. Nothing has changed then.
template <class X, class T, int D>
bool Domain<X, T, D>::anyone_stops(const std::vector<std::uint32_t>& left,
                                   const std::vector<Buffer<X, std::uint32_t>>& cells) {
    const bool stops = stops_here(left, cells);
    bool any = false;
    for (const int theirs : share_->comm->tell(int(stops), "whether particles have left"))
        any = any || theirs != 0;
    return any && !refuse_to_sort(stops, left, cells);
}

/// The present table's sums into the new one, `keys`, with those of blocks that only others held.
template <class X, class T, int D>
void Domain<X, T, D>::adopt_table_of_ranks(Buffer<X, std::uint64_t>& keys,
                                           const std::vector<std::vector<std::uint64_t>>& after) {
    const RankShare<D>& s = *share_;
    const int me = s.rank(), ranks = s.ranks();
    const std::size_t block = std::size_t(plan_.sum_channels) * block_cells;
    // Whoever holds a block has all of its sums: the first who does hands them on.
    const auto provider = [&](std::uint64_t key) {
        for (int r = 0; r < ranks; ++r)
            if (detail::holds(s.keys[std::size_t(r)], key)) return r;
        return -1;
    };
    std::vector<Bytes> out(std::size_t(ranks), Bytes{});
    for (int r = 0; r < ranks; ++r) {
        if (r == me) continue;
        Packer packer;
        for (std::uint64_t key : after[std::size_t(r)]) {
            if (detail::holds(s.keys[std::size_t(r)], key) || provider(key) != me) continue;
            const std::int32_t slot = find_key(table_.keys, table_.slots, key);
            packer.put(sums_[parity()].data() + std::size_t(slot) * block, block);
        }
        out[std::size_t(r)] = packer.take();
    }
    std::vector<std::size_t> wanted(std::size_t(ranks), 0);
    for (std::uint64_t key : after[std::size_t(me)])
        if (!detail::holds(s.keys[std::size_t(me)], key))
            if (const int from = provider(key); from >= 0) ++wanted[std::size_t(from)];
    const auto in = s.comm->exchange_and_read(
        std::move(out), s.comm->others(), "sums of blocks",
        [&](int r, Unpacker& from) { from.leave(wanted[std::size_t(r)] * block * sizeof(Sum)); });
    adopt_table(keys);
    std::vector<Unpacker> messages(in.begin(), in.end());
    for (std::uint64_t key : after[std::size_t(me)]) {
        const int from = detail::holds(s.keys[std::size_t(me)], key) ? -1 : provider(key);
        if (from < 0) continue;
        const std::int32_t slot = find_key(table_.keys, table_.slots, key);
        messages[std::size_t(from)].get(sums_[parity()].data() + std::size_t(slot) * block, block);
    }
}

template <class X, class T, int D>
bool Domain<X, T, D>::sort_among_ranks() {
    const double began = now();
    RankShare<D>& s = *share_;
    const int me = s.rank();
    const std::size_t slots = std::size_t(table_.slots), bodies = bodies_.size();
    using Find = FindCells<X, T, D>;
    Buffer<X, std::uint32_t> flag(exec_), count(exec_);
    flag.reserve_discard(slots);
    flag.zero();
    std::vector<Buffer<X, std::uint32_t>> cells;
    std::vector<std::uint32_t> left;
    for (Body& body : bodies_) {
        auto& cell = cells.emplace_back(exec_);
        cell.reserve_discard(body.count);
        count.assign({0});
        find_cells(body, flag.data(), cell.data(), count.data());
        left.push_back(count.host()[0]);
    }
    if (anyone_stops(left, cells)) return false;
    remove_left(left, cells);

    std::vector<std::uint64_t> load(slots, 0);
    for (std::size_t b = 0; b < bodies; ++b)
        for (std::uint32_t p = 0; p < bodies_[b].count; ++p)
            if (cells[b].data()[p] != Find::outside) ++load[cells[b].data()[p] / block_cells];
    rebalance(load);
    std::vector<int> owner(slots);
    for (std::size_t k = 0; k < slots; ++k) owner[k] = s.partition.owner(table_.keys[k]);

    // Those of others, out and in.
    std::vector<detail::Emigrants<T>> come(bodies);
    std::vector<Packer> packers(s.keys.size());
    for (std::size_t b = 0; b < bodies; ++b) {
        const Body& body = bodies_[b];
        const std::uint32_t* cell = cells[b].data();
        std::vector<detail::Emigrants<T>> go(s.keys.size());
        std::vector<std::vector<std::uint32_t>> places(s.keys.size());
        for (std::int32_t h = 0; h < body.homes; ++h) {
            const std::int32_t home = body.home.data()[h];
            const std::uint32_t* start = body.cell_start.data() + std::size_t(home) * block_cells;
            for (std::uint32_t p = start[0]; p < start[block_cells]; ++p) {
                if (cell[p] == Find::outside) continue;
                const std::size_t to = cell[p] / block_cells, r = std::size_t(owner[to]);
                if (int(r) == me) continue;
                places[r].push_back(p);
                go[r].from.push_back(table_.keys[home]);
                go[r].to.push_back(table_.keys[to]);
                go[r].cell.push_back(cell[p] % block_cells);
                go[r].id.push_back(body.id.data()[p]);
            }
        }
        for (std::size_t r = 0; r < go.size(); ++r) {
            if (int(r) == me) continue;
            const HomeMoves moves = body.home_moves();
            for (int a = 0; a < D; ++a) {
                auto& out = go[r].column.emplace_back();
                for (std::uint32_t p : places[r])
                    out.push_back(moves.from_home(body.offset[std::size_t(a)].data()[p], p, a));
            }
            for (const auto& column : body.state) {
                auto& out = go[r].column.emplace_back();
                for (std::uint32_t p : places[r]) out.push_back(column.data()[p]);
            }
            go[r].pack(packers[r]);
            s.migrated += places[r].size();
        }
    }
    std::vector<Bytes> out;
    for (Packer& packer : packers) out.push_back(packer.take());
    std::vector<std::vector<detail::Emigrants<T>>> told(s.keys.size());
    s.comm->exchange_and_read(
        std::move(out), s.comm->others(), "particles", [&](int r, Unpacker& from) {
            std::vector<detail::Emigrants<T>> theirs;
            for (std::size_t b = 0; b < bodies; ++b) {
                const Body& body = bodies_[b];
                const auto mine = [&](std::uint64_t key) { return s.partition.owner(key) == me; };
                theirs.emplace_back(from, body.offset.size() + body.state.size());
                checks::emigrants(theirs.back(), body.offset.size(), s.keys[std::size_t(r)], mine,
                                  ids_of(spec_.bodies[b]));
            }
            told[std::size_t(r)] = std::move(theirs);
        });
    for (std::size_t b = 0; b < bodies; ++b) {
        std::uint64_t all = bodies_[b].count;
        for (int r : s.comm->others()) {
            all += told[std::size_t(r)][b].id.size();
            come[b].append(told[std::size_t(r)][b]);
        }
        if (all + column_padding >= (std::uint64_t(1) << 32))
            throw CapacityError("a rank is to have " + std::to_string(all) +
                                " particles of body '" + spec_.bodies[b].name +
                                "'; it can hold 2^32. Take more ranks");
    }
    told.clear();

    // The table of the blocks that this rank now has particles in.
    std::vector<std::uint64_t> homes;
    for (std::size_t k = 0; k < slots; ++k)
        if (owner[k] == me && load[k] > 0) homes.push_back(table_.keys[k]);
    for (const auto& c : come) homes.insert(homes.end(), c.to.begin(), c.to.end());
    inflow_.keep_own(spec_, share_->partition, share_->rank(), table_.keys_of, homes);
    std::sort(homes.begin(), homes.end());
    homes.erase(std::unique(homes.begin(), homes.end()), homes.end());
    Buffer<X, std::uint64_t> home_keys(exec_), keys(exec_);
    home_keys.assign(homes);
    blocks_.neighbourhood(home_keys, keys);
    auto after = gather_tables(keys);
    if (spec_.contact.any()) {
        hold_all_fields(after);
        keys.assign(after[std::size_t(me)]);
    }
    const auto& mine = after[std::size_t(me)];

    for (std::size_t b = 0; b < bodies; ++b) {
        BlockTableView<D> table = table_;
        table.keys = mine.data();
        table.slots = std::int32_t(mine.size());
        admit(int(b), come[b], cells[b], owner, table);
    }
    adopt_table_of_ranks(keys, after);
    list_homes(find_homes());
    link_ranks(std::move(after));
    link_meshes(false);
    return end_of_sort(began);
}

/// Particles that stay, those that came from other ranks and those of inlets, into the order of the
/// cells of the new table. `cell`: where those of the present table stand, `owner`: of its slots.
template <class X, class T, int D>
void Domain<X, T, D>::admit(int number, const detail::Emigrants<T>& come,
                            Buffer<X, std::uint32_t>& cell, const std::vector<int>& owner,
                            const BlockTableView<D>& table) {
    Body& body = bodies_[std::size_t(number)];
    const auto slot_of = [&](std::uint64_t key) {
        return std::uint32_t(find_key(table.keys, table.slots, key));
    };
    const std::uint32_t before = body.count, more = std::uint32_t(come.id.size());
    const std::size_t rows = std::size_t(before) + more + column_padding;
    const auto append = [&]<class E>(Buffer<X, E>& column, const std::vector<E>& tail) {
        if (rows > column.size()) {
            Buffer<X, E> larger(exec_);
            larger.reserve_discard(rows + rows / 8);
            exec_.zero(larger.data(), larger.size() * sizeof(E));
            exec_.copy(larger.data(), column.data(), before * sizeof(E));
            column.swap(larger);
        }
        exec_.upload(column.data() + before, tail.data(), tail.size() * sizeof(E));
    };
    std::size_t c = 0;
    for (auto& column : body.offset) append(column, come.column[c++]);
    for (auto& column : body.state) append(column, come.column[c++]);
    append(body.id, come.id);

    // By the block they come from: one rank had all particles of a block, in order.
    std::vector<std::uint32_t> arrived(more);
    for (std::uint32_t k = 0; k < more; ++k) arrived[k] = k;
    std::stable_sort(arrived.begin(), arrived.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return come.from[a] < come.from[b]; });
    std::vector<std::uint32_t> place, key;
    place.reserve(rows);
    key.reserve(rows);
    std::size_t next = 0;
    const auto take_arrived = [&](std::uint64_t below) {
        for (; next < arrived.size() && come.from[arrived[next]] < below; ++next) {
            const std::uint32_t k = arrived[next];
            place.push_back(before + k);
            key.push_back(slot_of(come.to[k]) * block_cells + come.cell[k]);
        }
    };
    std::vector<std::uint32_t> slot_after(owner.size());
    for (std::size_t k = 0; k < owner.size(); ++k) slot_after[k] = slot_of(table_.keys[k]);
    for (std::int32_t h = 0; h < body.homes; ++h) {
        const std::int32_t home = body.home.data()[h];
        take_arrived(table_.keys[home]);
        const std::uint32_t* start = body.cell_start.data() + std::size_t(home) * block_cells;
        for (std::uint32_t p = start[0]; p < start[block_cells]; ++p) {
            const std::uint32_t to = cell.data()[p];
            if (to == ~0u || owner[to / block_cells] != share_->rank()) continue;
            place.push_back(p);
            key.push_back(slot_after[to / block_cells] * block_cells + to % block_cells);
        }
    }
    take_arrived(~std::uint64_t(0));
    if (const std::uint32_t supplied = inflow_.arriving(std::size_t(number)); supplied > 0) {
        body.count = before + more;
        cell.reserve_discard(std::size_t(body.count) + supplied);
        append_arrivals(number, cell, table);
        for (std::uint32_t p = before + more; p < body.count; ++p) {
            place.push_back(p);
            key.push_back(cell.data()[p]);
        }
    }

    cell.assign(key);
    const std::int64_t range = std::int64_t(table.slots) * block_cells;
    body.cell_start.reserve_discard(std::size_t(range) + 2);
    arrange(exec_, cell, range, body.id.data(), body.cell_start.data(), body.cell.data(),
            body.order);
    for (std::size_t k = 0; k < key.size(); ++k) cell.data()[k] = place[cell.data()[k]];
    body.count = std::uint32_t(key.size());
    permute(body, cell.data());
}

}  // namespace mpm
