// The kernels behind the verbs of the CUDA executor (exec/cuda.cuh): loops over functions that are
// handed to them, and their maxima and sums.
#pragma once

#include <cuda_runtime.h>

#include <concepts>
#include <cstdint>
#include <cstring>
#include <initializer_list>

#include "mpm/core/config.hpp"
#include "mpm/exec/sums.hpp"

namespace mpm::cuda {

/// First in a kernel of a step (`launch_next`): returns when what came before on the stream is done
/// and seen, and lets what comes after it be brought to the device meanwhile.
__device__ __forceinline__ void after_previous() {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    cudaGridDependencySynchronize();
    cudaTriggerProgrammaticLaunchCompletion();
#endif
}

template <class F>
__global__ void single_kernel(const __grid_constant__ F f) {
    f();
}

template <class F>
__global__ void each_kernel(std::int64_t n, const __grid_constant__ F f) {
    const std::int64_t i = std::int64_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < n) f(i);
}

/// For functions that wait for one read after another: half of the registers that they would take,
/// and twice as many at a time.
inline constexpr int next_threads = 64;
template <class F>
__global__ void __launch_bounds__(next_threads, 8)
    next_kernel(std::int64_t n, const __grid_constant__ F f) {
    after_previous();
    const std::int64_t i = std::int64_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < n) f(i);
}

inline constexpr int max_threads = 256;

/// Runs f once, on the last of `all` blocks that come here. Every thread of every block must call
/// it; `arrivals` is zero before and after.
template <class F>
__device__ __forceinline__ void last_of(std::uint32_t all, std::uint32_t* arrivals, const F& f) {
    __syncthreads();
    if (threadIdx.x != 0) return;
    // What any thread of the block has told is there before the block is counted: without this a
    // maximum or a count could come a step late, and the bits with it.
    __threadfence();
    if (atomicAdd(arrivals, 1u) + 1 != all) return;
    __threadfence();
    f();
    *arrivals = 0;
}

/// What has work for few of its items says which (`wanted`).
template <class F>
concept Choosy = requires(const F& f, std::int64_t i) {
    { f.wanted(i) } -> std::same_as<bool>;
};

/// Some of it goes one by one: one lane of a warp has it while the others wait outside. Of long
/// functions that lanes leave and enter apart some have waited for each other for ever
/// (design/gpu-step.md).
template <class F>
concept PartlyOneByOne = requires(const F& f, std::int64_t i) {
    { f.one_by_one(i) } -> std::same_as<bool>;
};

/// run(i) for the wanted ones of n items, which each warp lines up until there is one for each
/// lane; after them for those that go one by one, of which neighbours belong to different warps.
/// All lanes call this together.
template <class F, class R>
__device__ __forceinline__ void each_wanted(std::int64_t n, const F& f, const R& run) {
    __shared__ std::int64_t lines[max_threads / 32][64];
    const int lane = threadIdx.x % 32;
    std::int64_t* line = lines[threadIdx.x / 32];
    const std::int64_t warps = std::int64_t(gridDim.x) * (max_threads / 32),
                       warp = std::int64_t(blockIdx.x) * (max_threads / 32) + threadIdx.x / 32;
    int waiting = 0, at_a_time = 32;
    for (std::int64_t k = 0;;) {
        const bool single = at_a_time == 1;
        for (;
             waiting < at_a_time && (single ? 32 * k * warps + warp : 32 * (k * warps + warp)) < n;
             ++k) {
            const std::int64_t i =
                single ? (32 * k + lane) * warps + warp : 32 * (k * warps + warp) + lane;
            bool wanted = i < n;
            if constexpr (PartlyOneByOne<F>) wanted = wanted && f.one_by_one(i) == single;
            wanted = wanted && f.wanted(i);
            const unsigned all = __ballot_sync(~0u, wanted);
            if (wanted) line[waiting + __popc(all & ((1u << lane) - 1))] = i;
            waiting += __popc(all);
        }
        __syncwarp();
        if (waiting == 0) {
            if (single || !PartlyOneByOne<F>) return;
            at_a_time = 1;
            k = 0;
            continue;
        }
        const int now = waiting < at_a_time ? waiting : at_a_time;
        waiting -= now;
        if (lane < now) run(line[waiting + lane]);
        __syncwarp();
    }
}

