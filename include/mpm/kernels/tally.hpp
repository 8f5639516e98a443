// Sums, extremes and counts over the particles of a body, taken in the step that starts at a
// sample's time: what sensors of regions, attributes and bodies are made of. Sums are exact
// (core/exact.hpp), so that they have the same bits on any number of threads, ranks and devices.
#pragma once

#include <iterator>

#include "mpm/core/exact.hpp"
#include "mpm/kernels/sampling.hpp"

namespace mpm {

/// What one pass over a body's particles finds. All zeros is that of none.
struct Tally {
    Int128 sum[6];
    std::uint64_t count[3];
    std::uint64_t ids[2];    // sums of ids and of their squares: tells whether others are there
    double low[3], high[3];  // where there is a count

    MPM_INLINE void take(int c, double x) {
        if (count[c] == 0 || x < low[c] || x != x) low[c] = x;
        if (count[c] == 0 || x > high[c] || x != x) high[c] = x;
        ++count[c];
    }
    MPM_INLINE Tally& operator+=(const Tally& other) {
        for (int k = 0; k < 6; ++k) sum[k] += other.sum[k];
        for (int k = 0; k < 2; ++k) ids[k] += other.ids[k];
        for (int c = 0; c < 3; ++c) {
            if (other.count[c] == 0) continue;
            const double a = other.low[c], b = other.high[c];
            if (count[c] == 0 || a < low[c] || a != a) low[c] = a;
            if (count[c] == 0 || b > high[c] || b != b) high[c] = b;
            count[c] += other.count[c];
        }
        return *this;
    }
};

/// What a tally is of. The first ones are attributes: sums of their values.
enum class TallyOf : std::int32_t {
    position,  // of the world, m
    velocity,  // m/s
    speed,
    kinetic_energy,  // J
    elevation,       // position along `up`, m
    volume,          // m^3
    density,         // kg/m^3
    pressure,        // Pa
    volume_ratio,
    elastic_energy,  // J
    plastic_strain,
    von_mises,  // Pa
    stress,     // Pa, the component `part` of 3 x 3
    // What follows are sums alone, of positions from `reference`:
    motion,    // position, velocity; extremes are of positions in the domain
    second,    // x x, y y, z z, x y, x z, y z
    spin,      // x cross v (in 2D one number); then places at first
    turn,      // place at first times position: the first two rows
    turn_rest  // the third row
};
/// In this order, as specifications call them.
inline constexpr const char* tally_names[] = {
    "position", "velocity", "speed",        "kinetic_energy", "elevation",      "volume",
    "density",  "pressure", "volume_ratio", "elastic_energy", "plastic_strain", "von_mises",
    "stress",   "motion",   "second",       "spin",           "turn",           "turn_rest"};
static_assert(std::size(tally_names) == std::size_t(TallyOf::turn_rest) + 1);
MPM_INLINE bool is_vector(TallyOf of) { return of <= TallyOf::velocity; }
inline bool needs_places(TallyOf of) { return of >= TallyOf::spin; }
MPM_INLINE bool of_law(TallyOf of) { return of >= TallyOf::volume && of <= TallyOf::stress; }
MPM_INLINE bool sees_velocity(TallyOf of) {
    return (of >= TallyOf::velocity && of <= TallyOf::kinetic_energy) || of == TallyOf::motion ||
           of == TallyOf::spin;
}

template <int D>
struct TallyTask {
    std::int32_t sensor;       // among all sensors
    std::int32_t body;         // among those that are tallied
    std::uint32_t first, ids;  // counted from the body's first
    TallyOf of;
    std::int32_t part;
    std::int32_t axis;  // of a vector: the only one that counts; -1: each
    std::int32_t sign;  // of a vector: 1 or -1 for values of that sign alone, 0 for all
    std::int32_t boxed;
    std::int64_t row;           // where its part of the sensor's rows begins
    double lower[D], upper[D];  // m from the lower corner, where it is boxed
    double origin[D];           // of the domain's lower corner in the world, m
    double reference[D], up[D];
    double scale[6];
    const double* places;  // (D, ids) m from the reference, at first; null where nobody asks
};

/// A row of a tally in a sensor's ring: sums in pieces, counts, halves of `ids`, extremes, scales.
struct TallyRow {
    static constexpr int counts = 6 * exact_pieces, ids = counts + 3, low = ids + 4, high = low + 3,
                         scales = high + 3, size = scales + 6;
    static constexpr int finished = 6 + 3 + 4 + 3 + 3;  // numbers that come of it
};

/// The smallest and the largest id of the particles of a home block, the latter by what it lacks to
/// the largest there are. All bits set: of none.
struct IdSpan {
    std::uint64_t low, below;
    MPM_INLINE bool meets(std::uint32_t first, std::uint32_t count) const {
        return ~below >= first && low < std::uint64_t(first) + count;
    }
};

/// A body, as its tallies see it.
template <class T, int D, class Law>
struct TallyBody {
    BodyView<T, D> view;
    PhaseNumbers n;
    Law law;
    double parameters[max_parameters];
    std::int32_t reals;  // of its law
    std::int32_t columns;
    std::int32_t two_volumes, volumetric;
    const IdSpan* ids;  // of each home; null where all tasks are of all its ids
};

/// The ids of each home block, `lanes` workers a block.
template <class X, class T, int D>
struct FindIdSpans {
    static constexpr int lanes = 32;
    BodyView<T, D> body;
    IdSpan* to;
    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int64_t h = i / lanes;
        const std::uint32_t* start = body.cell_start + std::int64_t(body.home[h]) * block_cells;
        IdSpan span{~std::uint64_t(0), ~std::uint64_t(0)};
        for (std::uint32_t q = start[0] + std::uint32_t(i % lanes); q < start[block_cells];
             q += lanes) {
            const std::uint64_t id = body.id[q];
            if (id < span.low) span.low = id;
            if (~id < span.below) span.below = ~id;
        }
        X::keep_smallest(&to[h].low, span.low);
        X::keep_smallest(&to[h].below, span.below);
    }
};

