// Ranks as threads: everyone gets what everyone gave, whatever arrives first, and a rank that fails
// stops all instead of leaving them to wait.
#include "mpm/exec/rank_threads.hpp"

#include <gtest/gtest.h>

#include "mpm/core/error.hpp"
#include "support/unruly.hpp"

namespace mpm {
namespace {

/// Each rank tells its neighbours in a row what round it is, and all what it has heard.
void talk(RankThreads& ranks, int rounds) {
    ranks.together([&](int rank) {
        Communicator& c = ranks.of(rank);
        ASSERT_EQ(c.rank(), rank);
        ASSERT_EQ(c.ranks(), ranks.ranks());
        std::vector<int> peers;
        if (rank > 0) peers.push_back(rank - 1);
        if (rank + 1 < c.ranks()) peers.push_back(rank + 1);
        for (int round = 0; round < rounds; ++round) {
            std::vector<Bytes> to{std::size_t(c.ranks())};
            for (int p : peers) {
                Packer packer;
                packer.put(std::vector<int>(std::size_t(round % 5), 100 * rank + p + round));
                to[std::size_t(p)] = packer.take();
            }
            const auto in = c.exchange(std::move(to), peers);
            std::vector<int> heard = {rank};
            for (int p : peers) {
                Unpacker unpacker(in[std::size_t(p)]);
                const auto list = unpacker.list<int>();
                EXPECT_TRUE(unpacker.empty());
                EXPECT_EQ(list, std::vector<int>(std::size_t(round % 5), 100 * p + rank + round));
                heard.push_back(p);
            }
            const auto all = c.all_gather(heard);
            ASSERT_EQ(all.size(), std::size_t(c.ranks()));
            EXPECT_EQ(all[std::size_t(rank)], heard);
            for (int r = 0; r < c.ranks(); ++r) EXPECT_EQ(all[std::size_t(r)].at(0), r);
        }
    });
}

TEST(RankThreads, everyone_gets_what_everyone_gave) {
    for (int n : {1, 2, 3, 4}) {
        RankThreads ranks(n);
        talk(ranks, 200);
        talk(ranks, 1);
    }
}

TEST(RankThreads, whatever_arrives_first) {
    test::UnrulyRanks ranks(4, 11);
    talk(ranks, 60);
    EXPECT_GT(ranks.overtaken(), 0u) << "the test must disturb to mean anything";
}

TEST(RankThreads, one_that_fails_stops_all) {
    for (int guilty : {0, 2}) {
        RankThreads ranks(3);
        const auto work = [&](int rank) {
            Communicator& c = ranks.of(rank);
            for (int round = 0; round < 5; ++round) {
                c.all_gather(std::vector<int>{round});
                if (rank == guilty && round == 3) throw SceneError("no such luck");
            }
        };
        try {
            ranks.together(work);
            FAIL() << "nobody heard of it";
        } catch (const SceneError& e) {
            EXPECT_STREQ(e.what(), "no such luck");
        }
        // Nobody can go on without it, and nobody waits for it.
        EXPECT_THROW(ranks.together(work), RankStopped);
        ranks.begin_anew();
        talk(ranks, 10);
    }
}

TEST(RankThreads, a_message_that_is_too_short) {
    Packer packer;
    packer.put(std::vector<int>{1, 2});
    const Bytes bytes = packer.take();
    Unpacker unpacker(bytes);
    EXPECT_EQ(unpacker.list<int>(), (std::vector<int>{1, 2}));
    EXPECT_THROW(unpacker.list<int>(), Error);
    Packer more;
    const std::uint64_t count = std::uint64_t(1) << 62;  // of ints: their bytes wrap to none
    more.put(&count, 1);
    const Bytes wrong = more.take();
    Unpacker other(wrong);
    EXPECT_THROW(other.list<int>(), Error);
}

}  // namespace
}  // namespace mpm