/// Maxima are not negative, so their bits order as they do, and the largest is the same in whatever
/// order it is found. They are zero before and after; `then` reads them in between.
template <int M, class F, class G>
__global__ void __launch_bounds__(max_threads)
    max_kernel(std::int64_t n, const __grid_constant__ F f, double* maxima,
               const __grid_constant__ G then, std::uint32_t* arrivals) {
    after_previous();
    double local[M] = {};
    if constexpr (Choosy<F>) {
        each_wanted(n, f, [&](std::int64_t i) { f(i, local); });
    } else {
        const std::int64_t stride = std::int64_t(gridDim.x) * blockDim.x;
        for (std::int64_t i = std::int64_t(blockIdx.x) * blockDim.x + threadIdx.x; i < n;
             i += stride)
            f(i, local);
    }
    __shared__ double of_warp[max_threads / 32][M];
    const int lane = threadIdx.x % 32, warp = threadIdx.x / 32;
    for (int m = 0; m < M; ++m) {
        double x = local[m];
        for (int by = 16; by > 0; by /= 2) x = fmax(x, __shfl_down_sync(~0u, x, by));
        if (lane == 0) of_warp[warp][m] = x;
    }
    __syncthreads();
    if (threadIdx.x < M) {
        double x = 0;
        for (int w = 0; w < max_threads / 32; ++w) x = fmax(x, of_warp[w][threadIdx.x]);
        if (x > 0) {
            atomicMax(reinterpret_cast<unsigned long long*>(maxima) + threadIdx.x,
                      static_cast<unsigned long long>(__double_as_longlong(x)));
        }
    }
    last_of(gridDim.x, arrivals, [&] {
        then(const_cast<const double*>(maxima));
        for (int m = 0; m < M; ++m) maxima[m] = 0;
    });
}

/// What a lane further along has, word by word.
template <class A>
__device__ __forceinline__ A shuffled_down(const A& own, int by) {
    static_assert(sizeof(A) % sizeof(unsigned) == 0);
    constexpr int words = int(sizeof(A) / sizeof(unsigned));
    unsigned word[words];
    memcpy(word, &own, sizeof own);
    for (int k = 0; k < words; ++k) word[k] = __shfl_down_sync(~0u, word[k], by);
    A other;
    memcpy(&other, word, sizeof other);
    return other;
}
__device__ __forceinline__ double shuffled_down(double own, int by) {
    return __shfl_down_sync(~0u, own, by);
}

/// Adds what the first `lanes` lanes of a warp hold, a power of two, in a fixed order; the sums are
/// the first one's.
template <int W, class A>
__device__ __forceinline__ void add_lanes(A (&local)[W], int lanes) {
    for (int w = 0; w < W; ++w)
        for (int by = lanes / 2; by > 0; by /= 2) local[w] += shuffled_down(local[w], by);
}

/// Adds what the threads of a block hold, in a fixed order; the sums are thread 0's.
template <int W, class A>
__device__ __forceinline__ void add_up(A (&local)[W]) {
    constexpr int warps = max_threads / 32;
    __shared__ A of_warp[warps][W];
    const int lane = threadIdx.x % 32, warp = threadIdx.x / 32;
    add_lanes<W>(local, 32);
    for (int w = 0; w < W && lane == 0; ++w) of_warp[warp][w] = local[w];
    __syncthreads();
    if (warp == 0) {
        for (int w = 0; w < W; ++w) local[w] = of_warp[lane % warps][w];
        add_lanes<W>(local, warps);
    }
    __syncthreads();
}

/// A type whose sums are the same in any order may have a way of its own to be added up: each block
/// adds to one total a set, so that no last block has many parts to read. Totals are zeros before
/// and after. `add(own, total)`, all threads of a block; `take(total, to)`, a warp: what is there,
/// in shared memory, and zeros again. `then` has the lanes of a warp for it.
template <class A>
struct TotalOf {
    static constexpr bool known = false;
};

