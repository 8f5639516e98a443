// A mutex that threads get in the order in which they ask. Whoever steps a simulation gives it back
// for moments only and takes it again at once: with a plain mutex a reader might wait for ever.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace mpm {

class FairMutex {
public:
    /// Whether it is free and nobody waits for it; then it is the caller's.
    bool try_lock() {
        const std::lock_guard<std::mutex> held(mutex_);
        if (serving_ != next_) return false;
        ++next_;
        return true;
    }
    void lock() {
        std::unique_lock<std::mutex> held(mutex_);
        const std::uint64_t mine = next_++;
        turn_.wait(held, [&] { return serving_ == mine; });
    }
    void unlock() {
        {
            const std::lock_guard<std::mutex> held(mutex_);
            ++serving_;
        }
        turn_.notify_all();
    }

private:
    std::mutex mutex_;
    std::condition_variable turn_;
    std::uint64_t next_ = 0, serving_ = 0;  // the next number to give out, and whose turn it is
};

}  // namespace mpm
