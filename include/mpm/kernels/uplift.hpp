// Water in the gap below what stands on a bed. Solids that touch a bed touch it at few points, and
// water between these presses up on the whole of their base (as below dams: Terzaghi, uplift). On a
// grid such a gap is thinner than any cell: no water is there, solids would stand on a dry, sealed
// base, rub with all of their weight, and never float off. So where a boundary for some bodies asks
// for it the gap is not resolved but known: pressure is that of the water beside the base, linear
// between its edges along each axis, nothing where an edge is dry.
#pragma once

#include "mpm/kernels/sampling.hpp"

namespace mpm {

/// A boundary for some bodies with water in the gap below them.
struct UpliftRecord {
    int boundary;
    double full;  // mass of a node that a body fills, kg
};
/// One word has a bit for each that a node lies above.
inline constexpr int most_uplifts = 32;

/// Part of a node that lies above a plane, whose height above the plane is given in cells: of
/// quadratic splines, ∫ N ds.
MPM_INLINE double part_above(double height) {
    const double far = absolute(height);
    const double upper = far < 0.5   ? 0.5 + (0.75 - far * far / 3) * far
                         : far < 1.5 ? 1 - (1.5 - far) * (1.5 - far) * (1.5 - far) / 6
                                     : 1;
    return height < 0 ? 1 - upper : upper;
}
/// Of a node half a cell above a bed, and the mean height of that part in cells: with s from the
/// bed, ∫ s N ds over it.
inline constexpr double above_bed = 5.0 / 6, height_above_bed = 0.65;

/// Where a node lies that a boundary may hold up: in the one row on a bed that is a base's,
/// deeper, or neither.
enum class OnBed { none, foot, inside };
/// And how high above the bed, in cells, with the bed's normal by its part against gravity.
template <int D>
struct BedPlace {
    OnBed is = OnBed::none;
    double height = 0.5;
    double normal[D] = {};

