// How ranks speak to each other. A rank is one device, or one domain on a CPU, with its own state;
// what it must know of others it is told through this seam, and no text above knows whether the
// others are threads or processes. A run on one rank has no communicator at all.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "mpm/core/error.hpp"

namespace mpm {

using Bytes = std::vector<unsigned char>;

/// Devices of one process that share a scene: at most as many as a host has.
inline constexpr int most_devices = 16;
/// Ranks on devices, of all hosts: kernels know where the parts of all of them begin.
inline constexpr int most_device_ranks = 128;

/// Thrown where a rank waits for another that has failed.
struct RankStopped : Error {
    using Error::Error;
};

/// A piece of a device's memory that goes to another rank, or comes from it.
struct Parcel {
    void* at;
    std::size_t bytes;
    int rank;
};

class Communicator {
public:
    virtual ~Communicator() = default;
    virtual int rank() const = 0;
    virtual int ranks() const = 0;
    /// Whether all ranks are threads of one process, which can read each other's memory.
    virtual bool one_process() const { return true; }

    /// Gives to[p] to each of `peers` and returns, by rank, what they gave. Collective among peers:
    /// who lists a rank is listed by it, and both make the same calls in the same order. What
    /// arrives first is nobody's business.
    virtual std::vector<Bytes> exchange(std::vector<Bytes> to, const std::vector<int>& peers) = 0;

    /// Ends the work of all ranks: whoever waits now or later throws RankStopped with this text.
    virtual void stop(const std::string& why) noexcept = 0;
    /// Throws RankStopped where the work of all ranks has been ended: for who waits elsewhere.
    virtual void check() = 0;
    /// The same for who waits, elsewhere than here, for what these ranks have yet to do: also where
    /// one of them has ended.
    virtual void check_awaited(const std::vector<int>&) { check(); }

    /// All ranks but this one.
    std::vector<int> others() const {
        std::vector<int> out;
        for (int r = 0; r < ranks(); ++r)
            if (r != rank()) out.push_back(r);
        return out;
    }
    /// Lists of everyone, by rank.
    template <class E>
    std::vector<std::vector<E>> all_gather(const std::vector<E>& mine) {
        static_assert(std::is_trivially_copyable_v<E>);
        Bytes bytes(mine.size() * sizeof(E));
        if (!mine.empty()) std::memcpy(bytes.data(), mine.data(), bytes.size());
        const std::vector<Bytes> in =
            exchange(std::vector<Bytes>(std::size_t(ranks()), bytes), others());
        std::vector<std::vector<E>> out(in.size());
        for (int r = 0; r < ranks(); ++r) {
            auto& list = out[std::size_t(r)];
            const Bytes& from = in[std::size_t(r)];
            list.resize(from.size() / sizeof(E));
            if (!from.empty()) std::memcpy(list.data(), from.data(), from.size());
        }
        out[std::size_t(rank())] = mine;
        return out;
    }
};

/// Numbers one after another into a message, and out of it in the same order.
class Packer {
public:
    template <class E>
    void put(const E* data, std::size_t n) {
        static_assert(std::is_trivially_copyable_v<E>);
        const std::size_t at = bytes_.size();
        bytes_.resize(at + n * sizeof(E));
        if (n > 0) std::memcpy(bytes_.data() + at, data, n * sizeof(E));
    }
    template <class E>
    void put(const std::vector<E>& list) {
        const std::uint64_t n = list.size();
        put(&n, 1);
        put(list.data(), list.size());
    }
    Bytes take() { return std::exchange(bytes_, {}); }

private:
    Bytes bytes_;
};
class Unpacker {
public:
    explicit Unpacker(const Bytes& bytes) : at_(bytes.data()), left_(bytes.size()) {}
    template <class E>
    void get(E* data, std::size_t n) {
        require(n, sizeof(E));
        const std::size_t size = n * sizeof(E);
        if (size > 0) std::memcpy(data, at_, size);
        at_ += size;
        left_ -= size;
    }
    template <class E>
    std::vector<E> list() {
        std::uint64_t n = 0;
        get(&n, 1);
        require(n, sizeof(E));  // before memory is taken for them
        std::vector<E> out(n);
        get(out.data(), n);
        return out;
    }
    bool empty() const { return left_ == 0; }

private:
    void require(std::size_t n, std::size_t size) const {
        if (n > left_ / size)
            throw Error("a message between ranks is shorter than what it should hold");
    }

    Bytes::const_pointer at_;
    std::size_t left_;
};

}  // namespace mpm
