// Ranks whose messages arrive late and out of order, and stop when they are told to.
#pragma once

#include <chrono>
#include <deque>
#include <random>
#include <thread>
#include <vector>

#include "mpm/exec/rank_threads.hpp"

namespace mpm::test {

/// A courier holds up to a handful of messages, of whichever ranks, and brings one of them at
/// random after a random while.
class UnrulyRanks final : public RankThreads {
public:
    UnrulyRanks(int ranks, unsigned seed, int most_microseconds = 50)
        : RankThreads(ranks), random_(seed), most_(most_microseconds) {
        courier_ = std::thread([this] { carry(); });
    }
    ~UnrulyRanks() override {
        {
            const std::lock_guard lock(mutex_);
            done_ = true;
        }
        wake_.notify_all();
        courier_.join();
    }
    /// How many messages were overtaken by a later one.
    std::uint64_t overtaken() const { return overtaken_; }

private:
    struct Held {
        Address where;
        Bytes bytes;
    };
    void send(const Address& where, Bytes bytes) override {
        {
            const std::lock_guard lock(mutex_);
            held_.push_back({where, std::move(bytes)});
        }
        wake_.notify_all();
    }
    void carry() {
        std::unique_lock lock(mutex_);
        while (true) {
            wake_.wait(lock, [&] { return done_ || !held_.empty(); });
            if (held_.empty()) return;
            const int pause = std::uniform_int_distribution<int>(0, most_)(random_);
            lock.unlock();
            std::this_thread::sleep_for(std::chrono::microseconds(pause));
            lock.lock();
            const std::size_t k =
                std::uniform_int_distribution<std::size_t>(0, held_.size() - 1)(random_);
            overtaken_ += k;
            Held next = std::move(held_[k]);
            held_.erase(held_.begin() + std::ptrdiff_t(k));
            lock.unlock();
            deliver(next.where, std::move(next.bytes));
            lock.lock();
        }
    }

    std::mutex mutex_;
    std::condition_variable wake_;
    std::deque<Held> held_;
    std::mt19937 random_;
    int most_;
    bool done_ = false;
    std::uint64_t overtaken_ = 0;
    std::thread courier_;
};

}  // namespace mpm::test