/// The answers of a law on the CPU: those that its instance has.
template <int D>
struct LawByPointer {
    Observe<D> observe_with;
    void (*adopt_with)(double*, double);
    MPM_INLINE Observation<D> observe(const double* state, const double (&rate)[D][D],
                                      const double* parameters) const {
        return observe_with(state, rate, parameters);
    }
    MPM_INLINE void adopt(double* state, double loss) const { adopt_with(state, loss); }
};

/// How an executor asks the law of a body: `type`, and `make(ops, name of the law)`.
template <class X, int D>
struct LawOf {
    using type = LawByPointer<D>;
    template <class Ops>
    static type make(const Ops& ops, const std::string&) {
        return {ops.observe, ops.adopt};
    }
    static bool knows(const std::string&) { return true; }
};

/// What readers know of a particle's law: the volume that F-bar gives it included. `s`: all that it
/// stores.
template <class T, int D, class Law>
MPM_INLINE Observation<D> observe_particle(const TallyBody<T, D, Law>& body, const double* s,
                                           const double (&rate)[D][D]) {
    double own[max_state_columns];
    for (int r = 0; r < body.columns; ++r) own[r] = s[r];
    if (body.two_volumes) body.law.adopt(own, s[body.reals]);
    Observation<D> o = body.law.observe(own, rate, body.parameters);
    if (body.volumetric)
        o.volume_ratio = 1 - s[0];
    else if (body.two_volumes)
        o.volume_ratio = body.law.observe(s, rate, body.parameters).volume_ratio;
    return o;
}

/// Cauchy stress, 3 x 3; in the plane with what acts across it.
template <int D>
MPM_INLINE double stress_of(const Observation<D>& o, int i, int j) {
    if constexpr (D == 2) {
        if (i == 2 && j == 2) return -3 * o.pressure - o.stress[0][0] - o.stress[1][1];
        if (i == 2 || j == 2) return 0;
    }
    return o.stress[i][j];
}
template <int D>
MPM_INLINE double von_mises_of(const Observation<D>& o) {
    double mean = 0, square = 0;
    for (int a = 0; a < 3; ++a) mean += stress_of(o, a, a) / 3;
    for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) {
            const double s = stress_of(o, a, b) - (a == b ? mean : 0.0);
            square += s * s;
        }
    return sqrt(1.5 * square);
}

/// `lanes` workers share a home block.
template <class X, class T, int D, class Law>
struct MeasureTallies {
    using Grid = typename X::template Grid<T>;
    using Sum = typename X::template Sum<T>;
    /// On a device one or two particles each; on the CPU those of a cell.
    static constexpr int lanes = X::is_device ? 256 : block_cells;

    const TallyTask<D>* tasks;
    const SensorRecord* sensors;
    const std::int32_t* asking;  // sensors that have tallies
    int asking_count;
    const TallyBody<T, D, Law>* bodies;
    BlockTableView<D> table;
    const Grid* nodes;
    int channels;
    const Sum* sums;  // of masses, where gradients ask for them
    int sum_channels;
    bool wide;  // the kernel reaches five nodes
    double cell_size;

