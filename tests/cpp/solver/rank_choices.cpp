// Where ranks begin and what their loads are weighed by is the user's choice and changes no bit:
// planes at given places, groups of bodies, measured time.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>

#include "mpm/core/error.hpp"
#include "mpm/solver/make_domain.hpp"
#include "mpm/solver/merged.hpp"
#include "mpm/solver/ranks.hpp"
#include "support/ranks.hpp"
#include "support/scene.hpp"

namespace mpm {
namespace {

using test::expect_same_particles;
using test::expect_same_samples;
using test::go;
using test::with_ranks;

constexpr int steps = test::sanitized ? 30 : 80;
constexpr double never = std::numeric_limits<double>::infinity();

/// Body by body.
std::vector<std::uint64_t> counts(const Spec& s) {
    std::vector<std::uint64_t> out;
    for (const BodySpec& b : s.bodies) out.push_back(b.count);
    return out;
}
std::uint64_t all_of(const Spec& s) {
    const auto n = counts(s);
    return std::accumulate(n.begin(), n.end(), std::uint64_t(0));
}

class RankChoices : public ::testing::TestWithParam<int> {
protected:
    const int dimension = GetParam();
    Spec scene() { return test::gauged_scene(dimension, dimension == 3); }
};

TEST_P(RankChoices, planes_at_given_places) {
    const auto one = make_cpu_engine(scene());
    go(*one, steps);
    const auto samples = one->drain();
    for (int ranks : {2, 3, 4}) {
        for (double limit : {never, 1.05}) {
            if (test::sanitized && ranks != 3) continue;
            Spec s = with_ranks(scene(), ranks, 0, limit);
            for (int r = 1; r < ranks; ++r) s.ranks.planes.push_back(r);
            const auto many = make_cpu_engine(s);
            go(*many, steps);
            expect_same_particles(*many, *one, 3);
            expect_same_samples(many->drain(), samples, s);
            if (limit == never) {
                EXPECT_EQ(many->statistics().at("rebalances"), 0);
            }
        }
    }
}

TEST_P(RankChoices, particles_begin_on_their_side_of_a_plane) {
    Spec s = with_ranks(scene(), 2, 0, never);
    const double edge = (dimension == 2 ? 8 : 4) * s.cell_size;
    const auto side = [&](double plane) {
        std::uint64_t below = 0;
        for (const BodySpec& b : s.bodies) {
            std::vector<double> x(b.count * std::uint64_t(dimension));
            b.position(0, b.count, x.data());
            for (std::uint64_t p = 0; p < b.count; ++p)
                below += x[p * std::uint64_t(dimension)] < plane;
        }
        return below;
    };
    for (std::int64_t plane : {1, 2, 3}) {
        s.ranks.planes = {plane};
        const auto first =
            dimension == 2 ? all_of(RankScenes<2>(s).spec[0]) : all_of(RankScenes<3>(s).spec[0]);
        EXPECT_EQ(first, side(double(plane) * edge)) << plane;
    }
}

/// A run that goes on begins with its planes again; else where the load was even.
TEST_P(RankChoices, planes_after_a_resume) {
    const auto one = make_cpu_engine(scene());
    go(*one, steps);
    Spec s = with_ranks(scene(), 3, 0, never);
    s.ranks.planes = {3, 4};
    const auto begun = make_cpu_engine(s);
    go(*begun, steps / 2);
    const State saved = begun->save();
    const auto again = make_cpu_engine(s), even = make_cpu_engine(with_ranks(scene(), 3, 0, never));
    again->load(saved);
    even->load(saved);
    go(*again, steps - steps / 2);
    go(*even, steps - steps / 2);
    expect_same_particles(*again, *one, 3);
    expect_same_particles(*even, *one, 3);
    EXPECT_EQ(again->statistics().at("rebalances"), 0);
    EXPECT_GT(again->statistics().at("imbalance"), even->statistics().at("imbalance"));
}

TEST_P(RankChoices, groups_of_bodies) {
    const auto one = make_cpu_engine(scene());
    go(*one, steps);
    const auto samples = one->drain();
    for (int axis : {RanksSpec::chosen, RanksSpec::curve, 1}) {
        Spec s = with_ranks(scene(), 2, axis, axis == 1 ? 1.05 : never);
        s.ranks.grouped = true;
        s.bodies[0].groups = {{0, 0}};
        s.bodies[1].groups = s.bodies[2].groups = {{0, 1}};
        const auto many = make_cpu_engine(s);
        go(*many, steps / 2);
        const State saved = many->save();
        go(*many, steps - steps / 2);
        expect_same_particles(*many, *one, 3);
        expect_same_samples(many->drain(), samples, s);
        const auto again = make_cpu_engine(s);
        again->load(saved);
        go(*again, steps - steps / 2);
        expect_same_particles(*again, *one, 3);
    }
}

/// Loads by time: the motion is that of one rank, whatever clocks say; and cuts follow them.
TEST_P(RankChoices, loads_by_measured_time) {
    const auto one = make_cpu_engine(scene());
    go(*one, steps);
    const auto samples = one->drain();
    for (int ranks : {2, 3, 4}) {
        if (test::sanitized && ranks != 3) continue;
        Spec s = with_ranks(scene(), ranks, RanksSpec::curve, 0);
        s.ranks.measured = true;
        const auto many = make_cpu_engine(s);
        go(*many, steps);
        expect_same_particles(*many, *one, 3);
        expect_same_samples(many->drain(), samples, s);
    }
}

TEST_P(RankChoices, cuts_follow_the_clocks) {
    const auto one = make_cpu_engine(scene());
    go(*one, steps);
    std::vector<double> moved;
    for (double slow : {1.0, 9.0}) {
        Spec s = with_ranks(scene(), 2, RanksSpec::curve, 1.4);
        s.ranks.measured = true;
        std::vector<double> told(2, 0.0);
        s.ranks.seconds = [&](int r) {
            return told[std::size_t(r)] += r == 0 ? slow * 1e-3 : 1e-3;
        };
        const auto many = make_cpu_engine(s);
        go(*many, steps);
        expect_same_particles(*many, *one, 3);
        moved.push_back(many->statistics().at("rebalances"));
    }
    EXPECT_EQ(moved[0], 0) << "ranks that take the same time are even";
    EXPECT_GT(moved[1], 0) << "the first is slow";
}

// In space ranks are under sanitizers in ranks.cpp.
const std::vector dimensions = test::sanitized ? std::vector{2} : std::vector{2, 3};
INSTANTIATE_TEST_SUITE_P(Dimensions, RankChoices, ::testing::ValuesIn(dimensions));

/// Bodies that are stepped as one keep their groups.
TEST(RankGroups, of_merged_bodies) {
    Spec s = test::empty_scene(2, false, {64, 16});
    const int left[] = {2, 40, 26};
    std::uint64_t id = 0;
    for (const int x : left) {
        s.bodies.push_back(test::body(s, "b" + std::to_string(x), "TaitFluid", test::fluid(2e5),
                                      test::lattice(s, {x, 2}, {x + 6, 8}, 2), 4));
        s.bodies.back().first_id = id;
        id += s.bodies.back().count;
    }
    test::add_walls(s, Response::separable);
    Spec g = with_ranks(s, 3, RanksSpec::chosen, never);
    g.ranks.grouped = true;
    for (int b = 0; b < 3; ++b) g.bodies[std::size_t(b)].groups = {{0, b}};
    const MergedSpec merged = merge_alike(g);
    ASSERT_EQ(merged.spec.bodies.size(), 1u);
    const RankScenes<2> scenes(merged.spec);
    EXPECT_EQ(scenes.partition.axis(), 0);
    for (const Spec& rank : scenes.spec) EXPECT_EQ(all_of(rank), s.bodies[0].count);
    // From left to right.
    EXPECT_EQ(scenes.spec[1].bodies[0].ids.at(0), 2 * s.bodies[0].count);
    const auto one = make_cpu_engine(s), many = make_cpu_engine(g);
    go(*one, steps);
    go(*many, steps / 2);
    const auto again = make_cpu_engine(g);
    again->load(many->save());
    go(*again, steps - steps / 2);
    expect_same_particles(*again, *one, 3);
}

TEST(RankGroups, what_is_refused) {
    const auto refused = [](const std::function<void(Spec&)>& change, const std::string& text) {
        Spec s = with_ranks(test::gauged_scene(2, true), 3, 0, 1.05);
        change(s);
        try {
            make_cpu_engine(s);
            ADD_FAILURE() << "not refused: " << text;
        } catch (const SceneError& e) {
            EXPECT_NE(std::string(e.what()).find(text), std::string::npos) << e.what();
        }
    };
    refused([](Spec& s) { s.ranks.planes = {2}; }, "1 planes are given for 3 ranks");
    refused([](Spec& s) { s.ranks.planes = {2, 2}; }, "do not ascend");
    refused([](Spec& s) { s.ranks.planes = {0, 2}; }, "from block 1");
    refused([](Spec& s) { s.ranks.axis = -1, s.ranks.planes = {1, 2}; }, "across no axis");
    refused([](Spec& s) { s.ranks.grouped = true, s.bodies[1].groups = {{0, 3}}; }, "of group 3");
    refused([](Spec& s) { s.ranks.grouped = true, s.ranks.planes = {1, 2}; }, "give one of them");
}

}  // namespace
}  // namespace mpm
