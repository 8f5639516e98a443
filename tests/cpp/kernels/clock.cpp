// The clock alone: what Decide and EndStep do with given nodal speeds.
#include "mpm/kernels/clock.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace mpm {
namespace {

constexpr double dx = 0.1, dt = 0.01, least_mass = 0.5, wave_speed = 20;
constexpr double forever = std::numeric_limits<double>::infinity();

/// A run whose grid update is a number: the speed of the fastest node.
struct Course {
    Clock clock{};
    double maxima[maxima_count] = {};
    BodyConstants constants[2] = {{1000, 0, 0.25}, {500, 0.02, 0}};
    BodyNumbers numbers[2] = {};
    std::vector<SensorRecord> sensors;
    std::vector<std::vector<double>> samples;  // by sensor: times
    int sum_bits = 0, sorts = 0, collections = 0;
    double waves = wave_speed;

    explicit Course(double speed) {
        clock.time = 0;
        clock.dt = clock.dt_next = clock.dt_stable = dt;
        clock.drift_limit = 0.3;
        clock.stray_limit = ~std::uint64_t(0);
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
        Decide<2> decide{};
        decide.clock = &clock;
        decide.cell_size = dx;
        decide.constants = constants;
        decide.numbers = numbers;
        decide.bodies = 2;
        decide.sensors = sensors.data();
        decide.sensor_count = int(sensors.size());
        decide.sum_bits = sum_bits;
        decide.least_mass = least_mass;
        decide.wave_speed = waves;
        decide(maxima);
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

/// Nodes that hold no more than the particle's own share of them, each as fast as one that counts
/// `fastest` may be.
TEST(LightNodes, give_a_particle_no_more_than_they_are_said_to) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> power(-9, 0);
    const double fastest = 3, mass = 2.5;
    double most = 0;
    for (int dimension : {2, 3}) {
        const int nodes = dimension == 2 ? 9 : 27;
        const double light = light_mass(mass, 3, dimension);
        for (int trial = 0; trial < 2000; ++trial) {
            std::vector<double> weight(static_cast<std::size_t>(nodes));
            double all = 0, felt = 0;
            for (double& w : weight) all += w = std::pow(10, power(random));
            for (const double w : weight) {
                const double m = w / all * mass;
                felt += w / all * fastest * std::fmax(1, light / m);
            }
            EXPECT_LE(most_moved(fastest, 1, 1), (1 + light_nodes_add) * fastest * (1 + 1e-15));
            EXPECT_LE(felt, most_moved(fastest, 1, 1));
            most = std::fmax(most, felt);
        }
    }
    EXPECT_GT(most, fastest) << "light nodes did add";
}

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
    Course run(0.4);  // 0.04 cells a step, and what light nodes add
    const double moved = most_moved(0.4, dt, dx);
    for (int k = 0; k < 100; ++k) {
        const Halt h = run.step();
        EXPECT_LE(run.clock.drift, 0.3 + 1e-12);
        if (h == Halt::sort) {
            ++run.sorts;
            EXPECT_GT(run.clock.drift + moved, 0.3);
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

TEST(Clock, sort_is_asked_for_when_strays_cost_more) {
    Course run(0.01);
    run.clock.stray_limit = 1000;
    EXPECT_EQ(run.step(), Halt::none);
    run.clock.strays = 999;
    EXPECT_EQ(run.step(), Halt::none);
    run.clock.strays = 1000;
    EXPECT_EQ(run.step(), Halt::sort);
    EXPECT_EQ(run.clock.step, 2);
    run.clock.drift = 0;  // a fresh sort is not sorted again, whatever is counted
    run.clock.halt = Halt::none;
    EXPECT_EQ(run.step(), Halt::none);
}

/// What a sort that looks ahead does to the clock.
void sort_ahead(Clock& clock) {
    clock.drift = clock.ahead;
    clock.strays = 0;
    clock.halt = Halt::none;
}

TEST(Clock, a_sort_looks_half_of_the_way_ahead) {
    Course run(0.1);  // 0.01 cells a step, and what light nodes add
    const double moved = most_moved(0.1, dt, dx);
    run.clock.look_ahead = 1.0 / 3;
    std::vector<double> ahead, way;
    for (std::int64_t last = 0; ahead.size() < 12;) {
        if (run.step() != Halt::sort) continue;
        way.push_back(moved * double(run.clock.step - last));
        last = run.clock.step;
        ahead.push_back(run.clock.ahead);
        sort_ahead(run.clock);
    }
    for (std::size_t k = 0; k + 1 < ahead.size(); ++k)
        EXPECT_NEAR(ahead[k] + way[k + 1], 0.3, 1.01 * moved);
    EXPECT_NEAR(ahead.back(), way.back() / 2, 0.5 * moved);
}

TEST(Clock, a_sort_looks_less_ahead_where_strays_cost_little) {
    for (std::uint64_t strays : {0, 250, 1000, 5000}) {
        Course run(0.1);
        run.clock.look_ahead = 1.0 / 3;
        run.clock.stray_limit = 1000;
        run.clock.drift = strays < 1000 ? 0.295 : 0.2;
        run.clock.strays = strays;
        ASSERT_EQ(run.step(), Halt::sort);
        const double room = 0.3 - most_moved(0.1, dt, dx);
        EXPECT_NEAR(run.clock.ahead, strays < 1000 ? room / 3 * double(strays) / 1000 : 0.2 / 3,
                    1e-12);
    }
}

/// Whatever the speeds: the limit holds, and the step that has halted for a sort goes on after it.
TEST(Clock, a_sort_that_looks_ahead_is_not_sorted_again) {
    Course run(0);
    std::uint64_t draw = 1;
    run.clock.look_ahead = 0.5;
    int sorts = 0, ahead = 0;
    for (int k = 0; k < 20000; ++k) {
        draw = draw * 6364136223846793005u + 1442695040888963407u;
        const double u = double(draw >> 11) / double(std::uint64_t(1) << 53);
        run.maxima[max_speed] = k % 1000 < 900 ? 1.2 * u * u : 9 * u;
        const double before = run.clock.drift,
                     moved = most_moved(run.maxima[max_speed], run.clock.dt, dx);
        if (moved > 1) continue;
        if (run.step() == Halt::sort) {
            ++sorts;
            ahead += run.clock.ahead > 0;
            sort_ahead(run.clock);
            EXPECT_LE(run.clock.drift + moved, std::max(0.3, moved));
            EXPECT_EQ(run.step(), Halt::none);
        }
        EXPECT_TRUE(run.clock.drift <= 0.3 + 1e-12 || run.clock.drift <= moved + 1e-12)
            << before << " and " << moved;
    }
    EXPECT_GT(ahead, 100);
    EXPECT_GT(sorts, ahead);
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
    for (double speed : {0.0, 4.9, 5.1, 9.5}) {  // with light nodes 9.6 is a cell a step
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
    overflow.clock.deposited[momentum_sum] = 2;
    overflow.clock.deposit_limit[momentum_sum] = 1;
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
        EXPECT_DOUBLE_EQ(run.numbers[b].rate, 10);
        // The impulse belongs to the step that follows.
        EXPECT_DOUBLE_EQ(run.numbers[b].impulse, 4 * dt / (density * dx));
    }
    EXPECT_DOUBLE_EQ(run.numbers[0].ratio, 0.25);
    EXPECT_DOUBLE_EQ(run.numbers[1].ratio, 1 - std::exp(-0.2));
}

/// Steps of changing length, seen from the particles: each moves by its own, and the stress acts
/// for the one that follows.
TEST(Clock, body_numbers_follow_the_step) {
    Course run(0);
    for (double speed : {1.0, 1.0, 50.0, 80.0, 80.0, 40.0, 1.0, 1.0, 1.0}) {
        run.maxima[max_speed] = speed;
        run.clock.drift = 0;
        if (speed * run.clock.dt > dx) run.clock.dt = 0.9 * dx / speed;  // came to it gradually
        const double now = run.clock.dt;
        ASSERT_EQ(run.step(), Halt::none) << speed;
        for (int b = 0; b < 2; ++b) {
            const double density = b == 0 ? 1000 : 500;
            EXPECT_DOUBLE_EQ(run.numbers[b].move, now / dx);
            EXPECT_DOUBLE_EQ(run.numbers[b].impulse, 4 * run.clock.dt / (density * dx));
        }
        EXPECT_DOUBLE_EQ(run.numbers[1].ratio, -std::expm1(-now / 0.02));
    }
    EXPECT_EQ(run.clock.dt, dt);
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

/// A run whose sums are integers of 31 bits.
struct Deposits : Course {
    explicit Deposits(double speed, double mass = 3) : Course(speed) {
        sum_bits = 31;
        maxima[max_mass] = mass;
        for (int q = 0; q < quantities; ++q) {  // as the first deposit leaves them
            clock.scale_write[q] = clock.unit_read[q] = 1;
            clock.deposit_limit[q] = 10;
        }
    }
    /// What particles left before this step; what they leave in the next is the caller's.
    Halt step(double momentum, double group = 0) {
        clock.deposited[momentum_sum] = momentum;
        clock.deposited[group_sum] = group;
        return Course::step();
    }
    void expect_scales() const {
        // Rest of the course of one step: no more than what moved in it.
        const double moved = clock.speed * clock.dt / dx;
        const double mass = std::fmax(maxima[max_mass], least_mass), room = std::ldexp(1.0, 30);
        for (int q = 0; q < quantities; ++q) {
            const double scale = clock.scale_write[q];
            EXPECT_TRUE(std::isfinite(scale));
            EXPECT_GT(scale, 0);
            EXPECT_EQ(clock.unit_read[q], 1 / scale) << "what is written is read by the next step";
            EXPECT_EQ(clock.deposited[q], 0) << "a new step deposits anew";
            const double most = q == mass_sum ? 1 : clock.deposit_limit[q];
            EXPECT_TRUE(std::isfinite(most));
            EXPECT_GT(most, 0);
            EXPECT_LE(mass * mass_growth(moved, 2) * most * scale, room);
            EXPECT_GT(mass * mass_growth(moved, 2) * most * scale, room / 4);
        }
    }
};

TEST(ClockDeposits, above_their_limit_are_a_fault_at_the_next_look) {
    for (int q : {momentum_sum, group_sum}) {
        for (double factor : {1.0, 1.0000001, 100.0, HUGE_VAL, std::nan("")}) {
            Deposits run(0.1);
            ASSERT_EQ(run.step(2, 0.01), Halt::none);
            const double limit = run.clock.deposit_limit[q];
            const auto time = run.clock.time;
            run.clock.deposited[q] = limit * factor;
            if (factor == 1.0) {
                EXPECT_EQ(run.Course::step(), Halt::none) << "the limit itself still fits";
                EXPECT_EQ(run.clock.step, 2);
                continue;
            }
            EXPECT_EQ(run.Course::step(), Halt::fault) << factor;
            EXPECT_EQ(run.clock.fault, FaultKind::fixed_point);
            EXPECT_EQ(run.clock.step, 1);
            EXPECT_EQ(run.clock.time, time);
            if (std::isnan(factor))
                EXPECT_TRUE(std::isnan(run.clock.fault_value));
            else
                EXPECT_EQ(run.clock.fault_value, limit * factor);
        }
    }
}

/// Deposits so large for the step that what moves would round away, whatever their limit.
TEST(ClockDeposits, beside_which_motion_rounds_away_are_a_fault) {
    for (double cells : {255.0, 257.0, 1e7}) {
        Deposits run(0.1);
        run.clock.deposit_limit[momentum_sum] = HUGE_VAL;
        const bool fits = cells < 256;
        EXPECT_EQ(run.step(cells * dx / dt), fits ? Halt::none : Halt::fault) << cells;
        EXPECT_EQ(run.clock.fault, fits ? FaultKind::none : FaultKind::fixed_point);
        if (fits) {
            // A node that crosses 2^-16 cells a step is told from rest.
            const double mass = run.maxima[max_mass], slowest = std::ldexp(dx / dt, -16);
            EXPECT_GT(mass * slowest * run.clock.scale_write[momentum_sum], 1);
        }
        run = Deposits(0.1);
        run.sum_bits = 62;
        run.clock.deposit_limit[momentum_sum] = HUGE_VAL;
        EXPECT_EQ(run.step(cells * dx / dt), Halt::none) << "double precision holds both";
    }
}

/// A fault of particles says more than what it does to the sums.
TEST(ClockDeposits, particle_faults_come_first) {
    Deposits run(0.1);
    ASSERT_EQ(run.step(2), Halt::none);
    run.clock.fault_particle = 3;
    EXPECT_EQ(run.step(std::nan("")), Halt::fault);
    EXPECT_EQ(run.clock.fault, FaultKind::particle);
}

TEST(ClockDeposits, limits_follow_what_was_deposited) {
    Deposits run(0.25);
    run.clock.gravity[1] = -10;
    const double calm = 1e-6 * wave_speed + 10 * dt, moved = most_moved(0.25, dt, dx);
    const double blow = deposit_of_blow(wave_speed * dt / dx);
    double before = 0;
    for (double momentum : {0.0, 1e-3, 1.0, 16.0, 15.0, 0.1, 0.2, 0.1}) {
        ASSERT_EQ(run.step(momentum, 0.1 * momentum), Halt::none) << momentum;
        run.clock.drift = 0;
        const double recent = std::fmax(momentum, before);  // of the last two steps
        EXPECT_NEAR(run.clock.deposit_limit[momentum_sum],
                    deposit_growth * (recent + calm) + blow * 0.25, 1e-9 * (recent + 1));
        const double group = run.clock.deposit_limit[group_sum];
        EXPECT_GE(group, deposit_growth * (0.1 * recent + 2 * moved));
        EXPECT_LE(group, deposit_growth * (0.1 * recent + 2 * moved + 1e-6));
        run.expect_scales();
        before = momentum;
    }
}

/// A fluid particle alone, compressed by 1e-4: its slope s (m/s a cell) is the next step's rate,
/// and its stress is linear in j = J - 1. It deposits 3/2 |s|, which may vanish where it turns.
TEST(ClockDeposits, of_a_particle_alone_turn_without_a_fault) {
    for (int d : {2, 3}) {
        double least = 1;
        for (double courant = 0.01; courant < 1 / std::sqrt(double(d)); courant += 0.001) {
            Deposits run(0);
            const double c = run.waves = courant * dx / dt;
            double j = -1e-4, s = -4 * dt * c * c / dx * j;
            double before = HUGE_VAL, last = 1.5 * std::abs(s);
            for (int k = 0; k < 2000; ++k) {
                run.maxima[max_speed] = std::sqrt(double(d)) * std::abs(s);
                run.clock.drift = 0;
                ASSERT_EQ(run.step(last), Halt::none) << d << "D, C " << courant << ", step " << k;
                j += d * dt / dx * s;
                s -= 4 * dt * c * c / dx * j;
                const double next = 1.5 * std::abs(s);
                ASSERT_LE(next, 3 * std::fmax(last, before) * (1 + 1e-9));
                least = std::fmin(least, last / next);
                before = last;
                last = next;
            }
        }
        EXPECT_LT(least, 1e-3) << "some must turn where the deposit vanishes";
    }
}

/// A blow: the nodes are fast at once, and what that deposits fits.
TEST(ClockDeposits, speed_opens_the_limit_at_once) {
    Deposits run(0);
    for (int k = 0; k < 5; ++k) ASSERT_EQ(run.step(0), Halt::none);
    EXPECT_LT(run.clock.deposit_limit[momentum_sum], 0.001);
    run.maxima[max_speed] = 5;
    ASSERT_EQ(run.step(0), Halt::none);
    EXPECT_GE(run.clock.deposit_limit[momentum_sum], deposit_growth * 5);
    run.expect_scales();
    EXPECT_EQ(run.step(deposit_growth * 5), Halt::sort) << "half a cell a step";
    EXPECT_EQ(run.clock.fault, FaultKind::none);
}

/// Whatever halts a step, its deposits are still judged, and still known to the limits after it.
TEST(ClockDeposits, outlive_a_halt) {
    for (Halt why : {Halt::sort, Halt::steps, Halt::until, Halt::samples}) {
        for (bool fits : {true, false}) {
            Deposits run(0.4);
            if (why == Halt::samples) run.add_sensor(1.5 * dt, 1);
            for (int k = 0; k < 2; ++k) ASSERT_EQ(run.step(2, 0.01), Halt::none);
            const auto before = run.clock;
            if (why == Halt::sort) run.clock.drift = 0.29;
            if (why == Halt::steps) run.clock.steps_left = 0;
            if (why == Halt::until) run.clock.until = run.clock.time;
            ASSERT_EQ(run.step(3, 0.02), why);
            for (int again = 0; again < 3; ++again) run.Course::step();  // what was queued
            EXPECT_EQ(run.clock.step, 2);
            EXPECT_EQ(run.clock.deposited[momentum_sum], 3);
            EXPECT_EQ(run.clock.deposited[group_sum], 0.02);
            EXPECT_EQ(run.clock.deposited_before[momentum_sum], 2);
            for (int q = 0; q < quantities; ++q) {
                EXPECT_EQ(run.clock.scale_write[q], before.scale_write[q]);
                EXPECT_EQ(run.clock.unit_read[q], before.unit_read[q]);
                EXPECT_EQ(run.clock.deposit_limit[q], before.deposit_limit[q]);
            }
            if (!fits) run.clock.deposited[momentum_sum] = 1000;
            run.clock.halt = Halt::none;
            run.clock.drift = 0;
            run.clock.steps_left = -1;
            run.clock.until = forever;
            for (auto& r : run.sensors) r.count = 0;
            if (!fits) {
                EXPECT_EQ(run.Course::step(), Halt::fault);
                EXPECT_EQ(run.clock.fault, FaultKind::fixed_point);
                continue;
            }
            EXPECT_EQ(run.Course::step(), Halt::none);
            EXPECT_EQ(run.clock.step, 3);
            const double blow = 0.4 * deposit_of_blow(wave_speed * dt / dx);
            EXPECT_GE(run.clock.deposit_limit[momentum_sum], deposit_growth * 3 + blow);
            EXPECT_LT(run.clock.deposit_limit[momentum_sum], deposit_growth * 3.01 + blow);
            run.expect_scales();
        }
    }
}

TEST(ClockDeposits, rest_has_finite_scales) {
    for (double mass : {0.0, 1e-9, 3.0}) {
        Deposits run(0, mass);
        for (int k = 0; k < 3; ++k) {
            ASSERT_EQ(run.step(0), Halt::none);
            run.expect_scales();
            // Rounding of a fluid at rest is no fault.
            EXPECT_GT(run.clock.deposit_limit[momentum_sum], 1e-6 * wave_speed);
        }
    }
}

/// Nodes that carry their particles one cell in a step are the fastest that pass.
TEST(ClockDeposits, fast_steps_leave_room_for_mass) {
    for (double speed : {0.1, 1.0, 5.0, 9.5}) {
        Deposits run(speed);
        ASSERT_EQ(run.step(speed), Halt::none);
        EXPECT_LE(3 * mass_growth(most_moved(speed, dt, dx), 2) * run.clock.scale_write[mass_sum],
                  std::ldexp(1.0, 30));
    }
}

}  // namespace
}  // namespace mpm