    /// Whether no sensor is due that asks.
    MPM_INLINE bool idle() const {
        for (int k = 0; k < asking_count; ++k)
            if (sensors[asking[k]].due) return false;
        return true;
    }
    /// Whether the sensor of one task is not.
    MPM_INLINE bool idle(int number) const { return !sensors[tasks[number].sensor].due; }

    MPM_INLINE void operator()(std::int64_t i, int number, Tally* tally) const {
        const TallyTask<D>& task = tasks[number];
        const auto& body = bodies[task.body];
        const std::int64_t h = i / lanes;
        const std::int32_t slot = body.view.home[h];
        const std::int32_t* corner = table.corners + std::int64_t(slot) * D;
        if (task.boxed && !reaches(task, corner)) return;
        // Bodies that are alike are stored as one: each of them is in few of its homes.
        if (body.ids && !body.ids[h].meets(task.first, task.ids)) return;
        const int lane = int(i % lanes);
        const std::uint32_t* start = body.view.cell_start + std::int64_t(slot) * block_cells;
        const auto one = [&](std::uint32_t q, int home) {
            const std::uint32_t id = body.view.id[q] - task.first;  // wraps below the first
            if (id < task.ids) particle(task, body, slot, corner, q, home, id, *tally);
        };
        if constexpr (X::is_device) {
            for (std::uint32_t q = start[0] + lane; q < start[block_cells]; q += lanes)
                one(q, body.view.home_cell(q));
        } else {
            for (std::uint32_t q = start[lane]; q < start[lane + 1]; ++q) one(q, lane);
        }
    }

    /// Whether a block's particles, up to two cells beside it, may lie in the box.
    MPM_INLINE bool reaches(const TallyTask<D>& task, const std::int32_t* corner) const {
        for (int a = 0; a < D; ++a)
            if ((corner[a] - 2) * cell_size > task.upper[a] ||
                (corner[a] + Block<D>::edge + 2) * cell_size < task.lower[a])
                return false;
        return true;
    }

    MPM_INLINE void particle(const TallyTask<D>& task, const TallyBody<T, D, Law>& body,
                             std::int32_t slot, const std::int32_t* corner, std::uint32_t q,
                             int home, std::uint32_t id, Tally& tally) const {
        int at[D];
        Block<D>::coordinates(home, at);
        Vec<double, D> offset;
        double x[D], v[D] = {};
        for (int a = 0; a < D; ++a) {
            offset[a] = double(body.view.offset[a][q]);
            x[a] = (double(corner[a] + at[a]) + 0.5 + offset[a]) * cell_size;
            if (task.boxed && !(x[a] >= task.lower[a] && x[a] <= task.upper[a])) return;
        }
        Standing<double, D> stands;
        stands.find(corner, at, offset);
        const std::int32_t* around = table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
        const NodesAround<Grid> node{nodes, channels, around};
        const StoredNumbers<T> stored{body.view.state, q};
        if (sees_velocity(task.of)) {
            bool found = false;
            if constexpr (X::is_device) {
                const KernelChoice& k = body.n.kernel;
                found = body.n.velocity < 0 && k.kernel == Kernel::quadratic && !k.clamped;
                if (found) spline_velocity(stands, around, v);
            }
            if (!found) particle_velocity<X::is_device, D>(body.n, wide, stands, stored, node, v);
        }
        // What is added up, and that of which there are extremes: each is done in one place, for a
        // device takes longer to fetch what it does once than to do it.
        double number[6] = {}, seen[D] = {};
        unsigned counts = 0;  // of `seen`, by bits
        if (task.of >= TallyOf::motion) {
            find_moments(task, x, v, id, number);
            if (task.of == TallyOf::motion) {
                for (int a = 0; a < D; ++a) seen[a] = x[a];
                counts = (1u << D) - 1;
                const std::uint64_t own_id = body.view.id[q];
                tally.ids[0] += own_id;
                tally.ids[1] += own_id * own_id;
            }
        } else {
            counts = find_values(task, body, stands, around, node, stored, x, v, seen);
            for (int c = 0; c < D; ++c)
                if (counts >> c & 1) number[c] = seen[c];
        }
        MPM_NO_UNROLL for (int c = 0; c < D; ++c) if (counts >> c & 1) tally.take(c, seen[c]);
        MPM_NO_UNROLL for (int k = 0; k < 6; ++k) if (number[k] != 0) tally.sum[k] +=
            exact(number[k], task.scale[k]);
    }

