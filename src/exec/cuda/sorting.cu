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

__global__ void count_keys(const std::uint32_t* key, std::int64_t n, std::uint32_t* count,
                           std::uint32_t* arrival) {
    const std::int64_t i = std::int64_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < n) arrival[i] = atomicAdd(&count[key[i]], 1u);
}

__global__ void fill_buckets(const std::uint32_t* key, const std::uint32_t* arrival,
                             const std::uint32_t* start, std::int64_t n, std::uint32_t* order) {
    const std::int64_t i = std::int64_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < n) order[start[key[i]] + arrival[i]] = std::uint32_t(i);
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

std::int64_t Cuda::sort_unique(std::uint64_t* keys, std::int64_t n, int bits) {
    if (n == 0) return 0;
    const cuda::DeviceGuard guard(device());
    Buffer<Cuda, std::uint64_t> sorted(*this);
    Buffer<Cuda, std::int64_t> kept(*this);
    sorted.reserve_discard(n);
    kept.reserve_discard(1);
    with_memory(*this, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortKeys(memory, bytes, keys, sorted.data(), n, 0, bits,
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

void Cuda::sort_by_key(std::uint32_t* keys, std::int32_t* values, std::int64_t n, int bits) {
    if (n == 0) return;
    const cuda::DeviceGuard guard(device());
    Buffer<Cuda, std::uint32_t> sorted(*this);
    Buffer<Cuda, std::int32_t> ordered(*this);
    sorted.reserve_discard(n);
    ordered.reserve_discard(n);
    with_memory(*this, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortPairs(memory, bytes, keys, sorted.data(), values,
                                               ordered.data(), n, 0, bits, stream());
    });
    copy(values, ordered.data(), std::size_t(n) * sizeof(std::int32_t));
}

void Cuda::bucket_order(const std::uint32_t* key, std::int64_t n, std::int64_t range,
                        std::uint32_t* order, std::uint32_t* start) {
    const cuda::DeviceGuard guard(device());
    Buffer<Cuda, std::uint32_t> arrival(*this);
    arrival.reserve_discard(std::size_t(n) + column_padding);
    zero(start, std::size_t(range + 1) * sizeof(std::uint32_t));
    // Counts stand where the starts will: an exclusive sum in place, whose last is the total.
    launch(&count_keys, (n + 255) / 256, 1, 256, key, n, start, arrival.data());
    with_memory(*this, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceScan::ExclusiveSum(memory, bytes, start, start, range + 1, stream());
    });
    launch(&fill_buckets, (n + 255) / 256, 1, 256, key,
           static_cast<const std::uint32_t*>(arrival.data()),
           static_cast<const std::uint32_t*>(start), n, order);
}

}  // namespace mpm
