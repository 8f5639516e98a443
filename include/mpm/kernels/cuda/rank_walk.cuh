// How a warp of the CUDA drivers walks the particles of its 32 cells (kernels/order.hpp).
#pragma once

#include "mpm/exec/cuda.cuh"
#include "mpm/kernels/order.hpp"

namespace mpm::cuda {

/// A lane owns a cell; all lanes of a warp must take part.
struct RankWalk {
    std::uint32_t count;    // particles of this lane's cell
    std::uint32_t own;      // those that this lane takes in step with the others
    std::uint32_t most;     // of any lane of the warp
    std::uint32_t surplus;  // of the warp
    std::uint32_t next;     // place of the first particle of the coming rank; in the end, of the
                            // surplus
    std::uint32_t rank = 0;

    __device__ RankWalk(std::uint32_t begin, std::uint32_t count) : count(count), next(begin) {
        const std::uint32_t all = __reduce_add_sync(~0u, count);
        const std::uint32_t cells = __popc(__ballot_sync(~0u, count > 0));
        const std::uint32_t limit = ranks_in_step(all, cells);
        own = count < limit ? count : limit;
        most = __reduce_max_sync(~0u, own);
        surplus = all - __reduce_add_sync(~0u, own);
    }
    /// Place of this lane's particle of the coming rank; means nothing when it has none.
    __device__ __forceinline__ std::uint32_t take() {
        const std::uint32_t holders = __ballot_sync(~0u, own > rank);
        const std::uint32_t place = next + __popc(holders & ((1u << threadIdx.x % 32) - 1));
        next += __popc(holders);
        ++rank;
        return place;
    }
    __device__ __forceinline__ void skip(int ranks) {
        for (int k = 0; k < ranks; ++k, ++rank) next += __popc(__ballot_sync(~0u, own > rank));
    }
    /// Place of the first of this lane's surplus, once all ranks have been taken.
    __device__ __forceinline__ std::uint32_t own_surplus() const {
        std::uint32_t before = count - own;
        for (int by = 1; by < 32; by *= 2) {
            const std::uint32_t other = __shfl_up_sync(~0u, before, by);
            if (threadIdx.x % 32 >= by) before += other;
        }
        return next + before - (count - own);
    }
};

/// Calls f(place) for the particles of each lane's cell, rank by rank.
template <class F>
__device__ __forceinline__ void for_each_of_cell(RankWalk walk, const F& f) {
#pragma unroll 1
    while (walk.rank < walk.most) {
        const bool mine = walk.rank < walk.own;
        const std::uint32_t place = walk.take();
        if (mine) f(place);
    }
    const std::uint32_t first = walk.own_surplus();
#pragma unroll 1
    for (std::uint32_t k = 0; k < walk.count - walk.own; ++k) f(first + k);
}

}  // namespace mpm::cuda