    MPM_INLINE BedPlace(OnBed here, int axis, int up) : is(here) { normal[axis] = up; }
};
/// The row of a base is that with heights in (-1/4, 3/4]: held whole by every surface that leans by
/// less than 45 degrees, and with a third of a base's mass at least.
inline constexpr double lowest_foot = -0.25;

/// Does a boundary hold a node that gravity pulls? `up` is the axis `axis` with its sign, against
/// gravity.
template <int D>
MPM_INLINE bool holds_up(const BoundaryView<D>& all, int boundary, const std::int64_t (&cell)[D],
                         int axis, int up) {
    Vec<double, D> v{};
    v[axis] = -up;
    apply_boundary<true>(all, boundary, cell, BoundAxes<D>{}, v, NothingSeen{}, false);
    return absolute(v[axis]) < 0.5;
}
/// Whether a boundary acts at a node by where it is limited to across gravity. Along gravity limits
/// say nothing of a bed: rows below its plane bear what stands on it.
template <int D>
MPM_INLINE bool acts_across(const BoundaryRecord<D>& r, double cell_size,
                            const std::int64_t (&cell)[D], int axis) {
    double x[D];
    node_position<D>(cell, cell_size, x);
    bool inside = true;
    for (int a = 0; a < D && r.limited; ++a)
        inside = inside && (a == axis || (x[a] >= r.within_lower[a] && x[a] <= r.within_upper[a]));
    return inside;
}
/// Of a surface: its plane is where the distance says, along gravity, whatever it is limited to.
template <int D>
MPM_INLINE BedPlace<D> on_surface_of(const BoundaryView<D>& all, int boundary,
                                     const std::int64_t (&cell)[D], int axis, int up) {
    const SurfaceRecord<D>& s = all.surfaces[all.records[boundary].surface - 1];
    BedPlace<D> found(OnBed::none, axis, up);
    double x[D], normal[D], distance;
    node_position<D>(cell, all.cell_size, x);
    if (!s.field.at(x, distance, normal)) return found;
    const double leans = up * normal[axis];
    found.is = distance < 0 ? OnBed::inside : OnBed::none;
    if (leans < 0.7) return found;
    found.height = distance / (leans * all.cell_size);
    for (int a = 0; a < D; ++a) found.normal[a] = normal[a] / leans;
    found.is = found.height <= lowest_foot       ? OnBed::inside
               : found.height <= lowest_foot + 1 ? OnBed::foot
                                                 : OnBed::none;
    // Two rows that are a cell apart by all digits but the last are not one base's both, or none's:
    // the upper one is if the lower one is not, worked out as for itself.
    if (absolute(found.height - (lowest_foot + 1)) < 0.01) {
        std::int64_t below[D];
        for (int a = 0; a < D; ++a) below[a] = cell[a] - (a == axis ? up : 0);
        node_position<D>(below, all.cell_size, x);
        const bool lower = s.field.at(x, distance, normal) && up * normal[axis] >= 0.7 &&
                           distance / (up * normal[axis] * all.cell_size) > lowest_foot;
        found.is = lower ? OnBed::none : OnBed::foot;
    }
    return found;
}
template <int D>
MPM_INLINE BedPlace<D> on_bed_of(const BoundaryView<D>& all, int boundary,
                                 const std::int64_t (&cell)[D], int axis, int up) {
    if (all.records[boundary].surface > 0) return on_surface_of<D>(all, boundary, cell, axis, up);
    if (!holds_up<D>(all, boundary, cell, axis, up)) return {OnBed::none, axis, up};
    std::int64_t above[D];
    for (int a = 0; a < D; ++a) above[a] = cell[a] + (a == axis ? up : 0);
    return {holds_up<D>(all, boundary, above, axis, up) ? OnBed::inside : OnBed::foot, axis, up};
}

template <int D>
struct UpliftView {
    const UpliftRecord* records;
    int count;
    const GroupPressure* pressures;  // of fluids
    int pressure_count;
    // (fields,): 1 where a field of velocities is of solids alone; null without contacts.
    const std::int32_t* solid_fields;
    std::int64_t cells[D];  // of the domain
};

/// Which records each node of the listed blocks is a foot of.
template <int D>
struct MarkFeet {
    BlockTableView<D> table;
    BoundaryView<D> boundaries;
    const std::int32_t* blocks;
    const UpliftRecord* records;
    int count;
    int axis, up;
    std::uint32_t* mask;  // (blocks, nodes)
    std::uint32_t* flag;  // the same: 1 where any

    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int32_t slot = blocks[i / block_cells];
        std::int64_t cell[D];
        table.cell(slot, int(i % block_cells), cell);
        std::uint32_t found = 0;
        for (int k = 0; k < count; ++k)
            if (acts_across<D>(boundaries.records[records[k].boundary], boundaries.cell_size, cell,
                               axis) &&
                on_bed_of<D>(boundaries, records[k].boundary, cell, axis, up).is == OnBed::foot)
                found |= std::uint32_t(1) << k;
        mask[i] = found;
        flag[i] = found != 0;
    }
};

/// Impulses of the water in the gap on one node.
template <class T, class Sum, int D>
struct NodeUplift {
    NodeUpdate<T, Sum, D> node;
    KnownNodes<D> known;  // which of them are on lines
    UpliftView<D> uplift;
    int axis, up;

