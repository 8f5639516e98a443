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
/// How a node stands beside the surface of a boundary at rest.
template <int D>
struct SurfacePlace {
    double normal[D] = {};
    double distance = 0;  // m
    double leans = -1;    // part of the normal against gravity; -1 where nothing is known

    MPM_INLINE SurfacePlace(const BoundaryView<D>& all, const SurfaceRecord<D>& s,
                            const std::int64_t (&cell)[D], int axis, int up) {
        double x[D];
        node_position<D>(cell, all.cell_size, x);
        if (s.field.at(x, distance, normal))
            leans = up * normal[axis];
        else
            distance = 0;
    }
    /// Less than 45 degrees.
    MPM_INLINE bool bears() const { return leans >= 0.7; }
    MPM_INLINE double height(double cell_size) const { return distance / (leans * cell_size); }
};
/// Of a surface: its plane is where the distance says, along gravity, whatever it is limited to.
template <int D>
MPM_INLINE BedPlace<D> on_surface_of(const BoundaryView<D>& all, int boundary,
                                     const std::int64_t (&cell)[D], int axis, int up) {
    const SurfaceRecord<D>& s = all.surfaces[all.records[boundary].surface - 1];
    const SurfacePlace<D> here(all, s, cell, axis, up);
    BedPlace<D> found(here.distance < 0 ? OnBed::inside : OnBed::none, axis, up);
    if (!here.bears()) return found;
    found.height = here.height(all.cell_size);
    for (int a = 0; a < D; ++a) found.normal[a] = here.normal[a] / here.leans;
    found.is = found.height <= lowest_foot       ? OnBed::inside
               : found.height <= lowest_foot + 1 ? OnBed::foot
                                                 : OnBed::none;
    // Two rows that are a cell apart by all digits but the last are not one base's both, or none's:
    // the upper one is if the lower one is not, worked out as for itself.
    if (absolute(found.height - (lowest_foot + 1)) < 0.01) {
        std::int64_t below[D];
        moved_along<D>(cell, axis, -up, below);
        const SurfacePlace<D> lower(all, s, below, axis, up);
        found.is =
            lower.bears() && lower.height(all.cell_size) > lowest_foot ? OnBed::none : OnBed::foot;
    }
    return found;
}
template <int D>
MPM_INLINE BedPlace<D> on_bed_of(const BoundaryView<D>& all, int boundary,
                                 const std::int64_t (&cell)[D], int axis, int up) {
    if (all.records[boundary].surface > 0) return on_surface_of<D>(all, boundary, cell, axis, up);
    if (!holds_up<D>(all, boundary, cell, axis, up)) return {OnBed::none, axis, up};
    std::int64_t above[D];
    moved_along<D>(cell, axis, up, above);
    return {holds_up<D>(all, boundary, above, axis, up) ? OnBed::inside : OnBed::foot, axis, up};
}

