// The clock of a run: time, step size, drift, and whether the next step may go on. It lives where
// the particles live and is advanced by two small functions, so that a device needs no word from
// the host between steps: when something must happen (a sort, the end, a fault) the clock halts,
// what is still queued does nothing, and the host looks.
#pragma once

#include <cstdint>

#include "mpm/data/time_table.hpp"
#include "mpm/kernels/fixed_point.hpp"
#include "mpm/kernels/surface.hpp"
#include "mpm/physics/boundary/response.hpp"

namespace mpm {

enum class Halt : int {
    none = 0,
    sort = 1,
    until = 2,
    steps = 3,
    fault = 4,
    samples = 5,
    supply = 6
};
enum class FaultKind : int {
    none = 0,
    particle = 1,
    outran = 2,
    fixed_point = 3,
    smoothing = 4,
    smoothing_range = 5,
    crowded = 6  // more bodies at a node than contact keeps apart
};

inline constexpr int max_groups = 8;
inline constexpr int speed_log_size = 128;
inline constexpr std::uint64_t no_fault = ~std::uint64_t(0);

/// Slots of `maxima`: fastest node [m/s] and, for fixed point, largest nodal mass [kg].
enum Maximum : int { max_speed = 0, max_mass = 1, maxima_count = 2 };

/// Drops make light nodes fast (their force over their mass has no bound), but a node weighs in a
/// particle's velocity at most what its mass is of the particle's. So a node lighter than this
/// counts by its part of it, and all that a particle of the least mass may see, `nodes` along each
/// axis, add at most `light_nodes_add` to what the fastest that counts does.
inline constexpr double light_nodes_add = 0.05;
MPM_HD inline double light_mass(double least_mass, int nodes, int dimension) {
    double all = 1;
    for (int a = 0; a < dimension; ++a) all *= nodes;
    return least_mass * light_nodes_add / (all - 1);
}
/// Cells that no particle crosses more of in a step.
MPM_HD inline double most_moved(double speed, double dt, double cell_size) {
    return (1 + light_nodes_add) * speed * dt / cell_size;
}

/// Fastest component of what is driven by tables of places over the coming step, m/s.
template <int D>
MPM_CALL double driven_speed(const TimeTableView* drives, int count, double time, double dt) {
    const Reconverge at_return;
    double most = 0;
    for (int k = 0; k < count; ++k) {
        double before[D], after[D];
        drives[k].at(time, before);
        drives[k].at(time + dt, after);
        for (int a = 0; a < D; ++a) {
            const double way = after[a] < before[a] ? before[a] - after[a] : after[a] - before[a];
            if (way > most * dt) most = way / dt;
        }
    }
    return most;
}

struct Clock {
    double time, dt, dt_next, dt_stable;
    std::int64_t step;
    double gravity[3];
    double drift;        // cells that a particle may stand beside its home cell
    double drift_limit;  // when to sort at the latest
    // Particles that stood beside their home cell, over all steps since the last sort, and how many
    // cost more than a sort.
    std::uint64_t strays, stray_limit;
    double speed;  // fastest node of the step in progress
    // Fixed point: number = integer * unit for the sums being read, integer = number * scale for
    // those being filled; the largest deposits into the latter, and what they may be.
    double unit_read[quantities], scale_write[quantities];
    double deposited[quantities], deposit_limit[quantities];
    double sweep_scale;                  // of what a sweep of XPIC or FMPM adds
    double numbers_dt, numbers_dt_next;  // steps that the bodies' numbers are for
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
    // Largest deposits of the step before that of `deposited`. Clocks that were saved by earlier
    // versions end here (solver/saved_clock.hpp).
    double deposited_before[quantities];
    double look_ahead;  // share of the drift that a sort looks ahead
    double ahead;       // cells: the same of the sort that the clock halts for
};

/// Brings the host's clock to where the steps are taken, in order with them and without a wait.
struct SetClock {
    Clock from;
    Clock* to;
    MPM_HD void operator()() const { *to = from; }
};
static_assert(sizeof(SetClock) <= 4000, "parameters of a kernel");

/// What changes in a body's numbers from step to step.
struct BodyNumbers {
    double move, rate, impulse, ratio;
};
struct BodyConstants {
    double density;
    double smoothing_time;   // s, or 0
    double smoothing_ratio;  // per step, used when the time is 0
};

/// For a step of length `dt` whose deposit belongs to one of `dt_next`.
MPM_HD inline BodyNumbers body_numbers(const BodyConstants& body, double cell_size, double dt,
                                       double dt_next) {
    BodyNumbers n{};
    n.move = dt / cell_size;
    n.rate = 1 / cell_size;
    n.impulse = 4 * dt_next / (body.density * cell_size);
    n.ratio = body.smoothing_time > 0 ? -expm1(-dt / body.smoothing_time) : body.smoothing_ratio;
    return n;
}

template <int D>
struct BoundaryRecord {
    int is_box;
    int lower[D], upper[D];  // box: blocked cells; domain: 0 and the number of cells
    int present[2 * D];      // faces x-, x+, y-, ...
    SurfaceLaw law[2 * D];
    double start, end;
    TimeTableView motion;  // count 0: at rest
    int surface;           // one more than its number among the surfaces; 0: walls or a box
    std::uint64_t share;   // bit mask of the sums of mass that it acts on; 0: on all
    int limited;           // acts between these corners alone, m
    double within_lower[D], within_upper[D];
    // Of a box with linear faces: the cells that these cover, inside the domain; the rows of nodes
    // that end in them, on where the box ends with the domain.
    int face_lower[D], face_upper[D], rows_lower[D], rows_upper[D];
    // Evaluated each step:
    int active;
    double velocity[D];

