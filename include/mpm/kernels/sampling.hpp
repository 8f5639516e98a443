// Sensors, evaluated where the state lives and written into a ring per sensor. A sample is taken
// after the grid update of the step that starts at its time, so it sees the velocity with which
// that step moves the particles.
#pragma once

#include "mpm/core/exact.hpp"
#include "mpm/kernels/contact.hpp"
#include "mpm/kernels/reading.hpp"

namespace mpm {

/// The next row of a sensor's ring.
MPM_INLINE double* open_row(SensorRecord& r, double time) {
    double* row = r.values + std::int64_t(r.count) * r.columns;
    r.times[r.count] = time;
    ++r.count;
    return row;
}

template <int D>
inline constexpr int load_columns = D == 2 ? 3 : 6;  // forces, then moments

/// Scales of sums over nodes and steps (core/exact.hpp).
struct ImpulseScales {
    double impulse;  // N s
    double moment;   // N m s
    double work;     // J
};

template <int D>
struct LoadCellRecord {
    int sensor;  // among all sensors
    int boundary;
    int faces;  // bit mask
    double reference[D];
};

/// An impulse on the boundary of a load cell, and its moment, from one node.
template <int D, class Node>
MPM_INLINE void add_load(const Node& node, std::int32_t slot, int n, const LoadCellRecord<D>& cell,
                         const double (&f)[D], const ImpulseScales& scales, Int128* sum) {
    std::int64_t at[D];
    node.cell(slot, n, at);
    double r[D];
    for (int a = 0; a < D; ++a) {
        r[a] = (double(at[a]) + 0.5) * node.boundaries.cell_size - cell.reference[a];
        sum[a] += exact(f[a], scales.impulse);
    }
    if constexpr (D == 2) {
        sum[2] += exact(r[0] * f[1] - r[1] * f[0], scales.moment);
    } else {
        sum[3] += exact(r[1] * f[2] - r[2] * f[1], scales.moment);
        sum[4] += exact(r[2] * f[0] - r[0] * f[2], scales.moment);
        sum[5] += exact(r[0] * f[1] - r[1] * f[0], scales.moment);
    }
}

/// Momentum, and its moment, that the boundary of a load cell takes from one node in this step.
/// `contact`: in a scene with several fields of velocities.
template <class T, class Sum, int D, bool contact = false>
struct MeasureLoads {
    NodeUpdate<T, Sum, D> node;
    const std::int32_t* slots;  // blocks that the boundaries of load cells touch
    const LoadCellRecord<D>* cells;
    ImpulseScales scales;
    KnownNodes<D> known;  // where nodes beside boundaries are listed
    WallSeats<T> seats = {};
    ContactView of_contact = {};

    using Contact = NodeContact<T, Sum, D>;

