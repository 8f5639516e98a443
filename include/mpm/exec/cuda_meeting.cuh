// How devices that share a scene wait for each other, and where they do not reach each other's
// memory send what others need: between kernels, and without the host waiting for any of them.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "mpm/exec/communicator.hpp"
#include "mpm/exec/cuda.cuh"

namespace mpm {

/// Seconds for another rank that neither comes nor fails.
inline constexpr double rank_patience = 120;

/// One rank's side of it. Every method but `give_up` is called by all ranks alike.
class CudaMeeting {
public:
    /// Ranks of one process reach each other's memory (CudaPeers), others use NCCL (CudaParcels).
    static std::unique_ptr<CudaMeeting> open(Cuda& exec, Communicator& comm);
    virtual ~CudaMeeting() = default;

    /// Whether a rank's kernels read and write the memory of the others.
    virtual bool reaches() const = 0;
    /// Where they do: what is queued from here on begins when all ranks have done what they queued
    /// before.
    virtual void meet();
    /// Where they do not: queues that what the others gave is here. Of two ranks one gives what the
    /// other takes, in the same order and sizes.
    virtual void swap(const std::vector<Parcel>& out, const std::vector<Parcel>& in);
    /// Until all that is queued has run; throws where another rank has failed or does not come.
    virtual void wait() = 0;
    /// This rank has failed: what it has queued shall not wait for the others.
    virtual void give_up() noexcept = 0;
    /// After a failure.
    virtual void begin_anew() = 0;

protected:
    CudaMeeting() = default;
    CudaMeeting(const CudaMeeting&) = delete;
    CudaMeeting& operator=(const CudaMeeting&) = delete;
};

/// In one process. Two ways, the same for all ranks:
///
/// - events: each records one and waits for those of the others. Nothing on a device spins, so any
///   number of ranks may share one. The ranks' threads wait for each other to have queued it.
/// - flags: a kernel of one warp writes into the memory of the others and spins on its own. Only
///   where every rank has a device of its own: a kernel that spins must not keep another from
///   running. `LIBMPM_RANK_WAIT=flags` in the environment asks for it.
class CudaPeers final : public CudaMeeting {
public:
    /// Opens the memory of the ranks' devices to each other; throws DeviceError where they cannot
    /// reach it, or are not alike.
    CudaPeers(Cuda& exec, Communicator& comm);
    ~CudaPeers() override;

    bool reaches() const override { return true; }
    void meet() override;
    void wait() override;
    void give_up() noexcept override;
    void begin_anew() override;

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

class Nccl;

/// One process a device, by NCCL: what is given and taken runs on the stream, between kernels.
class CudaParcels final : public CudaMeeting {
public:
    /// Throws DeviceError, on all ranks, where one of them does not find NCCL, has the device of
    /// another, or one that is not like the others.
    CudaParcels(Cuda& exec, Communicator& comm);
    ~CudaParcels() override;

    bool reaches() const override { return false; }
    void swap(const std::vector<Parcel>& out, const std::vector<Parcel>& in) override;
    void wait() override;
    void give_up() noexcept override;
    void begin_anew() override;

private:
    /// Swaps that may be queued: a host that launches more than a device holds would block there,
    /// where it does not see that another rank has failed.
    static constexpr int most_queued = 32;

    void agree();
    void join();
    /// Polls until `done`, and meanwhile whether the others are at work.
    template <class Done>
    void poll(const Done& done);
    void look();
    void close() noexcept;

    Cuda& exec_;
    Communicator& comm_;
    std::vector<int> others_;
    const Nccl* nccl_ = nullptr;
    void* ring_ = nullptr;      // NCCL's communicator
    std::uint64_t number_ = 0;  // of swaps so far
    cudaEvent_t swapped_[most_queued] = {};
};

}  // namespace mpm
