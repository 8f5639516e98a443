#include "mpm/data/time_table.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "support/random.hpp"

namespace mpm {
namespace {

struct Table {
    std::vector<double> time, value;
    TableEnd end = TableEnd::hold;
    int components = 1;
    double at(double t, int component = 0) const {
        double out[3] = {-77, -77, -77};
        TimeTableView{time.data(), value.data(), std::int32_t(time.size()), components, end}.at(
            t, out);
        return out[component];
    }
};
constexpr TableEnd ends[] = {TableEnd::hold, TableEnd::repeat, TableEnd::zero};

TEST(TimeTable, knots_and_between) {
    for (TableEnd end : ends) {
        const Table t{{1, 2, 4}, {10, 20, -20}, end};
        EXPECT_EQ(t.at(1), 10);
        EXPECT_EQ(t.at(2), 20);
        EXPECT_EQ(t.at(4), -20);
        EXPECT_DOUBLE_EQ(t.at(1.25), 12.5);
        EXPECT_DOUBLE_EQ(t.at(3), 0);
        EXPECT_DOUBLE_EQ(t.at(3.5), -10);
    }
}

TEST(TimeTable, before_the_first_entry_its_value_holds) {
    for (TableEnd end : ends) {
        const Table t{{1, 2}, {10, 20}, end};
        EXPECT_EQ(t.at(0.999), 10);
        EXPECT_EQ(t.at(-1e9), 10);
    }
}

TEST(TimeTable, hold) {
    const Table t{{1, 2}, {10, 20}, TableEnd::hold};
    EXPECT_EQ(t.at(2.0000001), 20);
    EXPECT_EQ(t.at(1e12), 20);
}

TEST(TimeTable, zero) {
    const Table t{{1, 2}, {10, 20}, TableEnd::zero};
    EXPECT_EQ(t.at(2), 20);
    EXPECT_EQ(t.at(2.0000001), 0);
}

TEST(TimeTable, repeat) {
    const Table t{{1, 2, 4}, {10, 20, 10}, TableEnd::repeat};
    test::Random random(2);
    for (int k = 0; k < 1000; ++k) {
        const double at = random.between(1, 4);
        for (int n = 1; n < 5; ++n) EXPECT_NEAR(t.at(at + 3 * n), t.at(at), 1e-10) << at;
    }
    EXPECT_NEAR(t.at(2 + 3e6), 20, 1e-7);
}

/// A period that ends elsewhere than it began jumps; the jump is at the end, not before.
TEST(TimeTable, repeat_with_a_jump) {
    const Table t{{0, 1}, {0, 1}, TableEnd::repeat};
    EXPECT_EQ(t.at(1), 1);
    EXPECT_NEAR(t.at(1.25), 0.25, 1e-12);
    EXPECT_NEAR(t.at(7.75), 0.75, 1e-12);
}

TEST(TimeTable, one_entry) {
    for (TableEnd end : ends) {
        const Table t{{1}, {5}, end};
        EXPECT_EQ(t.at(0), 5);
        EXPECT_EQ(t.at(1), 5);
        EXPECT_EQ(t.at(2), end == TableEnd::zero ? 0 : 5);
    }
}

TEST(TimeTable, two_entries_of_one_time_are_a_jump) {
    const Table t{{0, 1, 1, 2}, {0, 0, 8, 8}};
    EXPECT_EQ(t.at(0.999999), 0);
    EXPECT_EQ(t.at(1), 8);
    EXPECT_EQ(t.at(1.5), 8);
}

TEST(TimeTable, components) {
    const Table t{{0, 2}, {1, 2, 3, 5, 6, 7}, TableEnd::zero, 3};
    for (int c = 0; c < 3; ++c) {
        EXPECT_DOUBLE_EQ(t.at(1, c), 3 + c);
        EXPECT_EQ(t.at(3, c), 0);
    }
}

TEST(TimeTable, many_entries_against_a_plain_search) {
    test::Random random(4);
    Table t;
    double now = 0;
    for (int k = 0; k < 97; ++k) {
        t.time.push_back(now += random.between(0.01, 1));
        t.value.push_back(random.between(-1, 1));
    }
    for (int round = 0; round < 2000; ++round) {
        const double at = random.between(t.time.front(), t.time.back());
        std::size_t k = 0;
        while (k + 2 < t.time.size() && t.time[k + 1] <= at) ++k;
        const double share = (at - t.time[k]) / (t.time[k + 1] - t.time[k]);
        EXPECT_NEAR(t.at(at), (1 - share) * t.value[k] + share * t.value[k + 1], 1e-12);
    }
}

}  // namespace
}  // namespace mpm
