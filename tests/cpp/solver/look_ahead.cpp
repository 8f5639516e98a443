// Sorts that look ahead: how far particles stand from their home cells, that these lie in the
// domain, that positions alone say who has left, and that motion does not mind.
#include <gtest/gtest.h>

#include <cstdlib>
#include <random>

#include "mpm/exec/cpu.hpp"
#include "support/ranks.hpp"
#include "support/scene.hpp"
#include "support/slow_engine.hpp"

namespace mpm {
namespace {

using test::forever;

/// While it lives, sorts of the engines that are made look this share of the drift ahead.
struct LookingAhead {
    explicit LookingAhead(const char* share) { setenv("LIBMPM_LOOK_AHEAD", share, 1); }
    ~LookingAhead() { unsetenv("LIBMPM_LOOK_AHEAD"); }
};
constexpr const char* third = "0.3333333333333333";

enum class On { cpu, device };

std::unique_ptr<Engine> make(const Spec& s, On on, const char* share = third) {
    const LookingAhead looking(share);
    if (on == On::cpu) return make_cpu_engine(s);
    return test::make_slow_engine(s);
}
RunResult step(Engine& e) { return e.run(1, forever, forever); }

/// How the particles of all bodies stand to their home cells.
struct Standing {
    double drift, furthest = 0, strays = 0, mean = 0;  // the last two over particles, and axes
    Standing(Engine& e, int dimension) {
        const State s = e.save();
        drift = saved_clock(s).drift;
        double particles = 0;
        // Bodies that are stepped as one are stored as one.
        for (int b = 0; s.contains("body" + std::to_string(b) + "_id"); ++b) {
            std::vector<std::vector<double>> offset;
            for (int a = 0; a < dimension; ++a)
                offset.push_back(
                    detail::numbers(s, "body" + std::to_string(b) + "_offset" + std::to_string(a)));
            for (std::size_t k = 0; k < offset[0].size(); ++k) {
                double most = 0;
                for (const auto& column : offset) {
                    most = std::max(most, std::abs(column[k]));
                    mean += column[k] / dimension;
                }
                strays += most > 0.5;
                furthest = std::max(furthest, most);
            }
            particles += double(offset[0].size());
        }
        mean /= particles;
        strays /= particles;
    }
};

/// A body of particles anywhere that flies at `velocity`, m/s, from [lower, upper) of the cells.
Spec flight(int dimension, int lower, int upper, double velocity, int cells = 64) {
    Spec s = test::empty_scene(dimension, true,
                               std::vector<std::int64_t>(std::size_t(dimension), cells));
    std::mt19937 draw(7);
    std::uniform_real_distribution<double> place(lower * s.cell_size, upper * s.cell_size);
    const int per_cell = dimension == 2 ? 16 : 8;
    std::vector<double> x(std::size_t(dimension * per_cell * std::pow(upper - lower, dimension)));
    for (double& at : x) at = place(draw);
    s.bodies.push_back(test::body(s, "block", "FixedCorotated", test::solid(), x, per_cell));
    for (double& v : s.bodies[0].velocity) v = velocity;
    return s;
}

class LookAhead : public ::testing::TestWithParam<std::tuple<On, int>> {
protected:
    const On on = std::get<0>(GetParam());
    const int dimension = std::get<1>(GetParam());
};

/// Over the same way between two sorts strays are halved, since particles stand beside their home
/// cells as far before as behind; a shorter way has fewer in proportion. And all fly as they did.
TEST_P(LookAhead, halves_the_strays_of_a_flight) {
    if (test::sanitized) GTEST_SKIP() << "a statistic of long runs; the other tests sort alike";
    const Spec scene = flight(dimension, 8, 18, 2);
    double strays[2], way[2], mean[2];
    Attributes where[2];
    for (int k = 0; k < 2; ++k) {
        const auto e = make(scene, on, k == 0 ? "0" : third);
        const auto sorts = [&] { return int(e->statistics().at("sorts")); };
        const int warm = 6, intervals = 4;
        while (sorts() < warm) ASSERT_EQ(step(*e).steps, 1);
        // The step after the sort that has just been is the first of what counts.
        int steps = 0;
        strays[k] = mean[k] = 0;
        for (; sorts() < warm + intervals; ++steps) {
            const Standing now(*e, dimension);
            strays[k] += now.strays;
            mean[k] += now.mean;
            ASSERT_LE(now.furthest, 0.5 + now.drift + 1e-5);
            ASSERT_EQ(step(*e).steps, 1);
        }
        strays[k] /= steps;
        mean[k] /= steps;
        way[k] = steps * 2 * e->time_step() / scene.cell_size / intervals;
        while (e->step() < 400) step(*e);
        where[k] = e->attributes(0, {"position", "velocity"});
    }
    EXPECT_GT(strays[0], 0.05) << "there must be strays to mean anything";
    EXPECT_LT(strays[1] / way[1], 0.6 * strays[0] / way[0]);
    EXPECT_GT(mean[0], 0.4 * way[0]);
    EXPECT_LT(std::abs(mean[1]), 0.1 * way[1]);
    std::map<std::uint64_t, std::size_t> row;
    for (std::size_t k = 0; k < where[1].id.size(); ++k) row[where[1].id[k]] = k;
    ASSERT_EQ(row.size(), where[0].id.size());
    for (const auto& [name, tolerance] : {std::pair("position", 2e-4), std::pair("velocity", 0.02)})
        for (std::size_t k = 0; k < where[0].id.size(); ++k)
            for (std::size_t a = 0; a < std::size_t(dimension); ++a)
                ASSERT_NEAR(where[1].values.at(name).data[row.at(where[0].id[k]) * dimension + a],
                            where[0].values.at(name).data[k * dimension + a], tolerance)
                    << name << " of particle " << where[0].id[k];
}

/// Whatever happens: nobody stands further from home than half a cell and the drift, which keeps
/// its limit; home cells lie in the domain, and the table has all blocks around them, or no engine
/// took the state.
TEST_P(LookAhead, keeps_particles_within_their_tiles) {
    Spec s = test::busy_scene(dimension, true);
    s.bodies[0].velocity[0] = 5;
    if (dimension == 2) s.bodies[1].velocity[0] = -20;  // against the wall
    const double limit = on == On::cpu ? Cpu::drift_limit : test::slow_drift_limit;
    const auto e = make(s, on), other = make(s, on);
    double most = 0;
    for (int k = 0; k < (test::sanitized ? 30 : 120); ++k) {
        const double before = e->time();
        ASSERT_EQ(step(*e).steps, 1);
        const Standing now(*e, dimension);
        const double moved =
            e->statistics().at("fastest_node") * (e->time() - before) / s.cell_size;
        most = std::max(most, now.drift);
        ASSERT_LE(now.drift, std::max(limit, moved) + 1e-9);
        ASSERT_LE(now.furthest, 0.5 + now.drift + 1e-5);
        if (k % 5 == 0) other->load(e->save());
    }
    EXPECT_GT(e->statistics().at("sorts"), test::sanitized ? 1 : 3);
    EXPECT_GT(most, 0.3 * limit);
}

/// The same where few particles are fast: then the drift calls for sorts, and not the strays.
TEST_P(LookAhead, keeps_a_jet_within_its_tiles) {
    if (test::sanitized && dimension == 3) GTEST_SKIP() << "as in the plane, and long";
    // Two steps and more between sorts, whatever the drift may be.
    Spec s = flight(dimension, 4, 6, on == On::cpu ? 12 : 15);
    std::vector<int> lower(std::size_t(dimension), 30), upper(std::size_t(dimension), 44);
    s.bodies.push_back(test::body(s, "rest", "TaitFluid", test::fluid(),
                                  test::lattice(s, lower, upper, 2), std::pow(2, dimension)));
    const double limit = on == On::cpu ? Cpu::drift_limit : test::slow_drift_limit;
    const auto e = make(s, on);
    double most = 0;
    for (int k = 0; k < 60; ++k) {
        ASSERT_EQ(step(*e).steps, 1);
        const Standing now(*e, dimension);
        most = std::max(most, now.drift);
        ASSERT_LE(now.furthest, 0.5 + now.drift + 1e-5);
        ASSERT_LE(now.drift, limit + 1e-9);
    }
    EXPECT_GT(most, limit - 0.2);  // a step takes a tenth
    EXPECT_GT(e->statistics().at("sorts"), 1);
}

/// A sort takes out those who stand outside of the domain, and nobody who will only be there.
TEST_P(LookAhead, leaves_positions_to_say_who_has_left) {
    Spec s = flight(dimension, 2, 8, 3, 12);
    s.leaving = Leaving::remove;
    const auto e = make(s, on);
    const double side = 12 * s.cell_size, rounding = 1e-5 * side;
    std::uint64_t gone = 0;
    const std::uint64_t all = e->particle_count(0);
    int checked = 0;
    double sorts = 0;
    while (gone < all && e->step() < 2000) {
        ASSERT_EQ(step(*e).steps, 1);
        for (const auto& batch : e->removed()) {
            gone += batch.ids.size();
            for (std::size_t k = 0; k < batch.ids.size(); ++k) {
                double furthest = 0;
                for (int a = 0; a < dimension; ++a)
                    furthest =
                        std::max(furthest, batch.position.data[k * std::size_t(dimension) + a]);
                ASSERT_GE(furthest, side - rounding);
            }
        }
        ASSERT_EQ(gone + e->particle_count(0), all);
        if (e->statistics().at("sorts") == sorts || e->particle_count(0) == 0) continue;
        sorts = e->statistics().at("sorts");
        // A sort, and one step.
        const double moved = 3 * e->time_step();
        const Attributes seen = e->attributes(0, {"position"});
        for (double x : seen.values.at("position").data)
            ASSERT_LE(x, side + 1.1 * moved + rounding);
        ++checked;
    }
    EXPECT_EQ(gone, all);
    EXPECT_GT(checked, 3);
}

/// The sorts of a run do not depend on who works, how many and with how many halts.
TEST_P(LookAhead, has_the_bits_of_one_run) {
    if (test::sanitized && dimension == 3) GTEST_SKIP() << "as in the plane, and long";
    Spec scene = test::gauged_scene(dimension, true);
    scene.threads = 1;
    const auto whole = make(scene, on), split = make(scene, on), resumed = make(scene, on);
    const int first = test::sanitized ? 17 : 37, rest = test::sanitized ? 23 : 63;
    ASSERT_EQ(whole->run(first + rest, forever, forever).steps, first + rest);
    ASSERT_GT(whole->statistics().at("sorts"), 2);
    ASSERT_GT(whole->statistics().at("drift"), 0);
    split->run(first, forever, forever);
    resumed->run(7, forever, forever);
    resumed->load(split->save());
    for (Engine* e : {split.get(), resumed.get()}) {
        e->run(rest, forever, forever);
        EXPECT_EQ(test::state_bytes(*e), test::state_bytes(*whole));
    }
    if (on == On::device) return;  // of their ranks: rank_devices.cpp
    scene.threads = 3;
    const auto threads = make(scene, on);
    threads->run(first + rest, forever, forever);
    EXPECT_EQ(test::state_bytes(*threads), test::state_bytes(*whole));
    scene.ranks.count = 3;
    for (int axis : {-1, 0}) {
        scene.ranks.axis = axis;
        const auto ranks = make(scene, on);
        ranks->run(first + rest, forever, forever);
        EXPECT_GT(ranks->statistics().at("migrated"), 0);
        test::expect_same_particles(*ranks, *whole, 3);
    }
}

INSTANTIATE_TEST_SUITE_P(All, LookAhead,
                         ::testing::Combine(::testing::Values(On::cpu, On::device),
                                            ::testing::Values(2, 3)));

TEST(LookAheadSwitch, takes_a_share_of_the_drift) {
    const Spec s = flight(2, 8, 10, 1);
    for (const char* wrong : {"0.6", "-0.1", "much", "nan"})
        EXPECT_THROW(make(s, On::cpu, wrong), SceneError) << wrong;
}

}  // namespace
}  // namespace mpm
