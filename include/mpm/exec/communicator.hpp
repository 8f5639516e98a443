// How ranks speak to each other. A rank is one device, or one domain on a CPU, with its own state;
// what it must know of others it is told through this seam, and no text above knows whether the
// others are threads or processes. A run on one rank has no communicator at all.
#pragma once

#include <cstdint>
#include <cstring>
#include <functional>
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

/// What is wrong with a message: "a list of 3 bytes". Whoever knows the sender says so.
struct MessageError : Error {
    using Error::Error;
};
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
    std::size_t left() const { return left_; }
    /// All that is left, which has so many bytes, is read elsewhere.
    void leave(std::size_t bytes) {
        if (left_ != bytes)
            throw MessageError("with " + std::to_string(left_) + " bytes in place of " +
                               std::to_string(bytes));
        at_ += left_;
        left_ = 0;
    }
    /// Throws where anything is left.
    void end() const {
        if (left_ > 0)
            throw MessageError("with " + std::to_string(left_) +
                               " bytes behind what it should hold");
    }

private:
    void require(std::size_t n, std::size_t size) const {
        if (n > left_ / size) throw MessageError("that is shorter than what it should hold");
    }

    Bytes::const_pointer at_;
    std::size_t left_;
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

    /// The same, and read(rank, Unpacker&) for each message: to its end, and so that it may be read
    /// once more. Nothing of a message is believed before it is read; where reading throws
    /// MessageError, that becomes a DeviceError which says who has sent what. Returns the messages.
    template <class Read>
    std::vector<Bytes> exchange_and_read(std::vector<Bytes> to, const std::vector<int>& peers,
                                         const char* what, const Read& read) {
        std::vector<Bytes> in = exchange(std::move(to), peers);
        for (int p : peers) {
            const Reader reader = [&](const Bytes& bytes) {
                Unpacker from(bytes);
                read(p, from);
                from.end();
            };
            try {
                hand_over(p, what, in[std::size_t(p)], reader);
            } catch (const MessageError& e) {
                throw DeviceError("rank " + std::to_string(p) + " has sent rank " +
                                  std::to_string(rank()) + " " + what + " " + e.what() +
                                  ". All ranks must run the same version of libmpm with the same "
                                  "scene; start them again");
            }
        }
        return in;
    }

    /// All ranks but this one.
    std::vector<int> others() const {
        std::vector<int> out;
        for (int r = 0; r < ranks(); ++r)
            if (r != rank()) out.push_back(r);
        return out;
    }
    /// Lists of everyone, by rank. `check(list, rank)` throws MessageError where another's cannot
    /// be.
    template <class E, class Check>
    std::vector<std::vector<E>> all_gather(const std::vector<E>& mine, const char* what,
                                           const Check& check) {
        static_assert(std::is_trivially_copyable_v<E>);
        Bytes bytes(mine.size() * sizeof(E));
        if (!mine.empty()) std::memcpy(bytes.data(), mine.data(), bytes.size());
        std::vector<std::vector<E>> out{std::size_t(ranks())};
        exchange_and_read(
            std::vector<Bytes>(out.size(), bytes), others(), what, [&](int r, Unpacker& from) {
                if (from.left() % sizeof(E) != 0)
                    throw MessageError("of " + std::to_string(from.left()) + " bytes");
                std::vector<E> list(from.left() / sizeof(E));
                from.get(list.data(), list.size());
                check(list, r);
                out[std::size_t(r)] = std::move(list);
            });
        out[std::size_t(rank())] = mine;
        return out;
    }
    template <class E>
    std::vector<std::vector<E>> all_gather(const std::vector<E>& mine,
                                           const char* what = "a list") {
        return all_gather(mine, what, [](const std::vector<E>&, int) {});
    }
    /// The same where all have as many.
    template <class E>
    std::vector<std::vector<E>> all_gather_alike(const std::vector<E>& mine,
                                                 const char* what = "a list") {
        return all_gather(mine, what, [&](const std::vector<E>& theirs, int) {
            if (theirs.size() != mine.size())
                throw MessageError("of " + std::to_string(theirs.size()) + " in place of " +
                                   std::to_string(mine.size()));
        });
    }
    /// One of each, by rank.
    template <class E>
    std::vector<E> tell(const E& mine, const char* what) {
        std::vector<E> out;
        for (const auto& list : all_gather_alike(std::vector<E>{mine}, what))
            out.push_back(list[0]);
        return out;
    }

protected:
    using Reader = std::function<void(const Bytes&)>;
    /// A message, and what it is, on its way to who reads it. Tests override it to give others in
    /// its place.
    virtual void hand_over(int /*from*/, const char* /*what*/, Bytes& bytes, const Reader& read) {
        read(bytes);
    }
};

}  // namespace mpm
