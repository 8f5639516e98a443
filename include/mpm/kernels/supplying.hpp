// Particles that come and go while a simulation runs: where new ones lie in the table of blocks,
// and which have left the domain.
#pragma once

#include "mpm/kernels/sorting.hpp"

namespace mpm {

/// Marks the blocks of particles that are to come as occupied; raises `missing` where the table has
/// no such block.
template <class X, int D>
struct MarkArrivals {
    BlockTableView<D> table;
    const std::uint64_t* keys;  // of their blocks
    std::uint32_t* occupied;
    std::uint32_t* missing;
    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int32_t slot = find_key(table.keys, table.slots, keys[i]);
        if (slot < 0)
            X::raise(missing);
        else
            occupied[slot] = 1;
    }
};

/// A particle outside the domain.
template <int D>
struct Leaver {
    std::uint32_t place, id;
    std::int32_t cell[D + D % 2];  // even: no gap that the host would read unwritten
    double position[D];            // m from the lower corner
};

/// Those particles that `FindCells` found outside, in any order.
template <class X, class T, int D>
struct ListLeavers {
    BlockTableView<D> table;
    BodyView<T, D> body;
    double cell_size;
    const std::uint32_t* new_cell;
    std::uint32_t* count;
    Leaver<D>* to;

    using Find = FindCells<X, T, D>;
    static constexpr int lanes = Find::lanes;

    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int32_t slot = body.home[i / lanes];
        const int lane = int(i % lanes);
        const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
        if constexpr (X::is_device) {
            for (std::uint32_t p = start[0] + lane; p < start[block_cells]; p += lanes)
                look(p, body.home_cell(p), slot);
        } else {
            for (std::uint32_t p = start[lane]; p < start[lane + 1]; ++p) look(p, lane, slot);
        }
    }

    MPM_INLINE void look(std::uint32_t p, int cell, std::int32_t slot) const {
        if (new_cell[p] != Find::outside) return;
        Leaver<D> who{};
        who.place = p;
        who.id = body.id[p];
        int at[D];
        Block<D>::coordinates(cell, at);
        for (int a = 0; a < D; ++a) {
            const std::int32_t home = table.corners[std::int64_t(slot) * D + a] + at[a];
            int shift;
            wrap_offset(body.offset[a][p], shift);
            who.cell[a] = home + shift;
            who.position[a] = (double(home) + 0.5 + double(body.offset[a][p])) * cell_size;
        }
        to[X::fetch_add(count, 1)] = who;
    }
};

}  // namespace mpm
