// Devices: full home blocks of a body two by two, as the fused step takes them whose warps share
// the work (kernels/cuda/split.cuh).
#pragma once

#include "mpm/data/blocks.hpp"

namespace mpm {

/// Full homes of a body: two that lie beside each other along the first axis make a pair, which
/// begins at an even block.
template <int D>
struct FullHomes {
    const std::uint32_t* cell_start;
    const std::int32_t* neighbours;
    const std::int32_t* corners;
    std::uint32_t least;  // particles
    static constexpr int before = Block<D>::neighbours / 6,
                         after = Block<D>::neighbours - 1 - before;

    MPM_INLINE bool even(std::int32_t slot) const {
        return corners[std::int64_t(slot) * D] / Block<D>::edge % 2 == 0;
    }
    /// The slot on one side of another, if it is one of them, else -1.
    MPM_INLINE std::int32_t beside(std::int32_t slot, int side) const {
        const std::int32_t other = neighbours[std::int64_t(slot) * Block<D>::neighbours + side];
        if (other < 0) return -1;
        const std::uint32_t* start = cell_start + std::int64_t(other) * block_cells;
        return start[block_cells] - start[0] >= least ? other : -1;
    }
};
template <int D>
struct FlagPairs {
    FullHomes<D> full;
    const std::int32_t* home;
    std::uint32_t* flag;
    MPM_INLINE void operator()(std::int64_t h) const {
        flag[h] = full.even(home[h]) || full.beside(home[h], FullHomes<D>::before) < 0;
    }
};
template <int D>
struct ListPairs {
    FullHomes<D> full;
    const std::int32_t* home;
    const std::uint32_t* position;  // scan of the flags
    std::int32_t* pair;             // (pairs, 2)
    MPM_INLINE void operator()(std::int64_t h) const {
        if (position[h + 1] == position[h]) return;
        std::int32_t* const to = pair + 2 * std::int64_t(position[h]);
        const bool even = full.even(home[h]);
        to[0] = even ? home[h] : -1;
        to[1] = even ? full.beside(home[h], FullHomes<D>::after) : home[h];
    }
};

}  // namespace mpm
