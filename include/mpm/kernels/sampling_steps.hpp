// Devices: sensors that take samples of a moment have their passes in the steps in which the host
// expects that one of them is due. A launch that finds nothing to do costs as much as a tenth of
// the step of a small scene.
#pragma once

#include <cmath>
#include <vector>

#include "mpm/kernels/clock.hpp"

namespace mpm {

/// What one thread knows of them before the clock decides.
struct MomentSensors {
    SensorRecord* sensors = nullptr;
    int sensor_count = 0;
    const std::int32_t* which = nullptr;
    int count = 0;
    bool launched = true;  // their passes follow in this step

    /// Where one is due in a step without its pass the clock halts, as for a full ring: the step is
    /// begun again, with the pass.
    MPM_HD bool halt(Clock* clock) const {
        if (launched || clock->halt != Halt::none) return false;
        for (int k = 0; k < count; ++k) {
            const SensorRecord& r = sensors[which[k]];
            const bool due = r.interval <= 0 ? r.next <= clock->step
                                             : clock->time >= double(r.next) * r.interval;
            if (!due) continue;
            for (int s = 0; s < sensor_count; ++s) sensors[s].due = 0;
            clock->halt = Halt::samples;
            return true;
        }
        return false;
    }
};

/// On the host: when samples are expected. `time` of the step to come and its length follow the
/// clock as long as steps keep their length. Those that speeds make shorter than what is stable go
/// on changing: a hundredth of a step is allowed for each that has been taken since the clock was
/// read.
struct ExpectedSamples {
    std::vector<double> intervals;  // s, each once; 0: every step
    double time = 0, dt = 0;
    double change = 0;    // of a step's length, a step
    int taken = 0;        // steps since the clock was read
    bool missed = false;  // the clock has halted for a sample that is due

    void read(const Clock& clock) {
        time = clock.time;
        dt = clock.dt;
        change = clock.dt < clock.dt_stable ? 0.01 : 0;
        taken = 0;
    }
    /// Whether a sample may be due in the step to come; then goes on to the next.
    bool next() {
        bool due = missed && !intervals.empty();
        missed = false;
        const double spare = dt * (1e-6 + change * taken);
        for (const double interval : intervals)
            due =
                due || interval <= 0 ||
                std::floor((time + spare) / interval) > std::floor((time - dt - spare) / interval);
        time += dt;
        ++taken;
        return due;
    }
};

}  // namespace mpm
