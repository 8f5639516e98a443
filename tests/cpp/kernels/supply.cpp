// Inlets as the clock sees them: when a layer of particles is due, and what it may add to a node.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "mpm/kernels/clock.hpp"

namespace mpm {
namespace {

constexpr double dx = 0.1, dt = 0.01, spacing = 0.05;

struct Course {
    Clock clock{};
    double maxima[maxima_count] = {};
    BodyConstants constants{1000, 0, 0.25};
    BodyNumbers numbers{};
    double time[2] = {0, 1}, speed[2] = {0, 2};  // m/s: 0 to 2 within a second
    SupplyRecord supply{{time, speed, 2, 1, TableEnd::hold}, 0, spacing, 0};
    Decide<2> decide{};

    Course() {
        clock.dt = clock.dt_next = clock.dt_stable = dt;
        clock.drift_limit = 0.3;
        clock.stray_limit = ~std::uint64_t(0);
        clock.until = std::numeric_limits<double>::infinity();
        clock.steps_left = -1;
        clock.fault_particle = no_fault;
        clock.log_stride = 1;
        decide.clock = &clock;
        decide.cell_size = dx;
        decide.constants = &constants;
        decide.numbers = &numbers;
        decide.bodies = 1;
        decide.least_mass = 0.5;
        decide.wave_speed = 20;
        decide.supplies = &supply;
        decide.supply_count = 1;
    }
    Halt step() {
        decide(maxima);
        EndStep{&clock, dx}();
        return clock.halt;
    }
};

TEST(Supply, a_layer_is_due_when_the_water_has_moved_on_by_the_spacing) {
    Course run;
    double moved = 0;
    int layers = 0;
    while (run.clock.step < 200) {
        const double t = run.clock.time;
        const Halt halt = run.step();
        if (halt == Halt::supply) {
            EXPECT_GE(moved, spacing * (layers + 1) - 1e-12);
            run.supply.due = spacing * (++layers + 1);
            run.clock.halt = Halt::none;
            continue;
        }
        ASSERT_EQ(halt, Halt::none);
        // The zone moves with the velocity of the step's beginning.
        moved += 2 * std::fmin(t, 1) * dt;
        EXPECT_DOUBLE_EQ(run.supply.moved, moved);
        EXPECT_LT(moved, spacing * (layers + 2));
    }
    EXPECT_EQ(layers, int(moved / spacing));
    EXPECT_NEAR(moved, 1 + 2, 2 * dt);
}

TEST(Supply, a_halt_before_it_changes_nothing) {
    Course run;
    run.supply.moved = run.supply.due;
    for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(run.step(), Halt::supply);
        EXPECT_EQ(run.clock.step, 0);
        EXPECT_EQ(run.supply.moved, run.supply.due);
        run.clock.halt = Halt::none;
    }
    // Nor does one that a run ends with: the next run decides the same step again.
    run.supply.due = 1;
    run.clock.time = 0.5;
    run.clock.steps_left = 0;
    EXPECT_EQ(run.step(), Halt::steps);
    EXPECT_EQ(run.supply.moved, spacing);
    run.clock.steps_left = 1;
    run.clock.halt = Halt::none;
    EXPECT_EQ(run.step(), Halt::none);
    EXPECT_DOUBLE_EQ(run.supply.moved, spacing + 1.0 * dt);
}

TEST(Supply, it_comes_before_a_sort_which_it_does_itself) {
    Course run;
    run.maxima[max_speed] = 1;
    run.clock.drift = 0.29;
    run.supply.moved = run.supply.due;
    EXPECT_EQ(run.step(), Halt::supply);
}

TEST(Supply, sums_have_room_for_its_mass) {
    Course bare, run;
    for (Course* c : {&bare, &run}) {
        c->decide.sum_bits = 31;
        c->maxima[max_mass] = 3;
        for (int q = 0; q < quantities; ++q) {
            c->clock.unit_read[q] = 1;
            c->clock.deposit_limit[q] = 10;
        }
    }
    run.decide.supplied_mass = 5;
    bare.step();
    run.step();
    const double room = std::ldexp(1.0, 30);
    EXPECT_LE(run.clock.scale_write[mass_sum] * (3 + 5), room);
    EXPECT_GT(bare.clock.scale_write[mass_sum] * (3 + 5), room);
}

}  // namespace
}  // namespace mpm
