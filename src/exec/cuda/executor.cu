#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>
#include <thread>
#include <unordered_map>
#include <vector>

#include "mpm/exec/cuda.cuh"
#include "mpm/exec/cuda_devices.hpp"

namespace mpm {

void cuda::check(cudaError_t code, const char* what, const char* file, int line) {
    if (code == cudaSuccess) return;
    const std::string text = std::string(cudaGetErrorName(code)) + ": " + cudaGetErrorString(code) +
                             " (" + what + ", " + file + ":" + std::to_string(line) + ")";
    cudaGetLastError();  // a refused allocation or launch is no lasting state
    if (code == cudaErrorMemoryAllocation) throw CapacityError("out of device memory: " + text);
    throw DeviceError(text);
}

std::vector<CudaDevice> cuda_devices() {
    int count = 0;  // left as it is when the call fails
    const cudaError_t code = cudaGetDeviceCount(&count);
    if (code != cudaSuccess) {
        cudaGetLastError();
        throw DeviceError(std::string("no CUDA device can be used: ") + cudaGetErrorString(code));
    }
    std::vector<CudaDevice> out;
    for (int k = 0; k < count; ++k) {
        const cuda::DeviceGuard guard(k);
        cudaDeviceProp properties{};
        MPM_CUDA(cudaGetDeviceProperties(&properties, k));
        CudaDevice d;
        d.index = k;
        d.name = properties.name;
        // Asking for what is free makes a context, which takes some hundred MiB itself. A device on
        // which others hold all is there, and full: the run that wants it says so.
        d.memory = properties.totalGlobalMem;
        const cudaError_t asked = cudaMemGetInfo(&d.free, &d.memory);
        if (asked == cudaErrorMemoryAllocation) {
            cudaGetLastError();
            d.free = 0;
        } else {
            MPM_CUDA(asked);
        }
        d.compute_capability =
            std::to_string(properties.major) + "." + std::to_string(properties.minor);
        out.push_back(d);
    }
    return out;
}

std::string cuda_runtime() {
    int version = 0;
    MPM_CUDA(cudaRuntimeGetVersion(&version));
    return std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

// Large pieces bypass the pool, which rounds up what it takes: 3.05e9 bytes held for 2.78e9 in use
// at 64 M particles. Those freed are kept for the next of about their size.
struct Cuda::Context::Pieces {
    struct Kept {
        void* p;
        std::size_t bytes;
        int missed;  // times that it did not fit what was asked for
    };
    std::vector<Kept> kept;
    std::unordered_map<void*, std::size_t> given;  // what pieces in use really have
    Peak now, most;
};

Cuda::Context::Context(int device, bool shared)
    : device(device), shared(shared), pieces(std::make_unique<Pieces>()) {
    int count = 0;
    const cudaError_t code = cudaGetDeviceCount(&count);
    if (code != cudaSuccess) {
        cudaGetLastError();
        throw DeviceError(std::string("no CUDA device can be used: ") + cudaGetErrorString(code));
    }
    if (device < 0 || device >= count) {
        throw DeviceError("there is no CUDA device " + std::to_string(device) + "; found " +
                          std::to_string(count) +
                          ". Choose one of cuda:0 to cuda:" + std::to_string(count - 1));
    }
    const cuda::DeviceGuard guard(device);
    MPM_CUDA(cudaDeviceGetAttribute(&multiprocessors, cudaDevAttrMultiProcessorCount, device));
    int major = 0;
    MPM_CUDA(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, device));
    // A kernel built for less has no `after_previous`, on whatever device it runs. On a shared
    // device blocks that wait for the kernel before them would hold room that others could use.
    overlaps = !shared && major >= 9 && cuda::built_from(900);
    barriers = major >= 8 && cuda::built_from(800);
    int pools = 0;
    MPM_CUDA(cudaDeviceGetAttribute(&pools, cudaDevAttrMemoryPoolsSupported, device));
    if (!pools) {
        throw DeviceError("CUDA device " + std::to_string(device) +
                          " has no memory pools; use another device or device='cpu'");
    }
    try {
        MPM_CUDA(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
        MPM_CUDA(cudaStreamCreateWithFlags(&side, cudaStreamNonBlocking));
        MPM_CUDA(cudaEventCreateWithFlags(&event, cudaEventDisableTiming));
        cudaMemPoolProps properties{};
        properties.allocType = cudaMemAllocationTypePinned;
        properties.location.type = cudaMemLocationTypeDevice;
        properties.location.id = device;
        MPM_CUDA(cudaMemPoolCreate(&pool, &properties));
        // What a sort has used stays for the next one.
        std::uint64_t keep = ~std::uint64_t(0);
        MPM_CUDA(cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &keep));
        MPM_CUDA(cudaMallocHost(&staging, staging_bytes));
        MPM_CUDA(cudaMalloc(&maxima, max_maxima * sizeof(double)));
        MPM_CUDA(cudaMalloc(&arrivals, sizeof(std::uint32_t)));
        MPM_CUDA(cudaMemsetAsync(maxima, 0, max_maxima * sizeof(double), stream));
        MPM_CUDA(cudaMemsetAsync(arrivals, 0, sizeof(std::uint32_t), stream));
    } catch (...) {
        close();
        throw;
    }
}

Cuda::Context::~Context() { close(); }

void Cuda::Context::close() noexcept {
    int before = -1;
    cudaGetDevice(&before);
    cudaSetDevice(device);
    if (side) cudaStreamSynchronize(side);
    if (stream) cudaStreamSynchronize(stream);
    if (staging) cudaFreeHost(staging);
    if (maxima) cudaFree(maxima);
    if (arrivals) cudaFree(arrivals);
    if (pool) cudaMemPoolDestroy(pool);
    for (const Pieces::Kept& k : pieces->kept) cudaFree(k.p);
    if (event) cudaEventDestroy(event);
    if (side) cudaStreamDestroy(side);
    if (stream) cudaStreamDestroy(stream);
    if (before >= 0) cudaSetDevice(before);
    cudaGetLastError();
}

Cuda::Cuda(int device, bool shared) : context_(std::make_unique<Context>(device, shared)) {}

void Cuda::side_stream() {
    const cuda::DeviceGuard guard(device());
    MPM_CUDA(cudaEventRecord(context_->event, context_->stream));
    MPM_CUDA(cudaStreamWaitEvent(context_->side, context_->event, 0));
    context_->beside = true;
    context_->order = Context::apart;
}

void Cuda::join() {
    const cuda::DeviceGuard guard(device());
    context_->beside = false;
    context_->order = Context::joined;
    MPM_CUDA(cudaEventRecord(context_->event, context_->side));
    MPM_CUDA(cudaStreamWaitEvent(context_->stream, context_->event, 0));
}

void* Cuda::allocate(std::size_t bytes) {
    const cuda::DeviceGuard guard(device());
    if (bytes >= large) return allocate_large(bytes);
    void* p = nullptr;
    cudaError_t code = cudaMallocFromPoolAsync(&p, bytes, context_->pool, stream());
    if (code == cudaErrorMemoryAllocation) {
        // Freed pieces may be too small each: give them back and try once more.
        cudaGetLastError();
        trim();
        code = cudaMallocFromPoolAsync(&p, bytes, context_->pool, stream());
    }
    if (code == cudaErrorMemoryAllocation) out_of_memory(bytes);
    MPM_CUDA(code);
    return p;
}

namespace {

/// A size that fits kept pieces also where numbers of particles change a little from sort to sort,
/// as they do on ranks: at most 1.6 % and 8 MiB more. A device gives memory by 2 MiB anyway.
std::size_t rounded_large(std::size_t bytes) {
    const std::size_t step =
        std::clamp(std::bit_floor(bytes / 64), std::size_t(2) << 20, std::size_t(8) << 20);
    return (bytes + step - 1) / step * step;
}

}  // namespace

/// The kept piece that fits best, or a new one. Whoever had it has queued all work on it before.
void* Cuda::allocate_large(std::size_t bytes) {
    bytes = rounded_large(bytes);
    Context::Pieces& c = *context_->pieces;
    // Tables of ranks grow and shrink by some hundredths from one to the next, and a new piece has
    // to be mapped into every device: one a little larger will do.
    auto best = c.kept.end();
    for (auto k = c.kept.begin(); k != c.kept.end(); ++k)
        if (k->bytes >= bytes && k->bytes <= bytes + bytes / 16 &&
            (best == c.kept.end() || k->bytes < best->bytes))
            best = k;
    void* p = nullptr;
    if (best != c.kept.end()) {
        p = best->p;
        bytes = best->bytes;
        c.kept.erase(best);
    } else {
        // Sizes change slowly while particles leave: what fits nothing any more goes back.
        for (Context::Pieces::Kept& k : c.kept) ++k.missed;
        free_kept(most_missed);
        cudaError_t code = cudaMalloc(&p, bytes);
        if (code == cudaErrorMemoryAllocation) {
            cudaGetLastError();
            trim();
            code = cudaMalloc(&p, bytes);
        }
        if (code == cudaErrorMemoryAllocation) out_of_memory(bytes);
        MPM_CUDA(code);
        c.now.held += bytes;
    }
    c.given[p] = bytes;
    c.now.used += bytes;
    c.most.used = std::max(c.most.used, c.now.used);
    c.most.held = std::max(c.most.held, c.now.held);
    return p;
}

/// Gives back what has been missed so often.
void Cuda::free_kept(int missed) {
    Context::Pieces& c = *context_->pieces;
    std::erase_if(c.kept, [&](const Context::Pieces::Kept& k) {
        if (k.missed < missed) return false;
        MPM_CUDA(cudaFree(k.p));
        c.now.held -= k.bytes;
        return true;
    });
}

void Cuda::out_of_memory(std::size_t bytes) {
    cudaGetLastError();
    std::size_t free = 0, total = 0;
    MPM_CUDA(cudaMemGetInfo(&free, &total));
    throw CapacityError("out of memory on CUDA device " + std::to_string(device()) + ": " +
                        std::to_string(bytes) + " bytes asked for in one piece, " +
                        std::to_string(free) + " of " + std::to_string(total) +
                        " free. Use fewer particles or another device");
}

void Cuda::release(void* p, std::size_t bytes) noexcept {
    if (bytes >= large) {
        Context::Pieces& c = *context_->pieces;
        const auto given = c.given.find(p);
        c.now.used -= given->second;
        c.kept.push_back({p, given->second, 0});
        c.given.erase(given);
        return;
    }
    int before = -1;
    cudaGetDevice(&before);
    if (before != device()) cudaSetDevice(device());
    if (cudaFreeAsync(p, stream()) != cudaSuccess) cudaGetLastError();
    if (before >= 0 && before != device()) cudaSetDevice(before);
}

void Cuda::copy(void* to, const void* from, std::size_t bytes) {
    if (bytes == 0) return;  // a rank may hold nothing at all
    const cuda::DeviceGuard guard(device());
    MPM_CUDA(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToDevice, stream()));
}

