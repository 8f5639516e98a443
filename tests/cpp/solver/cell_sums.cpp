// Smoothing over cells as devices do it, by integers, on a device that is none
// (support/slow_device.hpp): against the CPU, in any order and cut, and what must not pass.
#include "mpm/kernels/cell_sums.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "mpm/core/error.hpp"
#include "support/ranks.hpp"
#include "support/scene.hpp"
#include "support/slow_engine.hpp"

namespace mpm {
namespace {

using test::go;

std::unique_ptr<Engine> on_device(const Spec& s) { return test::make_slow_engine(s); }

struct Form {
    const char* name;
    SmoothingChoice choice;
};
SmoothingChoice flux(FluxLimiter limiter, bool extrema) {
    SmoothingChoice k;
    k.form = CellForm::flux;
    k.limiter = limiter;
    k.extrema = extrema;
    k.gamma = 0.5;
    return k;
}
SmoothingChoice only(CellForm form) {
    SmoothingChoice k;
    k.form = form;
    return k;
}
const Form forms[] = {{"C0", only(CellForm::constant)},
                      {"C1", only(CellForm::linear)},
                      {"NB", only(CellForm::nodal)},
                      {"F0", flux(FluxLimiter::none, false)},
                      {"F0L1", flux(FluxLimiter::linear, false)},
                      {"F0L2", flux(FluxLimiter::quadratic, false)},
                      {"F0A", flux(FluxLimiter::none, true)},
                      {"F0AL1", flux(FluxLimiter::linear, true)},
                      {"F0AL2", flux(FluxLimiter::quadratic, true)},
                      {"F1", only(CellForm::linear_flux)}};

/// Waves of `amplitude` in every component of the state of a body that begins here. Where a field
/// is zero but for rounding, rounding decides which of its cells are extrema.
void begin_with_waves(const Spec& s, BodySpec& b, int width, double amplitude) {
    const std::vector<double> x = test::positions(b, s.dimension);
    std::vector<double> state(b.count * std::size_t(width));
    for (std::size_t k = 0; k < b.count; ++k)
        for (int c = 0; c < width; ++c) {
            double phase = 0.4 + c;
            for (int a = 0; a < s.dimension; ++a)
                phase += (0.83 - 0.21 * a) * x[k * std::size_t(s.dimension) + std::size_t(a)] /
                         s.cell_size;
            state[k * std::size_t(width) + std::size_t(c)] = amplitude * std::sin(phase);
        }
    b.state_width = width;
    b.state = rows_of(std::move(state), width);
}

/// Water and an elastic block that are thrown against walls, both smoothed.
Spec thrown(int dimension, bool single, Kernel kernel, const SmoothingChoice& choice) {
    const bool flat = dimension == 2;
    Spec s = test::empty_scene(
        dimension, single,
        flat ? std::vector<std::int64_t>{40, 20} : std::vector<std::int64_t>{12, 8, 8});
    s.gravity.value[std::size_t(dimension - 1)] = -9.81;
    s.pipeline = "phased";
    s.kernel.kernel = kernel;
    if (kernel == Kernel::linear) {
        s.kernel.gradient = GradientForm::shapes;
        s.transfer.scheme = "PIC";
    }
    s.bodies.push_back(test::body(
        s, "water", "TaitFluid", test::fluid(),
        flat ? test::lattice(s, {0, 0}, {20, 12}, 2) : test::lattice(s, {0, 0, 0}, {6, 8, 5}, 2),
        flat ? 4 : 8));
    s.bodies.push_back(test::body(
        s, "block", "LinearElastic", {800, 1e6, 0.3},
        flat ? test::lattice(s, {34, 4}, {40, 9}, 3) : test::lattice(s, {9, 2, 2}, {12, 5, 5}, 2),
        flat ? 9 : 8));
    s.bodies[0].velocity[0] = 4;
    s.bodies[1].velocity[0] = 2;
    for (BodySpec& b : s.bodies) b.cell_smoothing = choice;
    s.bodies[0].smoothed_field = "volume";
    s.bodies[1].smoothed_field = "strain";
    begin_with_waves(s, s.bodies[0], 1, 1e-3);
    begin_with_waves(s, s.bodies[1], flat ? 3 : 6, 1e-3);
    test::add_walls(s, Response::separable);
    return s;
}

/// Root of mean squares of the pressures' differences, as a share of theirs.
double apart(Engine& one, Engine& other, int body) {
    const Attributes x = one.attributes(body, {"pressure"}),
                     y = other.attributes(body, {"pressure"});
    std::map<std::uint64_t, double> of;
    for (std::size_t k = 0; k < y.id.size(); ++k) of[y.id[k]] = y.values.at("pressure").data[k];
    double sum = 0, size = 0;
    for (std::size_t k = 0; k < x.id.size(); ++k) {
        const double p = of.at(x.id[k]);
        sum += std::pow(x.values.at("pressure").data[k] - p, 2);
        size += p * p;
    }
    EXPECT_GT(size, 0);
    return std::sqrt(sum / size);
}

/// Rounding of a step in parts of what a sound wave carries: single precision, and sums on the grid
/// of 31 bits on a scale of the largest of them (tests/python/test_cuda.py). At the edge of a body
/// it weighs a hundredfold, and functions that are linear spread what is there.
constexpr double of_a_step = 1e-6, at_edges = 100;

class SumsOfCells : public ::testing::TestWithParam<std::tuple<Form, int, Kernel>> {
protected:
    const SmoothingChoice choice = std::get<0>(GetParam()).choice;
    const int dimension = std::get<1>(GetParam());
    const Kernel kernel = std::get<2>(GetParam());
    // Gradients of linear functions jump where particles cross nodes, and runs part.
    const double rounding = of_a_step * (kernel == Kernel::linear ? at_edges : 1);
    const int steps = kernel == Kernel::linear ? 8 : 60;
    Spec scene(bool single) const { return thrown(dimension, single, kernel, choice); }
};

TEST_P(SumsOfCells, do_what_the_cpu_does) {
    const auto reference = make_cpu_engine(scene(false)), single = make_cpu_engine(scene(true)),
               device = on_device(scene(true));
    for (Engine* e : {reference.get(), single.get(), device.get()})
        ASSERT_EQ(go(*e, steps).reason, "steps");
    ASSERT_TRUE(steps == 8 || device->statistics().at("sorts") > 0);
    for (int b = 0; b < 2; ++b) {
        EXPECT_LT(apart(*single, *reference, b), steps * rounding);
        EXPECT_LT(apart(*device, *reference, b), steps * rounding);
        const auto calls = device->smoothing(b).rows, expected = reference->smoothing(b).rows;
        ASSERT_EQ(calls.size(), std::size_t(steps));
        double change = 0, expected_change = 0, most = 0;
        for (std::size_t k = 0; k < calls.size(); ++k) {
            ASSERT_NEAR(calls[k].time, expected[k].time, 1e-5);
            most = std::max(most, expected[k].before);
            EXPECT_NEAR(calls[k].before, expected[k].before, 1e-4 * most + 1e-15);
            EXPECT_LE(calls[k].change, 1e-6 * calls[k].before + 1e-16);
            change += calls[k].change;
            expected_change += expected[k].change;
        }
        EXPECT_LT(change, 0);
        EXPECT_NEAR(change, expected_change, 1e-2 * std::abs(expected_change));
    }
}

TEST_P(SumsOfCells, have_one_result_whatever_the_order) {
    const auto once = on_device(scene(true)), other = on_device(scene(true));
    test::cells_backwards = true;
    go(*once, steps);
    test::cells_backwards = false;
    for (int n : {1, 3, steps - 4}) {
        go(*other, n);
        other->attributes(0, {"pressure"});
    }
    ASSERT_TRUE(steps == 8 || once->statistics().at("sorts") > 0);
    EXPECT_EQ(test::state_bytes(*once), test::state_bytes(*other));
    for (int b = 0; b < 2; ++b) {
        const auto x = once->smoothing(b).rows, y = other->smoothing(b).rows;
        ASSERT_EQ(x.size(), y.size());
        for (std::size_t k = 0; k < x.size(); ++k) EXPECT_EQ(x[k].change, y[k].change);
    }
}

std::string name_of(const ::testing::TestParamInfo<SumsOfCells::ParamType>& i) {
    return std::string(std::get<0>(i.param).name) + "_" + std::to_string(std::get<1>(i.param)) +
           "D_" + (std::get<2>(i.param) == Kernel::quadratic ? "quadratic" : "linear");
}
INSTANTIATE_TEST_SUITE_P(Forms, SumsOfCells,
                         ::testing::Combine(::testing::ValuesIn(forms), ::testing::Values(2),
                                            ::testing::Values(Kernel::quadratic)),
                         name_of);
const std::vector some =
    test::sanitized ? std::vector{forms[2]} : std::vector{forms[2], forms[8], forms[9]};
INSTANTIATE_TEST_SUITE_P(Some, SumsOfCells,
                         ::testing::Combine(::testing::ValuesIn(some), ::testing::Values(3),
                                            ::testing::Values(Kernel::quadratic, Kernel::linear)),
                         name_of);

TEST(CellSums, stand_before_the_fused_step_too) {
    for (const Form& form : {forms[0], forms[2], forms[7]}) {
        std::unique_ptr<Engine> engine[2];
        for (int k = 0; k < 2; ++k) {
            Spec s = thrown(2, true, Kernel::quadratic, form.choice);
            s.bodies.pop_back();  // LinearElastic has no fused form
            s.pipeline = k == 0 ? "auto" : "phased";
            engine[k] = on_device(s);
            ASSERT_EQ(go(*engine[k], 60).reason, "steps");
        }
        EXPECT_LT(apart(*engine[0], *engine[1], 0), 60 * of_a_step) << form.name;
        const auto x = engine[0]->smoothing(0).rows, y = engine[1]->smoothing(0).rows;
        ASSERT_EQ(x.size(), 60u);
        EXPECT_NEAR(x.back().change, y.back().change, 1e-3 * std::abs(y.back().change));
    }
}

/// Ranks of devices, where they reach each other's memory and where they do not.
class CellsOfRanks : public ::testing::TestWithParam<std::tuple<Form, int, bool>> {};

TEST_P(CellsOfRanks, have_the_bits_of_one) {
    const auto [form, dimension, reach] = GetParam();
    const Spec s = thrown(dimension, true, Kernel::quadratic, form.choice);
    const int half = 30;
    const auto one = on_device(s);
    go(*one, half);
    const State saved = one->save();
    ASSERT_EQ(go(*one, half).reason, "steps");
    ASSERT_GT(one->statistics().at("sorts"), 0) << "the scene must sort to mean anything";
    const auto two = test::make_slow_engine(test::on_devices(s, 2, 0), reach);
    go(*two, half);
    go(*two, half);
    EXPECT_GT(two->statistics().at("migrated"), 0);
    test::expect_same_states(*two, *one, 2);
    test::expect_same_smoothing(*two, *one, 2, 1e-11);
    const auto four = test::make_slow_engine(test::on_devices(s, 4, RanksSpec::curve, 0), reach);
    four->load(saved);
    go(*four, half);
    test::expect_same_states(*four, *one, 2);
}

/// In one pass, with a rank that has none of the water until it comes, and one body after another
/// until none of it is left anywhere.
TEST(CellSums, of_ranks_stand_before_the_fused_step_and_outlive_the_last_particle) {
    for (const Form& form : {forms[1], forms[2]}) {
        Spec s = thrown(2, true, Kernel::quadratic, form.choice);
        s.bodies.pop_back();
        s.pipeline = "auto";
        s.gravity.value = {60, 0};
        s.boundaries.clear();
        s.outlets.push_back({"out", 1});
        s.leaving = Leaving::remove;
        // Blocks are of eight cells: the second rank has those from 24 on, water begins before 20.
        Spec parted = test::on_devices(s, 2, 0, std::numeric_limits<double>::infinity());
        parted.ranks.planes = {3};
        const auto one = on_device(s), two = test::make_slow_engine(parted);
        for (Engine* e : {one.get(), two.get()}) {
            e->run(-1, 0.05, test::forever);
            ASSERT_GT(e->particle_count(0), 0u);
        }
        test::expect_same_states(*two, *one, 1);
        for (Engine* e : {one.get(), two.get()}) {
            e->run(-1, 1.0, test::forever);
            EXPECT_EQ(e->particle_count(0), 0u);
        }
        test::expect_same_smoothing(*two, *one, 1, 1e-11);
    }
}

std::string name_of_ranks(const ::testing::TestParamInfo<CellsOfRanks::ParamType>& i) {
    return std::string(std::get<0>(i.param).name) + "_" + std::to_string(std::get<1>(i.param)) +
           "D_" + (std::get<2>(i.param) ? "reached" : "sent");
}
const std::vector of_ranks = test::sanitized
                                 ? std::vector{forms[2], forms[9]}
                                 : std::vector{forms[0], forms[1], forms[2], forms[8], forms[9]};
INSTANTIATE_TEST_SUITE_P(Plane, CellsOfRanks,
                         ::testing::Combine(::testing::ValuesIn(of_ranks), ::testing::Values(2),
                                            ::testing::Bool()),
                         name_of_ranks);
INSTANTIATE_TEST_SUITE_P(Solid, CellsOfRanks,
                         ::testing::Combine(::testing::ValuesIn(some), ::testing::Values(3),
                                            ::testing::Values(true)),
                         name_of_ranks);

TEST(CellScale, holds_all_particles_in_one_cell) {
    for (std::uint64_t n : {1ull, 7ull, 8ull, 8'000'001ull, (1ull << 32) - 1}) {
        const CellScale s = CellScale::of(n);
        const long double most = std::ldexp(1.0L, 63);
        EXPECT_LT(n * (s.field * (long double)(most_smoothed) + 0.5L), most);
        EXPECT_LT(n * (s.one + 0.5L), most);
        EXPECT_GT(8 * n * s.one, most) << "and wastes no more than two bits";
    }
}

/// What a call leaves of a clock, of `particles` of 1 kg.
Clock taken(double before, double after, double particles, const SmoothingChoice& choice,
            SmoothingLog& log) {
    Clock clock{};
    const double sum[smoothing_sums] = {before, after};
    TakeSmoothing::of(&clock, &log, 1.0, std::uint64_t(particles), true, choice, 3, {})(0, sum);
    return clock;
}

TEST(TakeSmoothing, lets_pass_what_rounding_adds_and_halts_at_more) {
    const SmoothingChoice c0 = only(CellForm::constant);
    const double n = 8e6, q = 1e-5, quantum = 1 / CellScale::of(std::uint64_t(n)).field;
    SmoothingLog log;
    EXPECT_EQ(taken(n * q * q, n * q * q * 0.9, n, c0, log).halt, Halt::none);
    // Each mean off by half a quantum, and all of a field that is no larger than that.
    EXPECT_EQ(taken(n * q * q, n * std::pow(q + 0.4 * quantum, 2), n, c0, log).halt, Halt::none);
    EXPECT_EQ(taken(0, n * std::pow(0.4 * quantum, 2), n, c0, log).halt, Halt::none);
    EXPECT_EQ(log.calls, 3);
    const Clock more = taken(n * q * q, n * q * q * 1.001, n, c0, log);
    EXPECT_EQ(more.halt, Halt::fault);
    EXPECT_EQ(more.fault, FaultKind::smoothing);
    EXPECT_EQ(more.fault_particle >> 40, 3u);
    EXPECT_EQ(taken(n * q * q, std::nan(""), n, c0, log).fault, FaultKind::smoothing);
    log.beyond = fault_number(3, 17);
    EXPECT_EQ(taken(1, 1, n, c0, log).fault, FaultKind::smoothing_range);
}

/// Energies of all count: one rank's may grow by what another's loses.
TEST(TakeSmoothing, of_several_ranks_is_judged_together) {
    const std::uint64_t n = 1000, elsewhere = 99;
    RankTold told[2] = {{{4, 5}, 0}, {{6, 4}, 0}};
    const auto judged = [&](bool own_beyond) {
        Clock clock{};
        SmoothingLog log;
        if (own_beyond) log.beyond = fault_number(3, 17);
        RankTold* boxes[] = {told};
        const TakeSmoothing take = TakeSmoothing::of(&clock, &log, 1.0, n, true,
                                                     only(CellForm::constant), 3, {boxes, 0, 1});
        const double own[smoothing_sums] = {4, 5};
        take(0, own);
        EXPECT_EQ(log.calls, 0) << "nothing is recorded before all have told";
        TakeSmoothingOfAll{take, told, 2, elsewhere}();
        EXPECT_EQ(log.calls, 1);
        EXPECT_EQ(log.call[0].before, 10);
        EXPECT_EQ(log.call[0].change, -1);
        return clock;
    };
    EXPECT_EQ(judged(false).halt, Halt::none);
    EXPECT_EQ(judged(true).fault_particle, fault_number(3, 17));
    told[1].beyond = 1;
    const Clock other = judged(false);
    EXPECT_EQ(other.fault, FaultKind::smoothing_range);
    EXPECT_EQ(other.fault_particle, elsewhere);
    told[1] = {{6, 7}, 0};
    Clock clock{};
    SmoothingLog log;
    RankTold* boxes[] = {told};
    const TakeSmoothing take =
        TakeSmoothing::of(&clock, &log, 1.0, n, true, only(CellForm::constant), 3, {boxes, 0, 1});
    TakeSmoothingOfAll{take, told, 2, elsewhere}();
    EXPECT_EQ(clock.fault, FaultKind::smoothing);
}

TEST(CellSums, refuse_a_strain_that_they_cannot_hold) {
    Spec s = thrown(2, true, Kernel::quadratic, only(CellForm::constant));
    BodySpec& b = s.bodies[1];
    b.restored = true;
    b.state_width = 3;
    b.parameters[1] = 1e-6;  // so soft that nothing outruns a cell for it
    std::vector<double> state(b.count * 3, 0.0);
    state[3 * 11 + 2] = 40;  // a shear
    b.state = rows_of(state, 3);
    for (const int ranks : {1, 3}) {
        const auto engine =
            ranks == 1 ? on_device(s) : test::make_slow_engine(test::on_devices(s, ranks, 0));
        const RunResult r = go(*engine, 5);
        EXPECT_EQ(r.reason, "fault");
        EXPECT_EQ(r.fault.code, "smoothing-range");
        EXPECT_EQ(r.fault.body, "block");
        EXPECT_EQ(r.fault.step, 0);
        EXPECT_EQ(r.fault.ids, std::vector<std::uint64_t>{b.first_id + 11});
    }
}

TEST(CellSums, what_is_not_built_for_devices_is_refused) {
    const auto refused = [](const auto& change) {
        Spec s = thrown(2, true, Kernel::quadratic, only(CellForm::constant));
        s.transfer.scheme = "PIC";
        change(s.bodies[1]);
        EXPECT_THROW(on_device(s), SceneError);
    };
    refused([](BodySpec& b) {
        b.assumed_part = TensorPart::full;
        b.assumed = only(CellForm::constant);
    });
    refused([](BodySpec& b) { b.damping = 0.1; });
    refused([](BodySpec& b) { b.force = {0, {0, 1}, {1, 1, 1, 1}}; });
}

}  // namespace
}  // namespace mpm