    /// What stands and what flows at the nodes of a cell.
    struct Place {
        double solid = 0, water = 0;  // kg
        double full = 0;              // of a node in the midst of the water, kg
        double pressure = 0;          // mean of the water there, Pa
    };
    MPM_INLINE Place at(const std::int64_t (&cell)[D]) const {
        Place found;
        const Clock& clock = *node.clock;
        each_field_of_node<D>(node.grid.table, cell, [&](std::int32_t slot, int n) {
            const Sum* s = node.sums(slot, n);
            double all = from_sum<double>(s[0], clock.unit_read[mass_sum]);
            if (of_solids(slot)) {
                found.solid += all;
                return;
            }
            for (int k = 0; k < uplift.pressure_count; ++k) {
                const GroupPressure& g = uplift.pressures[k];
                const double mass =
                    from_sum<double>(s[g.weight * block_cells], clock.unit_read[mass_sum]);
                if (!(mass > 0)) continue;
                all -= mass;
                found.water += mass;
                found.full = g.full;
                const double j =
                    from_sum<double>(s[g.sum * block_cells], clock.unit_read[group_sum]) / mass;
                const double p = j > 0 && j < 1 ? g.at(j) : 0.0;
                if (p > found.pressure) found.pressure = p;
            }
            found.solid += all > 0 ? all : 0;
        });
        return found;
    }
    /// Of the water in a cell, on the bed of a boundary, Pa; where there is none the water's own.
    MPM_INLINE double on_bed(const std::int64_t (&cell)[D], const Place& lowest,
                             int boundary) const {
        if (!(lowest.water > 0)) return 0;
        double taken = 0;
        const OnBed where = on_bed_of<D>(node.boundaries, boundary, cell, axis, up).is;
        return where == OnBed::foot && takes_from_water(cell, boundary, taken)
                   ? taken / (area(node.boundaries.cell_size) * node.clock->dt)
                   : on_lined_bed(cell, lowest);
    }
    /// Whether nodes are held where the water meets the bed, and what that takes of the water above
    /// in this step, N s: what the bed bears. Volumes beside held nodes say nothing, since held
    /// nodes need no balance of forces, and what is in motion strains cells there as it likes
    /// (design/walls.md, 8).
    MPM_INLINE bool takes_from_water(const std::int64_t (&cell)[D], int boundary,
                                     double& taken) const {
        bool lined = false;
        const bool surface = node.boundaries.records[boundary].surface > 0;
        for (int row = surface ? -2 : -1; row < (surface ? 2 : 1); ++row) {
            std::int64_t at[D];
            for (int a = 0; a < D; ++a) at[a] = cell[a] + (a == axis ? row * up : 0);
            double normal[D] = {};
            normal[axis] = up;
            if (surface && !held_by_surface(boundary, at, normal)) continue;
            each_field_of_node<D>(node.grid.table, at, [&](std::int32_t slot, int n) {
                if (of_solids(slot)) return;
                // Along gravity, in the row of cells on the bed: lines towards other walls change
                // nothing there.
                if (row == 0 && node.touched[slot] && known.asks)
                    lined = lined || known.lines[known.place(slot, n) * D + axis] != 0;
                const Sum* s = node.sums(slot, n);
                const double mass = from_sum<double>(s[0], node.clock->unit_read[mass_sum]);
                double to_bed = 0;
                for (int a = 0; a < D; ++a)
                    to_bed -= normal[a] * (from_sum<double>(s[(1 + a) * block_cells],
                                                            node.clock->unit_read[momentum_sum]) +
                                           mass * node.clock->gravity[a] * node.clock->dt);
                taken += to_bed > 0 ? up * normal[axis] * to_bed : 0;
            });
        }
        return !lined;
    }
    /// Whether a surface holds a node up, and its normal there: a row below a thin deck is held
    /// down, by the water below it.
    MPM_INLINE bool held_by_surface(int boundary, const std::int64_t (&cell)[D],
                                    double (&normal)[D]) const {
        const BoundaryView<D>& all = node.boundaries;
        const SurfaceRecord<D>& s = all.surfaces[all.records[boundary].surface - 1];
        double x[D], distance;
        node_position<D>(cell, all.cell_size, x);
        return s.field.at(x, distance, normal) && up * normal[axis] >= 0.7 &&
               decayed(s.decay, distance / s.thickness) > 0;
    }
    /// The same between lines of linear cells, where cells are strained rightly: the mean of the
    /// second row of nodes, where water reaches that high, and the weight of what lies below it.
    MPM_INLINE double on_lined_bed(const std::int64_t (&cell)[D], const Place& lowest) const {
        std::int64_t above[D];
        for (int a = 0; a < D; ++a) above[a] = cell[a] + (a == axis ? up : 0);
        const Place second = at(above);
        const bool high = second.water > 0.5 * lowest.full;
        const Place& of = high ? second : lowest;
        const double part = of.water / ((high ? 1.0 : above_bed) * of.full);
        const double fills = part < 1 ? part : 1.0;
        const double height = high ? 0.6 + 0.9 * fills : height_above_bed * fills;
        return of.pressure + of.full * absolute(node.clock->gravity[axis]) * height /
                                 area(node.boundaries.cell_size);
    }
    MPM_INLINE bool of_solids(std::int32_t slot) const {
        const BlockTableView<D>& table = node.grid.table;
        return uplift.solid_fields && uplift.solid_fields[table.keys_of.field(table.keys[slot])];
    }
    /// Of a face of a cell, m² (m in the plane).
    MPM_INLINE static double area(double cell_size) {
        double all = 1;
        for (int a = 1; a < D; ++a) all *= cell_size;
        return all;
    }
    /// From a place on the bed to the next one along an axis: in its row, or one higher or lower
    /// where a surface leans or has a step of a cell. False where the domain ends. Where the bed
    /// ends a base has an edge, wet or dry.
    MPM_INLINE bool next_on_bed(int boundary, int along, int side, std::int64_t (&cell)[D],
                                BedPlace<D>& bed) const {
        cell[along] += side;
        if (cell[along] < 0 || cell[along] >= uplift.cells[along]) return false;
        bed = on_bed_of<D>(node.boundaries, boundary, cell, axis, up);
        if (bed.is == OnBed::foot || node.boundaries.records[boundary].surface == 0) return true;
        std::int64_t there[D];
        for (int a = 0; a < D; ++a) there[a] = cell[a];
        there[axis] += bed.is == OnBed::inside ? up : -up;
        const BedPlace<D> leans = on_bed_of<D>(node.boundaries, boundary, there, axis, up);
        if (leans.is == OnBed::foot) {
            cell[axis] = there[axis];
            bed = leans;
        }
        return true;
    }
    /// At an edge, whose first node that no base covers is given. The body fills a sixth of that
    /// one still, and weighs on the bed there: so the next one's, if water alone is at it.
    MPM_INLINE double beside_edge(const std::int64_t (&cell)[D], const Place& first, int along,
                                  int side, const UpliftRecord& r) const {
        std::int64_t next[D];
        for (int a = 0; a < D; ++a) next[a] = cell[a];
        BedPlace<D> bed(OnBed::none, axis, up);
        if (next_on_bed(r.boundary, along, side, next, bed)) {
            const Place p = at(next);
            if (p.water > 0 && p.solid < 0.025 * part_above(bed.height) * r.full)
                return on_bed(next, p, r.boundary);
        }
        return on_bed(cell, first, r.boundary);
    }
    /// Is a node inside of a box, or behind a face of a surface that nothing stands on?
    MPM_INLINE bool in_a_wall(const std::int64_t (&cell)[D]) const {
        const BoundaryView<D>& all = node.boundaries;
        double x[D], there[D], normal[D], distance;
        node_position<D>(cell, all.cell_size, x);
        bool any = false;
        for (int b = 0; b < all.count && !any; ++b) {
            const BoundaryRecord<D>& r = all.records[b];
            if (!r.active || r.share != 0 || r.law[0].response == Response::prescribed) continue;
            if (r.surface > 0) {
                const SurfaceRecord<D>& s = all.surfaces[r.surface - 1];
                s.to_body(x, there);
                any =
                    s.field.at(there, distance, normal) && distance < 0 && up * normal[axis] < 0.7;
            } else if (r.is_box) {
                any = true;
                for (int a = 0; a < D; ++a)
                    any = any && cell[a] >= r.lower[a] && cell[a] < r.upper[a];
            }
        }
        return any;
    }
    /// Below a base at this place: between its edges on both sides along each axis, Pa. Walls close
    /// a base; a quarter of a body's mass covers a node.
    MPM_INLINE double in_gap(const std::int64_t (&cell)[D], const UpliftRecord& r) const {
        double sum = 0, weight = 0;
        for (int a = 0; a < D; ++a) {
            if (a == axis) continue;
            for (int side = -1; side < 2; side += 2) {
                std::int64_t there[D];
                for (int c = 0; c < D; ++c) there[c] = cell[c];
                BedPlace<D> bed(OnBed::none, axis, up);
                for (int k = 1; next_on_bed(r.boundary, a, side, there, bed); ++k) {
                    const Place p = at(there);
                    if (p.solid > 0.25 * part_above(bed.height) * r.full) continue;
                    // Where the bed rises or a wall stands, nothing is and nothing can be.
                    if (!(p.water > 0) && (bed.is == OnBed::inside || in_a_wall(there))) break;
                    const double near = 1 / (k - 0.5);
                    sum += near * beside_edge(there, p, a, side, r);
                    weight += near;
                    break;
                }
            }
        }
        return weight > 0 ? sum / weight : 0;
    }
    /// Across the bed, of a record at a node that is a foot of it, N s.
    MPM_INLINE Vec<double, D> operator()(std::int32_t slot, int n, const UpliftRecord& r) const {
        Vec<double, D> impulse{};
        const BoundaryRecord<D>& b = node.boundaries.records[r.boundary];
        if (!b.active) return impulse;
        const double mass = node.part_of(node.sums(slot, n), b.share);
        if (!(mass > 0)) return impulse;
        std::int64_t cell[D];
        node.cell(slot, n, cell);
        const BedPlace<D> bed = on_bed_of<D>(node.boundaries, r.boundary, cell, axis, up);
        const double full = r.full * part_above(bed.height);
        const double pressed = (mass < full ? mass / full : 1.0) * in_gap(cell, r) *
                               area(node.boundaries.cell_size) * node.clock->dt;
        const bool leans = b.surface > 0 && plane_around(cell, r.boundary, bed);
        for (int a = 0; a < D; ++a) impulse[a] = pressed * (leans || a == axis ? bed.normal[a] : 0);
        return impulse;
    }
    /// Is a surface a plane for a cell around a node? Its normal turns at edges of a level bed, and
    /// would push a base over them.
    MPM_INLINE bool plane_around(const std::int64_t (&cell)[D], int boundary,
                                 const BedPlace<D>& bed) const {
        bool plane = true;
        for (int a = 0; a < D; ++a) {
            if (a == axis) continue;
            for (int side = -1; side < 2; side += 2) {
                std::int64_t there[D];
                for (int c = 0; c < D; ++c) there[c] = cell[c] + (c == a ? side : 0);
                const BedPlace<D> beside = on_bed_of<D>(node.boundaries, boundary, there, axis, up);
                const double rises = bed.height + side * bed.normal[a];
                plane = plane && absolute(beside.height - rises) < 0.05;
            }
        }
        return plane;
    }
};