    MPM_INLINE void operator()(std::int64_t i, int number, Int128* sum) const {
        if (node.clock->halt != Halt::none) return;
        const std::int32_t slot = slots[i / block_cells];
        const int n = int(i % block_cells);
        const T m = node.mass(slot, n);
        if (!(m > T(0))) return;
        const LoadCellRecord<D>& cell = cells[number];
        // Of one node in doubles, one after the other as boundaries respond: the same on any number
        // of threads and ranks. Exact sums at each response are a fifth of what this pass takes to
        // compile.
        double f[D] = {};
        const auto seen = [&](T mass, int boundary, int face, const Vec<T, D>& before,
                              const Vec<T, D>& after) {
            if (cell.boundary != boundary || !(cell.faces >> face & 1)) return;
            for (int a = 0; a < D; ++a)
                f[a] += double(mass) * (double(before[a]) - double(after[a]));
        };
        if constexpr (contact) {
            std::int32_t first, count;
            find_siblings<D>(node.grid.table, slot, of_contact.fields, first, count);
            const Contact all{node, of_contact, known};
            typename Contact::Fields fields;
            if (count > 1) all.find(first, count, n, fields);
            if (fields.count > 1 && !fields.too_many) {
                if (fields.slot[0] != slot) return;  // that one has them all
                all.solve(n, fields,
                          [&](int k, int boundary, int face, const Vec<T, D>& before,
                              const Vec<T, D>& after) {
                              seen(fields.mass[k], boundary, face, before, after);
                          });
                return add(slot, n, cell, f, sum);
            }
        }
        node.tell(slot, n, m, node.momentum(slot, n), known, seats,
                  [&](int boundary, int face, const Vec<T, D>& before, const Vec<T, D>& after) {
                      seen(m, boundary, face, before, after);
                  });
        add(slot, n, cell, f, sum);
    }
    MPM_INLINE void add(std::int32_t slot, int n, const LoadCellRecord<D>& cell,
                        const double (&f)[D], Int128* sum) const {
        add_load<D>(node, slot, n, cell, f, scales, sum);
    }
    /// Is its contact beside lines worked out here? See exec/cuda_kernels.cuh.
    MPM_INLINE bool one_by_one(std::int64_t i) const requires contact {
        const std::int32_t slot = slots[i / block_cells];
        const int n = int(i % block_cells);
        const Contact all{node, of_contact, known};
        if (!all.on_lines(slot) || !(node.mass(slot, n) > T(0))) return false;
        std::int32_t first, count;
        find_siblings<D>(node.grid.table, slot, of_contact.fields, first, count);
        for (std::int32_t k = first; k < slot; ++k)
            if (node.mass(k, n) > T(0)) return false;
        return all.meet_at(slot, first + count - slot, n);
    }
};

/// A row of means in a sensor's ring: sums in pieces, their scales, and the time that they are for.
template <int columns>
struct MeanRow {
    static constexpr int scales = columns * exact_pieces, elapsed = scales + columns,
                         size = elapsed + 1;
};

/// A sample that is due is the mean since the one before; then this step's share is added.
template <int columns, class Record>
struct TakeMean {
    const Clock* clock;
    SensorRecord* sensors;
    const Record* cells;
    Int128* impulse;  // (cells, columns)
    double scale[columns];

    MPM_INLINE void operator()(int number, const Int128* sum) const {
        Int128* of_cell = impulse + number * columns;
        SensorRecord& r = sensors[cells[number].sensor];
        if (r.due) {
            const double elapsed = clock->time - r.last_time;
            if (elapsed > 0) {  // the first sample, at the start, has nothing to average over
                double* row = open_row(r, clock->time);
                for (int c = 0; c < columns; ++c) {
                    to_pieces(of_cell[c], row + c * exact_pieces);
                    row[MeanRow<columns>::scales + c] = scale[c];
                    of_cell[c] = 0;
                }
                row[MeanRow<columns>::elapsed] = elapsed;
            }
            r.last_time = clock->time;
        }
        for (int c = 0; c < columns; ++c) of_cell[c] += sum[c];
    }
};
template <int D>
using TakeLoad = TakeMean<load_columns<D>, LoadCellRecord<D>>;

/// Force along each axis, normal, along the faces, and the power that friction takes.
template <int D>
inline constexpr int contact_columns = D + 3;

struct ContactLoadRecord {
    int sensor;              // among all sensors
    std::int32_t fields[2];  // of the only pair that counts; -1: all pairs of the contact
    std::int64_t sides;      // where its (kinds, kinds) numbers begin
};
template <int D>
using TakeContact = TakeMean<contact_columns<D>, ContactLoadRecord>;

/// What the pairs of a contact exchange at one node in this step, worked out again from its sums.
template <class T, class Sum, int D>
struct MeasureContacts {
    NodeContact<T, Sum, D> of;
    const std::int32_t* blocks;  // of those with several fields
    const ContactLoadRecord* sensors;
    // Of two fields, the lower first: 1 where the force on the second counts, -1 where that on the
    // first does, 0 where none does.
    const std::int32_t* sides;
    ImpulseScales scales;