void Cuda::upload(void* to, const void* from, std::size_t bytes) {
    if (bytes == 0) return;  // a rank may hold nothing at all
    const cuda::DeviceGuard guard(device());
    MPM_CUDA(cudaMemcpyAsync(to, from, bytes, cudaMemcpyHostToDevice, stream()));
    MPM_CUDA(cudaStreamSynchronize(stream()));
}

void Cuda::download(void* to, const void* from, std::size_t bytes) {
    if (bytes == 0) return;  // a rank may hold nothing at all
    const cuda::DeviceGuard guard(device());
    const bool small = bytes <= staging_bytes;
    MPM_CUDA(cudaMemcpyAsync(small ? context_->staging : to, from, bytes, cudaMemcpyDeviceToHost,
                             stream()));
    MPM_CUDA(cudaStreamSynchronize(stream()));
    if (small) std::memcpy(to, context_->staging, bytes);
}

void Cuda::zero(void* p, std::size_t bytes) {
    if (bytes == 0) return;
    const cuda::DeviceGuard guard(device());
    MPM_CUDA(cudaMemsetAsync(p, 0, bytes, stream()));
}

void Cuda::wait() {
    const cuda::DeviceGuard guard(device());
    MPM_CUDA(cudaStreamSynchronize(stream()));
}