    /// What `particle_velocity` finds with quadratic splines, to the bit, without what slopes need;
    /// a plane of nodes is read at once, where that waits for one node after another.
    MPM_INLINE void spline_velocity(const Standing<double, D>& stands, const std::int32_t* around,
                                    double (&v)[D]) const {
        const Places<D, 3> places = places_in_grid<3>(stands.cell);
        const auto weight = [&](int a, int k) {
            return shape_value(Kernel::quadratic, -(double(k - 1) - stands.xi[a]), 0.0).value;
        };
        double row[3], last[3];
        MPM_UNROLL for (int k = 0; k < 3; ++k) {
            row[k] = weight(1, k);
            last[k] = D == 3 ? weight(D - 1, k) : 0.0;
        }
        for (int a = 0; a < D; ++a) v[a] = 0;
        MPM_NO_UNROLL for (int i = 0; i < 3; ++i) {
            const double first = weight(0, i);
            if (first == 0) continue;  // as `for_each_node`
            const int place = i == 0   ? places.part[0][0]
                              : i == 1 ? places.part[0][1]
                                       : places.part[0][2];
            constexpr int depth = D == 3 ? 3 : 1, count = 3 * depth;
            bool there[count];
            const Grid* from[count];
            Grid u[count][D];
            MPM_UNROLL for (int n = 0; n < count; ++n) {
                const int at = place + places.part[1][n / depth] +
                               (D == 3 ? places.part[D - 1][n % depth] : 0);
                const std::int32_t slot = around[at >> 8];
                there[n] = slot >= 0;
                from[n] = nodes +
                          (std::int64_t(there[n] ? slot : 0) * block_cells + (at & 255)) * channels;
            }
            MPM_UNROLL for (int n = 0; n < count; ++n) MPM_UNROLL for (int a = 0; a < D; ++a)
                u[n][a] = from[n][a];
            MPM_UNROLL for (int n = 0; n < count; ++n) {
                double w = first * row[n / depth];
                if constexpr (D == 3) w = w * last[n % depth];
                MPM_UNROLL for (int a = 0; a < D; ++a) {
                    const double next = v[a] + w * double(u[n][a]);
                    v[a] = there[n] ? next : v[a];
                }
            }
        }
    }

    /// The values of an attribute; says by bits which of them count.
    template <class Node>
    MPM_INLINE unsigned find_values(const TallyTask<D>& task, const TallyBody<T, D, Law>& body,
                                    const Standing<double, D>& stands, const std::int32_t* around,
                                    const Node& node, const StoredNumbers<T>& stored,
                                    const double (&x)[D], const double (&v)[D],
                                    double (&value)[D]) const {
        int values = 1;
        if (is_vector(task.of)) {
            values = task.axis < 0 ? D : 1;
            for (int c = 0; c < values; ++c) {
                const int a = task.axis < 0 ? c : task.axis;
                value[c] = task.of == TallyOf::velocity ? v[a] : x[a] + task.origin[a];
            }
        } else if (of_law(task.of)) {
            value[0] = of_its_law(task, body, stands, around, node, stored);
        } else if (task.of == TallyOf::elevation) {
            for (int a = 0; a < D; ++a) value[0] += (x[a] + task.origin[a]) * task.up[a];
        } else {
            for (int a = 0; a < D; ++a) value[0] += v[a] * v[a];
            value[0] = task.of == TallyOf::speed ? sqrt(value[0])
                                                 : 0.5 * body.view.particle_mass * value[0];
        }
        unsigned counts = 0;
        for (int c = 0; c < values; ++c)
            if (task.sign == 0 || task.sign * value[c] > 0) counts |= 1u << c;
        return counts;
    }