    /// Does it have contact beside lines? See exec/cuda_kernels.cuh.
    MPM_INLINE bool one_by_one(std::int64_t i) const {
        const std::int32_t block = blocks[i / block_cells], first = of.contact.first[block];
        return of.on_lines(first) &&
               of.meet_at(first, of.contact.count[block], int(i % block_cells));
    }
    MPM_INLINE void operator()(std::int64_t i, int number, Int128* sum) const {
        const auto& node = of.node;
        if (node.clock->halt != Halt::none) return;
        const std::int32_t block = blocks[i / block_cells];
        const int n = int(i % block_cells);
        const ContactLoadRecord& sensor = sensors[number];
        typename NodeContact<T, Sum, D>::Fields f;
        of.find(of.contact.first[block], of.contact.count[block], n, f);
        if (f.count < 2 || f.too_many) return;
        const auto side = [&](int a, int b) {
            const auto field = [&](int k) {
                return std::int32_t(node.grid.table.keys_of.field(node.grid.table.keys[f.slot[k]]));
            };
            if (sensor.fields[0] >= 0 &&
                (field(a) != sensor.fields[0] || field(b) != sensor.fields[1]))
                return 0;
            return int(sides[sensor.sides + f.kind[a] * of.contact.kinds + f.kind[b]]);
        };
        bool any = false;
        for (int a = 0; a < f.count && !any; ++a)
            for (int b = a + 1; b < f.count && !any; ++b) any = side(a, b) != 0;
        if (!any) return;
        of.solve(n, f, NothingSeen{},
                 [&](int a, int b, const Vec<T, D>& impulse, const Vec<T, D>& normal,
                     const Vec<T, D>& w, T mass) {
                     const int sign = side(a, b);
                     if (sign == 0) return;
                     double push = 0, square = 0, work = 0;
                     for (int x = 0; x < D; ++x) push += double(impulse[x]) * double(normal[x]);
                     for (int x = 0; x < D; ++x) {
                         const double along = double(impulse[x]) - push * double(normal[x]);
                         square += along * along;
                         work += along * double(w[x]);
                         sum[x] += exact(sign * double(impulse[x]), scales.impulse);
                     }
                     sum[D] += exact(push, scales.impulse);
                     sum[D + 1] += exact(sqrt(square), scales.impulse);
                     // At the velocity that is left, with which particles move: what the impulse
                     // takes beyond that stresses have brought in the same step.
                     sum[D + 2] += exact(work - square / double(mass), scales.work);
                 });
    }
};

/// Where a wave gauge or a velocity probe is.
template <int D>
struct PointRecord {
    int sensor;       // among all sensors
    int axis;         // of a gauge: vertical; -1: a velocity probe
    int channel = 0;  // of a gauge, among the sums: mass of all, or of one body
    double full = 1;  // mass of a full node, kg
    double position[D];
};

/// Workers that do one thing together: on a device the lanes of a warp, all of them or one.
struct Lanes {
    int lane = 0, count = 1;

    /// The first lane of which something is true; -1 where there is none.
    MPM_INLINE int first(bool here) const {
#if defined(__CUDA_ARCH__)
        if (count > 1) return __ffs(int(__ballot_sync(~0u, here))) - 1;
#endif
        return here ? 0 : -1;
    }
    /// What a lane has.
    MPM_INLINE double of(double here, [[maybe_unused]] int which) const {
#if defined(__CUDA_ARCH__)
        if (count > 1) return __shfl_sync(~0u, here, which);
#endif
        return here;
    }
};

/// Free surface above a point: where the nodes' fill falls through one half, from above,
/// interpolated linearly along the vertical and between the columns of nodes around the point.
/// Not-a-number where the column is dry. Lanes look at a node of a column each.
template <class T, class Sum, int D>
struct SampleGauge {
    const NodeUpdate<T, Sum, D>& node;
    const PointRecord<D>& point;
    double cell_size;
    const std::int64_t (&cells)[D];
    Lanes lanes;

