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

/// Blocks with fewer particles are not worth an arena, where there are many such: a launch of their
/// own costs what a thousand of them do. Measured on an H200 (docs/performance.md).
inline constexpr std::uint32_t least_of_block = 32;
inline constexpr std::uint32_t least_of_sparse = 4096;  // homes of a body

/// Threads of a block that takes lone particles, and how many such blocks they need.
inline constexpr int lone_threads = 128;
inline std::int64_t lone_blocks(std::uint32_t particles) {
    return (std::int64_t(particles) + lone_threads - 1) / lone_threads;
}

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
