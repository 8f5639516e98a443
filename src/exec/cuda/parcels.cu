#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <string>
#include <thread>

#include "mpm/exec/cuda_meeting.cuh"
#include "nccl.hpp"

namespace mpm {

namespace {

/// What ranks tell each other before they join: whether, and with which device.
struct Ready {
    int multiprocessors = 0;
    char device[16] = {};  // its number in the world
    char why[1024] = {};   // not; "" if ready
};

/// Joining waits for the others in a place where it cannot be told that one has failed, so it has
/// a thread of its own, which owns what it works with.
struct Joining {
    std::atomic<bool> done{false};
    const Nccl* nccl = nullptr;
    int device = 0, rank = 0, ranks = 0;
    Nccl::Id id{};
    void* ring = nullptr;
    std::string failed;

    void run() noexcept {
        try {
            MPM_CUDA(cudaSetDevice(device));
            nccl->check(nccl->comm_init_rank(&ring, ranks, id, rank), "ncclCommInitRank", ring);
            greet();
        } catch (const std::exception& e) {
            failed = e.what();
        }
        done.store(true, std::memory_order_release);
    }
    /// A byte to and from everyone: connections are made by the first that uses them.
    void greet() {
        char* bytes = nullptr;
        cudaStream_t stream = nullptr;
        MPM_CUDA(cudaMalloc(&bytes, 2 * std::size_t(ranks)));
        MPM_CUDA(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
        nccl->check(nccl->group_start(), "ncclGroupStart");
        int code = Nccl::success;
        for (int r = 0; r < ranks && code == Nccl::success; ++r) {
            if (r == rank) continue;
            code = nccl->send(bytes + r, 1, Nccl::bytes, r, ring, stream);
            if (code == Nccl::success)
                code = nccl->recv(bytes + ranks + r, 1, Nccl::bytes, r, ring, stream);
        }
        const int ended = nccl->group_end();
        nccl->check(code != Nccl::success ? code : ended, "first words", ring);
        MPM_CUDA(cudaStreamSynchronize(stream));
        MPM_CUDA(cudaStreamDestroy(stream));
        MPM_CUDA(cudaFree(bytes));
    }
};

}  // namespace

CudaParcels::CudaParcels(Cuda& exec, Communicator& comm)
    : exec_(exec), comm_(comm), others_(comm.others()) {
    const cuda::DeviceGuard guard(exec.device());
    try {
        agree();
        join();
        for (cudaEvent_t& event : swapped_)
            MPM_CUDA(cudaEventCreateWithFlags(&event, cudaEventDisableTiming));
    } catch (...) {
        close();
        throw;
    }
}

CudaParcels::~CudaParcels() { close(); }

/// Who cannot take part says so before anyone waits for it.
void CudaParcels::agree() {
    Ready mine;
    mine.multiprocessors = exec_.multiprocessors();
    try {
        cudaDeviceProp properties{};
        MPM_CUDA(cudaGetDeviceProperties(&properties, exec_.device()));
        static_assert(sizeof properties.uuid == sizeof mine.device);
        std::memcpy(mine.device, &properties.uuid, sizeof mine.device);
        nccl_ = &Nccl::open();
    } catch (const std::exception& e) {
        std::strncpy(mine.why, e.what(), sizeof mine.why - 1);
        if (mine.why[0] == 0) mine.why[0] = '?';
    }
    const auto told = comm_.all_gather(std::vector<Ready>{mine});
    const auto name = [](std::size_t r) { return "rank " + std::to_string(r); };
    for (std::size_t r = 0; r < told.size(); ++r)
        if (told[r].at(0).why[0] != 0) throw DeviceError(name(r) + ": " + told[r].at(0).why);
    for (std::size_t r = 0; r < told.size(); ++r) {
        const Ready& a = told[r].at(0);
        for (std::size_t k = 0; k < r; ++k) {
            if (std::memcmp(told[k].at(0).device, a.device, sizeof a.device) == 0)
                throw DeviceError(name(k) + " and " + name(r) +
                                  " are processes with the same CUDA device; start as many as "
                                  "there are devices, or name the device of each by "
                                  "CUDA_VISIBLE_DEVICES");
        }
        if (a.multiprocessors != told[0].at(0).multiprocessors)
            throw DeviceError("the device of " + name(r) + " has " +
                              std::to_string(a.multiprocessors) + " multiprocessors and that of " +
                              name(0) + " " + std::to_string(told[0].at(0).multiprocessors) +
                              "; devices that share a scene must be alike, or its bits would "
                              "depend on which of them it runs on");
    }
}

void CudaParcels::join() {
    std::vector<Nccl::Id> mine;
    if (comm_.rank() == 0) nccl_->check(nccl_->get_unique_id(&mine.emplace_back()), "an id");
    const auto joining = std::make_shared<Joining>();
    joining->nccl = nccl_;
    joining->device = exec_.device();
    joining->rank = comm_.rank();
    joining->ranks = comm_.ranks();
    joining->id = comm_.all_gather(mine)[0].at(0);
    std::thread([joining] { joining->run(); }).detach();
    const auto done = [&] { return joining->done.load(std::memory_order_acquire); };
    while (!done()) {
        comm_.check_awaited(others_);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ring_ = joining->ring;
    if (!joining->failed.empty()) throw DeviceError(joining->failed);
    comm_.all_gather(std::vector<int>{1});  // a rank that fails here is known before the first swap
}

void CudaParcels::close() noexcept {
    int before = -1;
    cudaGetDevice(&before);
    cudaSetDevice(exec_.device());
    give_up();
    cudaStreamSynchronize(exec_.stream());
    for (cudaEvent_t& event : swapped_) {
        if (event) cudaEventDestroy(event);
        event = nullptr;
    }
    if (before >= 0) cudaSetDevice(before);
    cudaGetLastError();
}

void CudaParcels::look() {
    comm_.check_awaited(others_);
    if (!ring_) return;  // given up: what is queued comes to its end by itself
    int state = Nccl::success;
    nccl_->check(nccl_->comm_get_async_error(ring_, &state), "ncclCommGetAsyncError", ring_);
    if (state != Nccl::in_progress) nccl_->check(state, "between kernels", ring_);
}

template <class Done>
void CudaParcels::poll(const Done& done) {
    if (done()) return;
    const auto began = std::chrono::steady_clock::now();
    for (unsigned tries = 1; !done(); ++tries) {
        if (tries % 64 == 0) {
            look();
            const std::chrono::duration<double> waited = std::chrono::steady_clock::now() - began;
            if (waited.count() > rank_patience)
                throw DeviceError("rank " + std::to_string(comm_.rank()) + " has waited " +
                                  std::to_string(int(rank_patience)) +
                                  " s for the others, of whom one has not come");
        }
        std::this_thread::yield();
    }
}

void CudaParcels::swap(const std::vector<Parcel>& out, const std::vector<Parcel>& in) {
    if (out.empty() && in.empty()) return;
    if (!ring_) throw DeviceError("this rank no longer speaks with the others after a failure");
    const cuda::DeviceGuard guard(exec_.device());
    cudaEvent_t& mark = swapped_[number_ % most_queued];
    try {
        if (number_ >= std::uint64_t(most_queued)) {
            poll([&] {
                const cudaError_t code = cudaEventQuery(mark);
                if (code == cudaSuccess) return true;
                if (code != cudaErrorNotReady) MPM_CUDA(code);
                cudaGetLastError();
                return false;
            });
        }
        nccl_->check(nccl_->group_start(), "ncclGroupStart", ring_);
        int code = Nccl::success;
        for (const Parcel& p : out) {
            if (code != Nccl::success || p.bytes == 0) continue;
            code = nccl_->send(p.at, p.bytes, Nccl::bytes, p.rank, ring_, exec_.stream());
        }
        for (const Parcel& p : in) {
            if (code != Nccl::success || p.bytes == 0) continue;
            code = nccl_->recv(p.at, p.bytes, Nccl::bytes, p.rank, ring_, exec_.stream());
        }
        const int ended = nccl_->group_end();
        nccl_->check(code != Nccl::success ? code : ended, "a swap", ring_);
    } catch (...) {
        give_up();
        throw;
    }
    MPM_CUDA(cudaEventRecord(mark, exec_.stream()));
    ++number_;
    exec_.after_wait();
}

void CudaParcels::wait() {
    const cuda::DeviceGuard guard(exec_.device());
    try {
        poll([&] {
            const cudaError_t code = cudaStreamQuery(exec_.stream());
            if (code == cudaSuccess) return true;
            if (code != cudaErrorNotReady) MPM_CUDA(code);
            cudaGetLastError();
            return false;
        });
    } catch (...) {
        give_up();  // or whoever waits for the stream from here on would wait for ever
        throw;
    }
}

void CudaParcels::give_up() noexcept {
    if (ring_) nccl_->comm_abort(ring_);
    ring_ = nullptr;
}

void CudaParcels::begin_anew() { wait(); }

}  // namespace mpm