    MPM_INLINE double fill(std::int64_t (&c)[D]) const {
        double mass = 0;
        each_field_of_node<D>(node.grid.table, c, [&](std::int32_t slot, int number) {
            mass += from_sum<double>(node.sums(slot, number)[point.channel * block_cells],
                                     node.clock->unit_read[mass_sum]);
        });
        return mass / point.full;
    }
    MPM_INLINE double surface(std::int64_t (&c)[D]) const {
        double above = 0;
        for (std::int64_t top = cells[point.axis] - 1; top >= 0; top -= lanes.count) {
            c[point.axis] = top - lanes.lane;
            const double own = c[point.axis] >= 0 ? fill(c) : 0;
            const int at = lanes.first(own >= 0.5);
            if (at >= 0) {
                const double here = lanes.of(own, at);
                if (at > 0) above = lanes.of(own, at - 1);
                return (double(top - at) + 0.5 + (here - 0.5) / (here - above)) * cell_size;
            }
            above = lanes.of(own, lanes.count - 1);
        }
        return nan("");
    }
    MPM_INLINE void operator()(double* row) const {
        const int axis = point.axis;
        double sum = 0, total = 0;
        for (int corner = 0; corner < (1 << D); ++corner) {
            if (corner >> axis & 1) continue;
            double weight = 1;
            std::int64_t c[D];
            for (int a = 0; a < D; ++a) {
                if (a == axis) continue;
                const double s = point.position[a] / cell_size - 0.5;
                const std::int64_t low = std::int64_t(floor(s));
                const int up = corner >> a & 1;
                weight *= up ? s - double(low) : 1 - (s - double(low));
                c[a] = low + up;
                if (c[a] < 0) c[a] = 0;
                if (c[a] >= cells[a]) c[a] = cells[a] - 1;
            }
            const double z = surface(c);
            if (z == z) {
                sum += weight * z;
                total += weight;
            }
        }
        row[0] = total > 0 ? sum / total : nan("");
    }
};

/// Gauges and probes that are due, a warp each on devices.
template <class T, class Sum, int D>
struct SamplePoints {
    NodeUpdate<T, Sum, D> node;
    SensorRecord* sensors;
    const PointRecord<D>* points;
    double cell_size;
    std::int64_t cells[D];
    KernelChoice kernel;  // what a probe sees of the scene's functions (`functions_of_point`)
    bool wide;            // they reach five nodes along an axis

    MPM_INLINE void operator()(std::int64_t k, Lanes lanes = {}) const {
        SensorRecord& r = sensors[points[k].sensor];
        if (!r.due) return;
        double found[D];
        sample(points[k], found, lanes);
        if (lanes.lane != 0) return;
        double* row = open_row(r, node.clock->time);
        for (int c = 0; c < r.columns; ++c) row[c] = found[c];
    }
    MPM_CALL void sample(const PointRecord<D>& point, double* row, Lanes lanes = Lanes()) const {
        const Reconverge at_return;
        if (point.axis >= 0) {
            SampleGauge<T, Sum, D>{node, point, cell_size, cells, lanes}(row);
            return;
        }
        double at[D], v[D];
        for (int a = 0; a < D; ++a) at[a] = point.position[a] / cell_size;
        T together[D];
        const auto moving = [&](std::int64_t(&c)[D]) -> const T* {
            if (node.grid.table.keys_of.fields != 1)
                return mean_of_fields(c, together) ? together : nullptr;
            int number = 0;
            const std::int32_t slot = find_node<D>(node.grid.table, c, number);
            if (slot < 0 || !(node.mass(slot, number) > T(0))) return nullptr;
            return node.grid.velocity + node.grid.velocity_place(slot, number);
        };
        const bool wet = wide ? point_velocity<5>(kernel, at, moving, v)
                              : point_velocity<3>(kernel, at, moving, v);
        for (int a = 0; a < D; ++a) row[a] = wet ? v[a] : nan("");
    }
    /// Mean velocity of all fields at a node, by their mass; false where none has any.
    MPM_INLINE bool mean_of_fields(const std::int64_t (&c)[D], T (&v)[D]) const {
        T mass = 0;
        for (int a = 0; a < D; ++a) v[a] = 0;
        each_field_of_node<D>(node.grid.table, c, [&](std::int32_t slot, int number) {
            const T m = node.mass(slot, number);
            if (!(m > T(0))) return;
            const T* u = node.grid.velocity + node.grid.velocity_place(slot, number);
            mass += m;
            for (int a = 0; a < D; ++a) v[a] += m * u[a];
        });
        for (int a = 0; a < D && mass > T(0); ++a) v[a] /= mass;
        return mass > T(0);
    }
};

/// Opens the row that `TrackParticles` fills; particles that have been removed read not-a-number.
struct OpenTrack {
    const Clock* clock;
    SensorRecord* sensor;
    MPM_HD void operator()() const {
        SensorRecord& r = *sensor;
        if (!r.due) return;
        double* row = open_row(r, clock->time);
        for (int c = 0; c < r.columns; ++c) row[c] = nan("");
    }
};

/// Positions and velocities of chosen particles, the latter as every reader has them.
template <class G, class T, int D, bool device>
struct TrackParticles {
    BlockTableView<D> table;
    const G* nodes;
    int channels;
    PhaseNumbers n;
    bool wide;  // the kernel reaches five nodes
    SensorRecord* sensor;
    BodyView<T, D> body;
    const std::uint32_t* ids;  // ascending
    const std::int32_t* column;
    int count;
    double cell_size;

