// The CPU executor's verbs against the standard library, at several thread counts and sizes around
// the limits from which they use threads.
#include "mpm/exec/cpu.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <set>
#include <vector>

#include "mpm/exec/buffer.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

constexpr int thread_counts[] = {1, 2, 3, 4, 7};

void expect_stable_order(int threads, const std::vector<std::uint32_t>& key, std::int64_t range) {
    Cpu exec(threads);
    std::vector<std::uint32_t> order(key.size(), ~0u), start(std::size_t(range) + 2, 12345),
        expected(key.size());
    exec.stable_order(key.data(), std::int64_t(key.size()), range, order.data(), start.data());
    std::iota(expected.begin(), expected.end(), 0u);
    std::stable_sort(expected.begin(), expected.end(),
                     [&](auto a, auto b) { return key[a] < key[b]; });
    ASSERT_TRUE(order == expected) << threads << " threads, " << key.size() << " keys";
    std::vector<std::uint32_t> sorted = key;
    std::sort(sorted.begin(), sorted.end());
    for (std::int64_t k = 0; k <= range; ++k) {
        const auto first =
            std::lower_bound(sorted.begin(), sorted.end(), std::uint32_t(k)) - sorted.begin();
        ASSERT_EQ(start[std::size_t(k)], std::uint32_t(first)) << "key " << k;
    }
    EXPECT_EQ(start[std::size_t(range) + 1], 12345u) << "wrote beyond the result";
}

TEST(CpuVerbs, stable_order) {
    test::Random random(9);
    for (int threads : thread_counts) {
        for (std::size_t n : {0, 1, 2, 1000, 65536, 65537, 150001}) {
            for (int range : {1, 64, 9999}) {
                std::vector<std::uint32_t> key(n);
                for (auto& k : key) k = std::uint32_t(random.integer(0, range));  // range included
                expect_stable_order(threads, key, range);
                std::sort(key.begin(), key.end());
                expect_stable_order(threads, key, range);
                for (auto& k : key) {  // nearly sorted, as between two steps
                    const int moved =
                        int(k) + (random.integer(0, 9) == 0 ? random.integer(-20, 20) : 0);
                    k = std::uint32_t(std::clamp(moved, 0, range));
                }
                expect_stable_order(threads, key, range);
                std::reverse(key.begin(), key.end());
                expect_stable_order(threads, key, range);
            }
        }
        expect_stable_order(threads, std::vector<std::uint32_t>(100000, 3), 3);
    }
}

TEST(CpuVerbs, exclusive_scan) {
    test::Random random(10);
    for (int n : {0, 1, 7, 100000}) {
        std::vector<std::uint32_t> in(n), out(n + 2, 7);
        for (auto& x : in) x = std::uint32_t(random.integer(0, 9));
        Cpu(2).exclusive_scan(in.data(), out.data(), n);
        std::uint32_t sum = 0;
        for (int i = 0; i <= n; ++i) {
            ASSERT_EQ(out[i], sum);
            if (i < n) sum += in[i];
        }
        EXPECT_EQ(out[n + 1], 7u);
    }
}

TEST(CpuVerbs, sort_unique) {
    test::Random random(11);
    for (int n : {0, 1, 5, 30000}) {
        std::vector<std::uint64_t> keys(n);
        for (auto& k : keys) k = (std::uint64_t(random.integer(0, 5000)) << 33) + 1;
        const std::set<std::uint64_t> expected(keys.begin(), keys.end());
        const auto left = Cpu(2).sort_unique(keys.data(), n, 46);
        ASSERT_EQ(left, std::int64_t(expected.size()));
        EXPECT_TRUE(std::equal(expected.begin(), expected.end(), keys.begin()));
    }
}

TEST(CpuVerbs, max_each) {
    test::Random random(12);
    for (int threads : thread_counts) {
        for (int n : {0, 1, 16384, 16385, 100003}) {
            std::vector<double> x(n), y(n);
            double top[2] = {0, 0};
            for (int i = 0; i < n; ++i) {
                x[i] = random.between(-5, 5);
                y[i] = random.between(-5, -1);
                top[0] = std::max(top[0], x[i]);
            }
            double maxima[2] = {99, 99};
            int calls = 0;
            Cpu(threads).max_each<2>(
                n,
                [&](std::int64_t i, double(&local)[2]) {
                    local[0] = std::max(local[0], x[i]);
                    local[1] = std::max(local[1], y[i]);
                },
                [&](const double* found) {
                    std::copy(found, found + 2, maxima);
                    ++calls;
                });
            EXPECT_EQ(calls, 1) << threads << " threads, " << n;
            EXPECT_EQ(maxima[0], top[0]) << threads << " threads, " << n;
            EXPECT_EQ(maxima[1], 0) << "maxima start at zero";
        }
    }
    // The largest may be the first or the last element.
    for (int at : {0, 99999}) {
        double most = 0;
        Cpu(3).max_each<1>(
            100000,
            [&](std::int64_t i, double(&local)[1]) {
                local[0] = std::max(local[0], i == at ? 2.0 : 1.0);
            },
            [&](const double* found) { most = found[0]; });
        EXPECT_EQ(most, 2.0);
    }
}

TEST(CpuVerbs, for_each_visits_every_index_once) {
    for (int threads : thread_counts) {
        for (int n : {0, 1, 8, 9, 32768, 32769, 50000}) {
            std::vector<int> small(n, 0), large(n, 0);
            Cpu(threads).for_each(n, [&](std::int64_t i) { ++small[i]; });
            Cpu(threads).for_each_large(n, [&](std::int64_t i) { ++large[i]; });
            EXPECT_EQ(std::count(small.begin(), small.end(), 1), n);
            EXPECT_EQ(std::count(large.begin(), large.end(), 1), n);
        }
    }
}

