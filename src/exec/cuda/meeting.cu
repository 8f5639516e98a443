#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <string>
#include <thread>

#include "mpm/exec/cuda_meeting.cuh"

namespace mpm {

namespace {

struct Addresses {
    unsigned long long* of[most_devices];
};

__device__ __forceinline__ unsigned long long nanoseconds() {
    unsigned long long t;
    asm volatile("mov.u64 %0, %%globaltimer;" : "=l"(t));
    return t;
}

/// A thread for each other rank: tells it, and waits until it has told.
__global__ void meet_kernel(const __grid_constant__ Addresses flags, int rank, int ranks,
                            unsigned long long number, unsigned long long most_nanoseconds,
                            int* gave_up, volatile int* stopped) {
    const int r = int(threadIdx.x);
    if (r >= ranks || r == rank) return;
    __threadfence_system();
    asm volatile("st.release.sys.global.u64 [%0], %1;" ::"l"(flags.of[r] + rank), "l"(number)
                 : "memory");
    if (*static_cast<volatile int*>(gave_up)) return;
    const unsigned long long* mine = flags.of[rank] + r;
    const unsigned long long began = nanoseconds();
    for (unsigned tries = 1;; ++tries) {
        unsigned long long told;
        asm volatile("ld.acquire.sys.global.u64 %0, [%1];" : "=l"(told) : "l"(mine) : "memory");
        if (told >= number) break;
        if (tries % 1024 != 0) continue;
        const bool late = nanoseconds() - began > most_nanoseconds;
        if (!late && stopped[0] == 0) continue;
        if (late) stopped[1] = r + 1;
        *static_cast<volatile int*>(gave_up) = 1;
        break;
    }
}

std::string name_of(int device) { return "cuda:" + std::to_string(device); }

}  // namespace

void Cuda::reach(int other) {
    if (other == device()) return;
    const cuda::DeviceGuard guard(device());
    const std::string pair =
        "cuda:" + std::to_string(device()) + " and cuda:" + std::to_string(other);
    int can = 0, atomics = 0;
    MPM_CUDA(cudaDeviceCanAccessPeer(&can, device(), other));
    if (can)
        MPM_CUDA(cudaDeviceGetP2PAttribute(&atomics, cudaDevP2PAttrNativeAtomicSupported, device(),
                                           other));
    if (!can || !atomics)
        throw DeviceError(pair + " cannot share a scene: " +
                          (can ? "neither adds natively in the memory of the other"
                               : "neither reaches the memory of the other") +
                          ". Choose devices between which `nvidia-smi topo -p2p a` says OK, as "
                          "NVLink gives it, or run on one of them");
    const cudaError_t code = cudaDeviceEnablePeerAccess(other, 0);
    if (code == cudaErrorPeerAccessAlreadyEnabled)
        cudaGetLastError();
    else
        MPM_CUDA(code);
    cudaMemAccessDesc access{};
    access.location.type = cudaMemLocationTypeDevice;
    access.location.id = other;
    access.flags = cudaMemAccessFlagsProtReadWrite;
    MPM_CUDA(cudaMemPoolSetAccess(context_->pool, &access, 1));
}

std::unique_ptr<CudaMeeting> CudaMeeting::open(Cuda& exec, Communicator& comm) {
    if (comm.one_process()) return std::make_unique<CudaPeers>(exec, comm);
    return std::make_unique<CudaParcels>(exec, comm);
}
void CudaMeeting::meet() { throw DeviceError("ranks that do not reach each other cannot meet"); }
void CudaMeeting::swap(const std::vector<Parcel>&, const std::vector<Parcel>&) {
    throw DeviceError("ranks that reach each other's memory send nothing");
}

CudaPeers::CudaPeers(Cuda& exec, Communicator& comm) : exec_(exec), comm_(comm) {
    const int me = comm.rank(), ranks = comm.ranks();
    if (ranks > most_devices)
        throw DeviceError("the scene has " + std::to_string(ranks) +
                          " devices; one process takes at most " + std::to_string(most_devices) +
                          ". Take fewer, or a process for each with ranks=\"processes\"");
    const cuda::DeviceGuard guard(exec.device());
    try {
        for (cudaEvent_t& event : post_->event)
            MPM_CUDA(cudaEventCreateWithFlags(&event, cudaEventDisableTiming));
        MPM_CUDA(cudaMalloc(&flags_, std::size_t(ranks) * sizeof *flags_));
        MPM_CUDA(cudaMalloc(&gave_up_, sizeof *gave_up_));
        MPM_CUDA(cudaMemset(flags_, 0, std::size_t(ranks) * sizeof *flags_));
        MPM_CUDA(cudaMemset(gave_up_, 0, sizeof *gave_up_));
        int* pinned = nullptr;
        MPM_CUDA(cudaMallocHost(&pinned, 2 * sizeof(int)));
        stopped_ = pinned;
        stopped_[0] = 0;
        stopped_[1] = 0;
        MPM_CUDA(cudaDeviceSynchronize());
        const auto told = comm.all_gather(
            std::vector<Told>{{exec.device(), exec.multiprocessors(), post_.get(), flags_}});
        bool apart = true;
        for (int r = 0; r < ranks; ++r) {
            const Told& t = told[std::size_t(r)].at(0);
            for (int other = 0; other < r; ++other)
                apart = apart && told[std::size_t(other)].at(0).device != t.device;
            if (t.multiprocessors != exec.multiprocessors())
                throw DeviceError(name_of(exec.device()) + " has " +
                                  std::to_string(exec.multiprocessors()) + " multiprocessors and " +
                                  name_of(t.device) + " " + std::to_string(t.multiprocessors) +
                                  "; devices that share a scene must be alike, or its bits would "
                                  "depend on which of them it runs on");
            if (r != me) exec.reach(t.device);
            posts_.push_back(t.post);
            all_flags_.push_back(t.flags);
        }
        const char* asked = std::getenv("LIBMPM_RANK_WAIT");
        by_flags_ = apart && asked != nullptr && std::string(asked) == "flags";
        comm.all_gather(std::vector<int>{1});  // nobody reaches before all have opened
    } catch (...) {
        close();
        throw;
    }
}

CudaPeers::~CudaPeers() { close(); }

void CudaPeers::close() noexcept {
    int before = -1;
    cudaGetDevice(&before);
    cudaSetDevice(exec_.device());
    give_up();
    cudaStreamSynchronize(exec_.stream());
    for (cudaEvent_t event : post_->event)
        if (event) cudaEventDestroy(event);
    if (flags_) cudaFree(flags_);
    if (gave_up_) cudaFree(gave_up_);
    if (stopped_) cudaFreeHost(const_cast<int*>(stopped_));
    flags_ = nullptr;
    gave_up_ = nullptr;
    stopped_ = nullptr;
    if (before >= 0) cudaSetDevice(before);
    cudaGetLastError();
}

void CudaPeers::meet() {
    const int me = comm_.rank(), ranks = comm_.ranks();
    ++number_;
    if (by_flags_) {
        Addresses flags{};
        for (int r = 0; r < ranks; ++r) flags.of[r] = all_flags_[std::size_t(r)];
        exec_.launch(&meet_kernel, 1, 1, 32, flags, me, ranks,
                     static_cast<unsigned long long>(number_),
                     static_cast<unsigned long long>(rank_patience * 1e9), gave_up_, stopped_);
        return;
    }
    const cuda::DeviceGuard guard(exec_.device());
    const std::size_t turn = number_ % 2;
    MPM_CUDA(cudaEventRecord(post_->event[turn], exec_.stream()));
    post_->recorded.store(number_, std::memory_order_release);
    const auto began = std::chrono::steady_clock::now();
    for (int r = 0; r < ranks; ++r) {
        if (r == me) continue;
        const Post& theirs = *posts_[std::size_t(r)];
        // They cannot be two meetings ahead, so what they have recorded last is for this one or the
        // next, in its own event.
        for (unsigned tries = 1; theirs.recorded.load(std::memory_order_acquire) < number_;
             ++tries) {
            if (tries % 256 != 0) continue;
            comm_.check();
            const std::chrono::duration<double> waited = std::chrono::steady_clock::now() - began;
            if (waited.count() > rank_patience)
                throw DeviceError("rank " + std::to_string(me) + " has waited " +
                                  std::to_string(int(rank_patience)) + " s for rank " +
                                  std::to_string(r) + ", which has not come");
            std::this_thread::yield();
        }
        MPM_CUDA(cudaStreamWaitEvent(exec_.stream(), theirs.event[turn], 0));
    }
    exec_.after_wait();
}

void CudaPeers::wait() {
    if (by_flags_) {
        const cuda::DeviceGuard guard(exec_.device());
        // While a kernel spins nobody may block: a rank that has failed will never answer it.
        for (unsigned tries = 1;; ++tries) {
            const cudaError_t code = cudaStreamQuery(exec_.stream());
            if (code == cudaSuccess) break;
            if (code != cudaErrorNotReady) MPM_CUDA(code);
            cudaGetLastError();
            if (tries % 64 == 0) comm_.check();
            std::this_thread::yield();
        }
    } else {
        exec_.wait();
    }
    comm_.check();
    if (stopped_[1] != 0)
        throw DeviceError("rank " + std::to_string(comm_.rank()) + " has waited " +
                          std::to_string(int(rank_patience)) + " s for rank " +
                          std::to_string(stopped_[1] - 1) + ", which has not come");
}

void CudaPeers::give_up() noexcept {
    if (stopped_) stopped_[0] = 1;
}

void CudaPeers::begin_anew() {
    const cuda::DeviceGuard guard(exec_.device());
    exec_.wait();
    MPM_CUDA(cudaMemset(gave_up_, 0, sizeof *gave_up_));
    MPM_CUDA(cudaDeviceSynchronize());
    stopped_[0] = 0;
    stopped_[1] = 0;
    for (const auto& theirs : comm_.all_gather(std::vector<std::uint64_t>{number_}))
        number_ = std::max(number_, theirs.at(0));
}

}  // namespace mpm
