// How devices add tallies up. A tally has whole numbers of which sums or maxima are asked for, so
// their order is free: lanes by the reductions that a warp has, warps in shared memory, and blocks
// by atomics. Loops stay loops: this runs once a launch, and fetching instructions takes longer
// than they do.
#pragma once

#include <cstddef>

#include "mpm/exec/cuda.cuh"
#include "mpm/kernels/tally.hpp"

namespace mpm::cuda {

/// Where things are in a tally, in words of 64 bits. A total has keys (`order_key`) for extremes,
/// of what is low that of the negative: the largest ones are asked for.
struct TallyWords {
    static constexpr int counts = 12, ids = counts + 3, low = ids + 2, high = low + 3,
                         size = high + 3;
};
static_assert(offsetof(Tally, count) == 8 * TallyWords::counts &&
              offsetof(Tally, ids) == 8 * TallyWords::ids &&
              offsetof(Tally, low) == 8 * TallyWords::low &&
              offsetof(Tally, high) == 8 * TallyWords::high);

/// Of the lanes of a warp; devices before compute capability 8 have no instruction for it.
__device__ __forceinline__ unsigned lanes_sum(unsigned own) {
#if !defined(__CUDA_ARCH__) || __CUDA_ARCH__ >= 800
    return __reduce_add_sync(~0u, own);
#else
    for (int by = 16; by > 0; by /= 2) own += __shfl_xor_sync(~0u, own, by);
    return own;
#endif
}
__device__ __forceinline__ unsigned lanes_max(unsigned own) {
#if !defined(__CUDA_ARCH__) || __CUDA_ARCH__ >= 800
    return __reduce_max_sync(~0u, own);
#else
    for (int by = 16; by > 0; by /= 2) own = max(own, __shfl_xor_sync(~0u, own, by));
    return own;
#endif
}
/// The sum of what the lanes of a warp have, modulo its size.
template <class Integer>
__device__ __forceinline__ Integer sum_of_lanes(Integer own) {
    if (!__any_sync(~0u, own != 0)) return 0;
    return from_limbs<Integer>([&](int k) { return lanes_sum(limb(own, k)); });
}
__device__ __forceinline__ std::uint64_t largest_of_lanes(std::uint64_t own) {
    const unsigned high = lanes_max(unsigned(own >> 32)),
                   low = lanes_max(own >> 32 == high ? unsigned(own) : 0u);
    return std::uint64_t(high) << 32 | low;
}

template <>
struct TotalOf<Tally> {
    static constexpr bool known = true;
    using Word = unsigned long long;
    using Unsigned128 = unsigned __int128;
    using At = TallyWords;

    __device__ static void add(const Tally& own, Tally* total) {
        constexpr int warps = max_threads / 32;
        __shared__ Word of_warp[warps][At::size];
        std::uint64_t any = own.ids[0] | own.ids[1];
        for (int c = 0; c < 3; ++c) any |= own.count[c];
        for (int k = 0; k < 6; ++k)
            any |= std::uint64_t(own.sum[k] >> 64) | std::uint64_t(own.sum[k]);
        // Few blocks have anything to add where a region is small.
        if (!__syncthreads_or(any != 0)) return;

        const int lane = int(threadIdx.x) % 32, warp = int(threadIdx.x) / 32;
        Word* word = of_warp[warp];
        MPM_NO_UNROLL for (int k = 0; k < 6; ++k) {
            const auto sum = sum_of_lanes(Unsigned128(own.sum[k]));
            if (lane < 2) word[2 * k + lane] = Word(lane == 0 ? sum : sum >> 64);
        }
        MPM_NO_UNROLL for (int k = 0; k < 5; ++k) {
            const auto sum = sum_of_lanes(k < 3 ? own.count[k] : own.ids[k - 3]);
            if (lane == 0) word[At::counts + k] = sum;
        }
        MPM_NO_UNROLL for (int c = 0; c < 3; ++c) {
            const bool has = own.count[c] != 0;
            std::uint64_t low = 0, high = 0;
            if (__any_sync(~0u, has)) {
                low = largest_of_lanes(has ? order_key(-own.low[c]) : 0);
                high = largest_of_lanes(has ? order_key(own.high[c]) : 0);
            }
            if (lane == 0) {
                word[At::low + c] = low;
                word[At::high + c] = high;
            }
        }
        __syncthreads();

        // Each kind by a warp of its own, so that none waits for the others.
        Word* to = reinterpret_cast<Word*>(total);
        if (warp == 0 && lane < 6) {
            Unsigned128 sum = 0;
            for (int w = 0; w < warps; ++w)
                sum += Unsigned128(of_warp[w][2 * lane + 1]) << 64 | of_warp[w][2 * lane];
            const Word low = Word(sum), before = low != 0 ? atomicAdd(to + 2 * lane, low) : 0;
            // Whoever goes over the end of the lower word carries.
            const Word high = Word(sum >> 64) + (before + low < low ? 1 : 0);
            if (high != 0) atomicAdd(to + 2 * lane + 1, high);
        } else if (warp == 1 && lane < 5) {
            Word sum = 0;
            for (int w = 0; w < warps; ++w) sum += of_warp[w][At::counts + lane];
            if (sum != 0) atomicAdd(to + At::counts + lane, sum);
        } else if (warp == 2 && lane < 6) {
            Word largest = 0;
            for (int w = 0; w < warps; ++w) {
                const Word key = of_warp[w][At::low + lane];
                if (key > largest) largest = key;
            }
            if (largest != 0) atomicMax(to + At::low + lane, largest);
        }
        __syncthreads();  // the block is counted after this
    }

    __device__ static void take(Tally* total, Tally& to) {
        const int lane = int(threadIdx.x) % 32;
        if (lane < At::size) {
            Word word = atomicExch(reinterpret_cast<Word*>(total) + lane, Word(0));
            if (lane >= At::low) {
                const double x = from_order_key(word);
                word = std::bit_cast<Word>(lane < At::high ? -x : x);
            }
            reinterpret_cast<Word*>(&to)[lane] = word;
        }
        __syncwarp();
    }
};

}  // namespace mpm::cuda