template <int D>
struct UpliftView {
    const UpliftRecord* records;
    int count;
    const GroupPressure* pressures;  // of fluids
    int pressure_count;
    // (fields,): as `BoundaryView` has them; null without contacts.
    const std::int32_t* solid_fields;
    double meets;           // part of a node that solids and fluids fill where contact begins
    std::int64_t cells[D];  // of the domain
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
        each_held_row(cell, boundary,
                      [&](int row, std::int32_t slot, int n, const double(&normal)[D]) {
                          if (of_solids(slot)) return;
                          // Along gravity, in the row of cells on the bed: lines towards other
                          // walls change nothing there.
                          if (row == 0 && node.touched[slot] && known.asks)
                              lined = lined || known.lines[known.place(slot, n) * D + axis] != 0;
                          const double to_bed = presses(slot, n, normal);
                          taken += to_bed > 0 ? up * normal[axis] * to_bed : 0;
                      });
        return !lined;
    }
    /// f(row, slot, node, normal) of all fields' nodes by which a bed bears what is above a place
    /// on it, whose own row is 0.
    template <class F>
    MPM_INLINE void each_held_row(const std::int64_t (&cell)[D], int boundary, const F& f) const {
        const bool surface = node.boundaries.records[boundary].surface > 0;
        for (int row = surface ? -2 : -1; row < (surface ? 2 : 1); ++row) {
            std::int64_t at[D];
            moved_along<D>(cell, axis, row * up, at);
            double normal[D] = {};
            normal[axis] = up;
            if (surface && !held_by_surface(boundary, at, normal)) continue;
            each_field_of_node<D>(node.grid.table, at,
                                  [&](std::int32_t slot, int n) { f(row, slot, n, normal); });
        }
    }
    /// What a node would press against a normal in this step, N s.
    MPM_INLINE double presses(std::int32_t slot, int n, const double (&normal)[D]) const {
        const Sum* s = node.sums(slot, n);
        const double mass = from_sum<double>(s[0], node.clock->unit_read[mass_sum]);
        double all = 0;
        for (int a = 0; a < D; ++a)
            all -= normal[a] * (from_sum<double>(s[(1 + a) * block_cells],
                                                 node.clock->unit_read[momentum_sum]) +
                                mass * node.clock->gravity[a] * node.clock->dt);
        return all;
    }
    /// Whether a surface holds a node up, and its normal there: a row below a thin deck is held
    /// down, by the water below it.
    MPM_INLINE bool held_by_surface(int boundary, const std::int64_t (&cell)[D],
                                    double (&normal)[D]) const {
        const BoundaryView<D>& all = node.boundaries;
        const SurfaceRecord<D>& s = all.surfaces[all.records[boundary].surface - 1];
        const SurfacePlace<D> place(all, s, cell, axis, up);
        for (int a = 0; a < D; ++a) normal[a] = place.normal[a];
        return place.bears() && decayed(s.decay, place.distance / s.thickness) > 0;
    }
    /// The same between lines of linear cells, where cells are strained rightly: the mean of the
    /// second row of nodes, where water reaches that high, and the weight of what lies below it.
    MPM_INLINE double on_lined_bed(const std::int64_t (&cell)[D], const Place& lowest) const {
        std::int64_t above[D];
        moved_along<D>(cell, axis, up, above);
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
            if (p.water > 0 && p.solid < 0.025 * filled_at(bed.height) * r.full)
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
                    if (covers(p, there, bed, r)) continue;
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
    /// Of a record at a node that is a foot of it. A base over a part `covered` of the bed, δ off
    /// it, is lifted by covered (1 - wet) (p - ρ g δ).
    struct Gap {
        double mass = 0;        // of what may be lifted, kg
        double covered = 0;     // by which it lifts
        double solid = 1;       // its part of all solids there
        double free = 0;        // part of the bed that nothing but water covers
        double filled = 0;      // part of it with water in the gap above
        double pressed = 0;     // by water on all of the bed there, of its part along gravity, N s
        double lifting = 0;     // likewise on the base by the gap, if that covered all
        double normal[D] = {};  // of the bed, by its part against gravity
        MPM_INLINE double lifts(int a) const { return covered * lifting * normal[a]; }
    };
    MPM_INLINE Gap gap(std::int32_t slot, int n, const UpliftRecord& r) const {
        Gap found;
        const BoundaryRecord<D>& b = node.boundaries.records[r.boundary];
        if (!b.active) return found;
        found.mass = node.part_of(node.sums(slot, n), b.share);
        if (!(found.mass > 0)) return found;
        std::int64_t cell[D];
        node.cell(slot, n, cell);
        const BedPlace<D> bed = on_bed_of<D>(node.boundaries, r.boundary, cell, axis, up);
        const Place there = at(cell);
        found.pressed = in_gap(cell, r) * area(node.boundaries.cell_size) * node.clock->dt;
        // A base that has come off the bed has less mass here, and as much as before in the row
        // above, of a body that is two cells high: so high it is, and so much thicker is the gap.
        const double whole = filled_at(bed.height), foot = found.mass / r.full, own = foot / whole,
                     above = mass_above(slot, cell, b.share) / r.full;
        double wide = own, off = 0, left = whole;
        for (int k = 0; k < 3; ++k) {
            const double next = above / filled_at(bed.height + 1 - off);
            wide = next > own ? (next < 1 ? next : 1.0) : (own < 1 ? own : 1.0);
            left = foot / wide < whole ? foot / wide : whole;
            off = bed.height - depth_of(left);
            if (!(off > 0)) off = 0;
        }
        // What little mass is left here is pushed with at most so many times its part of what was:
        // twice where it has the water's velocity, or it threw the water.
        const double most = (uplift.solid_fields ? 4 : 2) * own;
        found.covered = wide < most ? wide : most;
        if (there.solid > found.mass) found.solid = found.mass / there.solid;
        const double others = there.solid > found.mass ? (there.solid - found.mass) / r.full : 0;
        if (there.water > 0) found.free = 1 - wide - others / whole;
        if (!(found.free > 0)) found.free = 0;
        // Water that has come into the gap carries the base: of a sixth of a cell on, since beside
        // a base nothing tells it from what stands higher.
        const double water_full = there.full > 0 ? there.full : uplift.pressures[0].full,
                     opened = whole - left;
        double wet = 0;
        if (opened > 0.1) {
            wet = (there.water / water_full - found.free * whole) / (wide * opened);
            wet = wet > 0 ? (wet < 1 ? wet : 1.0) * (opened < 0.3 ? (opened - 0.1) / 0.2 : 1.0) : 0;
            if (uplift.solid_fields)
                wet *= pushes((there.solid / r.full + there.water / water_full) / whole);
        }
        found.filled = wide * wet;
        const double weight =
            water_full * absolute(node.clock->gravity[axis]) * node.clock->dt * off;
        found.lifting = found.pressed > weight ? (1 - wet) * (found.pressed - weight) : 0;
        const bool leans = b.surface > 0 && plane_around(cell, r.boundary, bed);
        for (int a = 0; a < D; ++a) found.normal[a] = leans || a == axis ? bed.normal[a] : 0;
        return found;
    }
    /// Does water beside contacts carry a base? Once both fill enough of what is above the bed of
    /// the node to push each other half a cell above it.
    MPM_INLINE double pushes(double filled) const {
        const double part = (filled - uplift.meets / above_bed) / 0.12;
        return part > 0 ? (part < 1 ? part : 1.0) : 0;
    }
    /// Of some channels of a node's field, in the row above it, kg.
    MPM_INLINE double mass_above(std::int32_t slot, const std::int64_t (&cell)[D],
                                 std::uint64_t channels) const {
        const BlockTableView<D>& table = node.grid.table;
        std::int64_t above[D];
        moved_along<D>(cell, axis, up, above);
        double mass = 0;
        each_field_of_node<D>(table, above, [&](std::int32_t s, int n) {
            if (table.keys_of.field(table.keys[s]) == table.keys_of.field(table.keys[slot]))
                mass = node.part_of(node.sums(s, n), channels);
        });
        return mass;
    }
    /// Does a base cover a place? One that has come off by a cell still does, with what it has in
    /// the row above.
    MPM_INLINE bool covers(const Place& p, const std::int64_t (&cell)[D], const BedPlace<D>& bed,
                           const UpliftRecord& r) const {
        const double least = 0.25 * r.full;
        if (p.solid > least * filled_at(bed.height)) return true;
        if (!(p.solid > 0)) return false;
        std::int64_t above[D];
        moved_along<D>(cell, axis, up, above);
        return at(above).solid > least;
    }
    /// What the gap lifts there, across the bed, N s.
    MPM_INLINE Vec<double, D> operator()(std::int32_t slot, int n, const UpliftRecord& r) const {
        const Gap of = gap(slot, n, r);
        Vec<double, D> impulse{};
        for (int a = 0; a < D; ++a) impulse[a] = of.lifts(a);
        return impulse;
    }
    /// The part that solids rub with of what the rows below a base press on the bed, which lifts it
    /// by `lifted` at its foot. By their part of the mass they would rub with what water beside an
    /// edge presses at nodes of both, and not with all of their own (design/walls.md, 8). `Gap` of
    /// the record.
    MPM_INLINE double rubbing_part(const std::int64_t (&cell)[D], const UpliftRecord& r,
                                   const Gap& of, const Vec<double, D>& lifted) const {
        double all = 0, steep = 0;
        each_held_row(cell, r.boundary,
                      [&](int row, std::int32_t slot, int n, const double(&normal)[D]) {
                          double to_bed = presses(slot, n, normal);
                          for (int a = 0; a < D && row == 0; ++a) to_bed -= normal[a] * lifted[a];
                          all += to_bed > 0 ? to_bed : 0;
                      });
        if (!(all > 0)) return 0;
        for (int a = 0; a < D; ++a) steep += of.normal[a] * of.normal[a];
        // How high the water stands beside the base is in what it presses.
        const double of_water = (of.free + of.filled) * of.pressed * sqrt(steep);
        return of_water < all ? of.solid * (1 - of_water / all) : 0;
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

}  // namespace mpm
