#include "mpm/data/blocks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

#include "support/random.hpp"

namespace mpm {
namespace {

template <int D>
void cells_round_trip() {
    std::set<int> seen;
    for (int n = 0; n < block_cells; ++n) {
        int c[D];
        Block<D>::coordinates(n, c);
        for (int a = 0; a < D; ++a) {
            ASSERT_GE(c[a], 0);
            ASSERT_LT(c[a], Block<D>::edge);
        }
        EXPECT_EQ(Block<D>::cell(c), n);
        seen.insert(n);
        if (c[D - 1] + 1 < Block<D>::edge) {  // last axis fastest
            ++c[D - 1];
            EXPECT_EQ(Block<D>::cell(c), n + 1);
        }
    }
    EXPECT_EQ(int(seen.size()), block_cells);
}
TEST(Blocks, cells_round_trip) {
    cells_round_trip<2>();
    cells_round_trip<3>();
}

template <int D>
void keys_round_trip() {
    BlockKeys<D> keys;
    for (int a = 0; a < D; ++a) keys.counts[a] = 5 + 2 * a + 2 * BlockKeys<D>::rim;
    std::set<std::uint64_t> seen;
    std::uint64_t before = 0;
    bool first = true;
    std::int64_t total = 1;
    for (int a = 0; a < D; ++a) total *= keys.counts[a];
    for (std::int64_t n = 0; n < total; ++n) {
        std::int64_t b[D], back[D], rest = n;
        for (int a = D - 1; a >= 0; --a) {
            b[a] = rest % keys.counts[a] - BlockKeys<D>::rim;
            rest /= keys.counts[a];
        }
        const std::uint64_t key = keys.key(b);
        EXPECT_TRUE(seen.insert(key).second);
        EXPECT_TRUE(first || key > before) << "keys ascend with the last axis fastest";
        before = key;
        first = false;
        keys.block(key, back);
        for (int a = 0; a < D; ++a) ASSERT_EQ(back[a], b[a]);
    }
}
TEST(Blocks, keys_round_trip) {
    keys_round_trip<2>();
    keys_round_trip<3>();
}

/// A domain too large for 32-bit keys.
TEST(Blocks, keys_of_a_large_domain) {
    const BlockKeys<3> keys{{1000004, 1000004, 1000004}};
    const std::int64_t b[3] = {999999, 1000001, -2};
    std::int64_t back[3];
    keys.block(keys.key(b), back);
    for (int a = 0; a < 3; ++a) EXPECT_EQ(back[a], b[a]);
    EXPECT_GT(keys.key(b), std::uint64_t(1) << 32);
    EXPECT_EQ(keys.bits(), 60);
}

/// Sorts look at no more bits than the largest key has.
TEST(Blocks, bits_of_the_largest_key) {
    for (std::int64_t x : {5, 8, 100})
        for (std::int64_t y : {5, 16, 333}) {
            const BlockKeys<2> keys{{x, y}};
            const std::int64_t last[2] = {x - 1 - keys.rim, y - 1 - keys.rim};
            EXPECT_EQ(keys.key(last), std::uint64_t(x * y - 1));
            EXPECT_LT(keys.key(last), std::uint64_t(1) << keys.bits());
            EXPECT_GE(keys.key(last), std::uint64_t(1) << (keys.bits() - 1));
        }
}

TEST(Blocks, find_key) {
    test::Random random(1);
    for (int n : {0, 1, 2, 3, 64, 1000}) {
        std::set<std::uint64_t> set;
        while (int(set.size()) < n) set.insert(std::uint64_t(random.integer(0, 5000)) * 3 + 1);
        const std::vector<std::uint64_t> keys(set.begin(), set.end());
        for (int k = 0; k < n; ++k) {
            EXPECT_EQ(find_key(keys.data(), n, keys[k]), k);
            EXPECT_EQ(find_key(keys.data(), n, keys[k] - 1), -1);
        }
        EXPECT_EQ(find_key(keys.data(), n, 0), -1);
        EXPECT_EQ(find_key(keys.data(), n, ~std::uint64_t(0)), -1);
    }
}

TEST(Blocks, find_block_knows_its_limits) {
    BlockTableView<2> table{};
    table.keys_of = {{8, 9}};
    std::vector<std::uint64_t> keys;
    for (std::int64_t x = -2; x < 6; ++x)
        for (std::int64_t y = -2; y < 7; ++y) keys.push_back(table.keys_of.key({x, y}));
    table.slots = std::int32_t(keys.size());
    table.keys = keys.data();
    for (std::int64_t x = -4; x < 8; ++x) {
        for (std::int64_t y = -4; y < 9; ++y) {
            const bool inside = x >= -2 && x < 6 && y >= -2 && y < 7;
            EXPECT_EQ(find_block<2>(table, {x, y}), inside ? (x + 2) * 9 + y + 2 : -1)
                << x << ' ' << y;
        }
    }
}

TEST(Blocks, fields_of_a_block_follow_each_other) {
    BlockKeys<2> keys{{7, 9}, 3};
    BlockKeys<2> one{{7, 9}};
    std::vector<std::uint64_t> list;
    for (std::int64_t x = -2; x < 5; ++x) {
        for (std::int64_t y = -2; y < 7; ++y) {
            for (std::int64_t field = 0; field < 3; ++field) {
                const std::uint64_t key = keys.key({x, y}, field);
                std::int64_t b[2];
                keys.block(key, b);
                EXPECT_EQ(b[0], x);
                EXPECT_EQ(b[1], y);
                EXPECT_EQ(keys.field(key), field);
                EXPECT_EQ(key, one.key({x, y}) * 3 + std::uint64_t(field));
                if (field != 1 || (x + y) % 2 == 0) list.push_back(key);
            }
            EXPECT_EQ(one.field(one.key({x, y})), 0);
        }
    }
    EXPECT_TRUE(std::is_sorted(list.begin(), list.end()));
    EXPECT_LT(std::ldexp(1.0, keys.bits() - 1), double(list.back()));
    const BlockTableView<2> table{keys, std::int32_t(list.size()), list.data(), nullptr, nullptr};
    for (std::int64_t x = -2; x < 5; ++x) {
        for (std::int64_t y = -2; y < 7; ++y) {
            const std::int64_t cell[2] = {x * Block<2>::edge + 3, y * Block<2>::edge + 5};
            std::vector<std::int64_t> fields;
            each_field_of_node<2>(table, cell, [&](std::int32_t slot, int node) {
                fields.push_back(keys.field(list[std::size_t(slot)]));
                EXPECT_EQ(node, Block<2>::cell({3, 5}));
                EXPECT_EQ(find_block<2>(table, {x, y}, fields.back()), slot);
            });
            EXPECT_EQ(fields, (x + y) % 2 == 0 ? (std::vector<std::int64_t>{0, 1, 2})
                                               : (std::vector<std::int64_t>{0, 2}));
        }
    }
    each_field_of_node<2>(table, {500, 0}, [](std::int32_t, int) { FAIL(); });
}

/// Every node of the arena by brute force over global cells.
template <int D>
void arena_nodes() {
    constexpr int edge = Block<D>::edge, arena = Block<D>::arena_edge;
    int stride = 1;
    for (int a = D - 1; a >= 0; --a) {
        EXPECT_EQ(Block<D>::arena_stride(a), stride);
        stride *= arena;
    }
    EXPECT_EQ(stride, Block<D>::arena_nodes);
    for (int n = 0; n < Block<D>::arena_nodes; ++n) {
        int at[D], rest = n, neighbour, node, expected_neighbour = 0, expected_node = 0;
        for (int a = D - 1; a >= 0; --a) {
            at[a] = rest % arena;
            rest /= arena;
        }
        for (int a = 0; a < D; ++a) {
            const int global = 10 * edge + at[a] - Block<D>::margin;  // of block 10
            expected_neighbour = expected_neighbour * 3 + (global / edge - 9);
            expected_node = expected_node * edge + global % edge;
        }
        arena_node<D>(at, neighbour, node);
        ASSERT_EQ(neighbour, expected_neighbour) << n;
        ASSERT_EQ(node, expected_node) << n;
    }
}
TEST(Blocks, arena_node) {
    arena_nodes<2>();
    arena_nodes<3>();
}

}  // namespace
}  // namespace mpm
