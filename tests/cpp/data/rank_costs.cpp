// Cuts by what blocks have cost: they come to rest where all ranks take the same time, whether it
// is a rank or the blocks that are slow; noise does not move them; groups come to lie on a rank
// each as well as any cuts could have it.
#include "mpm/data/rank_costs.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <numeric>

#include "mpm/data/partition_groups.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

TEST(RankCosts, the_usual_step_is_the_median) {
    EXPECT_EQ(usual_nanoseconds({2e-6}), 2000u);
    EXPECT_EQ(usual_nanoseconds({3e-6, 1e-6, 2e-6, 4.0, 2e-6}), 2000u) << "one was disturbed";
    EXPECT_EQ(usual_nanoseconds({-1.0}), 0u) << "a clock that was set back";
}

TEST(RankCosts, are_by_weight_and_smoothed) {
    CostRates rates(3);
    EXPECT_EQ(rates.of(2), CostRates::one) << "before anyone has told";
    // The second takes twice as long for as much; the third has nothing.
    rates.tell({{1000, 500}, {2000, 500}, {7, 0}});
    const double mean = 3007.0 / 1000;
    EXPECT_NEAR(double(rates.of(0)) / CostRates::one, 0.5 * (1 + 2 / mean), 0.001);
    EXPECT_NEAR(double(rates.of(1)) / CostRates::one, 0.5 * (1 + 4 / mean), 0.001);
    EXPECT_EQ(rates.of(2), CostRates::one);
    for (int k = 0; k < 20; ++k) rates.tell({{1000, 500}, {2000, 500}, {7, 0}});
    EXPECT_NEAR(double(rates.of(1)) / double(rates.of(0)), 2.0, 0.01);
    rates = CostRates(2);
    rates.tell({{1, 1}, {0, 0}});
    rates.tell({{0, 100}, {0, 100}});
    EXPECT_GT(rates.of(0), 0u) << "clocks that stood still";
}

/// Full planes of blocks in a row, each with its cost by weight.
struct Row {
    BlockKeys<2> keys{{204, 8}};
    std::vector<BlockWeight> blocks;
    std::vector<double> cost;

    explicit Row(const std::function<double(int)>& of) {
        for (std::int64_t x = 0; x < 200; ++x) {
            const std::int64_t b[2] = {x, 0};
            blocks.push_back({keys.key(b), 272});
            cost.push_back(of(int(x)));
        }
    }
    std::vector<std::uint64_t> by_rates(const BlockPartition<2>& p, const CostRates& rates) {
        auto weighed = blocks;
        for (auto& b : weighed) b.weight *= rates.of(p.owner(b.key));
        return loads_of(p, weighed);
    }
};

struct Outcome {
    double uneven;  // the longest time by the mean, at the end
    int moved, last;
};

/// What ranks do at each sort, where a rank's time is the cost of its blocks times its own slowness
/// and some noise.
Outcome sort_often(Row& row, const std::vector<double>& slow, double noise, double limit,
                   int sorts = 60) {
    test::Random random(11);
    const int ranks = int(slow.size());
    BlockPartition<2> p(row.keys, 0);
    p.cut(row.blocks, ranks);
    CostRates rates(ranks);
    Outcome out{0, 0, 0};
    const auto times = [&](double much) {
        std::vector<double> t(slow.size(), 0);
        for (std::size_t k = 0; k < row.blocks.size(); ++k)
            t[std::size_t(p.owner(row.blocks[k].key))] += row.cost[k];
        for (std::size_t r = 0; r < t.size(); ++r)
            t[r] *= slow[r] * (1 + much * random.between(-1, 1));
        return t;
    };
    for (int sort = 0; sort < sorts; ++sort) {
        const auto weights = loads_of(p, row.blocks);
        const auto took = times(noise);
        std::vector<StepCost> told;
        for (std::size_t r = 0; r < slow.size(); ++r)
            told.push_back({std::uint64_t(1e6 * took[r]), weights[r]});
        rates.tell(told);
        const double was = imbalance(row.by_rates(p, rates));
        auto weighed = row.blocks;
        for (auto& b : weighed) b.weight *= rates.of(p.owner(b.key));
        if (was > limit && recut(p, weighed, limit, was)) {
            ++out.moved;
            out.last = sort;
        }
    }
    const auto end = times(0);
    out.uneven = *std::max_element(end.begin(), end.end()) * double(end.size()) /
                 std::accumulate(end.begin(), end.end(), 0.0);
    return out;
}

TEST(RankCosts, a_slow_rank_gets_less) {
    Row row([](int) { return 1.0; });
    for (const auto& slow : {std::vector<double>{2, 1}, {1, 1, 3}, {1, 2, 1, 1}}) {
        const Outcome found = sort_often(row, slow, 0, 1.05);
        EXPECT_LE(found.uneven, 1.05 + 0.03) << slow.size();
        EXPECT_GT(found.moved, 0);
        EXPECT_LT(found.last, 20) << "cuts come to rest";
    }
}

TEST(RankCosts, costly_blocks_count_for_more) {
    // A body of a material that costs five times as much, in a quarter of the water.
    Row row([](int x) { return x >= 40 && x < 90 ? 5.0 : 1.0; });
    for (int ranks : {2, 3, 4}) {
        const std::vector<double> alike(std::size_t(ranks), 1.0);
        const Outcome found = sort_often(row, alike, 0, 1.05),
                      never = sort_often(row, alike, 0, std::numeric_limits<double>::infinity());
        EXPECT_GT(never.uneven, 1.3);
        EXPECT_LE(found.uneven, 1.05 + 0.03) << ranks;
        EXPECT_LT(found.last, 20) << "cuts come to rest";
    }
}