    /// Whether it acts from the start to the end of any run.
    MPM_HD bool always() const { return start <= 0 && end > 1e300; }
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

/// An inlet, as the clock sees it: how far its water has moved in, and when the next layer of
/// particles is due.
struct SupplyRecord {
    TimeTableView velocity;  // m/s into the domain, one component, none below 0
    double moved, due;       // m
    double last;             // m, in the last step

    MPM_HD void advance(double time, double dt) {
        double speed = 0;
        velocity.at(time, &speed);
        last = speed * dt;
        moved += last;
    }
};

/// First half: forces and boundaries of this moment. Runs before the grid update, again after a
/// halt.
template <int D>
struct BeginStep {
    Clock* clock;
    TimeTableView gravity;
    BoundaryRecord<D>* boundaries;
    int boundary_count;
    SurfaceRecord<D>* surfaces = nullptr;

    MPM_HD void operator()() const {
        if (clock->halt != Halt::none) return;
        gravity.at(clock->time, clock->gravity);
        for (int b = 0; b < boundary_count; ++b) {
            auto& r = boundaries[b];
            r.active = clock->time >= r.start && clock->time < r.end;
            for (int a = 0; a < D; ++a) r.velocity[a] = 0;
            if (r.motion.count > 0) r.motion.at(clock->time, r.velocity);
            if (r.surface > 0) surfaces[r.surface - 1].set(clock->time);
        }
    }
};

/// Particles are shifted (kernels/shifting.hpp) at every tenth step, by a part of the excess above
/// the band of disorder (divided by the dimension: what flows from a node along all axes must not
/// be more than it has too much), and at most so many cells: measured in design/fbar.md, 4.
inline constexpr std::int64_t shift_every = 10;
inline constexpr double shift_rate = 0.2, shift_band = 0.05, shift_most = 0.05;

MPM_INLINE bool shifts_in(std::int64_t step) { return step % shift_every == 0; }

/// Second half, after the grid update has left its maxima: may this step go on, and how long is the
/// next one?
template <int D>
struct Decide {
    Clock* clock;
    double cell_size;
    const BodyConstants* constants;
    BodyNumbers* numbers;
    int bodies;
    SensorRecord* sensors;
    int sensor_count;
    int sum_bits;       // bits of a fixed-point sum that may be used; 0: sums are plain numbers
    double least_mass;  // of a particle, kg
    double wave_speed;
    double beyond = 0;  // share of the largest deposit that particles may move with beside the grid
    SupplyRecord* supplies = nullptr;
    int supply_count = 0;
    double supplied_mass = 0;  // that layers of one step may add to a node, kg
    double shift = 0;          // that particles may be shifted by in a step that shifts, cells
    // Of vertices that pins drive, whatever the nodes around them do.
    const TimeTableView* drives = nullptr;
    int drive_count = 0;

