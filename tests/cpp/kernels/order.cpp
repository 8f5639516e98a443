// The order in which devices store the particles of a block, and blocks two by two.
#include "mpm/kernels/order.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "mpm/kernels/home_pairs.hpp"
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

// By chunk -------------------------------------------------------------------------------------

using Block64 = std::uint32_t[block_cells];

struct InChunk {
    int cell = -1;
    std::uint32_t rank = 0;
};

/// Who stands at each place of a block; checks that every particle has one of its own.
std::vector<InChunk> chunked(const Block64& count, std::uint32_t begin) {
    std::uint32_t particles = 0;
    for (auto n : count) particles += n;
    std::vector<InChunk> at(particles);
    place_by_chunk(count, begin, [&](int cell, std::uint32_t rank, std::uint32_t place) {
        ASSERT_LT(rank, count[cell]) << "a particle that is not there";
        ASSERT_GE(place, begin);
        ASSERT_LT(place, begin + particles);
        ASSERT_EQ(at[place - begin].cell, -1) << "place taken twice";
        at[place - begin] = {cell, rank};
    });
    std::vector<std::uint32_t> seen(block_cells);
    for (const InChunk& p : at) {
        if (p.cell < 0) {
            ADD_FAILURE() << "a place stays empty";
            continue;
        }
        EXPECT_EQ(p.rank, seen[std::size_t(p.cell)]++) << "ranks of a cell ascend";
    }
    return at;
}

/// What the warps of a device rely on: they find chunks by sums of counts, four ranks each, cell by
/// cell in the order of places.
void check_chunks(const Block64& count, std::uint32_t begin) {
    const auto at = chunked(count, begin);
    int cell_at[block_cells];
    cells_by_place(count, cell_at);
    std::size_t place = 0;
    for (int half = 0; half < block_cells; half += warp_cells) {
        std::uint32_t most = 0;
        for (int k = 0; k < warp_cells; ++k) most = std::max(most, count[cell_at[half + k]]);
        for (std::uint32_t first = 0; first < most; first += chunk_ranks)
            for (int k = 0; k < warp_cells; ++k) {
                const int c = cell_at[half + k];
                for (std::uint32_t r = first; r < std::min(first + chunk_ranks, count[c]); ++r) {
                    ASSERT_LT(place, at.size());
                    EXPECT_EQ(at[place].cell, c);
                    EXPECT_EQ(at[place].rank, r);
                    ++place;
                }
            }
    }
    EXPECT_EQ(place, at.size());
}

TEST(ChunkOrder, every_particle_has_a_place) {
    test::Random random(3);
    for (int round = 0; round < 200; ++round) {
        Block64 count;
        const std::uint32_t most = round < 100 ? 16 : (round < 150 ? 3 : 200);
        for (auto& n : count) n = std::uint32_t(random.integer(0, int(most)));
        if (round % 7 == 0)
            for (int c = 0; c < block_cells; c += 3) count[c] = 0;
        check_chunks(count, std::uint32_t(round));
    }
    const Block64 none = {};
    check_chunks(none, 5);
}

/// Lanes of a warp have alike numbers, and no two cells of eight that follow each other meet in a
/// bank.
TEST(ChunkOrder, fuller_cells_come_first_within_their_class) {
    test::Random random(4);
    Block64 count;
    for (auto& n : count) n = std::uint32_t(random.integer(0, 20));
    int cell_at[block_cells];
    cells_by_place(count, cell_at);
    std::vector<bool> seen(block_cells);
    for (int p = 0; p < block_cells; ++p) {
        EXPECT_EQ(cell_at[p] % cell_classes, p % cell_classes);
        EXPECT_FALSE(seen[std::size_t(cell_at[p])]);
        seen[std::size_t(cell_at[p])] = true;
        if (p >= cell_classes) {
            EXPECT_GE(count[cell_at[p - cell_classes]], count[cell_at[p]]);
        }
    }
    Block64 even;
    for (auto& n : even) n = 8;
    cells_by_place(even, cell_at);
    for (int p = 0; p < block_cells; ++p) EXPECT_EQ(cell_at[p], p) << "equal cells stay in order";
}

TEST(ChunkOrder, a_byte_holds_cell_and_rank) {
    for (int cell = 0; cell < block_cells; ++cell)
        for (std::uint32_t rank = 0; rank < 9; ++rank) {
            const std::uint8_t byte = home_byte(cell, rank);
            EXPECT_EQ(home_cell_of(byte), cell);
            EXPECT_EQ(chunk_rank_of(byte), int(rank % chunk_ranks));
        }
}