void Cuda::wait_for_all() noexcept {
    int before = -1;
    cudaGetDevice(&before);
    if (before != device()) cudaSetDevice(device());
    if (cudaDeviceSynchronize() != cudaSuccess) cudaGetLastError();
    if (before >= 0 && before != device()) cudaSetDevice(before);
}

void Cuda::trim() {
    wait();
    const cuda::DeviceGuard guard(device());
    free_kept(0);
    MPM_CUDA(cudaMemPoolTrimTo(context_->pool, 0));
}

Cuda::Peak Cuda::peak() const {
    const cuda::DeviceGuard guard(device());
    Peak sum;
    MPM_CUDA(cudaMemPoolGetAttribute(context_->pool, cudaMemPoolAttrUsedMemHigh, &sum.used));
    MPM_CUDA(cudaMemPoolGetAttribute(context_->pool, cudaMemPoolAttrReservedMemHigh, &sum.held));
    sum.used += context_->pieces->most.used;
    sum.held += context_->pieces->most.held;
    return sum;
}

void Cuda::host_each(std::int64_t n, const void* f, void (*call)(const void*, std::int64_t)) {
    const std::int64_t wanted = std::min<std::int64_t>(std::thread::hardware_concurrency(), n / 16);
    if (wanted < 2) {
        for (std::int64_t i = 0; i < n; ++i) call(f, i);
        return;
    }
    std::atomic<std::int64_t> next{0};
    const auto work = [&] {
        for (std::int64_t i; (i = next.fetch_add(16)) < n;) {
            for (std::int64_t k = i; k < std::min(i + 16, n); ++k) call(f, k);
        }
    };
    std::vector<std::thread> others;
    for (std::int64_t k = 1; k < std::min<std::int64_t>(wanted, 32); ++k) others.emplace_back(work);
    work();
    for (auto& t : others) t.join();
}

}  // namespace mpm
