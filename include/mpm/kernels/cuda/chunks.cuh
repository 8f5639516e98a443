// How warps of the CUDA drivers find the cells and particles of a block that is stored by chunk
// (kernels/order.hpp).
#pragma once

#include "mpm/kernels/cuda/rank_walk.cuh"

namespace mpm::cuda {

/// Which cell of a home block has which place, and how many particles.
struct CellPlaces {
    std::uint32_t count[block_cells];   // by place
    std::uint32_t begin;                // the first particle
    std::uint8_t cell_at[block_cells];  // by place

    /// By one thread for cell c, which it returns the place of; `start` of the block's cells, or
    /// null for a block without particles. Others read it after a barrier.
    __device__ __forceinline__ int find(const std::uint32_t* start, int c) {
        constexpr int members = block_cells / cell_classes;
        std::uint32_t n[members] = {};
        MPM_UNROLL for (int k = 0; k < members; ++k) if (start) n[k] =
            start[c % cell_classes + cell_classes * k + 1] -
            start[c % cell_classes + cell_classes * k];
        const int mine = c / cell_classes;
        std::uint32_t own = 0;
        MPM_UNROLL for (int k = 0; k < members; ++k) own = k == mine ? n[k] : own;
        int before = 0;
        MPM_UNROLL for (int k = 0; k < members; ++k) before +=
            n[k] > own || (n[k] == own && k < mine);
        const int place = before * cell_classes + c % cell_classes;
        count[place] = own;
        cell_at[place] = std::uint8_t(c);
        if (c == 0) begin = start ? start[0] : 0;
        return place;
    }
};

/// How many particles of a chunk a lane's cell has, `first` of its ranks on.
__device__ __forceinline__ std::uint32_t of_chunk(std::uint32_t count, std::uint32_t first) {
    const std::uint32_t left = count > first ? count - first : 0;
    return left < chunk_ranks ? left : chunk_ranks;
}

/// The places of the particles of each lane's cell, which are stored from `before` on; all lanes of
/// a warp must take part.
template <HomeOrder by>
struct CellWalk;

template <>
struct CellWalk<HomeOrder::by_rank> {
    RankWalk walk;
    __device__ CellWalk(std::uint32_t before, std::uint32_t count) : walk(before, count) {}
    __device__ bool nobody() const { return walk.most == 0; }
    template <class F>
    __device__ __forceinline__ void each(const F& f) const {
        for_each_of_cell(walk, f);
    }
};

template <>
struct CellWalk<HomeOrder::by_chunk> {
    std::uint32_t before, count, most;
    __device__ CellWalk(std::uint32_t before, std::uint32_t count)
        : before(before), count(count), most(__reduce_max_sync(~0u, count)) {}
    __device__ bool nobody() const { return most == 0; }
    template <class F>
    __device__ __forceinline__ void each(const F& f) const {
        std::uint32_t next = before;
#pragma unroll 1
        for (std::uint32_t first = 0; first < most; first += chunk_ranks) {
            const std::uint32_t own = of_chunk(count, first);
            std::uint32_t up_to = own;
            for (int by = 1; by < 32; by *= 2) {
                const std::uint32_t other = __shfl_up_sync(~0u, up_to, by);
                if (threadIdx.x % 32 >= by) up_to += other;
            }
            for (std::uint32_t r = 0; r < own; ++r) f(next + up_to - own + r);
            next += __shfl_sync(~0u, up_to, 31);
        }
    }
};

}  // namespace mpm::cuda