    /// What is read comes first and together: on a device one thread does this, and each read that
    /// had to wait for a write before it would cost more than all the rest.
    MPM_HD void operator()(const double* maxima) const {
        const Halt halt = clock->halt;
        const std::uint64_t fault = clock->fault_particle, strays = clock->strays,
                            stray_limit = clock->stray_limit;
        const double time = clock->time, dt = clock->dt, dt_stable = clock->dt_stable,
                     drift = clock->drift, drift_limit = clock->drift_limit, until = clock->until,
                     numbers_dt = clock->numbers_dt, numbers_dt_next = clock->numbers_dt_next;
        const std::int64_t step = clock->step, steps_left = clock->steps_left;
        const double driven = drive_count > 0 ? driven_speed<D>(drives, drive_count, time, dt) : 0,
                     speed = maxima[max_speed] < driven ? driven : maxima[max_speed],
                     mass = maxima[max_mass];
        double gravity[D], deposited[quantities], before[quantities], limit[quantities];
        for (int a = 0; a < D; ++a) gravity[a] = clock->gravity[a];
        for (int q = 0; q < quantities; ++q) {
            deposited[q] = clock->deposited[q];
            before[q] = clock->deposited_before[q];
            limit[q] = clock->deposit_limit[q];
        }

        for (int s = 0; s < sensor_count; ++s) sensors[s].due = 0;
        if (halt != Halt::none) return;
        clock->speed = speed;
        if (fault != no_fault) return stop(FaultKind::particle, 0);
        for (int q = 0; q < quantities && sum_bits > 0; ++q)
            if (!(deposited[q] <= limit[q])) return stop(FaultKind::fixed_point, deposited[q]);
        if (sum_bits > 0 && deposited[momentum_sum] * dt > coarsest_deposit(sum_bits) * cell_size)
            return stop(FaultKind::fixed_point, deposited[momentum_sum]);
        const double moved = most_moved(speed, dt, cell_size) + (shifts_in(step) ? shift : 0.0);
        if (!(moved <= 1.0)) return stop(FaultKind::outran, speed);
        for (int s = 0; s < supply_count; ++s) {
            if (supplies[s].moved >= supplies[s].due) return sort_for(Halt::supply, moved);
        }
        if (drift > 0 && (drift + moved > drift_limit || strays >= stray_limit))
            return sort_for(Halt::sort, moved);
        for (int s = 0; s < sensor_count; ++s) {
            if (time >= double(sensors[s].next) * sensors[s].interval &&
                sensors[s].count >= sensors[s].capacity) {
                clock->halt = Halt::samples;
                return;
            }
        }
        for (int s = 0; s < sensor_count; ++s) {
            auto& r = sensors[s];
            if (r.interval <= 0 ? r.next <= step : time >= double(r.next) * r.interval) {
                r.due = 1;
                if (r.interval <= 0)
                    r.next = step + 1;
                else
                    while (time >= double(r.next) * r.interval) ++r.next;
            }
        }
        if (steps_left == 0) {
            clock->halt = Halt::steps;
            return;
        }
        if (time >= until) {
            clock->halt = Halt::until;
            return;
        }
        // No node may cross more than half a cell, so that its particles stay inside what the step
        // can see.
        double dt_next = dt_stable;
        if (speed * dt_next > 0.5 * cell_size) dt_next = 0.5 * cell_size / speed;
        clock->dt_next = dt_next;
        if (dt != numbers_dt || dt_next != numbers_dt_next) set_numbers(dt, dt_next);
        if (sum_bits > 0) {
            const double further = moved + beyond * deposited[momentum_sum] * dt / cell_size;
            choose_scales(gravity, deposited, before, speed, mass + supplied_mass,
                          further < 1 ? further : 1.0, dt_next);
        }
        for (int s = 0; s < supply_count; ++s) supplies[s].advance(time, dt);
        remember_speed(step, speed);
    }

