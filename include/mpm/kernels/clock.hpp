// The clock of a run: time, step size, drift, and whether the next step may go on. It lives where
// the particles live and is advanced by two small functions, so that a device needs no word from
// the host between steps: when something must happen (a sort, the end, a fault) the clock halts,
// what is still queued does nothing, and the host looks.
#pragma once

#include <cstdint>

#include "mpm/data/time_table.hpp"
#include "mpm/physics/boundary/response.hpp"

namespace mpm {

enum class Halt : int { none = 0, sort = 1, until = 2, steps = 3, fault = 4, samples = 5 };
enum class FaultKind : int { none = 0, particle = 1, outran = 2, fixed_point = 3 };

inline constexpr int max_groups = 8;
inline constexpr int speed_log_size = 128;
inline constexpr std::uint64_t no_fault = ~std::uint64_t(0);

/// Slots of `maxima`: fastest node [m/s], then the largest nodal mass, momentum and group sum for
/// fixed point.
enum Maximum : int {
    max_speed = 0,
    max_mass = 1,
    max_momentum = 2,
    max_group = 3,
    maxima_count = 4
};

struct Clock {
    double time, dt, dt_next, dt_stable;
    std::int64_t step;
    double gravity[3];
    double drift;        // cells that a particle may have moved since the last sort
    double drift_limit;  // when to sort
    double speed;        // fastest node of the step in progress
    double maxima[maxima_count];
    // Fixed-point exponents as factors: value = integer / scale. `read` belongs to the sums being
    // read.
    double scale_read[maxima_count], scale_write[maxima_count];
    double until;
    std::int64_t steps_left;
    Halt halt;
    FaultKind fault;
    std::uint64_t fault_particle;  // (body << 40) | index, the smallest seen
    double fault_value;
    // For "since when did it grow": fastest node at steps a power of two apart, thinned when full.
    std::int64_t log_step[speed_log_size];
    double log_speed[speed_log_size];
    std::int32_t log_count, log_stride;
};

/// What changes in a body's numbers from step to step.
struct BodyNumbers {
    double move, strain, rate, impulse, ratio;
};
struct BodyConstants {
    double density;
    double smoothing_time;   // s, or 0
    double smoothing_ratio;  // per step, used when the time is 0
};

template <int D>
struct BoundaryRecord {
    int is_box;
    int lower[D], upper[D];  // box: blocked cells; domain: 0 and the number of cells
    int present[2 * D];      // faces x-, x+, y-, ...
    SurfaceLaw law[2 * D];
    double start, end;
    TimeTableView motion;  // count 0: at rest
    // Evaluated each step:
    int active;
    double velocity[D];
};

struct SensorRecord {
    double interval;
    std::int64_t next;  // index of the next sample: due at the first step boundary with time >=
                        // next * interval
    double last_time;   // of the sample before
    std::int32_t due;
    std::int32_t count;  // rows in the ring
    std::int32_t capacity;
    std::int32_t columns;
    double* times;   // (capacity,)
    double* values;  // (capacity, columns)
};

/// First half: forces and boundaries of this moment. Runs before the grid update, again after a
/// halt.
template <int D>
struct BeginStep {
    Clock* clock;
    TimeTableView gravity;
    BoundaryRecord<D>* boundaries;
    int boundary_count;

    MPM_HD void operator()() const {
        if (clock->halt != Halt::none) return;
        gravity.at(clock->time, clock->gravity);
        for (int b = 0; b < boundary_count; ++b) {
            auto& r = boundaries[b];
            r.active = clock->time >= r.start && clock->time < r.end;
            for (int a = 0; a < D; ++a) r.velocity[a] = 0;
            if (r.motion.count > 0) r.motion.at(clock->time, r.velocity);
        }
    }
};

MPM_HD inline double power_of_two_below(double x) {
    int e;
    frexp(x, &e);
    return ldexp(1.0, e - 1);
}

/// Second half, after the grid update has left its maxima: may this step go on, and how long is the
/// next one?
template <int D>
struct Decide {
    Clock* clock;
    double* maxima;
    double cell_size;
    const BodyConstants* constants;
    BodyNumbers* numbers;
    int bodies;
    SensorRecord* sensors;
    int sensor_count;
    int sum_bits;       // bits of a fixed-point sum that may be used; 0: sums are plain numbers
    double least_mass;  // of a particle, kg
    double wave_speed;
    const std::uint32_t* overflow;  // raised by a pass whose sums did not fit

