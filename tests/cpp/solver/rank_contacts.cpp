// Several ranks against one where bodies have fields of velocities of their own: the same bits,
// with bodies that meet on both sides of a cut, that change ranks, whose cuts move at every sort,
// and with messages that come late; a node too crowded on one rank stops all. On the CPU, and on a
// device that is none (support/slow_device.hpp), whose ranks reach each other's memory or not.
#include <gtest/gtest.h>

#include <random>

#include "mpm/kernels/contact.hpp"
#include "mpm/solver/ranks.hpp"
#include "support/ranks.hpp"
#include "support/scene.hpp"
#include "support/slow_engine.hpp"
#include "support/unruly.hpp"

namespace mpm {
namespace {

using test::expect_same_particles;
using test::expect_same_samples;
using test::go;
using test::on_devices;
using test::with_ranks;

constexpr int half = test::sanitized ? 15 : 40;

/// The busy scene, whose blocks fly towards each other and slip along water that they fall into.
Spec touching(int dimension, bool single) {
    Spec s = test::gauged_scene(dimension, single);
    s.bodies[0].velocity[0] = 3;
    s.bodies[1].velocity[0] = 4;
    s.bodies[2].velocity[0] = -4;
    ContactSpec& c = s.contact;
    c.fields = 3;
    c.kind = {0, 1, 1};
    c.density = {1000, 700};
    c.laws.resize(2);
    c.laws[0].kind = ContactKind::fluid;
    c.laws[0].fill = 0.7;
    c.laws[1].kind = ContactKind::friction;
    c.laws[1].static_friction = 0.4;
    c.laws[1].dynamic_friction = 0.3;
    c.law_of = {-1, 0, 0, 1};
    for (int b = 0; b < 3; ++b) s.bodies[std::size_t(b)].fields = {{0, b}};
    for (int pair = 0; pair < 2; ++pair) {
        SensorSpec load;
        load.name = pair ? "blocks" : "afloat";
        load.kind = SensorKind::contact_load;
        load.interval = 0.002;
        load.sides =
            pair ? std::vector<std::int32_t>{0, 0, 0, 1} : std::vector<std::int32_t>{0, 1, -1, 0};
        s.sensors.push_back(load);
    }
    return s;
}

struct Kind {
    int dimension;
    bool single;
};
class RankContacts : public ::testing::TestWithParam<Kind> {
protected:
    Spec scene() { return touching(GetParam().dimension, GetParam().single); }
};

TEST_P(RankContacts, have_the_bits_of_one) {
    const auto one = make_cpu_engine(scene());
    go(*one, 2 * half);
    EXPECT_GT(one->statistics().at("sorts"), 1);
    const auto samples = one->drain();
    double pushed = 0;
    for (std::size_t k = samples.size() - 2; k < samples.size(); ++k)
        for (double v : samples[k].values.data) pushed = std::max(pushed, std::abs(v));
    EXPECT_GT(pushed, 0) << "the bodies must meet to mean anything";
    for (int ranks : {2, 3, 4}) {
        for (int axis : {-1, 0}) {
            if (test::sanitized && (ranks != 3 || axis == 0)) continue;
            const Spec s = with_ranks(scene(), ranks, axis, 1.05);
            const auto many = make_cpu_engine(s);
            go(*many, half);
            go(*many, half);
            EXPECT_GT(many->statistics().at("migrated"), 0);
            expect_same_particles(*many, *one, 3);
            expect_same_samples(many->drain(), samples, s);
        }
    }
}

TEST_P(RankContacts, with_late_messages_and_new_cuts_at_every_sort) {
    const auto one = make_cpu_engine(scene());
    go(*one, half);
    const Spec s = with_ranks(scene(), 4, -1, 0);
    const auto many = make_cpu_engine(s, std::make_unique<test::UnrulyRanks>(4, 5));
    go(*many, half);
    EXPECT_GT(many->statistics().at("rebalances"), 0);
    expect_same_particles(*many, *one, 3);
}

TEST_P(RankContacts, resume_on_another_number) {
    const auto straight = make_cpu_engine(scene());
    go(*straight, half);
    const auto from_one = straight->save();
    go(*straight, half);
    const auto samples = straight->drain();
    const auto three = make_cpu_engine(with_ranks(scene(), 3, -1, 1.05));
    three->load(from_one);
    go(*three, 5);
    const auto two = make_cpu_engine(with_ranks(scene(), 2, 0, 0));
    two->load(three->save());
    go(*two, 5);
    const auto again = make_cpu_engine(scene());
    again->load(two->save());
    go(*again, half - 10);
    expect_same_particles(*again, *straight, 3);
    // What a sensor had added up goes on: the last sample is the mean since the one before.
    const auto last = again->drain();
    for (std::size_t k = samples.size() - 2; k < samples.size(); ++k) {
        ASSERT_FALSE(last[k].values.data.empty());
        double size = 0;
        for (double v : samples[k].values.data) size = std::max(size, std::abs(v));
        EXPECT_NEAR(last[k].values.data.back(), samples[k].values.data.back(), 1e-11 * size);
    }
}

INSTANTIATE_TEST_SUITE_P(All, RankContacts,
                         ::testing::Values(Kind{2, false}, Kind{2, true}, Kind{3, true}));

class RankContactDevices : public ::testing::TestWithParam<std::tuple<int, bool>> {
protected:
    const int dimension = std::get<0>(GetParam());
    const bool reaches = std::get<1>(GetParam());
    const int half = dimension == 3 ? 20 : 60;
    Spec scene() { return touching(dimension, true); }
    std::unique_ptr<Engine> make(const Spec& s) { return test::make_slow_engine(s, reaches); }
};

TEST_P(RankContactDevices, have_the_bits_of_one) {
    const auto one = make(scene());
    go(*one, 2 * half);
    EXPECT_GT(one->statistics().at("sorts"), 1);
    EXPECT_GT(one->statistics().at("contact_blocks"), 0);
    const auto samples = one->drain();
    double pushed = 0;
    for (std::size_t k = samples.size() - 2; k < samples.size(); ++k)
        for (double v : samples[k].values.data) pushed = std::max(pushed, std::abs(v));
    EXPECT_GT(pushed, 0) << "the bodies must meet to mean anything";
    for (int ranks : {2, 4}) {
        for (int axis : {RanksSpec::chosen, RanksSpec::curve, 0}) {
            if (test::sanitized && axis != RanksSpec::chosen) continue;
            const Spec s = on_devices(scene(), ranks, axis);
            const auto many = make(s);
            go(*many, half);
            go(*many, half);
            EXPECT_GT(many->statistics().at("migrated"), 0);
            EXPECT_EQ(many->statistics().at("sorts"), one->statistics().at("sorts"));
            expect_same_particles(*many, *one, 3);
            expect_same_samples(many->drain(), samples, s, 1e-9);
        }
    }
}

TEST_P(RankContactDevices, may_cut_anew_at_every_sort) {
    if (test::sanitized && dimension == 3) GTEST_SKIP() << "as in the plane, and long";
    const int steps = (dimension == 3 ? 4 : 2) * half;  // until cuts have to move
    const auto one = make(scene());
    go(*one, steps);
    const auto many = make(on_devices(scene(), 3, -1, 0));
    go(*many, steps);
    EXPECT_GT(many->statistics().at("rebalances"), 0);
    expect_same_particles(*many, *one, 3);
    expect_same_samples(many->drain(), one->drain(), scene(), 1e-9);
}

TEST_P(RankContactDevices, beside_linear_walls) {
    Spec s = scene();
    for (BoundarySpec& b : s.boundaries)
        for (SurfaceLaw& law : b.law) law.linear = true;
    const auto one = make(s);
    go(*one, half);
    const auto many = make(on_devices(s, 3));
    go(*many, half);
    expect_same_particles(*many, *one, 3);
    expect_same_samples(many->drain(), one->drain(), s, 1e-9);
}

TEST_P(RankContactDevices, resume_on_another_number) {
    if (test::sanitized && dimension == 3) GTEST_SKIP() << "as in the plane, and long";
    const auto one = make(scene());
    go(*one, half);
    const State saved = one->save();
    go(*one, half);
    const auto three = make(on_devices(scene(), 3));
    three->load(saved);
    go(*three, half / 2);
    const auto two = make(on_devices(scene(), 2, 0));
    two->load(three->save());
    go(*two, half - half / 2);
    expect_same_particles(*two, *one, 3);
    const auto a = two->grid("velocity"), b = one->grid("velocity");
    EXPECT_EQ(a.data.size(), b.data.size()) << "a node is counted twice, or by nobody";
}

/// So many fields, each of which rubs on every other.
void rub_all(Spec& s, int fields) {
    s.contact.fields = fields;
    s.contact.kind.assign(std::size_t(fields), 0);
    s.contact.density = {700};
    s.contact.laws.resize(1);
    s.contact.laws[0].kind = ContactKind::friction;
    s.contact.laws[0].static_friction = 0.4;
    s.contact.laws[0].dynamic_friction = 0.3;
    s.contact.law_of = {0};
}

class RankContactDevicesMixing : public ::testing::TestWithParam<bool> {};

/// Blocks of five fields in a box that tilts: everyone meets everyone, and comes by every cut,
/// mostly without new tables.
TEST_P(RankContactDevicesMixing, nobody_is_lost_where_bodies_are_shaken) {
    Spec s = test::empty_scene(2, true, {40, 40});
    rub_all(s, 5);
    for (int k = 0; k < 5; ++k) {
        const int x = 2 + 7 * k;
        s.bodies.push_back(test::body(s, "block" + std::to_string(k), "FixedCorotated",
                                      test::solid(),
                                      test::lattice(s, {x, 3 + 2 * k}, {x + 6, 9 + 2 * k}, 2), 4));
        s.bodies.back().fields = {{0, k}};
    }
    test::add_walls(s, Response::separable);
    test::tilt(s);
    const auto one = test::make_slow_engine(s),
               many = test::make_slow_engine(on_devices(s, 4, -1, 1.1), GetParam());
    const int steps = test::sanitized ? 150 : 500;
    for (int part = 0; part < 4; ++part) {
        go(*one, steps);
        go(*many, steps);
        expect_same_particles(*many, *one, 5);
    }
    EXPECT_GT(many->statistics().at("migrated"), 0);
    EXPECT_LT(many->statistics().at("tables"), many->statistics().at("sorts"));
}

/// Small bodies of five fields that fly about between ranks of few blocks: they come to blocks
/// around which others alone have particles, where a rank that kept its table would lack what they
/// meet there. With blocks that were ready by their neighbours alone these two end otherwise.
TEST_P(RankContactDevicesMixing, fly_to_where_others_alone_have_been) {
    for (const unsigned seed : {2065u, 3076u}) {
        if (test::sanitized && seed != 2065u) continue;
        std::mt19937 random(seed);
        const auto in = [&](int low, int high) {
            return low + int(random() % unsigned(high - low));
        };
        Spec s = test::empty_scene(2, true, {56, 56});
        rub_all(s, 5);
        for (int k = 0; k < 24; ++k) {
            const int x = 1 + 11 * (k % 5) + in(0, 4), y = 1 + 11 * (k / 5) + in(0, 4);
            const int wide = in(2, 7), high = in(2, 7);
            BodySpec b = test::body(s, "block" + std::to_string(k), "FixedCorotated", test::solid(),
                                    test::lattice(s, {x, y}, {x + wide, y + high}, 2), 4);
            b.fields = {{0, k % 5}};
            for (int a = 0; a < 2; ++a) b.velocity[std::size_t(a)] = 0.1 * in(-60, 60);
            s.bodies.push_back(b);
        }
        test::add_walls(s, Response::separable);
        const auto one = test::make_slow_engine(s),
                   many = test::make_slow_engine(on_devices(s, in(5, 8), -1, 1e9), GetParam());
        go(*one, 300);
        go(*many, 300);
        EXPECT_GT(many->statistics().at("migrated"), 0);
        expect_same_particles(*many, *one, 24);
    }
}

INSTANTIATE_TEST_SUITE_P(Ways, RankContactDevicesMixing, ::testing::Bool());
INSTANTIATE_TEST_SUITE_P(Plane, RankContactDevices,
                         ::testing::Combine(::testing::Values(2), ::testing::Bool()));
INSTANTIATE_TEST_SUITE_P(Solid, RankContactDevices,
                         ::testing::Combine(::testing::Values(3),
                                            ::testing::ValuesIn(test::sanitized
                                                                    ? std::vector{true}
                                                                    : std::vector{true, false})));

Spec crowded() {
    Spec s = test::empty_scene(2, false, {24, 24});
    const int grains = most_fields_at_node + 1;
    s.contact.fields = grains;
    s.contact.kind.assign(std::size_t(grains), 0);
    s.contact.density = {700};
    s.contact.laws.resize(1);
    s.contact.laws[0].kind = ContactKind::friction;
    s.contact.law_of = {0};
    for (int k = 0; k < grains; ++k) {
        s.bodies.push_back(test::body(s, "grain" + std::to_string(k), "FixedCorotated",
                                      test::solid(), test::lattice(s, {4, 4}, {5, 5}, 2), 4));
        s.bodies.back().fields = {{0, k}};
    }
    // Something for the other rank to do, far away.
    s.bodies.push_back(test::body(s, "far", "FixedCorotated", test::solid(),
                                  test::lattice(s, {18, 18}, {22, 22}, 2), 4));
    s.bodies.back().fields = {{0, 0}};
    return s;
}

void expect_crowded(Engine& many) {
    const RunResult result = go(many, 5);
    EXPECT_EQ(result.reason, "fault");
    EXPECT_EQ(result.fault.code, "crowded-node");
    EXPECT_EQ(result.steps, 0);
}

TEST(RankContactFaults, a_crowded_node_stops_all) {
    expect_crowded(*make_cpu_engine(with_ranks(crowded(), 2, 0, 1.05)));
}

TEST(RankContactFaults, a_crowded_node_stops_all_devices) {
    Spec s = crowded();
    s.precision = Precision::single;
    for (bool reaches : {true, false})
        expect_crowded(*test::make_slow_engine(on_devices(s, 2, 0, 1.05), reaches));
}

}  // namespace
}  // namespace mpm