TEST(RankCosts, noise_moves_nothing) {
    Row row([](int) { return 1.0; });
    for (int ranks : {2, 4}) {
        const std::vector<double> alike(std::size_t(ranks), 1.0);
        EXPECT_EQ(sort_often(row, alike, 0.07, 1.05).moved, 0) << ranks;
    }
}

TEST(RankCosts, cuts_stay_where_new_ones_are_hardly_better) {
    BlockKeys<2> keys{{12, 8}};
    std::vector<BlockWeight> blocks;
    for (std::int64_t x = 0; x < 8; ++x) {
        const std::int64_t b[2] = {x, 0};
        blocks.push_back({keys.key(b), x == 3 ? 104u : 100u});
    }
    BlockPartition<2> p(keys, 0);
    p.cut_at({3});
    const auto before = p.cuts();
    const double was = imbalance(loads_of(p, blocks));
    EXPECT_NEAR(was, 2 * 504.0 / 804, 1e-12);
    EXPECT_TRUE(recut(p, blocks, 1.05, was));
    const auto even = p.cuts();
    EXPECT_NE(even, before);
    p.cut_at({5});
    EXPECT_FALSE(recut(p, blocks, 1.05, 1.02)) << "by less than 3 %";
    EXPECT_EQ(p.owner(blocks[4].key), 0) << "and the old ones are back";
    EXPECT_TRUE(recut(p, blocks, 0, 1.02)) << "at any price";
    EXPECT_EQ(p.cuts(), even);
}

/// Of `weights`, the particles that lie on the rank of their group if ranks have groups in order.
std::uint64_t as_asked(const BlockPartition<2>& p, const std::vector<GroupWeight>& weights,
                       const std::vector<int>& order) {
    std::uint64_t found = 0;
    for (const auto& w : weights)
        if (order[std::size_t(p.owner(w.key))] == w.group) found += w.particles;
    return found;
}

TEST(PartitionGroups, bodies_beside_each_other_are_parted) {
    const BlockKeys<2> keys{{34, 12}};
    std::vector<GroupWeight> weights;
    std::uint64_t all = 0;
    // The second from left is group 0, then 2, then 1; upright, so that only planes across x part
    // them.
    const int at[3] = {0, 20, 10};
    for (int g = 0; g < 3; ++g)
        for (std::int64_t x = at[g]; x < at[g] + 6 - g; ++x)
            for (std::int64_t y = 0; y < 8; ++y) {
                const std::int64_t b[2] = {x, y};
                weights.push_back({keys.key(b), g, std::uint64_t(64 + x)});
                all += weights.back().particles;
            }
    BlockPartition<2> p(keys, 0);
    EXPECT_EQ(cut_by_groups(p, weights, 3), all);
    EXPECT_EQ(as_asked(p, weights, {0, 2, 1}), all);
    std::vector<BlockWeight> blocks;
    for (const auto& w : weights) blocks.push_back({w.key, w.particles + 16});
    const auto chosen = choose_for_groups<2>(keys, blocks, weights, 3);
    EXPECT_EQ(chosen.axis(), 0);
    EXPECT_EQ(chosen.cuts(), p.cuts());
    std::reverse(weights.begin(), weights.end());
    BlockPartition<2> other(keys, 0);
    cut_by_groups(other, weights, 3);
    EXPECT_EQ(other.cuts(), p.cuts()) << "in whatever order they are told";
}

TEST(PartitionGroups, no_other_cuts_are_better) {
    const BlockKeys<2> keys{{16, 8}};
    test::Random random(5);
    for (int scene = 0; scene < 40; ++scene) {
        std::vector<GroupWeight> weights;
        for (std::int64_t x = 0; x < 12; ++x)
            for (int g = 0; g < 3; ++g) {
                const std::int64_t b[2] = {x, g % 2};
                if (random.between(0, 1) < 0.6)
                    weights.push_back({keys.key(b), g, 1 + std::uint64_t(random.between(0, 99))});
            }
        BlockPartition<2> p(keys, 0);
        const std::uint64_t found = cut_by_groups(p, weights, 3);
        // Of one order of groups, whichever it took.
        std::vector<int> order = {0, 1, 2};
        std::uint64_t best = 0;
        bool reached = false;
        do {
            reached = reached || as_asked(p, weights, order) == found;
            std::uint64_t here = 0;
            BlockPartition<2> any(keys, 0);
            for (std::int64_t i = 0; i <= 12; ++i)
                for (std::int64_t j = i; j <= 12; ++j) {
                    any.cut_at({i, j});
                    here = std::max(here, as_asked(any, weights, order));
                }
            if (as_asked(p, weights, order) == found) best = std::max(best, here);
        } while (std::next_permutation(order.begin(), order.end()));
        EXPECT_TRUE(reached);
        EXPECT_EQ(found, best) << scene;
    }
}

TEST(PartitionGroups, one_without_particles) {
    const BlockKeys<2> keys{{16, 8}};
    const std::int64_t b[2] = {3, 1};
    BlockPartition<2> p(keys, BlockPartition<2>::curve);
    EXPECT_EQ(cut_by_groups(p, {{keys.key(b), 1, 9}}, 3), 9u);
    EXPECT_EQ(p.owner(keys.key(b)), 0) << "the first of those that have any";
    EXPECT_EQ(p.ranks(), 3);
    EXPECT_EQ(cut_by_groups(p, {}, 2), 0u);
    EXPECT_EQ(p.ranks(), 2);
}

}  // namespace
}  // namespace mpm
