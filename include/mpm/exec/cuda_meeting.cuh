// How devices of one process that share a scene wait for each other, between kernels and without
// the host waiting for any of them.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "mpm/exec/communicator.hpp"
#include "mpm/exec/cuda.cuh"

namespace mpm {

/// One rank's side of it. Two ways, the same for all ranks:
///
/// - events: each records one and waits for those of the others. Nothing on a device spins, so any
///   number of ranks may share one. The ranks' threads wait for each other to have queued it.
/// - flags: a kernel of one warp writes into the memory of the others and spins on its own. Only
///   where every rank has a device of its own: a kernel that spins must not keep another from
///   running. `LIBMPM_RANK_WAIT=flags` in the environment asks for it.
class CudaMeeting {
public:
    /// All ranks together. Opens the memory of their devices to each other; throws DeviceError
    /// where they cannot reach it, or are not alike.
    CudaMeeting(Cuda& exec, Communicator& comm);
    ~CudaMeeting();
    CudaMeeting(const CudaMeeting&) = delete;
    CudaMeeting& operator=(const CudaMeeting&) = delete;

    /// What is queued from here on begins when all ranks have done what they queued before.
    void meet();
    /// Until all that is queued has run; throws where another rank has failed or does not come.
    void wait();
    /// This rank has failed: what it has queued shall not wait for the others.
    void give_up() noexcept;
    /// All ranks together, after a failure.
    void begin_anew();
    bool by_flags() const { return by_flags_; }

private:
    struct Post {
        std::atomic<std::uint64_t> recorded{0};
        cudaEvent_t event[2] = {nullptr, nullptr};
    };
    struct Told {
        int device, multiprocessors;
        const Post* post;
        unsigned long long* flags;
    };
    void close() noexcept;

    Cuda& exec_;
    Communicator& comm_;
    bool by_flags_ = false;
    std::uint64_t number_ = 0;  // of meetings so far
    std::unique_ptr<Post> post_ = std::make_unique<Post>();
    std::vector<const Post*> posts_;       // by rank
    unsigned long long* flags_ = nullptr;  // (ranks,) of whom the last meeting came, on the device
    std::vector<unsigned long long*> all_flags_;
    int* gave_up_ = nullptr;           // on the device: one has waited in vain
    volatile int* stopped_ = nullptr;  // pinned: wait no longer; then, who did not come
};

}  // namespace mpm