/// run(i) for the items of a set, by `threads` of which this is one; those that go one by one after
/// the others, and of these neighbours belong to different warps. All lanes call this together.
template <class F, class R>
__device__ __forceinline__ void each_partly_alone(const SumSet& set, const F& f,
                                                  std::int64_t thread, std::int64_t threads,
                                                  const R& run) {
    const std::int64_t end = set.first + set.count;
    const int lane = int(thread % 32);
    for (const bool alone : {false, true}) {
        for (std::int64_t k = 0; k * threads < set.count; ++k) {
            const std::int64_t i =
                set.first +
                (alone ? (32 * k + lane) * (threads / 32) + thread / 32 : k * threads + thread);
            unsigned left = __ballot_sync(~0u, i < end && f.one_by_one(i) == alone);
            while (left != 0) {
                const unsigned now = alone ? left & -left : left;
                if (now >> lane & 1) run(i);
                __syncwarp();
                left &= ~now;
            }
        }
    }
}

/// A block a place; the last of them adds the places of each set, or takes their total (`TotalOf`),
/// a warp a set. Which block that is changes nothing. Blocks behind the places take what runs
/// beside, a warp each, with all its lanes.
template <int W, class F, class G, class A, class H>
__global__ void __launch_bounds__(max_threads, sizeof(A) > 64 ? 2 : 1)
    sum_kernel(const __grid_constant__ SumSets sets, const __grid_constant__ F f, A* parts,
               const __grid_constant__ G then, std::uint32_t* arrivals, std::int64_t more,
               const __grid_constant__ H beside) {
    after_previous();
    if constexpr (requires { f.idle(); }) {
        if (f.idle()) return;
    }
    const std::int32_t place = std::int32_t(blockIdx.x);
    if (place >= sets.places) {
        const std::int64_t k =
            std::int64_t(place - sets.places) * (max_threads / 32) + threadIdx.x / 32;
        if (k < more) beside(k, {int(threadIdx.x % 32), 32});
        return;
    }
    {
        const int s = sets.owner(place);
        const SumSet set = sets.set[s];
        const std::int64_t stride = std::int64_t(set.parts) * max_threads;
        bool idle = false;
        if constexpr (requires { f.idle(s); }) idle = f.idle(s);
        if (!idle) {
            A local[W] = {};
            const std::int64_t thread = std::int64_t(place - set.place) * max_threads + threadIdx.x;
            if constexpr (PartlyOneByOne<F>) {
                each_partly_alone(set, f, thread, stride, [&](std::int64_t i) { f(i, s, local); });
            } else {
                for (std::int64_t i = thread; i < set.count; i += stride)
                    f(set.first + i, s, local);
            }
            if constexpr (TotalOf<A>::known) {
                static_assert(W == 1);
                TotalOf<A>::add(local[0], parts + s);
            } else {
                add_up<W>(local);
                for (int w = 0; w < W && threadIdx.x == 0; ++w)
                    parts[std::int64_t(place) * W + w] = local[w];
            }
        }
    }
    __shared__ bool last;
    if (threadIdx.x == 0) {
        __threadfence();
        last = atomicAdd(arrivals, 1u) + 1 == unsigned(sets.places);
        __threadfence();
    }
    __syncthreads();
    if (!last) return;
    for (int s = threadIdx.x / 32; s < sets.count; s += max_threads / 32) {
        if constexpr (requires { f.idle(s); }) {
            if (f.idle(s)) continue;
        }
        if constexpr (TotalOf<A>::known) {
            __shared__ A total[max_threads / 32];
            A& own = total[threadIdx.x / 32];
            TotalOf<A>::take(parts + s, own);
            then(s, static_cast<const A*>(&own), {int(threadIdx.x % 32), 32});
            __syncwarp();
        } else {
            const SumSet set = sets.set[s];
            A local[W] = {};
            for (std::int32_t k = threadIdx.x % 32; k < set.parts; k += 32)
                for (int w = 0; w < W; ++w) local[w] += parts[std::int64_t(set.place + k) * W + w];
            add_lanes<W>(local, 32);
            if (threadIdx.x % 32 == 0) then(s, static_cast<const A*>(local));
        }
    }
    if constexpr (requires { then.done(); }) {
        __syncthreads();
        if constexpr (TotalOf<A>::known) {
            if (threadIdx.x < 32) then.done({int(threadIdx.x), 32});
        } else {
            if (threadIdx.x == 0) then.done();
        }
    }
    if (threadIdx.x == 0) *arrivals = 0;
}

}  // namespace mpm::cuda