    MPM_INLINE void operator()(std::int64_t h) const {
        const SensorRecord& r = *sensor;
        if (!r.due) return;
        double* row = r.values + std::int64_t(r.count - 1) * r.columns;
        const std::int32_t slot = body.home[h];
        const std::int32_t* corner = table.corners + std::int64_t(slot) * D;
        const std::int32_t* around = table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
        const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
        HomeCells homes{start, body.cell};
        for (std::uint32_t q = start[0]; q < start[block_cells]; ++q) {
            int low = 0, high = count;
            while (low < high) {
                const int middle = (low + high) / 2;
                if (ids[middle] < body.id[q])
                    low = middle + 1;
                else
                    high = middle;
            }
            if (low == count || ids[low] != body.id[q]) continue;
            int home[D];
            Block<D>::coordinates(homes.of(q), home);
            double v[D];
            double* out = row + column[low] * 2 * D;
            Vec<double, D> offset;
            for (int a = 0; a < D; ++a) {
                offset[a] = double(body.offset[a][q]);
                out[a] = (double(corner[a] + home[a]) + 0.5 + offset[a]) * cell_size;
            }
            Standing<double, D> at;
            at.find(corner, home, offset);
            particle_velocity<device, D>(n, wide, at, StoredNumbers<T>{body.state, q},
                                         NodesAround<G>{nodes, channels, around}, v);
            for (int a = 0; a < D; ++a) out[D + a] = v[a];
        }
    }
};

/// Beside a sum that has nothing beside it.
struct Nothing {
    MPM_INLINE void operator()(std::int64_t, Lanes = {}) const {}
};

/// The parts that the bodies' energy passes left: (n, 3) kinetic, elastic, potential.
struct AddEnergies {
    const SensorRecord* sensor;
    const double* partial;
    MPM_INLINE void operator()(std::int64_t i, int /*set*/, double* sum) const {
        if (!sensor->due) return;
        for (int e = 0; e < 3; ++e) sum[e] += partial[3 * i + e];
    }
};

/// A row of sums of energy. `first` keeps the total of the first sample.
struct TakeEnergy {
    const Clock* clock;
    SensorRecord* sensor;
    double* first;  // total at the first sample, or not-a-number
    MPM_INLINE void operator()(int /*set*/, const double* sum) const {
        SensorRecord& r = *sensor;
        if (!r.due) return;
        const double total = sum[0] + sum[1] + sum[2];
        if (!(*first == *first)) *first = total;
        double* row = open_row(r, clock->time);
        for (int e = 0; e < 3; ++e) row[e] = sum[e];
        row[3] = *first - total;
    }
};

}  // namespace mpm
