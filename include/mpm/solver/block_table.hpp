// The table of blocks that hold particles, and of all their neighbours: keys, where each block
// lies, who is beside it. Knows no particle and no nodal value; what follows blocks into a new
// table is told by a map of slots.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/exec/buffer.hpp"
#include "mpm/kernels/sorting.hpp"
#include "mpm/solver/blocks_together.hpp"

namespace mpm {

/// Cells of a table are counted in 32 bits.
inline void check_slots(std::int64_t slots) {
    if (slots * block_cells >= std::int64_t(~0u))
        throw CapacityError(
            "the scene needs " + std::to_string(slots) +
            " blocks of 64 cells; one device holds at most 67108863. Use a larger cell_size");
}

template <class X, int D>
class BlockTable {
public:
    /// Of a domain of so many cells along each axis; `fields`: of velocities.
    BlockTable(X& exec, const std::vector<std::int64_t>& cells, int fields);
    BlockTable(const BlockTable&) = delete;
    BlockTable& operator=(const BlockTable&) = delete;

    /// One rank of several: blocks on both sides of mirrored walls come together, and no memory is
    /// given back while a table is made.
    void share(const BlocksTogether& together) {
        together_ = together;
        shared_ = true;
    }

    /// Neighbours and corners are those of the last `link`.
    const BlockTableView<D>& view() const { return view_; }
    const Buffer<X, std::uint64_t>& keys() const { return keys_; }
    const Buffer<X, std::int32_t>& neighbours() const { return neighbours_; }
    const Buffer<X, std::int32_t>& corners() const { return corners_; }
    /// (slots,): does any body hold particles there. Whoever lists homes fills it.
    Buffer<X, std::uint32_t>& occupied() { return occupied_; }
    std::size_t bytes() const { return keys_.bytes() + neighbours_.bytes() + corners_.bytes(); }

    /// The table of these home blocks; or that with these keys, ascending, or with these in
    /// exchange for those that it had.
    void make(const Buffer<X, std::uint64_t>& homes);
    void assign(const std::vector<std::uint64_t>& keys);
    void adopt(Buffer<X, std::uint64_t>& keys);
    /// Finds corners and neighbours.
    void link();