/// Both orders hold the same particles between the same places of a block, and say which cell each
/// is in.
TEST(ChunkOrder, whole_blocks) {
    test::Random random(5);
    const std::size_t cells = 5 * block_cells;
    std::vector<std::uint32_t> start(cells + 1);
    for (std::size_t c = 0; c < cells; ++c)
        start[c + 1] = start[c] + std::uint32_t(random.integer(0, 11));
    for (const HomeOrder order : {HomeOrder::by_rank, HomeOrder::by_chunk}) {
        std::vector<int> taken(start.back());
        place_homes(order, start.data(), cells,
                    [&](std::size_t c, std::uint32_t rank, std::uint32_t place, std::uint8_t byte) {
                        ASSERT_LT(rank, start[c + 1] - start[c]);
                        const std::size_t block = c / block_cells * block_cells;
                        ASSERT_GE(place, start[block]);
                        ASSERT_LT(place, start[block + block_cells]);
                        EXPECT_EQ(std::size_t(home_cell_of(byte)), c % block_cells);
                        ++taken[place];
                    });
        for (const int n : taken) EXPECT_EQ(n, 1);
    }
}

// Homes two by two ---------------------------------------------------------------------------

/// Every full home is in one pair, at the side where it lies, and beside the other; those that hold
/// few particles are in none.
TEST(HomePairs, each_full_home_once) {
    test::Random random(6);
    constexpr int blocks = 40, sides = Block<3>::neighbours;
    for (int round = 0; round < 50; ++round) {
        // A row of blocks along the first axis, of which some are missing in the table.
        std::vector<std::int32_t> corners, neighbours, slot_of(blocks, -1), home;
        for (int b = 0; b < blocks; ++b) {
            if (random.integer(0, 4) == 0) continue;
            slot_of[std::size_t(b)] = std::int32_t(corners.size() / 3);
            corners.insert(corners.end(), {b * Block<3>::edge, 0, 0});
        }
        const std::size_t slots = corners.size() / 3;
        neighbours.assign(slots * sides, -1);
        std::vector<std::uint32_t> start(slots * block_cells + 1);
        const std::uint32_t least = 8;
        for (int b = 0; b < blocks; ++b) {
            const std::int32_t s = slot_of[std::size_t(b)];
            if (s < 0) continue;
            if (b > 0) neighbours[std::size_t(s) * sides + 4] = slot_of[std::size_t(b - 1)];
            if (b + 1 < blocks)
                neighbours[std::size_t(s) * sides + 22] = slot_of[std::size_t(b + 1)];
            const auto n = std::uint32_t(random.integer(0, 16));
            for (int c = 0; c < block_cells; ++c)
                start[std::size_t(s) * block_cells + std::size_t(c) + 1] =
                    start[std::size_t(s) * block_cells] + n;
            if (n >= least) home.push_back(s);
        }
        std::shuffle(home.begin(), home.end(), std::mt19937(unsigned(round)));
        const FullHomes<3> full{start.data(), neighbours.data(), corners.data(), least};
        std::vector<std::uint32_t> flag(home.size()), position(home.size() + 1);
        for (std::size_t h = 0; h < home.size(); ++h)
            FlagPairs<3>{full, home.data(), flag.data()}(std::int64_t(h));
        for (std::size_t h = 0; h < home.size(); ++h) position[h + 1] = position[h] + flag[h];
        std::vector<std::int32_t> pair(2 * home.size(), -7);
        for (std::size_t h = 0; h < home.size(); ++h)
            ListPairs<3>{full, home.data(), position.data(), pair.data()}(std::int64_t(h));
        std::vector<int> seen(slots);
        for (std::size_t k = 0; k < position.back(); ++k) {
            const std::int32_t first = pair[2 * k], second = pair[2 * k + 1];
            ASSERT_GE(std::max(first, second), 0) << "an empty pair";
            for (int side = 0; side < 2; ++side) {
                const std::int32_t s = pair[2 * k + std::size_t(side)];
                ASSERT_GE(s, -1);
                if (s < 0) continue;
                ++seen[std::size_t(s)];
                EXPECT_EQ(corners[std::size_t(s) * 3] / Block<3>::edge % 2, side);
            }
            if (first >= 0 && second >= 0) {
                EXPECT_EQ(corners[std::size_t(second) * 3] - corners[std::size_t(first) * 3],
                          Block<3>::edge);
            }
        }
        for (std::size_t s = 0; s < slots; ++s)
            EXPECT_EQ(seen[s], std::count(home.begin(), home.end(), std::int32_t(s)));
    }
}

}  // namespace
}  // namespace mpm