/// Finds what the gaps add to the momenta of the nodes above them, and keeps these as they are and
/// with it.
template <class T, class Sum, int D>
struct FindUplift {
    NodeUplift<T, Sum, D> of;
    const std::int32_t* blocks;
    const std::int32_t* feet;   // by (listed block, node)
    const std::uint32_t* mask;  // (blocks, nodes)
    Sum *before, *with;         // (feet, D)

    MPM_INLINE void operator()(std::int64_t k) const {
        const NodeUpdate<T, Sum, D>& node = of.node;
        if (node.clock->halt != Halt::none) return;
        const std::int32_t i = feet[k];
        const std::int32_t slot = blocks[i / block_cells];
        const int n = i % block_cells;
        Vec<double, D> impulse{};
        for (int r = 0; r < of.uplift.count; ++r) {
            if (!(mask[i] >> r & 1)) continue;
            const Vec<double, D> one = of(slot, n, of.uplift.records[r]);
            for (int a = 0; a < D; ++a) impulse[a] += one[a];
        }
        for (int a = 0; a < D; ++a) {
            const Sum p = node.sums(slot, n)[(1 + a) * block_cells];
            before[k * D + a] = p;
            if constexpr (std::is_integral_v<Sum>)
                with[k * D + a] = p + Sum(rint(impulse[a] / node.clock->unit_read[momentum_sum]));
            else
                with[k * D + a] = p + Sum(impulse[a]);
        }
    }
};

