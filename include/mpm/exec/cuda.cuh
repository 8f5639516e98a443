// The CUDA executor: memory of one device, kernels on a stream of its own. The verbs mean what they
// mean on the CPU (exec/cpu.hpp); everything is queued and only `download`, `upload` and `wait`
// stop for it.
#pragma once

// Every unit for devices reads this, three times over: <algorithm>, <functional> and
// <unordered_map> would be a third of what it reads.
#include <cuda_runtime.h>

#include <cstdint>
#include <memory>
#include <utility>

#include "mpm/core/config.hpp"
#include "mpm/core/error.hpp"
#include "mpm/exec/cuda_kernels.cuh"
#include "mpm/exec/sums.hpp"

namespace mpm {

namespace cuda {

/// Throws DeviceError, or CapacityError when memory is short, unless `code` is success.
void check(cudaError_t code, const char* what, const char* file, int line);
#define MPM_CUDA(call) ::mpm::cuda::check((call), #call, __FILE__, __LINE__)

/// Whether all that is compiled is for devices of this compute capability, times 100, or later.
constexpr bool built_from(int capability) {
    constexpr int all[] = {__CUDA_ARCH_LIST__};
    for (int one : all)
        if (one < capability) return false;
    return true;
}

/// Makes a device current for a scope.
class DeviceGuard {
public:
    explicit DeviceGuard(int device) {
        MPM_CUDA(cudaGetDevice(&before_));
        if (before_ == device)
            before_ = -1;
        else
            MPM_CUDA(cudaSetDevice(device));
    }
    ~DeviceGuard() {
        if (before_ >= 0) cudaSetDevice(before_);
    }
    DeviceGuard(const DeviceGuard&) = delete;
    DeviceGuard& operator=(const DeviceGuard&) = delete;

private:
    int before_ = -1;
};

template <class T>
struct SumOf;
template <>
struct SumOf<float> {
    using type = std::int32_t;
    static constexpr int bits = 31;
};
template <>
struct SumOf<double> {
    using type = std::int64_t;
    static constexpr int bits = 62;
};

}  // namespace cuda

class CudaMeeting;

class Cuda {
public:
    static constexpr bool is_device = true;
    /// How ranks on devices wait for each other (exec/cuda_meeting.cuh).
    using Meeting = CudaMeeting;
    /// In which numbers the grid is kept beside particles in T.
    template <class T>
    using Grid = T;
    /// Type of a nodal sum: fixed point, so that sums do not depend on their order.
    template <class T>
    using Sum = typename cuda::SumOf<T>::type;
    template <class T>
    static constexpr int sum_bits = cuda::SumOf<T>::bits;
    /// How far a particle may drift from the cell it was sorted into, in cells: the arena of a
    /// block allows one.
    static constexpr double drift_limit = 0.95;
    /// Share of the drift that a sort looks ahead (`Decide::sort_for`): a third, which gains 2 to
    /// 6 % once particles have mixed (design/gpu-step.md).
    static constexpr double look_ahead = 1.0 / 3;
    /// Particles beside their cell, summed over the steps since the last sort, that have cost as
    /// much as a sort does: then it pays. Measured on an H200 (docs/performance.md).
    static std::uint64_t stray_limit(std::uint64_t particles) { return 500'000 + particles / 2; }
    /// Steps handed over before the state is looked at again.
    static constexpr int batch = 64;

    /// `shared`: other simulations run on the device at the same time, so that what a launch leaves
    /// idle is not lost; a run alone is slower for it.
    Cuda(int device, bool shared);
    Cuda(Cuda&&) noexcept = default;
    Cuda& operator=(Cuda&&) noexcept = default;

    void* allocate(std::size_t bytes);
    void release(void* p, std::size_t bytes) noexcept;
    void copy(void* to, const void* from, std::size_t bytes);
    void upload(void* to, const void* from, std::size_t bytes);
    void download(void* to, const void* from, std::size_t bytes);
    void zero(void* p, std::size_t bytes);
    void wait();
    /// For the work of others on the device, too.
    void wait_for_all() noexcept;
    /// Gives memory back that was freed and is kept for later.
    void trim();
    /// The most bytes that were in use at a time, and the most that were held for use.
    struct Peak {
        std::uint64_t used = 0, held = 0;
    };
    Peak peak() const;

    int device() const { return context_->device; }
    cudaStream_t stream() const { return context_->beside ? context_->side : context_->stream; }
    /// What is launched from here on may run beside what follows `main_stream`, until `join`.
    void side_stream();
    void main_stream() { context_->beside = false; }
    void join();
    int multiprocessors() const { return context_->multiprocessors; }
    bool shared() const { return context_->shared; }
    /// Can warps of a block wait for each other at barriers in shared memory
    /// (kernels/cuda/split.cuh)?
    bool shares_work() const { return context_->barriers; }

    /// Opens the memory of this device and another one to each other; throws DeviceError where that
    /// cannot be, and where one cannot add there.
    void reach(int other);
    /// The stream waits for another: what comes next must not come to the device before.
    void after_wait() { context_->order = Context::joined; }

    /// Queues a kernel of `blocks` x `rows` blocks.
    template <class... P, class... A>
    void launch(void (*kernel)(P...), std::int64_t blocks, int rows, int threads,
                const A&... arguments) {
        check_size(blocks);
        if (blocks <= 0) return;
        const cuda::DeviceGuard guard(device());
        kernel<<<dim3(unsigned(blocks), unsigned(rows)), unsigned(threads), 0, stream()>>>(
            arguments...);
        MPM_CUDA(cudaGetLastError());
    }

    /// As `launch`, for a kernel that begins with `after_previous`: its blocks come to the device
    /// while the kernel before it still runs, which hides most of what a launch takes.
    template <class... P, class... A>
    void launch_next(void (*kernel)(P...), std::int64_t blocks, int rows, int threads,
                     const A&... arguments) {
        if (!context_->one_after_another()) {
            launch(kernel, blocks, rows, threads, arguments...);
            return;
        }
        check_size(blocks);
        if (blocks <= 0) return;
        const cuda::DeviceGuard guard(device());
        launch_with(0, kernel, blocks, rows, threads, arguments...);
    }
    /// As `launch_next`, with `bytes` of shared memory a block: more than a kernel has unasked.
    template <class... P, class... A>
    void launch_large(int bytes, void (*kernel)(P...), std::int64_t blocks, int threads,
                      const A&... arguments) {
        check_size(blocks);
        if (blocks <= 0) return;
        const cuda::DeviceGuard guard(device());
        const auto allow = [&](cudaFuncAttribute what, int value) {
            MPM_CUDA(cudaFuncSetAttribute(reinterpret_cast<const void*>(kernel), what, value));
        };
        allow(cudaFuncAttributeMaxDynamicSharedMemorySize, bytes);
        allow(cudaFuncAttributePreferredSharedMemoryCarveout, cudaSharedmemCarveoutMaxShared);
        launch_with(std::size_t(bytes), kernel, blocks, 1, threads, arguments...);
    }

    // Verbs are defined outside of the class: not being inline, what several units launch can be
    // compiled in one of them (`extern template`).
    template <class F>
    void single(const F& f);
    template <class F>
    void for_each(std::int64_t n, const F& f);
    /// Iterations that cost much more than a few nanoseconds each: small blocks, so that they
    /// spread.
    template <class F>
    void for_each_large(std::int64_t n, const F& f);
    /// A pass of a step, whose iterations take long: it comes to the device while the one before
    /// still runs.
    template <class F>
    void for_each_next(std::int64_t n, const F& f);
    /// Host work on host copies.
    template <class F>
    void host_for(std::int64_t n, const F& f) {
        host_each(n, &f,
                  [](const void* each, std::int64_t i) { (*static_cast<const F*>(each))(i); });
    }

    /// then(maxima), with maxima[m] = max over i of what f(i, local) leaves in local[m], at least
    /// 0.
    template <int M, class F, class G>
    void max_each(std::int64_t n, const F& f, const G& then);
    /// Parts in which `sum_each` adds up n items: they depend on n and the device alone.
    std::int64_t sum_parts(std::int64_t n) const {
        const std::int64_t blocks = (n + cuda::max_threads - 1) / cuda::max_threads;
        const std::int64_t most = 2 * multiprocessors();
        return blocks < 1 ? 1 : (blocks < most ? blocks : most);
    }

    /// then(s, sums) for each set s, with sums[w] = sum over its items i of what f(i, s, local)
    /// adds to local[w]; sets in any order. `parts` has room for W sums a place, of whatever can be
    /// added and is none where it is zeros; of what has a way of its own (`cuda::TotalOf`) the
    /// first ones, a set each, are zeros. Beside it beside(k, lanes) runs for k < more, which are
    /// few and slow, on all lanes of a warp. Says `then` so at the end, where it wants to know
    /// (`then.done()`); does nothing where `f.idle()`, and leaves out sets where `f.idle(s)`. Sets
    /// may have fewer parts than `sum_parts`.
    template <int W, class F, class G, class A, class H>
    void sum_each(const SumSets& sets, const F& f, const G& then, A* parts, std::int64_t more,
                  const H& beside);

    /// For kernels that end with something done once (`cuda::last_of`).
    std::uint32_t* arrivals() const { return context_->arrivals; }

    /// out[i] = sum of in[0 .. i), for i in [0, n]: n + 1 results.
    void exclusive_scan(const std::uint32_t* in, std::uint32_t* out, std::int64_t n);
    /// Keys below 2^bits ascending, each once; returns how many remain.
    std::int64_t sort_unique(std::uint64_t* keys, std::int64_t n, int bits);
    /// order[start[k] .. start[k + 1]) = the elements of key k, in no particular order, for keys in
    /// [0, range); start has range + 1 entries.
    void bucket_order(const std::uint32_t* key, std::int64_t n, std::int64_t range,
                      std::uint32_t* order, std::uint32_t* start);

    /// Stable order of values by keys below 2^bits, in place; for few values and few bits.
    void sort_by_key(std::uint32_t* keys, std::int32_t* values, std::int64_t n, int bits);

    // Inside kernels. On the host they only have to exist.
    MPM_INLINE static void raise(std::uint32_t* flag) {
        *static_cast<volatile std::uint32_t*>(flag) = 1;
    }
    /// Keeps the smallest value seen.
    MPM_INLINE static void keep_smallest(std::uint64_t* to, std::uint64_t value) {
#if defined(__CUDA_ARCH__)
        atomicMin(reinterpret_cast<unsigned long long*>(to),
                  static_cast<unsigned long long>(value));
#else
        if (value < *to) *to = value;
#endif
    }
    /// Adds to an integer, in whatever order.
    MPM_INLINE static void add_integer(std::int64_t* to, std::int64_t by) {
#if defined(__CUDA_ARCH__)
        atomicAdd(reinterpret_cast<unsigned long long*>(to), static_cast<unsigned long long>(by));
#else
        *to += by;
#endif
    }
    /// Returns the value before the addition.
    MPM_INLINE static std::uint32_t fetch_add(std::uint32_t* to, std::uint32_t by) {
#if defined(__CUDA_ARCH__)
        return atomicAdd(to, by);
#else
        return std::exchange(*to, *to + by);
#endif
    }

private:
    static void check_size(std::int64_t blocks) {
        if (blocks > 0x7fffffff)
            throw CapacityError("more than 2^31 - 1 blocks of threads in one launch");
    }
    template <class... P, class... A>
    void launch_with(std::size_t bytes, void (*kernel)(P...), std::int64_t blocks, int rows,
                     int threads, const A&... arguments) {
        cudaLaunchAttribute early{};
        early.id = cudaLaunchAttributeProgrammaticStreamSerialization;
        early.val.programmaticStreamSerializationAllowed = 1;
        cudaLaunchConfig_t config{};
        config.gridDim = dim3(unsigned(blocks), unsigned(rows));
        config.blockDim = dim3(unsigned(threads));
        config.dynamicSmemBytes = bytes;
        config.stream = stream();
        config.attrs = &early;
        config.numAttrs = context_->one_after_another() ? 1 : 0;
        MPM_CUDA(cudaLaunchKernelEx(&config, kernel, arguments...));
    }
    struct Context {
        Context(int device, bool shared);
        ~Context();
        void close() noexcept;
        int device;
        bool shared;
        int multiprocessors = 0;
        cudaStream_t stream = nullptr, side = nullptr;
        cudaEvent_t event = nullptr;
        bool beside = false;
        // Kernels of a step may overlap their launches only where each follows the one before it.
        enum { serial, apart, joined } order = serial;
        bool overlaps = false;  // the device can do it
        bool barriers = false;  // in shared memory
        bool one_after_another() {
            const bool yes = overlaps && order == serial;
            if (order == joined) order = serial;
            return yes;
        }
        cudaMemPool_t pool = nullptr;
        struct Pieces;
        std::unique_ptr<Pieces> pieces;  // that are large
        void* staging = nullptr;         // pinned, for small downloads
        double* maxima = nullptr;
        std::uint32_t* arrivals = nullptr;
    };
    static constexpr std::size_t staging_bytes = 1 << 16, large = std::size_t(64) << 20;
    static constexpr int max_maxima = 8;
    static constexpr int most_missed = 4;
    static void host_each(std::int64_t n, const void* f, void (*call)(const void*, std::int64_t));
    void* allocate_large(std::size_t bytes);
    void free_kept(int missed);
    [[noreturn]] void out_of_memory(std::size_t bytes);
    std::unique_ptr<Context> context_;
};

template <class F>
void Cuda::single(const F& f) {
    launch(&cuda::single_kernel<F>, 1, 1, 1, f);
}
template <class F>
void Cuda::for_each(std::int64_t n, const F& f) {
    launch(&cuda::each_kernel<F>, (n + 255) / 256, 1, 256, n, f);
}
template <class F>
void Cuda::for_each_large(std::int64_t n, const F& f) {
    launch(&cuda::each_kernel<F>, (n + 31) / 32, 1, 32, n, f);
}
template <class F>
void Cuda::for_each_next(std::int64_t n, const F& f) {
    constexpr int threads = cuda::next_threads;
    launch_next(&cuda::next_kernel<F>, (n + threads - 1) / threads, 1, threads, n, f);
}
template <int M, class F, class G>
void Cuda::max_each(std::int64_t n, const F& f, const G& then) {
    static_assert(M <= max_maxima);
    // Of what goes one by one a warp has few.
    constexpr std::int64_t items = cuda::PartlyOneByOne<F> ? 32 : cuda::max_threads;
    const std::int64_t blocks = (n + items - 1) / items;
    // As many as run at once where warps line up what has work: each then sees more to choose from.
    const std::int64_t most = (cuda::Choosy<F> ? 2 : 8) * multiprocessors();
    launch_next(&cuda::max_kernel<M, F, G>, blocks < 1 ? 1 : (blocks < most ? blocks : most), 1,
                cuda::max_threads, n, f, context_->maxima, then, context_->arrivals);
}
template <int W, class F, class G, class A, class H>
void Cuda::sum_each(const SumSets& sets, const F& f, const G& then, A* parts, std::int64_t more,
                    const H& beside) {
    constexpr int warps = cuda::max_threads / 32;
    launch_next(&cuda::sum_kernel<W, F, G, A, H>, sets.places + (more + warps - 1) / warps, 1,
                cuda::max_threads, sets, f, parts, then, context_->arrivals, more, beside);
}

/// Mixed precision: whatever the particles are kept in, the grid and what goes to it and comes from
/// it are single.
class CudaMixed : public Cuda {
public:
    using Cuda::Cuda;
    using Base = Cuda;
    template <class>
    using Grid = float;
    template <class>
    using Sum = Cuda::Sum<float>;
    template <class>
    static constexpr int sum_bits = Cuda::sum_bits<float>;
};

}  // namespace mpm
