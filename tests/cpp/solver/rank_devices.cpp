// Ranks on devices against one, on a device that is none (support/slow_device.hpp): the same bits
// whatever the number of ranks, the cuts, and their moving while the scene runs; where ranks reach
// each other's memory and where they do not.
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <set>

#include "mpm/core/error.hpp"
#include "mpm/solver/ranks.hpp"
#include "support/ranks.hpp"
#include "support/scene.hpp"
#include "support/slow_engine.hpp"

namespace mpm {
namespace {

using test::expect_same_particles;
using test::expect_same_samples;
using test::forever;
using test::go;

Spec with_ranks(Spec s, int ranks, int axis = -1, double rebalance_above = 1.05) {
    return test::on_devices(std::move(s), ranks, axis, rebalance_above);
}

/// How ranks get what others have for them: sums are added where these are, or read from there in
/// one piece, or everything is sent.
enum class Way { packed, parcels };

std::unique_ptr<Engine> make(const Spec& s, Way way = Way::packed) {
    return test::make_slow_engine(s, way != Way::parcels);
}

class RankDevices : public ::testing::TestWithParam<std::tuple<int, Way>> {
protected:
    const int dimension = std::get<0>(GetParam());
    const Way way = std::get<1>(GetParam());
    const int half = dimension == 3 ? 20 : test::sanitized ? 30 : 60;
    Spec scene() { return test::gauged_scene(dimension, true); }
};

TEST_P(RankDevices, have_the_bits_of_one) {
    const auto one = make(scene());
    go(*one, 2 * half);
    ASSERT_GT(one->statistics().at("sorts"), 1) << "the scene must sort to mean anything";
    const auto samples = one->drain();
    for (int ranks : {2, 4}) {
        for (int axis : {RanksSpec::chosen, RanksSpec::curve, 0}) {
            if (test::sanitized && ranks == 2 && axis != RanksSpec::chosen) continue;
            const auto many = make(with_ranks(scene(), ranks, axis), way);
            go(*many, half);
            EXPECT_EQ(go(*many, half).steps, half);
            EXPECT_GT(many->statistics().at("migrated"), 0);
            EXPECT_GT(many->statistics().at("bytes_of_sums"), 0);
            EXPECT_EQ(many->statistics().at("sorts"), one->statistics().at("sorts"));
            expect_same_particles(*many, *one, 3);
            expect_same_samples(many->drain(), samples, scene(), 1e-9);
        }
    }
}

/// Transfers that store velocities, in one pass and phased, other kernels, and volumes that are
/// averaged within the step.
TEST_P(RankDevices, have_the_bits_of_one_by_any_method) {
    if (test::sanitized && dimension == 3) GTEST_SKIP() << "as in the plane, and long";
    const std::vector<std::function<void(Spec&)>> methods = {
        [](Spec& s) { s.transfer.scheme = "AFLIP"; },
        [](Spec& s) {
            s.transfer.scheme = "ASFLIP";
            s.pipeline = "phased";
            for (BodySpec& b : s.bodies) {
                b.shift.rule = ShiftRule::binary;
                b.shift.shift_max = 1;
            }
        },
        [](Spec& s) {
            s.transfer.scheme = "FLIP";
            s.bodies[0].smoothing = SmoothingForm::split;
        },
        [](Spec& s) { s.kernel.kernel = Kernel::cubic; },
        [](Spec& s) {
            s.transfer.scheme = "XPIC";
            s.transfer.order = 2;
        },
        [](Spec& s) {
            s.transfer.scheme = "FMPM";
            s.transfer.order = 3;
            s.bodies[0].smoothing = SmoothingForm::none;
        },
        [](Spec& s) {
            s.transfer.scheme = "PIC";
            s.kernel.kernel = Kernel::linear;
            s.kernel.gradient = GradientForm::shapes;
            s.bodies[0].smoothing = SmoothingForm::split;
        }};
    const int steps = half / 2;
    for (std::size_t k = 0; k < methods.size(); ++k) {
        SCOPED_TRACE(k);
        Spec s = scene();
        for (BodySpec& b : s.bodies) b.keep = 0.97;
        methods[k](s);
        const auto one = make(s);
        go(*one, steps);
        const State saved = one->save();
        go(*one, steps);
        const auto many = make(with_ranks(s, 3, -1, 0), way);
        go(*many, 2 * steps);
        EXPECT_GT(many->statistics().at("migrated"), 0);
        expect_same_particles(*many, *one, 3);
        expect_same_samples(many->drain(), one->drain(), s, 1e-9);
        const auto two = make(with_ranks(s, 2, 0), way);
        two->load(saved);
        go(*two, steps);
        expect_same_particles(*two, *one, 3);
    }
}

/// At planes, and with groups of bodies; until a sort moves the cuts, and again after a resume.
TEST_P(RankDevices, begin_where_they_are_asked_to) {
    if (test::sanitized && dimension == 3) GTEST_SKIP() << "as in the plane, and long";
    const auto one = make(scene());
    go(*one, 2 * half);
    for (bool planes : {true, false}) {
        Spec s = with_ranks(scene(), 2, 0, planes ? std::numeric_limits<double>::infinity() : 1.05);
        if (planes) s.ranks.planes = {1};
        s.ranks.grouped = !planes;
        s.bodies[0].groups = {{0, 0}};
        s.bodies[1].groups = s.bodies[2].groups = {{0, 1}};
        const auto many = make(s, way), again = make(s, way);
        go(*many, half);
        again->load(many->save());
        go(*again, half);
        expect_same_particles(*again, *one, 3);
        if (planes) {
            EXPECT_EQ(again->statistics().at("rebalances"), 0);
        }
    }
    Spec timed = with_ranks(scene(), 2);
    timed.ranks.measured = true;
    EXPECT_THROW(make(timed, way), SceneError);
}

TEST_P(RankDevices, may_cut_anew_at_every_sort) {
    const auto one = make(scene());
    go(*one, 2 * half);
    const auto many = make(with_ranks(scene(), 3, -1, 0), way);
    go(*many, 2 * half);
    EXPECT_GT(many->statistics().at("rebalances"), 0);
    expect_same_particles(*many, *one, 3);
    expect_same_samples(many->drain(), one->drain(), scene(), 1e-9);
}

TEST_P(RankDevices, share_nodes_across_mirrored_walls) {
    Spec s = scene();
    s.boundaries.erase(s.boundaries.begin() + 1);
    for (auto& law : s.boundaries[0].law) law.response = Response::mirror;
    const auto one = make(s);
    go(*one, half);
    const auto many = make(with_ranks(s, 3), way);
    go(*many, half);
    expect_same_particles(*many, *one, 3);
}

TEST_P(RankDevices, resume_on_another_number) {
    const auto one = make(scene());
    go(*one, half);
    const State saved = one->save();
    go(*one, half);
    const auto three = make(with_ranks(scene(), 3), way);
    three->load(saved);
    go(*three, half / 2);
    const State again = three->save();
    const auto two = make(with_ranks(scene(), 2, 0), way);
    two->load(again);
    go(*two, half - half / 2);
    expect_same_particles(*two, *one, 3);
}

TEST_P(RankDevices, stop_together_where_one_fails) {
    Spec s = scene();
    s.boundaries.clear();
    s.sensors.clear();
    s.gravity.value[0] = -60;
    const auto many = make(with_ranks(s, 3), way);
    const RunResult result = many->run(5000, forever, forever);
    EXPECT_EQ(result.reason, "fault");
    EXPECT_EQ(result.fault.code, "left-domain");
    EXPECT_GT(result.fault.ids.size(), 0u);
}

TEST_P(RankDevices, refuse_what_is_not_built) {
    Spec s = with_ranks(scene(), 2);
    s.ranks.devices.pop_back();
    EXPECT_THROW(make(s, way), SceneError);
}

TEST_P(RankDevices, go_on_from_a_state_after_one_that_is_refused) {
    const auto one = make(scene()), many = make(with_ranks(scene(), 3), way);
    const State state = one->save();
    State cut = state;
    cut["clock_dt"].bytes.pop_back();
    EXPECT_THROW(many->load(cut), SceneError);
    go(*many, 1);  // as if nobody had asked
    many->load(state);
    go(*one, 10);
    go(*many, 10);
    expect_same_particles(*many, *one, 3);
}

/// Clocks were images of memory, which grew at their end.
TEST_P(RankDevices, go_on_from_a_state_of_an_earlier_version) {
    const auto one = make(scene()), many = make(with_ranks(scene(), 3), way);
    go(*one, 20);
    const State state = test::as_format_1(one->save(), true);
    for (Engine* e : {one.get(), many.get()}) {
        e->load(state);
        go(*e, 20);
    }
    expect_same_particles(*many, *one, 3);
}

class RankDevicesMixing : public ::testing::TestWithParam<Way> {};
class RankDevicesEnd : public ::testing::TestWithParam<Way> {};

/// A box that tilts: every particle comes by every cut.
TEST_P(RankDevicesMixing, nobody_is_lost_or_doubled) {
    Spec s = test::empty_scene(2, true, {40, 40});
    s.bodies.push_back(test::body(s, "water", "TaitFluid", test::fluid(2e5),
                                  test::lattice(s, {0, 0}, {20, 20}, 2), 4));
    test::add_walls(s, Response::separable);
    test::tilt(s);
    const auto one = make(s), many = make(with_ranks(s, 4, -1, 1.1), GetParam());
    const auto count = one->particle_count(0);
    const int steps = test::sanitized ? 150 : 400;
    for (int part = 0; part < 4; ++part) {
        go(*one, steps);
        go(*many, steps);
        EXPECT_EQ(many->attributes(0, {"mass"}).id.size(), count);
        expect_same_particles(*many, *one, 1);
    }
    EXPECT_GT(many->statistics().at("migrated"), double(count)) << "it must mix to mean anything";
    EXPECT_LT(many->statistics().at("tables"), 0.9 * many->statistics().at("sorts"));
    EXPECT_GT(many->statistics().at("rebalances"), 2);
}

TEST_P(RankDevicesEnd, more_ranks_than_blocks) {
    Spec s = test::empty_scene(2, true, {16, 16});
    s.gravity.value[1] = -9.81;
    s.bodies.push_back(test::body(s, "block", "FixedCorotated", test::solid(),
                                  test::lattice(s, {2, 9}, {5, 12}, 2), 4));
    test::add_walls(s, Response::separable);
    const auto one = make(s), many = make(with_ranks(s, 4), GetParam());
    go(*one, 400);
    go(*many, 400);
    expect_same_particles(*many, *one, 1);
    EXPECT_EQ(many->grid("mass").data.size(), one->grid("mass").data.size());
}

/// A stream that layer after layer comes in by one face and leaves by the other.
TEST_P(RankDevicesEnd, inlets_and_outlets) {
    Spec s = test::empty_scene(2, true, {40, 12});
    s.bodies.push_back(test::body(s, "water", "TaitFluid", test::fluid(2e5),
                                  test::lattice(s, {0, 2}, {38, 8}, 2), 4));
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
    s.outlets.push_back({"out", 1});
    s.leaving = Leaving::remove;
    const auto one = make(s);
    one->run(-1, 0.3, forever);
    bool came = false, went = false;
    for (const Flow& f : one->flows()) (f.inlet ? came : went) = true;
    ASSERT_TRUE(came && went);
    for (int axis : {-1, 0}) {
        const auto many = make(with_ranks(s, 3, axis), GetParam());
        many->run(-1, 0.3, forever);
        expect_same_particles(*many, *one, 1);
    }
}

/// A particle of one rank breaks its law: all stop at the same step, and one says who it was.
TEST_P(RankDevicesEnd, a_fault_stops_all) {
    Spec s = test::empty_scene(2, true, {48, 24});
    s.bodies.push_back(test::body(s, "rest", "TaitFluid", {1000, 1e-2, 7.15, 0},
                                  test::lattice(s, {30, 4}, {44, 18}, 2), 4));
    s.bodies.push_back(test::body(s, "crushed", "TaitFluid", {1000, 1e-2, 7.15, 0},
                                  test::lattice(s, {4, 4}, {12, 12}, 2), 4));
    auto& b = s.bodies[1];
    b.velocity.clear();
    const auto x = test::positions(b, 2);
    for (double at : x) b.velocity.push_back(-20 * (at - 0.8));
    const auto one = make(s), many = make(with_ranks(s, 3), GetParam());
    const auto a = go(*one, 20000), c = go(*many, 20000);
    ASSERT_EQ(a.fault.body, "crushed");
    ASSERT_EQ(c.reason, "fault");
    EXPECT_EQ(c.fault.code, a.fault.code);
    EXPECT_EQ(c.fault.body, "crushed");
    EXPECT_EQ(c.fault.step, a.fault.step);
    EXPECT_EQ(c.steps, a.steps);
}

/// Time that is over for one is over for all, at the same step.
TEST_P(RankDevicesEnd, wall_time_stops_all_at_one_step) {
    Spec s = test::busy_scene(2, true);
    const auto many = make(with_ranks(s, 3), GetParam());
    std::int64_t done = 0;
    while (done < 40) {
        const auto r = many->run(40 - done, forever, 0.0);
        ASSERT_GT(r.steps, 0);
        done += r.steps;
    }
    const auto one = make(s);
    go(*one, 40);
    expect_same_particles(*many, *one, 3);
}

const std::vector all_ways = {Way::packed, Way::parcels};
const auto ways = ::testing::ValuesIn(all_ways);
INSTANTIATE_TEST_SUITE_P(Plane, RankDevices, ::testing::Combine(::testing::Values(2), ways));
INSTANTIATE_TEST_SUITE_P(
    Solid, RankDevices,
    ::testing::Combine(::testing::Values(3),
                       ::testing::ValuesIn(test::sanitized ? std::vector{Way::packed} : all_ways)));
INSTANTIATE_TEST_SUITE_P(Ways, RankDevicesMixing, ways);
INSTANTIATE_TEST_SUITE_P(Ways, RankDevicesEnd, ways);

}  // namespace
}  // namespace mpm