    /// Keys of a table: home blocks and all their neighbours, ascending.
    void neighbourhood(const Buffer<X, std::uint64_t>& homes, Buffer<X, std::uint64_t>& keys);
    /// Those of a table of the occupied blocks, `more` blocks and all their neighbours. `map` leads
    /// from the present table's slots to its own.
    void rebuild(const Buffer<X, std::uint32_t>& occupied, const Buffer<X, std::uint64_t>& more,
                 Buffer<X, std::uint64_t>& keys, Buffer<X, std::int32_t>& map);
    /// Where the present table's slots are in that of these keys.
    void map_to(const Buffer<X, std::uint64_t>& keys, Buffer<X, std::int32_t>& map);
    /// The present slot of each of these keys, -1 where there is none.
    void slots_of(const Buffer<X, std::uint64_t>& keys, Buffer<X, std::int32_t>& slots);
    /// A table with other keys before it is the table: no longer knows corners and neighbours of
    /// its own.
    BlockTableView<D> view_of(const Buffer<X, std::uint64_t>& keys) const {
        BlockTableView<D> view = view_;
        view.keys = keys.data();
        view.slots = std::int32_t(keys.size());
        return view;
    }

private:
    X& exec_;
    BlocksTogether together_;
    bool shared_ = false;
    BlockTableView<D> view_{};
    Buffer<X, std::uint64_t> keys_{exec_};
    Buffer<X, std::int32_t> neighbours_{exec_}, corners_{exec_};
    Buffer<X, std::uint32_t> occupied_{exec_};
};

template <class X, int D>
BlockTable<X, D>::BlockTable(X& exec, const std::vector<std::int64_t>& cells, int fields)
    : exec_(exec) {
    view_.keys_of.fields = fields;
    for (int a = 0; a < D; ++a) {
        if (cells[std::size_t(a)] < 1)
            throw SceneError("the domain has no cells along axis " + std::to_string(a));
        view_.keys_of.counts[a] =
            (cells[std::size_t(a)] + Block<D>::edge - 1) / Block<D>::edge + 2 * BlockKeys<D>::rim;
    }
}

template <class X, int D>
void BlockTable<X, D>::make(const Buffer<X, std::uint64_t>& homes) {
    neighbourhood(homes, keys_);
    view_ = view_of(keys_);
}

template <class X, int D>
void BlockTable<X, D>::assign(const std::vector<std::uint64_t>& keys) {
    keys_.assign(keys);
    view_ = view_of(keys_);
}

template <class X, int D>
void BlockTable<X, D>::adopt(Buffer<X, std::uint64_t>& keys) {
    keys_.swap(keys);
    view_ = view_of(keys_);
}

template <class X, int D>
void BlockTable<X, D>::link() {
    const std::int64_t slots = view_.slots;
    neighbours_.reserve_discard(slots * Block<D>::neighbours);
    corners_.reserve_discard(slots * D);
    exec_.for_each(slots * Block<D>::neighbours,
                   LinkBlocks<D>{view_, neighbours_.data(), corners_.data()});
    view_.neighbours = neighbours_.data();
    view_.corners = corners_.data();
}

template <class X, int D>
void BlockTable<X, D>::slots_of(const Buffer<X, std::uint64_t>& keys,
                                Buffer<X, std::int32_t>& slots) {
    slots.reserve_discard(keys.size());
    exec_.for_each(std::int64_t(keys.size()),
                   MapSlots{keys.data(), keys_.data(), view_.slots, slots.data()});
}

template <class X, int D>
void BlockTable<X, D>::neighbourhood(const Buffer<X, std::uint64_t>& homes,
                                     Buffer<X, std::uint64_t>& keys) {
    const std::int64_t n = std::int64_t(homes.size()) * Block<D>::neighbours;
    Buffer<X, std::uint64_t> all(exec_);
    all.reserve_discard(n);
    exec_.for_each(n, ListNeighbours<D>{view_.keys_of, homes.data(), all.data()});
    const std::int64_t slots = exec_.sort_unique(all.data(), n, view_.keys_of.bits());
    check_slots(slots);
    keys.reserve_discard(slots);
    exec_.copy(keys.data(), all.data(), std::size_t(slots) * sizeof(std::uint64_t));
    if (!together_.empty()) {
        auto with_others = keys.host();
        add_together<D>(view_.keys_of, together_, with_others);
        keys.assign(with_others);
    }
    // As large as this, it would weigh on the sort that follows. Not with several devices: what is
    // given back there has to be mapped into all of them again.
    const bool heavy = all.bytes() > (std::size_t(16) << 20) && !shared_;
    all = Buffer<X, std::uint64_t>(exec_);
    if (heavy) exec_.trim();
}

template <class X, int D>
void BlockTable<X, D>::rebuild(const Buffer<X, std::uint32_t>& occupied,
                               const Buffer<X, std::uint64_t>& more, Buffer<X, std::uint64_t>& keys,
                               Buffer<X, std::int32_t>& map) {
    const std::int64_t slots = view_.slots;
    Buffer<X, std::uint32_t> position(exec_);
    position.reserve_discard(slots + 1);
    exec_.exclusive_scan(occupied.data(), position.data(), slots);
    std::uint32_t homes = 0;
    exec_.download(&homes, position.data() + slots, sizeof homes);
    Buffer<X, std::uint64_t> list(exec_);
    list.reserve_discard(homes + more.size());
    if (more.size() > 0)
        exec_.copy(list.data() + homes, more.data(), more.size() * sizeof(std::uint64_t));
    exec_.for_each(slots, ListKeys{keys_.data(), position.data(), occupied.data(), list.data()});
    neighbourhood(list, keys);
    map_to(keys, map);
}

template <class X, int D>
void BlockTable<X, D>::map_to(const Buffer<X, std::uint64_t>& keys, Buffer<X, std::int32_t>& map) {
    map.reserve_discard(view_.slots);
    exec_.for_each(view_.slots,
                   MapSlots{keys_.data(), keys.data(), std::int32_t(keys.size()), map.data()});
}

}  // namespace mpm
