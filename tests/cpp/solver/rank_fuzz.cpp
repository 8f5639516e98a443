// Broken messages between ranks: real ones of a run, changed, go through all that reads messages of
// a run, of its sorts, new cuts, samples, ends and saved states. Each is refused by an error that
// says who has sent what, or means something that may be; none reads or writes beyond what there
// is, which the sanitizers see. LIBMPM_FUZZ_MESSAGES: how many at least; LIBMPM_FUZZ_SEED.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <thread>

#include "mpm/core/error.hpp"
#include "mpm/exec/inbox.hpp"
#include "mpm/solver/rank_checks.hpp"
#include "mpm/solver/rank_messages.hpp"
#include "mpm/solver/ranks.hpp"
#include "support/meshes_of_elements.hpp"
#include "support/mutate.hpp"
#include "support/ranks.hpp"

namespace mpm {
namespace {

using test::forever, test::Mutator;

std::uint64_t wanted() { return test::number_of("LIBMPM_FUZZ_MESSAGES", 4000); }
std::uint64_t seed() { return test::number_of("LIBMPM_FUZZ_SEED", 1); }

struct Count {
    std::uint64_t refused = 0, read = 0;
};

/// What is handed over is tried with changes first, so many of each message; then it is read as it
/// is. Or, with `risk`, once in so many messages the change is what is read, and used.
class FuzzRanks final : public RankThreads {
public:
    FuzzRanks(int ranks, std::uint64_t seed, std::uint64_t tries, std::uint64_t risk = 0)
        : RankThreads(ranks), tries_(tries), risk_(risk), seen_(std::size_t(ranks)) {
        for (int r = 0; r < ranks; ++r) mutators_.emplace_back(seed * 1000 + std::uint64_t(r));
    }
    std::map<std::string, Count> counts;
    std::uint64_t all() const {
        std::uint64_t n = 0;
        for (const auto& [what, c] : counts) n += c.refused + c.read;
        return n;
    }

private:
    void hand_over(int, int to, const char* what, Bytes& bytes, const Reader& read) override {
        Mutator& mutate = mutators_[std::size_t(to)];
        Count count;
        // Many messages of one kind tell no more than some of it.
        const std::uint64_t seen = ++seen_[std::size_t(to)][what];
        const std::uint64_t tries = seen <= 8 ? tries_ : (tries_ + 15) / 16;
        for (std::uint64_t k = 0; k < tries; ++k) {
            const Bytes broken = mutate(bytes);
            try {
                read(broken);
                ++count.read;
            } catch (const MessageError& e) {
                EXPECT_FALSE(std::string(e.what()).empty());
                ++count.refused;
            }
        }
        if (risk_ > 0 && mutate.below(risk_) == 0) {
            bytes = mutate(bytes);
            ++count.read;
        }
        {
            const std::lock_guard lock(counting_);
            counts[what].refused += count.refused;
            counts[what].read += count.read;
        }
        read(bytes);
    }

