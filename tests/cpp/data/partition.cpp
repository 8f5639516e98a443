// Who owns which blocks: the curve visits each once by steps to a neighbour, pieces are even, and
// what every rank works out by itself is the same.
#include "mpm/data/partition.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <map>
#include <numeric>
#include <vector>

#include "support/random.hpp"

namespace mpm {
namespace {

template <int D>
void steps_to_a_neighbour() {
    constexpr int bits = D == 2 ? 5 : 3;
    const std::int64_t edge = std::int64_t(1) << bits;
    std::map<std::uint64_t, std::vector<std::int64_t>> at;
    std::int64_t total = 1;
    for (int a = 0; a < D; ++a) total *= edge;
    for (std::int64_t n = 0; n < total; ++n) {
        std::int64_t b[D], rest = n;
        for (int a = 0; a < D; ++a) {
            b[a] = rest % edge;
            rest /= edge;
        }
        at[hilbert_place<D>(b, bits)] = std::vector<std::int64_t>(b, b + D);
    }
    ASSERT_EQ(at.size(), std::size_t(total)) << "each place once";
    EXPECT_EQ(at.rbegin()->first, std::uint64_t(total - 1)) << "and none left out";
    for (auto it = std::next(at.begin()); it != at.end(); ++it) {
        std::int64_t apart = 0;
        for (int a = 0; a < D; ++a)
            apart += std::abs(it->second[std::size_t(a)] - std::prev(it)->second[std::size_t(a)]);
        ASSERT_EQ(apart, 1) << "at place " << it->first;
    }
}
TEST(Partition, the_curve_steps_to_a_neighbour) {
    steps_to_a_neighbour<2>();
    steps_to_a_neighbour<3>();
}

template <int D>
BlockKeys<D> keys_of(std::int64_t edge) {
    BlockKeys<D> keys;
    for (int a = 0; a < D; ++a) keys.counts[a] = edge + a + 2 * BlockKeys<D>::rim;
    return keys;
}

/// Half of all blocks, each with a weight of its own.
template <int D>
std::vector<BlockWeight> some_blocks(const BlockKeys<D>& keys, test::Random& random) {
    std::vector<BlockWeight> out;
    std::uint64_t all = 1;
    for (std::int64_t n : keys.counts) all *= std::uint64_t(n);
    for (std::uint64_t k = 0; k < all; ++k)
        if (random.between(0, 1) < 0.5)
            out.push_back({k, 1 + std::uint64_t(random.between(0, 512))});
    return out;
}

template <int D>
void pieces_are_even(int axis) {
    test::Random random(7);
    const auto keys = keys_of<D>(D == 2 ? 40 : 12);
    auto blocks = some_blocks<D>(keys, random);
    for (int ranks : {1, 2, 3, 4, 7}) {
        BlockPartition<D> partition(keys, axis);
        partition.cut(blocks, ranks);
        ASSERT_EQ(partition.ranks(), ranks);
        std::vector<std::uint64_t> loads(std::size_t(ranks), 0);
        std::map<std::uint64_t, std::uint64_t> of_place;
        std::uint64_t heaviest = 0;
        for (const auto& b : blocks) {
            const int owner = partition.owner(b.key);
            ASSERT_GE(owner, 0);
            ASSERT_LT(owner, ranks);
            loads[std::size_t(owner)] += b.weight;
            heaviest = std::max(heaviest, of_place[partition.place(b.key)] += b.weight);
        }
        const std::uint64_t total = std::accumulate(loads.begin(), loads.end(), std::uint64_t(0));
        for (std::uint64_t load : loads)
            EXPECT_LE(std::abs(double(load) - double(total) / ranks), double(heaviest));
        // In whatever order the blocks are told.
        BlockPartition<D> other(keys, axis);
        auto reversed = blocks;
        std::reverse(reversed.begin(), reversed.end());
        other.cut(reversed, ranks);
        EXPECT_EQ(other.cuts(), partition.cuts());
    }
}
TEST(Partition, pieces_are_even) {
    pieces_are_even<2>(BlockPartition<2>::curve);
    pieces_are_even<3>(BlockPartition<3>::curve);
    pieces_are_even<2>(0);
    pieces_are_even<3>(1);
}

TEST(Partition, planes_are_planes) {
    const auto keys = keys_of<3>(8);
    test::Random random(3);
    BlockPartition<3> partition(keys, 0);
    partition.cut(some_blocks<3>(keys, random), 3);
    int before = 0;
    for (std::int64_t x = -2; x < 10; ++x) {
        const std::int64_t low[3] = {x, -2, -2}, high[3] = {x, 10, 11};
        const int owner = partition.owner(keys.key(low));
        EXPECT_EQ(partition.owner(keys.key(high)), owner) << "all blocks of a plane";
        EXPECT_GE(owner, before);
        before = owner;
    }
    EXPECT_EQ(before, 2);
}

TEST(Partition, planes_lie_where_they_were_asked_for) {
    const auto keys = keys_of<2>(8);
    BlockPartition<2> partition(keys, 1);
    partition.cut_at({2, 3, 7});
    ASSERT_EQ(partition.ranks(), 4);
    const int owner[] = {0, 0, 0, 0, 1, 2, 2, 2, 2, 3, 3};  // of the rim and the domain
    for (std::int64_t y = -2; y < 9; ++y) {
        const std::int64_t b[2] = {5, y};
        EXPECT_EQ(partition.owner(keys.key(b)), owner[y + 2]) << y;
    }
}

TEST(Partition, fewer_blocks_than_ranks) {
    const auto keys = keys_of<2>(8);
    BlockPartition<2> partition(keys, BlockPartition<2>::curve);
    partition.cut({}, 4);
    EXPECT_EQ(partition.ranks(), 4);
    const std::int64_t b[2] = {3, 3};
    EXPECT_EQ(partition.owner(keys.key(b)), 0);
    partition.cut({{keys.key(b), 5}}, 4);
    EXPECT_LT(partition.owner(keys.key(b)), 4);
}

/// A full box, its blocks in no order.
template <int D>
std::pair<BlockKeys<D>, std::vector<BlockWeight>> box_of(const std::int64_t (&edge)[D]) {
    BlockKeys<D> keys;
    std::int64_t all = 1, b[D];
    for (int a = 0; a < D; ++a) keys.counts[a] = edge[a] + 2 * BlockKeys<D>::rim;
    for (std::int64_t n : edge) all *= n;
    std::vector<BlockWeight> blocks;
    for (std::int64_t k = 0; k < all; ++k) {
        std::int64_t rest = (k * 7919) % all;
        for (int a = 0; a < D; ++a) {
            b[a] = rest % edge[a];
            rest /= edge[a];
        }
        blocks.push_back({keys.key(b), 512});
    }
    return {keys, blocks};
}

TEST(Partition, faces_of_planes_are_those_of_the_planes) {
    auto [keys, blocks] = box_of<3>({5, 6, 7});
    std::sort(blocks.begin(), blocks.end(),
              [](const auto& a, const auto& b) { return a.key < b.key; });
    const std::uint64_t faces[3] = {6 * 7, 5 * 7, 5 * 6};
    for (int axis = 0; axis < 3; ++axis) {
        BlockPartition<3> planes(keys, axis);
        planes.cut(blocks, 3);
        EXPECT_EQ(cut_faces(keys, blocks, planes), 2 * faces[axis]);
    }
    BlockPartition<3> one(keys, BlockPartition<3>::curve);
    one.cut(blocks, 1);
    EXPECT_EQ(cut_faces(keys, blocks, one), 0u);
}

TEST(Partition, flumes_are_cut_by_planes_and_cubes_along_the_curve) {
    const auto [flume, water] = box_of<3>({8, 40, 6});
    for (int ranks : {2, 4, 8}) {
        const auto chosen = choose_partition<3>(flume, water, ranks, 1.05);
        EXPECT_EQ(chosen.axis(), 1) << ranks;
        EXPECT_EQ(chosen.ranks(), ranks);
    }
    // Planes would be uneven: 40 of them for 16 ranks.
    EXPECT_EQ(choose_partition<3>(flume, water, 16, 1.05).axis(), BlockPartition<3>::curve);
    const auto [cube, full] = box_of<3>({8, 8, 8});
    EXPECT_EQ(choose_partition<3>(cube, full, 8, 1.05).axis(), BlockPartition<3>::curve);
    const auto [channel, flow] = box_of<2>({6, 100});
    EXPECT_EQ(choose_partition<2>(channel, flow, 3, 1.05).axis(), 1);
    EXPECT_EQ(choose_partition<2>(channel, {}, 3, 1.05).ranks(), 3);
}

TEST(Partition, imbalance_is_the_most_by_the_mean) {
    EXPECT_EQ(imbalance({}), 1.0);
    EXPECT_EQ(imbalance({0, 0}), 1.0);
    EXPECT_EQ(imbalance({3, 3, 3}), 1.0);
    EXPECT_EQ(imbalance({4, 0}), 2.0);
}

}  // namespace
}  // namespace mpm