/// Whether the nodes are to have what the gaps add: while no clock has halted.
struct MayLift {
    const Clock* clock;
    std::uint32_t* lifted;
    MPM_INLINE void operator()() const { *lifted = clock->halt == Halt::none; }
};
struct NotLifted {
    std::uint32_t* lifted;
    MPM_INLINE void operator()() const { *lifted = 0; }
};

/// Gives the nodes the sums with what the gaps add, or takes that away again: checkpoints keep the
/// sums without, and a reader's velocities begin with these. Nothing where they have not been
/// lifted.
template <class T, class Sum, int D>
struct SetFeet {
    GridView<T, Sum, D> grid;
    const std::int32_t* blocks;
    const std::int32_t* feet;
    const Sum* from;
    const std::uint32_t* lifted;

    MPM_INLINE void operator()(std::int64_t k) const {
        if (*lifted == 0) return;
        const std::int32_t i = feet[k];
        Sum* const s = grid.sums +
                       std::int64_t(blocks[i / block_cells]) * grid.sum_channels * block_cells +
                       i % block_cells;
        for (int a = 0; a < D; ++a) s[(1 + a) * block_cells] = from[k * D + a];
    }
};

/// What the water in a gap presses on the bed below it counts for the load cell of the boundary
/// that has the gap: the boundary itself takes that much less.
template <class T, class Sum, int D>
struct MeasureUplift {
    NodeUplift<T, Sum, D> of;
    const std::uint32_t* touched;  // (slots,): 1 + place among the listed blocks
    const std::uint32_t* mask;     // (listed blocks, nodes)
    const std::int32_t* slots;     // blocks that the boundaries of load cells touch
    const LoadCellRecord<D>* cells;
    ImpulseScales scales;

