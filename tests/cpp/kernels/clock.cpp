// The clock alone: what Decide and EndStep do with given nodal speeds.
#include "mpm/kernels/clock.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace mpm {
namespace {

constexpr double dx = 0.1, dt = 0.01;
constexpr double forever = std::numeric_limits<double>::infinity();

/// A run whose grid update is a number: the speed of the fastest node.
struct Course {
    Clock clock{};
    double maxima[maxima_count] = {};
    BodyConstants constants[2] = {{1000, 0, 0.25}, {500, 0.02, 0}};
    BodyNumbers numbers[2] = {};
    std::vector<SensorRecord> sensors;
    std::vector<std::vector<double>> samples;  // by sensor: times
    std::uint32_t overflow = 0;
    int sum_bits = 0, sorts = 0, collections = 0;

    explicit Course(double speed) {
        clock.time = 0;
        clock.dt = clock.dt_next = clock.dt_stable = dt;
        clock.drift_limit = 0.3;
        clock.until = forever;
        clock.steps_left = -1;
        clock.fault_particle = no_fault;
        clock.log_stride = 1;
        maxima[max_speed] = speed;
    }
    void add_sensor(double interval, int capacity = 1000) {
        SensorRecord r{};
        r.interval = interval;
        r.capacity = capacity;
        sensors.push_back(r);
        samples.emplace_back();
    }
    void decide() {
        Decide<2>{&clock,   maxima, dx,  constants, numbers, 2, sensors.data(), int(sensors.size()),
                  sum_bits, 1.0,    1.0, &overflow}();
    }
    /// What a driver does between two looks at the clock.
    Halt step() {
        decide();
        for (std::size_t s = 0; s < sensors.size(); ++s) {
            if (!sensors[s].due) continue;
            EXPECT_LT(sensors[s].count, sensors[s].capacity) << "row without room";
            samples[s].push_back(clock.time);
            ++sensors[s].count;
        }
        EndStep{&clock, dx}();
        return clock.halt;
    }
    Halt go(std::int64_t steps, double until) {
        clock.steps_left = steps;
        clock.until = until;
        clock.halt = Halt::none;
        for (int guard = 0; guard < 100000; ++guard) {
            const Halt h = step();
            if (h == Halt::sort) {
                clock.drift = 0;
                ++sorts;
            } else if (h == Halt::samples) {
                for (auto& r : sensors) r.count = 0;
                ++collections;
            } else if (h != Halt::none) {
                return h;
            }
            clock.halt = Halt::none;
        }
        ADD_FAILURE() << "the clock never halted";
        return Halt::none;
    }
};

TEST(Clock, steps) {
    Course run(0);
    EXPECT_EQ(run.go(7, forever), Halt::steps);
    EXPECT_EQ(run.clock.step, 7);
    EXPECT_NEAR(run.clock.time, 7 * dt, 1e-15);
    EXPECT_EQ(run.go(0, forever), Halt::steps);
    EXPECT_EQ(run.clock.step, 7);
    EXPECT_EQ(run.go(3, forever), Halt::steps);
    EXPECT_EQ(run.clock.step, 10);
}

TEST(Clock, until_stops_at_the_first_boundary_not_before) {
    Course run(0);
    EXPECT_EQ(run.go(-1, 0.055), Halt::until);
    EXPECT_EQ(run.clock.step, 6);
    EXPECT_EQ(run.clock.dt, dt) << "a step is never shortened to hit a time";
    EXPECT_EQ(run.go(-1, 0.055), Halt::until);
    EXPECT_EQ(run.clock.step, 6);
    EXPECT_EQ(run.go(2, 1e9), Halt::steps);
    EXPECT_EQ(run.clock.step, 8);
}

TEST(Clock, samples_come_once_however_a_run_is_split) {
    const auto collect = [](const std::vector<std::int64_t>& parts, int capacity, double speed) {
        Course run(speed);
        for (double interval : {0.0, 0.01, 0.025, 0.003, 1.0}) run.add_sensor(interval, capacity);
        for (auto n : parts) run.go(n, forever);
        EXPECT_EQ(run.collections > 0, capacity < 100);
        EXPECT_EQ(run.sorts > 0, speed > 0);
        return run.samples;
    };
    const auto whole = collect({100}, 1000, 0);
    EXPECT_EQ(whole[0].size(), 101u);  // every step boundary, both ends included
    for (const auto& s : whole) {
        EXPECT_EQ(s.front(), 0);
        for (std::size_t k = 1; k < s.size(); ++k) EXPECT_GT(s[k], s[k - 1]) << "doubled";
    }
    EXPECT_EQ(whole[2].size(), 41u);  // 0, 0.025, ... 1
    for (std::size_t k = 0; k + 1 < whole[2].size(); ++k) {
        // At the first boundary that is not before its time.
        EXPECT_GE(whole[2][k], 0.025 * double(k));
        EXPECT_LT(whole[2][k], 0.025 * double(k) + dt * (1 + 1e-9));
    }
    EXPECT_EQ(collect({37, 63}, 1000, 0), whole);
    EXPECT_EQ(collect({37, 0, 0, 1, 62}, 1000, 0), whole);
    EXPECT_EQ(collect({100}, 7, 0), whole) << "a full ring";
    EXPECT_EQ(collect({50, 50}, 3, 0), whole);
    EXPECT_EQ(collect({100}, 1000, 0.5), whole) << "sorts between";
    EXPECT_EQ(collect({33, 67}, 5, 0.5), whole) << "all at once";
}

TEST(Clock, sort_is_asked_for_before_a_particle_may_pass_the_limit) {
    Course run(0.4);  // 0.04 cells a step
    for (int k = 0; k < 100; ++k) {
        const Halt h = run.step();
        EXPECT_LE(run.clock.drift, 0.3 + 1e-12);
        if (h == Halt::sort) {
            ++run.sorts;
            EXPECT_GT(run.clock.drift + 0.04, 0.3);
            run.clock.drift = 0;
            run.clock.halt = Halt::none;
        } else {
            EXPECT_EQ(h, Halt::none);
        }
    }
    EXPECT_EQ(run.sorts, 100 / 8);
}

TEST(Clock, a_fresh_sort_is_not_sorted_again) {
    Course run(5);  // half a cell a step: beyond the limit at once
    for (int k = 0; k < 10; ++k) {
        EXPECT_EQ(run.step(), Halt::none);
        EXPECT_EQ(run.step(), Halt::sort);
        run.clock.drift = 0;
        run.clock.halt = Halt::none;
    }
    EXPECT_EQ(run.clock.step, 10);
}

TEST(Clock, a_halted_clock_stands) {
    for (Halt h : {Halt::sort, Halt::until, Halt::steps, Halt::fault, Halt::samples}) {
        Course run(0.1);
        run.add_sensor(0);
        run.sensors[0].due = 1;
        run.clock.halt = h;
        run.step();
        EXPECT_EQ(run.clock.step, 0);
        EXPECT_EQ(run.clock.time, 0);
        EXPECT_EQ(run.clock.drift, 0);
        EXPECT_EQ(run.sensors[0].due, 0);
        EXPECT_TRUE(run.samples[0].empty());
    }
}

TEST(Clock, no_node_crosses_more_than_half_a_cell) {
    for (double speed : {0.0, 4.9, 5.1, 9.9}) {
        Course run(speed);
        run.step();
        EXPECT_LE(run.clock.dt * speed, 0.5 * dx * (1 + 1e-12));
        EXPECT_LE(run.clock.dt, dt);
        EXPECT_EQ(run.clock.dt == dt, speed < 5);
    }
    Course run(50);  // ten times too fast for this step
    run.clock.dt = 0.0009;
    EXPECT_EQ(run.step(), Halt::none);
    EXPECT_DOUBLE_EQ(run.clock.dt, 0.001);
    run.maxima[max_speed] = 1;  // slows down: back to the stable step
    run.clock.drift = 0;
    run.step();
    EXPECT_EQ(run.clock.dt, dt);
}

TEST(Clock, faults) {
    Course fast(10.1);
    EXPECT_EQ(fast.step(), Halt::fault);
    EXPECT_EQ(fast.clock.fault, FaultKind::outran);
    EXPECT_EQ(fast.clock.fault_value, 10.1);
    EXPECT_EQ(fast.clock.step, 0);
    for (double bad : {std::nan(""), HUGE_VAL, 1e300}) {
        Course run(bad);
        EXPECT_EQ(run.step(), Halt::fault) << bad;
        EXPECT_EQ(run.clock.fault, FaultKind::outran);
    }
    Course particle(0);
    particle.clock.fault_particle = 5;
    EXPECT_EQ(particle.step(), Halt::fault);
    EXPECT_EQ(particle.clock.fault, FaultKind::particle);
    Course overflow(0);
    overflow.overflow = 1;
    EXPECT_EQ(overflow.step(), Halt::none) << "plain sums cannot overflow";
    overflow.sum_bits = 31;
    EXPECT_EQ(overflow.step(), Halt::fault);
    EXPECT_EQ(overflow.clock.fault, FaultKind::fixed_point);
}

TEST(Clock, body_numbers) {
    Course run(0);
    run.clock.dt = 0.004;
    run.step();
    for (int b = 0; b < 2; ++b) {
        const double density = b == 0 ? 1000 : 500;
        EXPECT_DOUBLE_EQ(run.numbers[b].move, 0.04);
        EXPECT_DOUBLE_EQ(run.numbers[b].strain, 0.16);
        EXPECT_DOUBLE_EQ(run.numbers[b].rate, 40);
        // The impulse belongs to the step that follows.
        EXPECT_DOUBLE_EQ(run.numbers[b].impulse, 4 * dt / (density * dx));
    }
    EXPECT_DOUBLE_EQ(run.numbers[0].ratio, 0.25);
    EXPECT_DOUBLE_EQ(run.numbers[1].ratio, 1 - std::exp(-0.2));
}

TEST(Clock, boundaries_are_active_in_their_window) {
    Course run(0);
    const double time[] = {0, 1}, motion[] = {0, 0, 2, 4}, down[] = {0, -10};
    BoundaryRecord<2> r{};
    r.start = 0.25;
    r.end = 0.75;
    r.motion = {time, motion, 2, 2, TableEnd::hold};
    const TimeTableView gravity{time, down, 1, 2, TableEnd::hold};
    const BeginStep<2> begin{&run.clock, gravity, &r, 1};
    for (double t : {0.0, 0.25, 0.5, 0.75, 2.0}) {
        run.clock.time = t;
        begin();
        EXPECT_EQ(bool(r.active), t >= 0.25 && t < 0.75) << t;
        EXPECT_DOUBLE_EQ(r.velocity[0], 2 * std::fmin(t, 1));
        EXPECT_DOUBLE_EQ(r.velocity[1], 4 * std::fmin(t, 1));
        EXPECT_EQ(run.clock.gravity[1], -10);
    }
}

TEST(Clock, speed_log_thins_itself_and_keeps_order) {
    Course run(0);
    for (int k = 0; k < 5000; ++k) {
        run.maxima[max_speed] = 1e-6 * k;
        run.clock.drift = 0;
        ASSERT_EQ(run.step(), Halt::none);
        ASSERT_LE(run.clock.log_count, speed_log_size);
    }
    ASSERT_GE(run.clock.log_count, speed_log_size / 2);
    for (int k = 0; k < run.clock.log_count; ++k) {
        EXPECT_EQ(run.clock.log_step[k], std::int64_t(k) * run.clock.log_stride);
        EXPECT_DOUBLE_EQ(run.clock.log_speed[k], 1e-6 * double(run.clock.log_step[k]));
    }
}

TEST(Clock, power_of_two_below) {
    for (double x : {1e-300, 0.3, 1.0, 1.5, 1024.0, 1e300}) {
        const double p = power_of_two_below(x);
        int e;
        EXPECT_EQ(std::frexp(p, &e), 0.5);
        EXPECT_LE(p, x);
        EXPECT_GT(2 * p, x * 0.999999);
    }
}

}  // namespace
}  // namespace mpm
