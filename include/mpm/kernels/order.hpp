// The order in which a device stores the particles of a block. A warp owns 32 cells, a lane one of
// them. The first particles of its cells come first, then the second ones, and so on, so that a
// warp reads neighbouring numbers; what a crowded cell holds beyond the others comes last, because
// it is done by whichever lane is free. CPUs store cell by cell: there the lanes are the particles
// of one cell.
//
// Both orders fill the same 32 cells between the same two places, so `cell_start` at a multiple of
// 32 holds for both.
#pragma once

#include <cstdint>

#include "mpm/data/blocks.hpp"

namespace mpm {

inline constexpr int warp_cells = 32;

/// Ranks that the lanes of a warp take in step: the mean of the cells that hold any. Fewer leave
/// too much for afterwards, more leave lanes idle; measured, the optimum is flat.
MPM_INLINE std::uint32_t ranks_in_step(std::uint32_t particles, std::uint32_t cells) {
    return cells == 0 ? 0 : (particles + cells - 1) / cells;
}

/// Calls put(cell, rank, place) for all particles of 32 cells; `count` is how many each holds and
/// `begin` where they start.
template <class Put>
void place_by_rank(const std::uint32_t (&count)[warp_cells], std::uint32_t begin, const Put& put) {
    std::uint32_t particles = 0, cells = 0;
    for (std::uint32_t n : count) {
        particles += n;
        cells += n > 0;
    }
    const std::uint32_t limit = ranks_in_step(particles, cells);
    for (std::uint32_t rank = 0; rank < limit; ++rank) {
        for (int c = 0; c < warp_cells; ++c)
            if (count[c] > rank) put(c, rank, begin++);
    }
    for (int c = 0; c < warp_cells; ++c)
        for (std::uint32_t rank = limit; rank < count[c]; ++rank) put(c, rank, begin++);
}

}  // namespace mpm
