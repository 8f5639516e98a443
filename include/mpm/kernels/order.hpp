// The order in which a device stores the particles of a block. CPUs store cell by cell: there the
// lanes are the particles of one cell.
//
// By rank: a warp owns 32 cells, a lane one of them. The first particles of its cells come first,
// then the second ones, and so on, so that a warp reads neighbouring numbers; what a crowded cell
// holds beyond the others comes last, because it is done by whichever lane is free. It fills the
// same 32 cells between the same two places as an order cell by cell, so `cell_start` at a multiple
// of 32 holds for both.
//
// By chunk, where warps share the work (kernels/cuda/split.cuh): the fuller cells of a block are
// its first 32, the others its second. A chunk is four ranks of 32 cells, cell by cell: a warp
// takes its particles as they lie, and four lanes read the same nodes. `cell_start` holds at
// blocks.
#pragma once

#include <cstddef>
#include <cstdint>

#include "mpm/data/blocks.hpp"

namespace mpm {

inline constexpr int warp_cells = 32;

enum class HomeOrder : std::uint8_t { by_rank, by_chunk };

/// Blocks with fewer particles are not worth an arena, where there are many such: a launch of their
/// own costs what a thousand of them do. Measured on an H200 (docs/performance.md).
inline constexpr std::uint32_t least_of_block = 32;
inline constexpr std::uint32_t least_of_sparse = 4096;  // homes of a body

/// Threads of a block that takes lone particles, and how many such blocks they need.
inline constexpr int lone_threads = 128;
inline std::int64_t lone_blocks(std::uint32_t particles) {
    return (std::int64_t(particles) + lone_threads - 1) / lone_threads;
}

/// Homes for each multiprocessor from which on two share a block of threads, where warps share the
/// work: it reads and adds to fewer nodes, and there are more than run at once all the same.
inline constexpr int pairs_from = 6;

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

/// Ranks of a chunk.
inline constexpr std::uint32_t chunk_ranks = 4;
/// Cells of a block that meet in no bank of shared memory with those of another class.
inline constexpr int cell_classes = 8;

/// What a device keeps of a particle's home: the number of its cell in the block, and in a body
/// that is stored by chunk which of the four ranks it has.
MPM_INLINE std::uint8_t home_byte(int cell, std::uint32_t rank) {
    return std::uint8_t(unsigned(cell) | (rank % chunk_ranks) << 6);
}
static_assert(block_cells == 1 << 6);
MPM_INLINE int home_cell_of(std::uint8_t byte) { return byte % block_cells; }
MPM_INLINE int chunk_rank_of(std::uint8_t byte) { return byte / block_cells; }

/// Cells of a block by places: the fuller ones of each class first, so that the lanes of a warp
/// have alike numbers of particles.
inline void cells_by_place(const std::uint32_t (&count)[block_cells], int (&cell_at)[block_cells]) {
    for (int c = 0; c < block_cells; ++c) {
        int before = 0;
        for (int other = c % cell_classes; other < block_cells; other += cell_classes)
            before += count[other] > count[c] || (count[other] == count[c] && other < c);
        cell_at[before * cell_classes + c % cell_classes] = c;
    }
}

/// Calls put(cell, rank, place) for all particles of a block's cells, which are stored by chunk.
template <class Put>
void place_by_chunk(const std::uint32_t (&count)[block_cells], std::uint32_t begin,
                    const Put& put) {
    int cell_at[block_cells];
    cells_by_place(count, cell_at);
    for (int half = 0; half < block_cells; half += warp_cells) {
        std::uint32_t most = 0;
        for (int k = 0; k < warp_cells; ++k)
            most = count[cell_at[half + k]] > most ? count[cell_at[half + k]] : most;
        for (std::uint32_t first = 0; first < most; first += chunk_ranks)
            for (int k = 0; k < warp_cells; ++k) {
                const int c = cell_at[half + k];
                for (std::uint32_t r = first; r < first + chunk_ranks && r < count[c]; ++r)
                    put(c, r, begin++);
            }
    }
}

/// Calls put(cell, rank, place, home byte) for all particles of whole blocks, on the host;
/// start[c]: particles before cell c.
template <class Put>
void place_homes(HomeOrder order, const std::uint32_t* start, std::size_t cells, const Put& put) {
    const auto of_groups = [&]<std::size_t together>(const auto& place_all) {
        for (std::size_t first = 0; first < cells; first += together) {
            std::uint32_t count[together];
            for (std::size_t c = 0; c < together; ++c)
                count[c] = start[first + c + 1] - start[first + c];
            place_all(count, start[first], [&](int c, std::uint32_t rank, std::uint32_t place) {
                const std::size_t cell = first + std::size_t(c);
                put(cell, rank, place,
                    home_byte(int(cell % block_cells), order == HomeOrder::by_chunk ? rank : 0));
            });
        }
    };
    if (order == HomeOrder::by_chunk)
        of_groups.template operator()<block_cells>([](const auto&... a) { place_by_chunk(a...); });
    else
        of_groups.template operator()<warp_cells>([](const auto&... a) { place_by_rank(a...); });
}

}  // namespace mpm