    /// A sort puts particles into the cells where they will be half way to the next sort. Of those
    /// that move as fast as any, that is `ahead` cells from where they are; of no other it is more.
    /// They then stand half a cell and `ahead` from their home cell's centre at most, along each
    /// axis, and the drift counts from `ahead` on. So the drift bounds what it bounds without:
    /// nobody stands further than half a cell and the drift from the centre, nor beyond
    /// `drift_limit` where no single step reaches further.
    ///
    /// When a sort that looked s ahead has been followed by a way d, the drift is s + d, and a
    /// third of it is half of the next way as soon as s is half of d; the rule gets there by
    /// thirds. What is looked ahead is lost to the way where the drift calls for sorts before
    /// strays have cost much: there it is less. The step that halts for the sort must fit in after
    /// it.
    MPM_HD void sort_for(Halt halt, double moved) const {
        const double drift = clock->drift, room = clock->drift_limit - moved;
        const std::uint64_t strays = clock->strays, limit = clock->stray_limit;
        const bool counted = limit != ~std::uint64_t(0);
        const double cost = counted && strays < limit ? double(strays) / double(limit) : 1;
        const double way = drift < room ? drift : room;
        clock->ahead = way > 0 && moved > 0 ? clock->look_ahead * cost * way : 0;
        clock->halt = halt;
    }

    MPM_HD void set_numbers(double dt, double dt_next) const {
        for (int b = 0; b < bodies; ++b) {
            numbers[b] = body_numbers(constants[b], cell_size, dt, dt_next);
        }
        clock->numbers_dt = dt;
        clock->numbers_dt_next = dt_next;
    }

    MPM_HD void stop(FaultKind kind, double value) const {
        clock->halt = Halt::fault;
        clock->fault = kind;
        clock->fault_value = value;
    }

    /// See kernels/fixed_point.hpp. A floor keeps rounding out of fluids at rest.
    MPM_HD void choose_scales(const double (&gravity)[D], const double (&deposited)[quantities],
                              const double (&before)[quantities], double speed, double mass,
                              double moved, double dt_next) const {
        double g = 0, recent[quantities];
        for (int q = 0; q < quantities; ++q)
            recent[q] = deposited[q] > before[q] ? deposited[q] : before[q];
        for (int a = 0; a < D; ++a) g += gravity[a] * gravity[a];
        const double calm = 1e-6 * wave_speed + sqrt(g) * dt_next;
        const FixedPoint f =
            fixed_point(sum_bits, (mass > least_mass ? mass : least_mass) * mass_growth(moved, D),
                        deposit_growth * (recent[momentum_sum] + calm) +
                            deposit_of_blow(wave_speed * dt_next / cell_size) * speed,
                        deposit_growth * (recent[group_sum] + D * moved + 1e-7));
        for (int q = 0; q < quantities; ++q) {
            clock->scale_write[q] = f.scale[q];
            clock->deposit_limit[q] = f.limit[q];
            clock->deposited_before[q] = deposited[q];
            clock->deposited[q] = 0;
        }
    }

    MPM_HD void remember_speed(std::int64_t step, double speed) const {
        if ((step & (clock->log_stride - 1)) != 0) return;  // a power of two
        if (clock->log_count == speed_log_size) {
            for (int k = 0; k < speed_log_size / 2; ++k) {
                clock->log_step[k] = clock->log_step[2 * k];
                clock->log_speed[k] = clock->log_speed[2 * k];
            }
            clock->log_count = speed_log_size / 2;
            clock->log_stride *= 2;
            if ((step & (clock->log_stride - 1)) != 0) return;
        }
        clock->log_step[clock->log_count] = step;
        clock->log_speed[clock->log_count] = speed;
        ++clock->log_count;
    }
};

struct EndStep {
    Clock* clock;
    double cell_size;
    double shift = 0;  // as `Decide::shift`
    MPM_HD void operator()() const {
        if (clock->halt != Halt::none) return;
        const double dt = clock->dt, dt_next = clock->dt_next, drift = clock->drift,
                     time = clock->time, speed = clock->speed;
        const std::int64_t step = clock->step, steps_left = clock->steps_left;
        double scale[quantities];
        for (int q = 0; q < quantities; ++q) scale[q] = clock->scale_write[q];
        clock->drift = drift + most_moved(speed, dt, cell_size) + (shifts_in(step) ? shift : 0.0);
        clock->time = time + dt;
        clock->dt = dt_next;
        clock->step = step + 1;
        clock->steps_left = steps_left - 1;
        for (int q = 0; q < quantities; ++q) clock->unit_read[q] = 1 / scale[q];
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