TEST(CpuVerbs, atomics_under_contention) {
    Cpu exec(4);
    std::uint32_t flag = 0, count = 0;
    std::uint64_t least = ~std::uint64_t(0);
    std::vector<int> tickets(100000, 0);
    exec.for_each(100000, [&](std::int64_t i) {
        Cpu::raise(&flag);
        Cpu::keep_smallest(&least, std::uint64_t(100000 - i) + 41);
        ++tickets[Cpu::fetch_add(&count, 1)];
    });
    EXPECT_EQ(flag, 1u);
    EXPECT_EQ(count, 100000u);
    EXPECT_EQ(least, 42u);
    EXPECT_EQ(std::count(tickets.begin(), tickets.end(), 1), 100000);
}

#if !defined(LIBMPM_SANITIZED)  // whose allocator ends the program instead
TEST(CpuVerbs, out_of_memory_is_an_error_with_the_size) {
    Cpu exec(1);
    try {
        exec.release(exec.allocate(std::size_t(1) << 60), std::size_t(1) << 60);
        FAIL() << "no machine has that much";
    } catch (const CapacityError& e) {
        EXPECT_NE(std::string(e.what()).find("1152921504606846976"), std::string::npos) << e.what();
    }
}
#endif

TEST(Buffer, keeps_moves_and_grows) {
    Cpu exec(1);
    Buffer<Cpu, int> a(exec), b(exec);
    a.assign({1, 2, 3});
    EXPECT_EQ(a.host(), (std::vector<int>{1, 2, 3}));
    b = std::move(a);
    EXPECT_EQ(b.host(), (std::vector<int>{1, 2, 3}));
    EXPECT_EQ(a.size(), 0u);
    const int* before = b.data();
    b.reserve_discard(2);  // smaller: same memory
    EXPECT_EQ(b.data(), before);
    EXPECT_EQ(b.size(), 2u);
    b.shrink(5);
    EXPECT_EQ(b.size(), 2u);
    b.reserve_discard(1000);
    b.zero();
    EXPECT_EQ(b.host(), std::vector<int>(1000, 0));
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(b.data()) % 64, 0u);
    Buffer<Cpu, int> empty(exec);
    EXPECT_TRUE(empty.host().empty());
}

}  // namespace

TEST(CpuVerbs, sum_each_adds_every_set_and_no_thread_changes_a_bit) {
    for (const std::vector<std::int64_t>& counts :
         {std::vector<std::int64_t>{0, 1, 63}, {64, 0, 65}, {1000, 3, 0}, {0, 0, 0}}) {
        std::vector<SumSet> sets;
        std::int64_t items = 0;
        std::int32_t places = 0;
        for (std::int64_t n : counts) {
            sets.push_back({items, n, places, std::int32_t(Cpu::sum_parts(n))});
            items += n;
            places += sets.back().parts;
        }
        const auto sums = [&](int threads) {
            Cpu exec(threads);
            std::vector<double> parts(std::size_t(places) * 2, -1.0), out(6, -1.0);
            std::vector<int> beside(5, 0);
            exec.sum_each<2>(
                SumSets{sets.data(), 3, places},
                [](std::int64_t i, int set, double* sum) {
                    sum[0] += 1;
                    sum[1] += (set + 1) / (double(i) + 3);
                },
                [&](int set, const double* sum) {
                    out[2 * set] = sum[0];
                    out[2 * set + 1] = sum[1];
                },
                parts.data(), 5, [&](std::int64_t k) { ++beside[k]; });
            for (int once : beside) EXPECT_EQ(once, 1);
            return out;
        };
        const auto one = sums(1);
        EXPECT_EQ(one, sums(3));
        for (int set = 0; set < 3; ++set) {
            double expected = 0;
            for (std::int64_t i = 0; i < counts[set]; ++i)
                expected += (set + 1) / (double(sets[set].first + i) + 3);
            EXPECT_EQ(one[2 * set], double(counts[set]));
            EXPECT_NEAR(one[2 * set + 1], expected, 1e-13);
        }
    }
}

TEST(CpuVerbs, sum_each_with_fewer_parts_has_every_item_and_leaves_out_idle_sets) {
    struct Counts {
        bool idle(int set) const { return set == 1; }
        void operator()(std::int64_t i, int set, std::int64_t* sum) const {
            sum[0] += 1;
            sum[1] += i * (set + 1);
        }
    };
    struct Take {
        std::vector<std::int64_t>* out;
        bool* said;
        void operator()(int set, const std::int64_t* sum) const {
            (*out)[2 * set] = sum[0];
            (*out)[2 * set + 1] = sum[1];
        }
        void done() const { *said = true; }
    };
    for (const std::int32_t parts : {1, 2, 3, 7}) {
        const std::int64_t counts[] = {1000, 500, 130};
        std::vector<SumSet> sets;
        std::int64_t items = 0;
        for (std::int64_t n : counts) {
            sets.push_back({items, n, std::int32_t(sets.size()) * parts, parts});
            items += n;
        }
        std::vector<std::int64_t> room(std::size_t(3 * parts) * 2, -1), out(6, -1);
        bool said = false;
        Cpu exec(2);
        exec.sum_each<2>(SumSets{sets.data(), 3, 3 * parts}, Counts{}, Take{&out, &said},
                         room.data(), 0, [](std::int64_t) {});
        EXPECT_TRUE(said);
        for (int set : {0, 2}) {
            const std::int64_t first = sets[set].first, n = counts[set];
            EXPECT_EQ(out[2 * set], n);
            EXPECT_EQ(out[2 * set + 1], (set + 1) * (n * first + n * (n - 1) / 2));
        }
        EXPECT_EQ(out[2], -1);
    }
}

}  // namespace mpm