    MPM_HD void operator()() const {
        for (int s = 0; s < sensor_count; ++s) sensors[s].due = 0;
        if (clock->halt != Halt::none) return;
        for (int m = 0; m < maxima_count; ++m) clock->maxima[m] = maxima[m];
        clock->speed = maxima[max_speed];
        if (clock->fault_particle != no_fault) return stop(FaultKind::particle, 0);
        if (sum_bits > 0 && *overflow) return stop(FaultKind::fixed_point, 0);
        const double moved = clock->speed * clock->dt / cell_size;
        if (!(moved <= 1.0)) return stop(FaultKind::outran, clock->speed);
        if (clock->drift > 0 && clock->drift + moved > clock->drift_limit) {
            clock->halt = Halt::sort;
            return;
        }
        for (int s = 0; s < sensor_count; ++s) {
            if (clock->time >= double(sensors[s].next) * sensors[s].interval &&
                sensors[s].count >= sensors[s].capacity) {
                clock->halt = Halt::samples;
                return;
            }
        }
        for (int s = 0; s < sensor_count; ++s) {
            auto& r = sensors[s];
            if (r.interval <= 0 ? r.next <= clock->step
                                : clock->time >= double(r.next) * r.interval) {
                r.due = 1;
                if (r.interval <= 0)
                    r.next = clock->step + 1;
                else
                    while (clock->time >= double(r.next) * r.interval) ++r.next;
            }
        }
        if (clock->steps_left == 0) {
            clock->halt = Halt::steps;
            return;
        }
        if (clock->time >= clock->until) {
            clock->halt = Halt::until;
            return;
        }
        // No node may cross more than half a cell, so that its particles stay inside what the step
        // can see.
        clock->dt_next = clock->dt_stable;
        if (clock->speed * clock->dt_next > 0.5 * cell_size)
            clock->dt_next = 0.5 * cell_size / clock->speed;
        for (int b = 0; b < bodies; ++b) {
            auto& n = numbers[b];
            n.move = clock->dt / cell_size;
            n.strain = 4 * clock->dt / cell_size;
            n.rate = 4 / cell_size;
            n.impulse = 4 * clock->dt_next / (constants[b].density * cell_size);
            n.ratio = constants[b].smoothing_time > 0
                          ? -expm1(-clock->dt / constants[b].smoothing_time)
                          : constants[b].smoothing_ratio;
        }
        if (sum_bits > 0) choose_scales();
        remember_speed();
    }

    MPM_HD void stop(FaultKind kind, double value) const {
        clock->halt = Halt::fault;
        clock->fault = kind;
        clock->fault_value = value;
    }

    /// Six bits of head room over the present maximum: a sum may grow 32-fold in one step before it
    /// is refused.
    MPM_HD void choose_scales() const {
        double g = 0;
        for (int a = 0; a < D; ++a) g += clock->gravity[a] * clock->gravity[a];
        const double mass =
            clock->maxima[max_mass] > least_mass ? clock->maxima[max_mass] : least_mass;
        const double calm = mass * (1e-6 * wave_speed + sqrt(g) * clock->dt_next);
        double top[maxima_count] = {0, mass, clock->maxima[max_momentum], clock->maxima[max_group]};
        if (top[max_momentum] < calm) top[max_momentum] = calm;
        // No j can change by more than 4 D speed dt / dx in this step; an eighth of that leaves
        // room for it.
        const double share = 1e-7 + 0.5 * D * clock->speed * clock->dt / cell_size;
        if (top[max_group] < share * mass) top[max_group] = share * mass;
        const double room = ldexp(1.0, sum_bits - 6);
        for (int m = max_mass; m < maxima_count; ++m)
            clock->scale_write[m] = power_of_two_below(room / top[m]);
    }

    MPM_HD void remember_speed() const {
        if (clock->step % clock->log_stride != 0) return;
        if (clock->log_count == speed_log_size) {
            for (int k = 0; k < speed_log_size / 2; ++k) {
                clock->log_step[k] = clock->log_step[2 * k];
                clock->log_speed[k] = clock->log_speed[2 * k];
            }
            clock->log_count = speed_log_size / 2;
            clock->log_stride *= 2;
            if (clock->step % clock->log_stride != 0) return;
        }
        clock->log_step[clock->log_count] = clock->step;
        clock->log_speed[clock->log_count] = clock->speed;
        ++clock->log_count;
    }
};

struct EndStep {
    Clock* clock;
    double cell_size;
    MPM_HD void operator()() const {
        if (clock->halt != Halt::none) return;
        clock->drift += clock->speed * clock->dt / cell_size;
        clock->time += clock->dt;
        clock->dt = clock->dt_next;
        ++clock->step;
        --clock->steps_left;
        for (int m = 0; m < maxima_count; ++m) clock->scale_read[m] = clock->scale_write[m];
    }
};

/// The end of a step and the beginning of the next, for backends that pay for every launch.
template <int D>
struct TurnStep {
    EndStep end;
    BeginStep<D> begin;
    MPM_HD void operator()() const {
        end();
        begin();
    }
};

}  // namespace mpm
