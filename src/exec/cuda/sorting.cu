// Scans and sorts of the CUDA executor; the one unit that compiles CUB.
#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>
#include <cub/device/device_select.cuh>

#include "mpm/exec/buffer.hpp"
#include "mpm/exec/cuda.cuh"

namespace mpm {

namespace {

/// Calls a CUB function twice: once for the size of its working memory, once to run.
template <class F>
void with_memory(Cuda& exec, const F& f) {
    std::size_t bytes = 0;
    MPM_CUDA(f(nullptr, bytes));
    Buffer<Cuda, unsigned char> memory(exec);
    memory.reserve_discard(bytes > 0 ? bytes : 1);
    MPM_CUDA(f(memory.data(), bytes));
}

__global__ void count_up(std::uint32_t* out, std::int64_t n) {
    const std::int64_t i = std::int64_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < n) out[i] = std::uint32_t(i);
}

/// First place of every key in [0, range], by bisection; a warp's keys read the same places.
__global__ void mark_starts(const std::uint32_t* sorted, std::int64_t n, std::int64_t range,
                            std::uint32_t* start) {
    const std::int64_t key = std::int64_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (key > range) return;
    std::int64_t low = 0, high = n;
    while (low < high) {
        const std::int64_t middle = (low + high) / 2;
        if (std::int64_t(sorted[middle]) < key)
            low = middle + 1;
        else
            high = middle;
    }
    start[key] = std::uint32_t(low);
}

int bits_for(std::int64_t range) {
    int bits = 1;
    while (bits < 32 && (std::int64_t(1) << bits) < range) ++bits;
    return bits;
}

}  // namespace

void Cuda::exclusive_scan(const std::uint32_t* in, std::uint32_t* out, std::int64_t n) {
    const cuda::DeviceGuard guard(device());
    zero(out, sizeof(std::uint32_t));
    if (n == 0) return;
    with_memory(*this, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceScan::InclusiveSum(memory, bytes, in, out + 1, n, stream());
    });
}

std::int64_t Cuda::sort_unique(std::uint64_t* keys, std::int64_t n) {
    if (n == 0) return 0;
    const cuda::DeviceGuard guard(device());
    Buffer<Cuda, std::uint64_t> sorted(*this);
    Buffer<Cuda, std::int64_t> kept(*this);
    sorted.reserve_discard(n);
    kept.reserve_discard(1);
    with_memory(*this, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortKeys(memory, bytes, keys, sorted.data(), n, 0, 64,
                                              stream());
    });
    with_memory(*this, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceSelect::Unique(memory, bytes, sorted.data(), keys, kept.data(), n,
                                         stream());
    });
    std::int64_t count = 0;
    download(&count, kept.data(), sizeof count);
    return count;
}

void Cuda::stable_order(const std::uint32_t* key, std::int64_t n, std::int64_t range,
                        std::uint32_t* order, std::uint32_t* start) {
    const cuda::DeviceGuard guard(device());
    Buffer<Cuda, std::uint32_t> sorted(*this), index(*this);
    sorted.reserve_discard(n);
    index.reserve_discard(n);
    if (n > 0) {
        launch(&count_up, (n + 255) / 256, 1, 256, index.data(), n);
        with_memory(*this, [&](void* memory, std::size_t& bytes) {
            return cub::DeviceRadixSort::SortPairs(memory, bytes, key, sorted.data(), index.data(),
                                                   order, n, 0, bits_for(range), stream());
        });
    }
    launch(&mark_starts, (range + 256) / 256, 1, 256, sorted.data(), n, range, start);
}

}  // namespace mpm
