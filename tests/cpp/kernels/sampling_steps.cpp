// Steps in which devices launch the passes of sensors that sample a moment: as few as there are
// samples where steps keep their length, and every one that is due where they do not, or the clock
// halts before it.
#include "mpm/kernels/sampling_steps.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace mpm {
namespace {

/// Steps of a run, in batches between which the host reads the clock.
struct Steps {
    int launched = 0, due = 0, missed = 0;

    /// Steps of `length(step)`, where `stable` is the longest that is allowed.
    template <class Length>
    void go(double interval, int batch, int steps, double stable, const Length& length) {
        ExpectedSamples expected;
        expected.intervals = {interval};
        Clock clock{};
        clock.dt = length(0);
        clock.dt_stable = stable;
        std::int64_t next = 0;
        for (int step = 0; step < steps; ++step) {
            if (step % batch == 0) expected.read(clock);
            const bool expects = expected.next();
            const bool is_due = clock.time >= double(next) * interval;
            while (clock.time >= double(next) * interval) ++next;
            launched += expects;
            due += is_due;
            missed += is_due && !expects;
            clock.time = clock.time + clock.dt;
            clock.dt = length(step + 1);
        }
    }
};

TEST(SamplingSteps, AreThoseOfSamplesWhereStepsKeepTheirLength) {
    Steps run;
    run.go(1e-3, 50, 5000, 1.9e-4, [](int) { return 1.9e-4; });
    EXPECT_EQ(run.missed, 0);
    EXPECT_GT(run.due, 900);
    // Twice where a step begins at a sample's time to all digits but the last: once in 19 ms.
    EXPECT_LE(run.launched, run.due + 51);
    Steps sparse;
    sparse.go(0.1, 50, 50000, 1.9e-4, [](int) { return 1.9e-4; });
    EXPECT_EQ(sparse.missed, 0);
    EXPECT_LE(sparse.launched, sparse.due + 6);
}

TEST(SamplingSteps, HaveEverySampleWhereStepsChangeSlowly) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> change(-0.005, 0.005);
    double dt = 2e-4;
    Steps run;
    run.go(1e-3, 20, 20000, 1, [&](int) { return dt *= 1 + change(random); });
    EXPECT_GT(run.due, 1000);
    EXPECT_LT(run.missed, run.due / 50);
}

TEST(SamplingSteps, HaveASampleThatTheClockHaltedFor) {
    ExpectedSamples expected;
    expected.intervals = {0.5};
    Clock clock{};
    clock.dt = clock.dt_stable = 0.01;
    clock.time = 0.2;
    expected.missed = true;
    expected.read(clock);
    EXPECT_TRUE(expected.next());
    EXPECT_FALSE(expected.next());
}

TEST(SamplingSteps, OfEveryStepAreAll) {
    ExpectedSamples expected;
    expected.intervals = {0.0, 0.5};
    Clock clock{};
    clock.dt = 0.01;
    expected.read(clock);
    for (int k = 0; k < 30; ++k) EXPECT_TRUE(expected.next());
    ExpectedSamples none;
    none.read(clock);
    for (int k = 0; k < 30; ++k) EXPECT_FALSE(none.next());
}

TEST(SamplingSteps, TheClockHaltsBeforeAMissedSample) {
    SensorRecord records[3] = {};
    for (auto& r : records) r.interval = 0.1;
    records[0].next = 1;  // a load cell, which has a pass in every step
    records[1].next = 3;
    records[2].next = 2;
    const std::int32_t moments[] = {1, 2};
    Clock clock{};
    clock.time = 0.15;
    for (auto& r : records) r.due = 1;  // of the step before
    EXPECT_FALSE((MomentSensors{records, 3, moments, 2, false}.halt(&clock)));
    clock.time = 0.2;
    EXPECT_FALSE((MomentSensors{records, 3, moments, 2, true}.halt(&clock)));
    EXPECT_EQ(clock.halt, Halt::none);
    EXPECT_TRUE((MomentSensors{records, 3, moments, 2, false}.halt(&clock)));
    EXPECT_EQ(clock.halt, Halt::samples);
    for (const auto& r : records) EXPECT_EQ(r.due, 0);
    EXPECT_EQ(records[2].next, 2);  // taken when the step is begun again
    // A clock that has halted for something else goes on with that.
    clock.halt = Halt::sort;
    EXPECT_FALSE((MomentSensors{records, 3, moments, 2, false}.halt(&clock)));
}

}  // namespace
}  // namespace mpm
