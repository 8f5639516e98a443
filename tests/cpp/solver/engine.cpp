// The CPU engine as its callers see it: bits that do not depend on how a run is split, on threads
// or on looking; state out and in; particles that leave; faults.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "mpm/core/error.hpp"
#include "support/scene.hpp"

namespace mpm {
namespace {

using test::forever;

constexpr int parts[] = {test::sanitized ? 17 : 37, test::sanitized ? 23 : 63};
constexpr int whole_run = parts[0] + parts[1];

RunResult go(Engine& e, std::int64_t steps) { return e.run(steps, forever, forever); }

void expect_equal(const std::vector<Samples>& a, const std::vector<Samples>& b) {
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t k = 0; k < a.size(); ++k) {
        EXPECT_EQ(a[k].time, b[k].time) << "sensor " << k;
        EXPECT_EQ(a[k].values.data, b[k].values.data) << "sensor " << k;
    }
}
void append(std::vector<Samples>& to, std::vector<Samples> more) {
    to.resize(more.size());
    for (std::size_t k = 0; k < more.size(); ++k) {
        to[k].time.insert(to[k].time.end(), more[k].time.begin(), more[k].time.end());
        auto& data = to[k].values.data;
        data.insert(data.end(), more[k].values.data.begin(), more[k].values.data.end());
    }
}

struct Kind {
    int dimension;
    bool single;
};
class Bits : public ::testing::TestWithParam<Kind> {
protected:
    Spec scene(int threads = 2) {
        Spec s = test::busy_scene(GetParam().dimension, GetParam().single);
        s.threads = threads;
        return s;
    }
};

TEST_P(Bits, do_not_depend_on_splitting_or_looking) {
    const auto whole = make_cpu_engine(scene()), split = make_cpu_engine(scene());
    EXPECT_EQ(go(*whole, whole_run).steps, whole_run);
    ASSERT_GT(whole->statistics().at("sorts"), 1) << "the scene must sort to mean anything";
    EXPECT_EQ(go(*split, parts[0]).steps, parts[0]);
    std::vector<Samples> samples;
    append(samples, split->drain());
    test::table(*split, 0);
    split->grid("velocity");
    split->save();
    EXPECT_EQ(go(*split, 0).steps, 0);
    EXPECT_EQ(go(*split, parts[1]).steps, parts[1]);
    append(samples, split->drain());
    EXPECT_EQ(split->time(), whole->time());
    EXPECT_EQ(test::state_bytes(*split), test::state_bytes(*whole));
    expect_equal(samples, whole->drain());
    for (int b = 0; b < 3; ++b) EXPECT_EQ(test::table(*split, b), test::table(*whole, b));
}

TEST_P(Bits, do_not_depend_on_the_number_of_threads) {
    const auto one = make_cpu_engine(scene(1));
    go(*one, parts[0]);
    const auto samples = one->drain();
    for (int threads : {2, 3, 4}) {
        const auto many = make_cpu_engine(scene(threads));
        go(*many, parts[0]);
        EXPECT_EQ(test::state_bytes(*many), test::state_bytes(*one)) << threads << " threads";
        expect_equal(many->drain(), samples);
    }
}

TEST_P(Bits, survive_saving_and_loading) {
    const auto straight = make_cpu_engine(scene()), before = make_cpu_engine(scene());
    go(*straight, whole_run);
    go(*before, parts[0]);
    const auto state = before->save();
    const auto resumed = make_cpu_engine(scene());
    go(*resumed, 7);  // whatever it did before is forgotten
    resumed->drain();
    resumed->load(state);
    EXPECT_EQ(resumed->step(), parts[0]);
    EXPECT_EQ(resumed->time(), before->time());
    EXPECT_EQ(test::state_bytes(*resumed), test::state_bytes(*before));
    go(*resumed, parts[1]);
    EXPECT_EQ(test::state_bytes(*resumed), test::state_bytes(*straight));
    std::vector<Samples> samples;
    append(samples, before->drain());
    append(samples, resumed->drain());
    expect_equal(samples, straight->drain());
}

/// One step apart in rounding only; positions in cells, velocities by the fastest particle.
TEST_P(Bits, fused_and_two_pass_agree_to_rounding) {
    const double tolerance = GetParam().single ? 2e-5 : 1e-12;
    Spec fused = scene(), split = scene();
    fused.pipeline = "fused";
    split.pipeline = "two-pass";
    const auto a = make_cpu_engine(fused), b = make_cpu_engine(split);
    go(*a, 20);
    go(*b, 20);
    EXPECT_NEAR(a->time(), b->time(), tolerance * a->time());
    for (int body = 0; body < 3; ++body) {
        const auto x = a->attributes(body, {"position", "velocity"}),
                   y = b->attributes(body, {"position", "velocity"});
        ASSERT_EQ(x.id, y.id);
        for (std::size_t k = 0; k < x.values.at("position").data.size(); ++k) {
            ASSERT_NEAR(x.values.at("position").data[k], y.values.at("position").data[k],
                        tolerance * 0.1);
            ASSERT_NEAR(x.values.at("velocity").data[k], y.values.at("velocity").data[k],
                        tolerance * 10);
        }
    }
}
/// Each dimension and each precision; under sanitizers not each with each.
const std::vector kinds =
    test::sanitized ? std::vector{Kind{2, false}, Kind{3, true}}
                    : std::vector{Kind{2, true}, Kind{2, false}, Kind{3, true}, Kind{3, false}};
INSTANTIATE_TEST_SUITE_P(All, Bits, ::testing::ValuesIn(kinds));

TEST(Engine, until_never_shortens_a_step) {
    const auto a = make_cpu_engine(test::busy_scene(2, true)),
               b = make_cpu_engine(test::busy_scene(2, true));
    const auto first = a->run(-1, 0.01, forever);
    EXPECT_EQ(first.reason, "until");
    EXPECT_GE(a->time(), 0.01);
    EXPECT_LT(a->time() - a->time_step(), 0.01);
    a->run(-1, 0.02, forever);
    b->run(-1, 0.02, forever);
    EXPECT_EQ(test::state_bytes(*a), test::state_bytes(*b));
}

TEST(Engine, wall_time_interrupts_and_continues) {
    const auto a = make_cpu_engine(test::busy_scene(2, true)),
               b = make_cpu_engine(test::busy_scene(2, true));
    std::int64_t done = 0;
    while (done < 10) {
        const auto r = a->run(10 - done, forever, 0.0);
        done += r.steps;
        ASSERT_TRUE(r.reason == "wall" || r.reason == "steps");
    }
    go(*a, 0);  // samples of a step boundary are taken when the run gets there or goes on
    go(*b, 10);
    EXPECT_EQ(test::state_bytes(*a), test::state_bytes(*b));
}

TEST(Engine, state_of_another_scene_is_refused) {
    const auto a = make_cpu_engine(test::busy_scene(2, true));
    auto state = a->save();
    State missing = state;
    missing.erase("keys");
    EXPECT_THROW(a->load(missing), SceneError);
    State other = state;
    other["sum_channels"].bytes[0] ^= 1;
    EXPECT_THROW(a->load(other), SceneError);
    State cut = state;
    cut["clock_dt"].bytes.pop_back();
    EXPECT_THROW(a->load(cut), SceneError);
    EXPECT_THROW(a->attributes(0, {"colour"}), SceneError);
    EXPECT_THROW(a->grid("colour"), SceneError);
}

// Particles that leave.

/// A block that flies out of an open domain through x+.
Spec leaving_scene(int dimension, Leaving policy) {
    Spec s =
        test::empty_scene(dimension, true, std::vector<std::int64_t>(std::size_t(dimension), 16));
    s.leaving = policy;
    const bool flat = dimension == 2;
    s.bodies.push_back(test::body(
        s, "block", "FixedCorotated", test::solid(),
        flat ? test::lattice(s, {10, 6}, {14, 9}, 2) : test::lattice(s, {10, 6, 6}, {14, 9, 9}, 2),
        flat ? 4 : 8));
    s.bodies[0].velocity[0] = 5;
    s.bodies.push_back(test::body(
        s, "rest", "FixedCorotated", test::solid(),
        flat ? test::lattice(s, {2, 6}, {5, 9}, 2) : test::lattice(s, {2, 6, 6}, {5, 9, 9}, 2),
        flat ? 4 : 8));
    return s;
}

class LeavingPolicy : public ::testing::TestWithParam<int> {};

TEST_P(LeavingPolicy, stop_keeps_the_state_readable) {
    const auto e = make_cpu_engine(leaving_scene(GetParam(), Leaving::stop));
    const auto count = e->particle_count(0);
    const auto r = go(*e, 100000);
    ASSERT_EQ(r.reason, "fault");
    EXPECT_EQ(r.fault.code, "left-domain");
    EXPECT_EQ(r.fault.body, "block");
    EXPECT_EQ(r.fault.step, e->step());
    ASSERT_FALSE(r.fault.ids.empty());
    EXPECT_EQ(r.fault.value, double(r.fault.ids.size()));
    const auto rows = test::table(*e, 0);
    EXPECT_EQ(rows.size(), count);
    const Attributes where = e->attributes(0, {"position"});
    const std::set<std::uint64_t> ids(r.fault.ids.begin(), r.fault.ids.end());
    EXPECT_EQ(ids.size(), r.fault.ids.size());
    for (std::size_t k = 0; k < where.id.size(); ++k) {
        const double x = where.values.at("position").data[k * std::size_t(GetParam())];
        EXPECT_EQ(ids.count(where.id[k]) == 1, x >= 1.6)
            << "particle " << where.id[k] << " at " << x;
    }
    EXPECT_TRUE(e->removed().empty());
    e->save();
    // Again the same answer, and no step further.
    const auto again = go(*e, 10);
    EXPECT_EQ(again.reason, "fault");
    EXPECT_EQ(again.steps, 0);
    EXPECT_EQ(again.fault.ids, r.fault.ids);
}

TEST_P(LeavingPolicy, freeze_and_delete_list_every_id_once) {
    for (Leaving policy : {Leaving::freeze, Leaving::remove}) {
        const bool freeze = policy == Leaving::freeze;
        const auto e = make_cpu_engine(leaving_scene(GetParam(), policy));
        const auto count = e->particle_count(0), others = e->particle_count(1);
        std::set<std::uint64_t> gone;
        std::uint64_t seen = 0;
        for (int part = 0; part < 40; ++part) {
            const auto r = e->run(-1, 0.01 * (part + 1), forever);
            ASSERT_EQ(r.reason, "until") << r.fault.code << ' ' << r.fault.message;
            for (const auto& batch : e->removed()) {
                EXPECT_EQ(batch.body, 0);
                EXPECT_EQ(batch.policy, freeze ? "freeze" : "delete");
                EXPECT_EQ(batch.position.shape[0], batch.ids.size());
                for (std::size_t k = 0; k < batch.ids.size(); ++k) {
                    EXPECT_TRUE(gone.insert(batch.ids[k]).second) << "listed twice";
                    EXPECT_GE(batch.position.data[k * std::size_t(GetParam())], 1.6);
                }
                seen += batch.ids.size();
            }
            EXPECT_EQ(e->particle_count(0), freeze ? count : count - seen);
            const auto rows = test::table(*e, 0);
            EXPECT_EQ(rows.size(), e->particle_count(0));
            for (const auto& [id, row] : rows) {
                EXPECT_TRUE(freeze || !gone.count(id));
                for (double x : row) ASSERT_TRUE(std::isfinite(x)) << "particle " << id;
            }
        }
        EXPECT_EQ(gone.size(), count) << "the whole body has left";
        EXPECT_EQ(e->particle_count(1), others);
        // Saved and loaded, what is frozen stays frozen.
        const auto copy = make_cpu_engine(leaving_scene(GetParam(), policy));
        copy->load(e->save());
        EXPECT_EQ(copy->particle_count(0), e->particle_count(0));
        EXPECT_EQ(test::table(*copy, 0), test::table(*e, 0));
    }
}
INSTANTIATE_TEST_SUITE_P(All, LeavingPolicy, ::testing::Values(2, 3));

/// Nothing left at all: time goes on.
TEST(Engine, an_empty_domain_runs_on) {
    Spec s = leaving_scene(2, Leaving::remove);
    s.bodies.pop_back();
    const auto e = make_cpu_engine(s);
    const auto r = e->run(-1, 0.5, forever);
    EXPECT_EQ(r.reason, "until") << r.fault.message;
    EXPECT_EQ(e->particle_count(0), 0u);
    EXPECT_TRUE(e->grid("mass").data.empty());
    EXPECT_TRUE(test::table(*e, 0).empty());
}

// Faults.

TEST(Faults, a_step_beyond_stability_is_refused) {
    Spec s = test::busy_scene(2, true);
    const double c =
        std::sqrt(1e6 * 0.7 / (1.3 * 0.4) / 800);  // the solid is faster than the water
    s.time_step = 1.01 * 0.1 / (c * std::sqrt(2.0));
    try {
        make_cpu_engine(s);
        FAIL() << "accepted";
    } catch (const SceneError& e) {
        EXPECT_NE(std::string(e.what()).find("block0"), std::string::npos) << e.what();
    }
    s.time_step *= 0.98;
    EXPECT_EQ(make_cpu_engine(s)->time_step(), s.time_step);
}

TEST(Faults, impossible_scenes) {
    const auto refused = [](auto change) {
        Spec s = test::busy_scene(2, true);
        change(s);
        EXPECT_THROW(make_cpu_engine(s), SceneError);
    };
    refused([](Spec& s) { s.dimension = 4; });
    refused([](Spec& s) { s.cells[0] = 0; });
    refused([](Spec& s) { s.pipeline = "guess"; });
    refused([](Spec& s) { s.bodies[0].material = "Cheese"; });
    refused([](Spec& s) { s.bodies[0].parameters.pop_back(); });
    refused([](Spec& s) {
        s.bodies[1].material = "LinearElastic";  // of the same parameters
        s.bodies[1].smoothing = SmoothingForm::one_volume;
    });
    for (double outside : {-0.01, 7.0}) {
        refused([outside](Spec& s) {
            auto x = test::positions(s.bodies[0], 2);
            x[0] = outside;
            s.bodies[0].position = rows_of(x, 2);
        });
    }
    refused([](Spec& s) { s.sensors[2].ids = {0}; });
}

/// However fast, the first step and all later ones stay within half a cell.
TEST(Faults, a_huge_velocity_shortens_the_step) {
    Spec s = leaving_scene(2, Leaving::remove);
    s.bodies[0].velocity = {1e5, 0};
    const auto e = make_cpu_engine(s);
    EXPECT_LE(e->time_step() * 1e5, 0.5 * 0.1 * (1 + 1e-12));
    EXPECT_EQ(go(*e, 3).reason, "steps");
}

/// An acceleration within one step that no speed limit can foresee.
TEST(Faults, outran_cell) {
    Spec s = leaving_scene(2, Leaving::remove);
    s.gravity.time = {0, 0.0099, 0.01, 1};
    s.gravity.value = {0, 0, 0, 0, 1e9, 0, 1e9, 0};
    s.bodies[0].velocity = {0, 0};
    const auto e = make_cpu_engine(s);
    const auto r = go(*e, 1000);
    ASSERT_EQ(r.reason, "fault");
    EXPECT_EQ(r.fault.code, "outran-cell");
    EXPECT_EQ(r.fault.step, e->step());
    EXPECT_GT(r.fault.step, 1);
    EXPECT_GT(r.fault.value * e->time_step(), 0.1);
    EXPECT_NE(r.fault.message, "");
    EXPECT_THROW(e->save(), NumericalError);
    const auto again = go(*e, 5);
    EXPECT_EQ(again.reason, "fault");
    EXPECT_EQ(again.fault.code, "outran-cell");
    EXPECT_EQ(again.steps, 0);
    for (const auto& [id, row] : test::table(*e, 0))
        for (double x : row) ASSERT_TRUE(std::isfinite(x)) << "the state is that before the fault";
}

TEST(Faults, a_velocity_that_is_not_a_number) {
    for (double bad : {std::nan(""), HUGE_VAL}) {
        Spec s = leaving_scene(2, Leaving::stop);
        s.bodies[0].velocity = {bad, 0};
        s.time_step = 1e-4;
        const auto r = go(*make_cpu_engine(s), 10);
        ASSERT_EQ(r.reason, "fault");
        EXPECT_EQ(r.fault.code, "non-finite");
    }
}

/// Matter without stiffness that runs together is crushed; the report names a particle and step,
/// and until then nothing that can be read is not a number.
void check_crushed(const char* material, std::vector<double> parameters, const char* code,
                   bool single) {
    Spec s = test::empty_scene(2, single, {24, 24});
    s.bodies.push_back(
        test::body(s, "first", material, parameters, test::lattice(s, {1, 1}, {3, 3}, 2), 4));
    s.bodies.push_back(
        test::body(s, "crushed", material, parameters, test::lattice(s, {8, 8}, {16, 16}, 2), 4));
    auto& b = s.bodies[1];
    b.velocity.clear();
    for (double x : test::positions(b, 2)) b.velocity.push_back(-20 * (x - 1.2));
    const auto e = make_cpu_engine(s);
    RunResult r;
    for (int step = 0; step < 20000; ++step) {
        r = go(*e, 1);
        if (r.reason == "fault") break;
        if (step % 10 != 0) continue;
        for (int body = 0; body < 2; ++body)
            for (const auto& [id, row] : test::table(*e, body))
                for (double x : row)
                    ASSERT_TRUE(std::isfinite(x)) << "step " << step << " particle " << id;
    }
    ASSERT_EQ(r.reason, "fault");
    EXPECT_EQ(r.fault.code, code) << r.fault.message;
    EXPECT_EQ(r.fault.body, "crushed");
    ASSERT_EQ(r.fault.ids.size(), 1u);
    EXPECT_GE(r.fault.ids[0], b.first_id);
    EXPECT_LT(r.fault.ids[0], b.first_id + b.count);
    EXPECT_EQ(r.fault.step, e->step() - 1) << "the step that did it is the one before";
    EXPECT_GE(r.fault.step, 1);
    EXPECT_NE(r.fault.message.find("volume ratio"), std::string::npos);
    // The particle named is beyond its law's range in what can be read.
    const Attributes a = e->attributes(1, {"volume_ratio"});
    for (std::size_t k = 0; k < a.id.size(); ++k) {
        if (a.id[k] != r.fault.ids[0]) continue;
        const double J = a.values.at("volume_ratio").data[k];
        EXPECT_TRUE(J < 0.0501 || J > 19.99) << J;
    }
}
TEST(Faults, compressed) {
    check_crushed("TaitFluid", {1000, 1e-2, 7.15, 0}, "compressed", true);
    check_crushed("TaitFluid", {1000, 1e-2, 7.15, 0}, "compressed", false);
}
TEST(Faults, inverted) {
    check_crushed("FixedCorotated", {1000, 1e-2, 0.3}, "inverted", true);
    check_crushed("FixedCorotated", {1000, 1e-2, 0.3}, "inverted", false);
}

}  // namespace
}  // namespace mpm
