// The order in which devices store the particles of 32 cells.
#include "mpm/kernels/order.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "support/random.hpp"

namespace mpm {
namespace {

using Counts = std::uint32_t[warp_cells];

struct Placed {
    std::uint32_t cell, rank;
};

/// Who stands at each place, counted from the first; checks that every particle has one of its own.
std::vector<Placed> placed(const Counts& count, std::uint32_t begin) {
    std::uint32_t particles = 0;
    for (auto n : count) particles += n;
    std::vector<Placed> at(particles, {~0u, ~0u});
    std::uint32_t calls = 0;
    place_by_rank(count, begin, [&](int cell, std::uint32_t rank, std::uint32_t place) {
        ++calls;
        ASSERT_GE(cell, 0);
        ASSERT_LT(cell, warp_cells);
        ASSERT_LT(rank, count[cell]) << "a particle that is not there";
        ASSERT_GE(place, begin);
        ASSERT_LT(place, begin + particles);
        ASSERT_EQ(at[place - begin].cell, ~0u) << "place taken twice";
        at[place - begin] = {std::uint32_t(cell), rank};
    });
    EXPECT_EQ(calls, particles);
    std::vector<std::vector<bool>> seen(warp_cells);
    for (int c = 0; c < warp_cells; ++c) seen[c].resize(count[c]);
    for (const Placed& p : at) {
        if (p.cell == ~0u) {
            ADD_FAILURE() << "a place stays empty";
            continue;
        }
        EXPECT_FALSE(seen[p.cell][p.rank]) << "a particle placed twice";
        seen[p.cell][p.rank] = true;
    }
    return at;
}

void check(const Counts& count, std::uint32_t begin) {
    const auto at = placed(count, begin);
    if (::testing::Test::HasFailure()) return;
    std::uint32_t cells = 0, surplus = 0;
    for (auto n : count) cells += n > 0;
    const std::uint32_t limit = ranks_in_step(std::uint32_t(at.size()), cells);
    for (auto n : count) surplus += n > limit ? n - limit : 0;
    const std::size_t in_step = at.size() - surplus;
    for (std::size_t k = 0; k < at.size(); ++k) {
        EXPECT_EQ(at[k].rank < limit, k < in_step) << "surplus comes last";
        if (k == 0 || k == in_step) continue;
        const Placed &a = at[k - 1], &b = at[k];
        if (k < in_step)
            EXPECT_TRUE(a.rank < b.rank || (a.rank == b.rank && a.cell < b.cell)) << k;
        else
            EXPECT_TRUE(a.cell < b.cell || (a.cell == b.cell && a.rank < b.rank)) << k;
    }
    // The lane of a cell finds its particle of a rank by counting who comes before.
    std::uint32_t place = 0;
    for (std::uint32_t rank = 0; rank < limit; ++rank)
        for (std::uint32_t c = 0; c < warp_cells; ++c)
            if (count[c] > rank) {
                EXPECT_EQ(at[place].cell, c);
                EXPECT_EQ(at[place].rank, rank);
                ++place;
            }
    EXPECT_EQ(place, in_step);
}

/// Few enough that lanes do not wait for one crowded cell, and enough for even cells.
TEST(RankOrder, ranks_in_step_are_about_the_mean_of_occupied_cells) {
    EXPECT_EQ(ranks_in_step(0, 0), 0u);
    for (std::uint32_t cells = 1; cells <= warp_cells; ++cells)
        for (std::uint32_t n : {cells, 8 * cells, 8 * cells + 1, 1000 * cells}) {
            EXPECT_GE(ranks_in_step(n, cells) * cells, n);
            EXPECT_LE(ranks_in_step(n, cells), n / cells + 3);
        }
}

TEST(RankOrder, nobody) {
    const Counts none = {};
    place_by_rank(none, 7, [](int, std::uint32_t, std::uint32_t) { FAIL(); });
}

TEST(RankOrder, even_cells_have_no_surplus) {
    Counts count;
    for (auto& n : count) n = 8;
    const auto at = placed(count, 1000);
    for (std::uint32_t k = 0; k < at.size(); ++k) {
        EXPECT_EQ(at[k].cell, k % 32);
        EXPECT_EQ(at[k].rank, k / 32);
    }
}

TEST(RankOrder, one_cell_alone) {
    for (int cell : {0, 13, 31})
        for (std::uint32_t n : {1u, 2u, 500u}) {
            Counts count = {};
            count[cell] = n;
            const auto at = placed(count, 3);
            for (std::uint32_t k = 0; k < n; ++k) EXPECT_EQ(at[k].rank, k);
        }
}

TEST(RankOrder, a_crowded_cell_comes_last) {
    Counts count;
    for (auto& n : count) n = 2;
    count[5] = 100;
    count[9] = 0;
    count[20] = 60;
    const std::uint32_t limit = ranks_in_step(218, 31);
    ASSERT_LT(limit, 60u);
    const auto at = placed(count, 0);
    ASSERT_EQ(at.size(), 218u);
    const std::uint32_t fifth = 100 - limit, twentieth = 60 - limit,
                        in_step = 218 - fifth - twentieth;
    for (std::uint32_t k = 0; k < 218; ++k) {
        if (k < in_step) {
            EXPECT_LT(at[k].rank, limit);
        } else {
            const std::uint32_t beyond = k - in_step;
            EXPECT_EQ(at[k].cell, beyond < fifth ? 5u : 20u);
            EXPECT_EQ(at[k].rank, limit + (beyond < fifth ? beyond : beyond - fifth));
        }
    }
    check(count, 0);
}

TEST(RankOrder, any_counts) {
    test::Random random(17);
    for (int round = 0; round < 3000; ++round) {
        Counts count;
        const int most = 1 << random.integer(0, 6), empty = random.integer(0, 9),
                  crowded = random.integer(0, 99);
        for (auto& n : count) {
            n = random.integer(0, 9) < empty ? 0 : std::uint32_t(random.integer(0, most));
            if (random.integer(0, 99) < crowded / 10) n += std::uint32_t(random.integer(0, 300));
        }
        check(count, std::uint32_t(random.integer(0, 1 << 30)));
        ASSERT_FALSE(HasFailure()) << "round " << round;
    }
}

}  // namespace
}  // namespace mpm
