// Several ranks against one: the same bits of particles and time whatever the number of ranks, the
// cuts, their moving while the scene runs, and the order in which messages arrive; sensors to the
// rounding of their sums; no particle lost or doubled; one that fails stops all.
#include "mpm/solver/ranks.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <set>

#include "mpm/core/error.hpp"
#include "support/ranks.hpp"
#include "support/scene.hpp"
#include "support/unruly.hpp"

namespace mpm {
namespace {

using test::expect_same_particles;
using test::expect_same_samples;
using test::forever;
using test::go;
using test::with_ranks;

constexpr int parts[] = {test::sanitized ? 17 : 37, test::sanitized ? 23 : 63};
constexpr int whole_run = parts[0] + parts[1];

struct Kind {
    int dimension;
    bool single;
};
class Ranks : public ::testing::TestWithParam<Kind> {
protected:
    Spec scene() { return test::gauged_scene(GetParam().dimension, GetParam().single); }
};

TEST_P(Ranks, have_the_bits_of_one) {
    const auto one = make_cpu_engine(scene());
    go(*one, whole_run);
    ASSERT_GT(one->statistics().at("sorts"), 1) << "the scene must sort to mean anything";
    const auto samples = one->drain();
    for (int ranks : {2, 3, 4}) {
        if (test::sanitized && ranks != 3) continue;
        for (int axis : {-1, 0}) {
            const Spec s = with_ranks(scene(), ranks, axis);
            const auto many = make_cpu_engine(s);
            EXPECT_EQ(many->statistics().at("ranks"), ranks);
            go(*many, parts[0]);
            EXPECT_EQ(go(*many, parts[1]).steps, parts[1]);
            EXPECT_GT(many->statistics().at("migrated"), 0);
            expect_same_particles(*many, *one, 3);
            expect_same_samples(many->drain(), samples, s);
        }
    }
}

TEST_P(Ranks, may_cut_anew_at_every_sort) {
    const auto one = make_cpu_engine(scene());
    go(*one, whole_run);
    const auto many = make_cpu_engine(with_ranks(scene(), 3, -1, 0));
    go(*many, whole_run);
    EXPECT_GT(many->statistics().at("rebalances"), 0);
    expect_same_particles(*many, *one, 3);
}

TEST_P(Ranks, do_not_mind_late_messages) {
    const auto one = make_cpu_engine(scene());
    go(*one, parts[0]);
    const Spec s = with_ranks(scene(), 4, -1, 1.0);
    auto threads = std::make_unique<test::UnrulyRanks>(4, 5);
    const test::UnrulyRanks& seen = *threads;
    const auto many = make_cpu_engine(s, std::move(threads));
    go(*many, parts[0]);
    EXPECT_GT(seen.overtaken(), 0u);
    expect_same_particles(*many, *one, 3);
}

TEST_P(Ranks, resume_on_another_number) {
    const auto straight = make_cpu_engine(scene());
    go(*straight, parts[0]);
    const auto from_one = straight->save();
    go(*straight, parts[1]);
    const auto samples = straight->drain();
    const auto three = make_cpu_engine(with_ranks(scene(), 3));
    three->load(from_one);
    go(*three, 5);
    const auto two = make_cpu_engine(with_ranks(scene(), 2, 0));
    two->load(three->save());
    EXPECT_EQ(two->time(), three->time());
    go(*two, 5);
    const auto again = make_cpu_engine(scene());
    again->load(two->save());
    EXPECT_EQ(again->step(), parts[0] + 10);
    go(*again, parts[1] - 10);
    expect_same_particles(*again, *straight, 3);
}

TEST_P(Ranks, in_two_passes) {
    Spec s = scene();
    s.pipeline = "two-pass";
    const auto one = make_cpu_engine(s);
    go(*one, parts[0]);
    for (int ranks : {2, 4}) {
        const auto many = make_cpu_engine(with_ranks(s, ranks, -1, 1.0));
        go(*many, parts[0]);
        EXPECT_GT(many->statistics().at("migrated"), 0);
        expect_same_particles(*many, *one, 3);
    }
}

/// What a guard sees is what it sees of one rank: each node and each particle once. A look changes
/// nothing.
TEST_P(Ranks, are_watched_as_one) {
    const auto one = make_cpu_engine(scene()), many = make_cpu_engine(with_ranks(scene(), 3)),
               unseen = make_cpu_engine(with_ranks(scene(), 3));
    // Sums in another order; mass is deposited in the precision of the grid.
    const double near = 1e-11, mass = GetParam().single ? 1e-6 : 1e-13;
    for (int part = 0; part < 3; ++part) {
        const Condition a = one->condition(1 << 24), b = many->condition(1 << 24);
        const double energy = std::abs(a.kinetic) + std::abs(a.elastic) + std::abs(a.potential);
        EXPECT_GT(a.mass, 0);
        EXPECT_NEAR(b.kinetic, a.kinetic, near * energy);
        EXPECT_NEAR(b.elastic, a.elastic, near * energy);
        EXPECT_NEAR(b.potential, a.potential, near * energy);
        EXPECT_EQ(b.speed, a.speed);
        EXPECT_NEAR(b.mass, a.mass, near * a.mass);
        EXPECT_NEAR(b.density, a.density, near * a.density);
        double placed = 0;
        for (const BodySpec& body : scene().bodies)
            placed += body.particle_mass * double(body.count);
        EXPECT_NEAR(b.mass, placed, mass * placed);
        ASSERT_EQ(b.volume_ratio.size(), 3u);
        for (int k = 0; k < 3; ++k)
            EXPECT_NEAR(b.volume_ratio[std::size_t(k)], a.volume_ratio[std::size_t(k)], near);
        go(*one, 10);
        go(*many, 10);
        go(*unseen, 10);
    }
    expect_same_particles(*many, *one, 3);
    expect_same_particles(*many, *unseen, 3);
}

/// Each dimension and each precision; under sanitizers not each with each.
const std::vector kinds =
    test::sanitized ? std::vector{Kind{2, false}, Kind{3, true}}
                    : std::vector{Kind{2, true}, Kind{2, false}, Kind{3, true}, Kind{3, false}};
INSTANTIATE_TEST_SUITE_P(All, Ranks, ::testing::ValuesIn(kinds));

/// Water that is shaken about a closed box, so that every part of it comes by every cut.
Spec shaken(int dimension, bool single) {
    const bool flat = dimension == 2;
    Spec s = test::empty_scene(
        dimension, single,
        flat ? std::vector<std::int64_t>{40, 40} : std::vector<std::int64_t>{16, 16, 16});
    s.bodies.push_back(test::body(
        s, "water", "TaitFluid", test::fluid(2e5),
        flat ? test::lattice(s, {0, 0}, {20, 20}, 2) : test::lattice(s, {0, 0, 0}, {8, 8, 8}, 2),
        flat ? 4 : 8));
    s.bodies[0].smoothing = SmoothingForm::one_volume_gradient;
    s.bodies[0].smoothing_time = 0.01;
    test::add_walls(s, Response::separable);
    test::tilt(s);
    return s;
}

struct Mixing {
    int dimension, ranks;
};
class RanksMixing : public ::testing::TestWithParam<Mixing> {};

/// LIBMPM_MIXING_STEPS=10000 goes on for longer.
TEST_P(RanksMixing, nobody_is_lost_or_doubled) {
    const auto [dimension, ranks] = GetParam();
    const char* asked = std::getenv("LIBMPM_MIXING_STEPS");
    // 240 steps in space cut anew 12 times.
    const int usual = dimension == 2    ? (test::sanitized ? 600 : 10002)
                      : test::sanitized ? 240
                                        : 600;
    const int steps = asked ? std::atoi(asked) : usual;
    const auto one = make_cpu_engine(shaken(dimension, true));
    const auto many = make_cpu_engine(with_ranks(shaken(dimension, true), ranks, -1, 1.1));
    std::set<std::uint64_t> all;
    const auto count = one->particle_count(0);
    for (std::uint64_t id = 0; id < count; ++id) all.insert(id);
    for (int part = 0; part < 6; ++part) {
        ASSERT_EQ(go(*one, steps / 6).reason, "steps");
        ASSERT_EQ(go(*many, steps / 6).reason, "steps");
        const auto ids = many->attributes(0, {"mass"}).id;
        EXPECT_EQ(ids.size(), count);
        EXPECT_EQ(std::set<std::uint64_t>(ids.begin(), ids.end()), all);
        expect_same_particles(*many, *one, 1);
    }
    const auto statistics = many->statistics();
    EXPECT_GT(statistics.at("migrated"), double(count)) << "it must mix to mean anything";
    EXPECT_GT(statistics.at("rebalances"), 2);
    RecordProperty("migrated", int(statistics.at("migrated")));
    RecordProperty("rebalances", int(statistics.at("rebalances")));
}

INSTANTIATE_TEST_SUITE_P(All, RanksMixing,
                         ::testing::Values(Mixing{2, 2}, Mixing{2, 4}, Mixing{3, 4}));

/// All of the water begins in the blocks of one of four equal parts of the domain.
TEST(RanksFlow, the_load_comes_out_even) {
    Spec s = shaken(2, false);
    const auto many = make_cpu_engine(with_ranks(s, 4, 0));
    go(*many, whole_run);
    EXPECT_LT(many->statistics().at("imbalance"), 1.6) << "planes of blocks of eight cells";
    const auto curve = make_cpu_engine(with_ranks(s, 4));
    go(*curve, whole_run);
    EXPECT_LT(curve->statistics().at("imbalance"), 1.25) << "blocks as large as a tenth of a part";
}

TEST(RanksEnd, particles_that_leave) {
    for (Leaving policy : {Leaving::freeze, Leaving::remove, Leaving::stop}) {
        Spec s = shaken(2, false);
        s.leaving = policy;
        s.boundaries.clear();
        s.gravity.time = {0};
        s.gravity.value = {40, 15};
        const auto one = make_cpu_engine(s), many = make_cpu_engine(with_ranks(s, 3));
        const auto a = one->run(-1, 0.38, forever), b = many->run(-1, 0.38, forever);
        ASSERT_EQ(a.reason, b.reason);
        EXPECT_EQ(a.steps, b.steps);
        if (policy == Leaving::stop) {
            ASSERT_EQ(a.reason, "fault");
            EXPECT_EQ(b.fault.code, "left-domain");
            EXPECT_EQ(b.fault.body, a.fault.body);
            EXPECT_EQ(b.fault.value, a.fault.value);
            EXPECT_EQ(b.fault.message, a.fault.message);
            auto ids = a.fault.ids;
            std::sort(ids.begin(), ids.end());
            EXPECT_EQ(b.fault.ids, ids);
        }
        std::set<std::uint64_t> gone_a, gone_b;
        for (const auto& r : one->removed()) gone_a.insert(r.ids.begin(), r.ids.end());
        for (const auto& r : many->removed())
            for (std::uint64_t id : r.ids) EXPECT_TRUE(gone_b.insert(id).second);
        EXPECT_EQ(gone_a, gone_b);
        EXPECT_EQ(gone_a.empty(), policy == Leaving::stop);
        expect_same_particles(*many, *one, 1);
    }
}

/// A particle of one rank breaks its law: all stop at the same step, and one says who it was.
TEST(RanksEnd, a_fault_stops_all) {
    Spec s = test::empty_scene(2, false, {48, 24});
    s.bodies.push_back(test::body(s, "rest", "TaitFluid", {1000, 1e-2, 7.15, 0},
                                  test::lattice(s, {30, 4}, {44, 18}, 2), 4));
    s.bodies.push_back(test::body(s, "crushed", "TaitFluid", {1000, 1e-2, 7.15, 0},
                                  test::lattice(s, {4, 4}, {12, 12}, 2), 4));
    auto& b = s.bodies[1];
    b.velocity.clear();
    const auto x = test::positions(b, 2);
    for (std::size_t k = 0; k < x.size(); ++k) b.velocity.push_back(-20 * (x[k] - 0.8));
    const auto one = make_cpu_engine(s), many = make_cpu_engine(with_ranks(s, 3));
    const auto a = go(*one, 20000), c = go(*many, 20000);
    ASSERT_EQ(a.fault.body, "crushed");
    ASSERT_EQ(c.reason, "fault");
    EXPECT_EQ(c.fault.code, a.fault.code);
    EXPECT_EQ(c.fault.body, "crushed");
    EXPECT_EQ(c.fault.step, a.fault.step);
    EXPECT_EQ(c.steps, a.steps);
    EXPECT_EQ(c.fault.message, a.fault.message);
    EXPECT_EQ(go(*many, 5).reason, "fault");
    EXPECT_THROW(many->save(), NumericalError);
}

/// What one rank cannot load none can, and all go on from the next state they are given.
TEST(RanksEnd, a_state_that_is_refused) {
    const Spec s = with_ranks(shaken(2, false), 3);
    const auto one = make_cpu_engine(shaken(2, false)), many = make_cpu_engine(s);
    State state = one->save(), cut = state;
    cut["clock_dt"].bytes.pop_back();
    EXPECT_THROW(many->load(cut), SceneError);
    go(*many, 1);  // as if nobody had asked
    many->load(state);
    go(*one, parts[0]);
    go(*many, parts[0]);
    expect_same_particles(*many, *one, 1);
}

TEST(RanksEnd, more_ranks_than_blocks) {
    Spec s = test::empty_scene(2, false, {16, 16});
    s.gravity.value[1] = -9.81;
    s.bodies.push_back(test::body(s, "block", "FixedCorotated", test::solid(),
                                  test::lattice(s, {2, 9}, {5, 12}, 2), 4));
    test::add_walls(s, Response::separable);
    const auto one = make_cpu_engine(s), many = make_cpu_engine(with_ranks(s, 4));
    go(*one, 400);
    go(*many, 400);
    expect_same_particles(*many, *one, 1);
    EXPECT_EQ(many->grid("mass").data.size(), one->grid("mass").data.size());
}

/// Nodes on both sides of a mirrored wall share: whoever has one side's must have the other's.
TEST(RanksFlow, mirrored_walls) {
    Spec s = shaken(2, false);
    for (SurfaceLaw& law : s.boundaries[0].law) law.response = Response::mirror;
    SensorSpec load;
    load.name = "load";
    load.kind = SensorKind::load_cell;
    load.boundary = 0;
    load.faces = 15;
    load.interval = 0.01;
    load.reference = {0, 0};
    s.sensors.push_back(load);
    const auto one = make_cpu_engine(s);
    go(*one, whole_run);
    const auto samples = one->drain();
    const auto state = one->save();
    go(*one, parts[0]);
    for (int axis : {-1, 0, 1}) {
        const Spec cut = with_ranks(s, 3, axis, 1.0);
        const auto many = make_cpu_engine(cut);
        go(*many, whole_run);
        expect_same_samples(many->drain(), samples, cut);
        many->load(state);
        go(*many, parts[0]);
        expect_same_particles(*many, *one, 1);
    }
}

/// A stream that layer after layer comes in by one face and leaves by the other.
TEST(RanksFlow, inlets_and_outlets) {
    Spec s = test::empty_scene(2, false, {40, 12});
    s.bodies.push_back(test::body(s, "water", "TaitFluid", test::fluid(2e5),
                                  test::lattice(s, {0, 2}, {30, 8}, 2), 4));
    s.bodies[0].velocity = {2, 0};
    s.bodies[0].id_count = 100000;
    InletSpec inlet;
    inlet.name = "in";
    inlet.body = 0;
    inlet.spacing = 0.05;
    for (int k = 4; k < 16; ++k) {
        inlet.points.push_back(0.025);
        inlet.points.push_back((k + 0.5) * 0.05);
    }
    inlet.velocity.time = {0};
    inlet.velocity.value = {2};
    s.inlets.push_back(inlet);
    inlet.name = "again";  // two layers may come at once, to one body
    inlet.points = {0.025, 0.95, 0.025, 1.0};
    s.inlets.push_back(inlet);
    s.outlets.push_back({"out", 1});
    s.leaving = Leaving::remove;
    const auto one = make_cpu_engine(s);
    const auto count = one->particle_count(0);
    one->run(-1, 0.7, forever);
    const auto flows = one->flows();
    bool came = false, went = false;
    for (const Flow& f : flows) (f.inlet ? came : went) = true;
    ASSERT_TRUE(came && went);
    EXPECT_NE(one->particle_count(0), count);
    for (int axis : {-1, 0}) {
        const auto many = make_cpu_engine(with_ranks(s, 3, axis));
        many->run(-1, 0.7, forever);
        expect_same_particles(*many, *one, 1);
        const auto theirs = many->flows();
        ASSERT_EQ(theirs.size(), flows.size());
        std::uint64_t particles[2] = {}, here[2] = {};
        for (const Flow& f : flows) particles[f.inlet] += f.particles;
        for (const Flow& f : theirs) here[f.inlet] += f.particles;
        EXPECT_EQ(here[0], particles[0]);
        EXPECT_EQ(here[1], particles[1]);
    }
}

TEST(RanksEnd, wall_time_stops_all_at_one_step) {
    const auto many = make_cpu_engine(with_ranks(shaken(2, false), 3)),
               one = make_cpu_engine(shaken(2, false));
    std::int64_t done = 0;
    while (done < 10) {
        const auto r = many->run(10 - done, forever, 0.0);
        ASSERT_GT(r.steps, 0);
        done += r.steps;
    }
    go(*one, 10);
    expect_same_particles(*many, *one, 1);
}

TEST(RanksEnd, what_is_not_built_is_refused) {
    const auto refused = [](auto change) {
        Spec s = shaken(2, false);
        change(s);
        try {
            make_cpu_engine(with_ranks(s, 2));
            FAIL() << "accepted";
        } catch (const SceneError& e) {
            EXPECT_NE(std::string(e.what()).find("not built for several ranks"), std::string::npos)
                << e.what();
        }
    };
    refused([](Spec& s) { s.functions.kind = "triangles"; });
    Spec outside = with_ranks(shaken(2, false), 2);
    auto x = test::positions(outside.bodies[0], 2);
    x[0] = -1;
    outside.bodies[0].position = rows_of(x, 2);
    EXPECT_THROW(make_cpu_engine(outside), SceneError);
}

}  // namespace
}  // namespace mpm
