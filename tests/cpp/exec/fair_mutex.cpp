// One thread at a time, and in the order of asking: a loop that takes the mutex again at once keeps
// nobody out. Compiled with the thread sanitizer too.
#include "mpm/exec/fair_mutex.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

namespace mpm {
namespace {

TEST(FairMutex, one_thread_at_a_time) {
    FairMutex mutex;
    long plain = 0, tried = 0;  // the sanitizer sees a race if two are inside
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t)
        threads.emplace_back([&] {
            for (int k = 0; k < 500; ++k) {
                if (k % 3 != 0) {
                    mutex.lock();
                } else if (!mutex.try_lock()) {
                    continue;
                } else {
                    ++tried;
                }
                ++plain;
                mutex.unlock();
            }
        });
    for (auto& t : threads) t.join();
    EXPECT_GE(plain, 4 * 333);
    EXPECT_EQ(plain - tried, 4 * 333);
}

TEST(FairMutex, a_loop_keeps_nobody_out) {
    FairMutex mutex;
    std::atomic<bool> over{false};
    long state = 0;
    std::thread loop([&] {
        while (!over) {
            mutex.lock();
            ++state;
            mutex.unlock();
        }
    });
    std::vector<long> seen;
    for (int k = 0; k < 200; ++k) {
        mutex.lock();
        seen.push_back(state);
        mutex.unlock();
    }
    over = true;
    loop.join();
    for (std::size_t k = 1; k < seen.size(); ++k) EXPECT_GE(seen[k], seen[k - 1]);
}

TEST(FairMutex, threads_come_in_the_order_of_asking) {
    FairMutex mutex;
    std::vector<int> order;
    std::vector<std::thread> threads;
    mutex.lock();
    for (int t = 0; t < 5; ++t) {
        std::atomic<bool> asks{false};
        threads.emplace_back([&, t] {
            asks = true;
            mutex.lock();
            order.push_back(t);
            mutex.unlock();
        });
        while (!asks) std::this_thread::yield();
        std::this_thread::sleep_for(std::chrono::milliseconds(20));  // now it waits
    }
    EXPECT_FALSE(mutex.try_lock());
    mutex.unlock();
    for (auto& t : threads) t.join();
    EXPECT_EQ(order, (std::vector<int>{0, 1, 2, 3, 4}));
    EXPECT_TRUE(mutex.try_lock());
    EXPECT_FALSE(mutex.try_lock());
    mutex.unlock();
}

}  // namespace
}  // namespace mpm