    std::vector<Mutator> mutators_;  // by rank: each has a thread
    std::uint64_t tries_, risk_;
    std::vector<std::map<std::string, std::uint64_t>> seen_;  // by rank
    std::mutex counting_;
};

/// Small, and with much to tell: particles that cross cuts, new cuts at every sort, a gauge and a
/// probe, an inlet's worth of sensors.
Spec fuzz_scene(int dimension, int ranks) {
    Spec s = test::gauged_scene(dimension, dimension == 3);
    const bool flat = dimension == 2;
    s.cells = flat ? std::vector<std::int64_t>{40, 24} : std::vector<std::int64_t>{12, 8, 8};
    s.boundaries.resize(1);
    s.bodies.resize(2);
    const auto cut = [&](BodySpec& b, std::vector<int> lower, std::vector<int> upper, int n) {
        auto x = test::lattice(s, lower, upper, n);
        b.count = x.size() / std::size_t(dimension);
        b.position = rows_of(std::move(x), dimension);
        b.velocity[0] = 25;
    };
    if (flat) {
        cut(s.bodies[0], {2, 0}, {24, 6}, 2);
        cut(s.bodies[1], {10, 8}, {18, 12}, 2);
    } else {
        cut(s.bodies[0], {1, 0, 0}, {8, 8, 3}, 1);
        cut(s.bodies[1], {2, 2, 4}, {6, 6, 6}, 1);
    }
    s.bodies[1].first_id = s.bodies[0].count;
    s.bodies[0].smoothing = SmoothingForm::none;
    s.bodies[0].cell_smoothing.form = CellForm::flux;
    s.bodies[0].smoothed_field = "volume";
    // A mesh across the cuts, whose elements flow.
    const double dx = s.cell_size;
    const auto mesh =
        flat ? test::box_of_elements({4 * dx, 14 * dx}, {20 * dx, 2 * dx}, {20, 2})
             : test::box_of_elements({2 * dx, 2 * dx, 6.2 * dx}, {7 * dx, 2 * dx, dx}, {7, 2, 1});
    const std::vector<double> solid = test::solid();
    s.bodies.push_back(test::body_of_elements(
        s, "mesh", "VonMises", {solid[0], solid[1], solid[2], 1e-3 * solid[1], 0}, mesh,
        (flat ? 40 : 14) * std::pow(dx, dimension), true));
    s.bodies.back().velocity[0] = 25;
    for (SensorSpec& sensor : s.sensors) {
        sensor.interval = std::min(sensor.interval, 0.001);
        if (sensor.kind == SensorKind::tracker) sensor.ids = {s.bodies[1].first_id};
        if (!sensor.position.empty())
            sensor.position =
                flat ? std::vector<double>{1.03, 0.31} : std::vector<double>{0.43, 0.3, 0.2};
    }
    s.ranks.count = ranks;
    s.ranks.rebalance_above = 0;
    s.threads = 1;
    return s;
}

/// All that ranks say to each other in a run, as processes do.
void run_all(const Spec& scene, FuzzRanks& threads, int steps,
             std::vector<std::map<std::uint64_t, std::vector<double>>>* found = nullptr) {
    std::mutex mutex;
    std::atomic<int> done = 0;
    if (found) found->assign(scene.bodies.size(), {});
    threads.together([&](int r) {
        Spec s = scene;
        // The threads outlive their work: nothing is owned here.
        s.ranks.processes = std::shared_ptr<Communicator>(&threads.of(r), [](Communicator*) {});
        const auto engine = make_cpu_engine(s);
        engine->run(steps, forever, forever);
        engine->drain();
        engine->removed();
        engine->flows();
        engine->condition(64);
        engine->timings();
        engine->statistics();
        const State state = engine->save();
        engine->run(2, forever, forever);
        for (int b = 0; found && b < int(scene.bodies.size()); ++b) {
            const auto mine = test::table(*engine, b);
            const std::lock_guard lock(mutex);
            (*found)[std::size_t(b)].insert(mine.begin(), mine.end());
        }
        // Threads do not notice that another has ended while they wait for it, as processes do.
        ++done;
        for (int k = 0; done < threads.ranks(); ++k) {
            threads.of(r).check();
            if (k > 5000) throw Error("rank " + std::to_string(r) + " is alone at the end");
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
    });
}

/// Messages of one body are a piece of those of all, so bodies have to follow each other.
TEST(RankChecks, parts_of_shared_blocks_come_body_after_body) {
    using Staged = RankShare<2>::Staged;
    const std::vector<int> colours = {4, 4};
    const std::vector<Staged> good = {{0, 0, 1, 1, 0}, {2, 0, 3, 1, 1}, {0, 1, 0, 1, 2}};
    EXPECT_NO_THROW(checks::staged_parts(good, 3, colours, 1));
    std::vector<Staged> bad = good;
    std::swap(bad[1].body, bad[2].body);
    try {
        checks::staged_parts(bad, 3, colours, 1);
        ADD_FAILURE() << "accepted";
    } catch (const MessageError& e) {
        EXPECT_NE(std::string(e.what()).find("bodies do not ascend at part 2"), std::string::npos)
            << e.what();
    }
}

class RankFuzz : public ::testing::TestWithParam<int> {};

TEST_P(RankFuzz, refused_messages_change_nothing) {
    const int dimension = GetParam();
    const Spec scene = fuzz_scene(dimension, 3);
    Spec alone = scene;
    alone.ranks = {};
    const auto one = make_cpu_engine(alone);
    const int steps = 24;
    one->run(steps + 2, forever, forever);
    std::map<std::string, Count> counts;
    std::uint64_t all = 0;
    for (std::uint64_t round = 0; all < wanted(); ++round) {
        FuzzRanks threads(3, seed() + round, wanted() < 100'000 ? 4 : 256);
        std::vector<std::map<std::uint64_t, std::vector<double>>> found;
        run_all(scene, threads, steps, &found);
        for (std::size_t b = 0; b < scene.bodies.size(); ++b)
            ASSERT_TRUE(found[b] == test::table(*one, int(b)))
                << "body " << b << " round " << round;
        all += threads.all();
        for (const auto& [what, c] : threads.counts) {
            counts[what].refused += c.refused;
            counts[what].read += c.read;
        }
    }
    for (const char* what :
         {"particles", "a table", "parts of shared blocks", "sums", "a vote", "weights of blocks",
          "blocks of points", "a state", "vertices", "sums over cells",
          "what smoothing has changed", "places at rest", "wanted vertices", "places of vertices"})
        EXPECT_GT(counts[what].refused, 0u) << what;
    for (const auto& [what, c] : counts)
        std::printf("%-30s %9llu refused %9llu read\n", what.c_str(),
                    static_cast<unsigned long long>(c.refused),
                    static_cast<unsigned long long>(c.read));
}

TEST_P(RankFuzz, whatever_is_used_ends_by_name_or_well) {
    const int dimension = GetParam();
    const Spec scene = fuzz_scene(dimension, 2);
    // A run is a hundred messages or so.
    const std::uint64_t runs = std::max<std::uint64_t>(wanted() / 400, 10);
    std::uint64_t used = 0, well = 0, named = 0;
    for (std::uint64_t k = 0; k < runs; ++k) {
        FuzzRanks threads(2, 77 * seed() + k, 0, 40);
        try {
            run_all(scene, threads, 12);
            ++well;
        } catch (const Error& e) {
            ++named;
            EXPECT_GT(std::string(e.what()).size(), 10u);
        }
        used += threads.all();
    }
    EXPECT_GT(named, 0u);
    std::printf("%llu changed messages were used: %llu runs ended well, %llu by an error\n",
                static_cast<unsigned long long>(used), static_cast<unsigned long long>(well),
                static_cast<unsigned long long>(named));
}

INSTANTIATE_TEST_SUITE_P(All, RankFuzz, ::testing::Values(2, 3),
                         [](const auto& info) { return info.param == 2 ? "flat" : "solid"; });

}  // namespace
}  // namespace mpm