    /// What the sums of a body's motion are of.
    MPM_INLINE void find_moments(const TallyTask<D>& task, const double (&x)[D],
                                 const double (&v)[D], std::uint32_t id,
                                 double (&number)[6]) const {
        double y[D], first[D] = {};
        for (int a = 0; a < D; ++a) {
            y[a] = x[a] - task.reference[a];
            if (task.places) first[a] = task.places[a * std::size_t(task.ids) + id];
        }
        switch (task.of) {
            case TallyOf::motion:
                for (int a = 0; a < D; ++a) {
                    number[a] = y[a];
                    number[3 + a] = v[a];
                }
                break;
            case TallyOf::second:
                for (int a = 0; a < D; ++a) number[a] = y[a] * y[a];
                number[3] = y[0] * y[1];
                if constexpr (D == 3) {
                    number[4] = y[0] * y[2];
                    number[5] = y[1] * y[2];
                }
                break;
            case TallyOf::spin:
                if constexpr (D == 2) {
                    number[0] = y[0] * v[1] - y[1] * v[0];
                } else {
                    number[0] = y[1] * v[2] - y[2] * v[1];
                    number[1] = y[2] * v[0] - y[0] * v[2];
                    number[2] = y[0] * v[1] - y[1] * v[0];
                }
                for (int a = 0; a < D; ++a) number[3 + a] = first[a];
                break;
            case TallyOf::turn:
                for (int a = 0; a < 2; ++a)
                    for (int b = 0; b < D; ++b) number[a * D + b] = first[a] * y[b];
                break;
            default:
                for (int b = 0; b < D; ++b) number[b] = first[D - 1] * y[b];
        }
    }

    template <class Node>
    MPM_INLINE double of_its_law(const TallyTask<D>& task, const TallyBody<T, D, Law>& body,
                                 const Standing<double, D>& stands, const std::int32_t* around,
                                 const Node& node, const StoredNumbers<T>& stored) const {
        double s[max_state_columns], rate[D][D] = {};
        for (int r = 0; r < body.columns; ++r) s[r] = stored(r);
        // Stresses of fluids have their viscosity, pressures that of what expands; solids do not
        // ask.
        if (body.volumetric && (task.of == TallyOf::stress || task.of == TallyOf::von_mises ||
                                task.of == TallyOf::pressure))
            particle_rate<X::is_device, D>(body.n, wide, stands, stored, node,
                                           HasMass<Sum>{sums, sum_channels, around}, cell_size,
                                           rate);
        const Observation<D> o = observe_particle(body, s, rate);
        switch (task.of) {
            case TallyOf::volume:
                return body.view.particle_volume * o.volume_ratio;
            case TallyOf::density:
                return body.view.particle_mass / (body.view.particle_volume * o.volume_ratio);
            case TallyOf::pressure:
                return o.pressure;
            case TallyOf::volume_ratio:
                return o.volume_ratio;
            case TallyOf::elastic_energy:
                return body.view.particle_volume * o.elastic_energy;
            case TallyOf::plastic_strain:
                return o.plastic_strain;
            case TallyOf::von_mises:
                return von_mises_of(o);
            default:
                return stress_of(o, task.part / 3, task.part % 3);
        }
    }
};

/// Leaves tallies in the rows of sensors that are due; the last one done opens the next rows.
/// On a device the lanes of a warp share the numbers of a row, and the sensors.
template <int D>
struct TakeTallies {
    const Clock* clock;
    SensorRecord* sensors;
    const TallyTask<D>* tasks;
    const std::int32_t* asking;  // sensors that have tallies
    int asking_count;

    MPM_INLINE void operator()(int number, const Tally* found, Lanes lanes = {}) const {
        const TallyTask<D>& task = tasks[number];
        const SensorRecord& r = sensors[task.sensor];
        if (!r.due) return;
        const Tally& t = *found;
        double* row = r.values + std::int64_t(r.count) * r.columns + task.row;
        for (int k = lanes.lane; k < 6; k += lanes.count) {
            to_pieces(t.sum[k], row + k * exact_pieces);
            row[TallyRow::scales + k] = task.scale[k];
        }
        for (int k = lanes.lane; k < 2; k += lanes.count) {
            row[TallyRow::ids + 2 * k] = double(t.ids[k] >> 32);
            row[TallyRow::ids + 2 * k + 1] = double(t.ids[k] & 0xffffffffu);
        }
        const double none = std::numeric_limits<double>::infinity();
        for (int c = lanes.lane; c < 3; c += lanes.count) {
            row[TallyRow::counts + c] = double(t.count[c]);
            row[TallyRow::low + c] = t.count[c] > 0 ? t.low[c] : none;
            row[TallyRow::high + c] = t.count[c] > 0 ? t.high[c] : -none;
        }
    }
    MPM_INLINE void done(Lanes lanes = {}) const {
        for (int k = lanes.lane; k < asking_count; k += lanes.count) {
            SensorRecord& r = sensors[asking[k]];
            if (!r.due) continue;
            // The step that starts now is the one whose velocities have been seen.
            open_row(r, clock->time)[r.columns - 1] = clock->dt;
        }
    }
};

}  // namespace mpm