    /// Of a load cell; -1 where its boundary has no gap, or it hears nothing of the face that has.
    MPM_INLINE int record_of(int number) const {
        const LoadCellRecord<D>& cell = cells[number];
        const BoundaryRecord<D>& b = of.node.boundaries.records[cell.boundary];
        const bool top = bool(b.is_box) == (of.up > 0);  // a surface has one face
        if (b.surface == 0 && !(cell.faces >> (2 * of.axis + top) & 1)) return -1;
        for (int r = 0; r < of.uplift.count; ++r)
            if (of.uplift.records[r].boundary == cell.boundary) return r;
        return -1;
    }
    MPM_INLINE bool idle(int number) const { return record_of(number) < 0; }
    MPM_INLINE void operator()(std::int64_t i, int number, Int128* sum) const {
        if (of.node.clock->halt != Halt::none) return;
        const std::int32_t slot = slots[i / block_cells];
        const int n = int(i % block_cells), r = record_of(number);
        const std::uint32_t listed = touched[slot];
        if (r < 0 || listed == 0 || !(mask[std::int64_t(listed - 1) * block_cells + n] >> r & 1))
            return;
        const Vec<double, D> pressed = of(slot, n, of.uplift.records[r]);
        double f[D];
        for (int a = 0; a < D; ++a) f[a] = -pressed[a];
        add_load<D>(of.node, slot, n, cells[number], f, scales, sum);
    }
};

/// Adds to what a load cell has of this step.
template <int D>
struct AddToLoad {
    Int128* impulse;  // (cells, columns)
    MPM_INLINE void operator()(int number, const Int128* sum) const {
        for (int c = 0; c < load_columns<D>; ++c) impulse[number * load_columns<D> + c] += sum[c];
    }
};

}  // namespace mpm
