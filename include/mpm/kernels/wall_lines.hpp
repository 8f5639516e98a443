// Walls that strain the cells beside them rightly: along a grid line towards a wall the velocity
// across it is linear and meets that of the wall in the plane of the wall. Derivation, measurements
// and what was tried: design/walls.md, 7.
//
// Nodes of a line by their place: 1, 0 and -1, at 3/2, 1/2 and -1/2 cells from the plane. The first
// leads the others,
//
//   v_i . n - w = T_i u,   T = 1, 1/3, -1/3,
//
// and u is the field of this kind that is nearest to what each node would do by itself, v*, in the
// metric of the masses: forces on a node that is led act on its leader (virtual work),
//
//   u = sum T_i m_i (v*_i . n - w) / sum T_i^2 m_i,    I = sum m_i (v_i - v*_i) . n,
//
// with I the impulse of the wall on the line. In gaps of two and three cells, where two such lines
// would overlap, node 0 leads node -1 alone, T = 1, -1; in a gap or a box of one cell nodes are
// held.
#pragma once

#include "mpm/kernels/surface_lines.hpp"

namespace mpm {

/// Integral over the line of the quadratic spline about 0, up to x cells.
MPM_INLINE double spline_up_to(double x) {
    if (x <= -1.5) return 0;
    if (x >= 1.5) return 1;
    if (x < -0.5) return (x + 1.5) * (x + 1.5) * (x + 1.5) / 6;
    if (x > 0.5) return 1 - (1.5 - x) * (1.5 - x) * (1.5 - x) / 6;
    return 0.5 + x * (0.75 - x * x / 3);
}

/// The line towards a wall across one axis on which a node is.
struct WallLine {
    enum Form { none, held, pair, linear };
    Form form = none;
    int boundary = 0, face = 0;
    int sign = 1;   // of the normal, which points into the material
    int place = 0;  // of the node

    MPM_INLINE int first() const { return form == linear ? 1 : 0; }
    template <class T>
    MPM_INLINE T share(int at) const {
        if (at == first()) return 1;
        return T(at == 0 ? 1 : -1) / T(form == linear ? 3 : 1);
    }
};

/// A face across an axis: its plane is the lower side of cell `plane`.
template <int D>
struct WallPlane {
    std::int64_t plane;
    int sign;
    MPM_INLINE WallPlane(const BoundaryRecord<D>& r, int face)
        : plane(face % 2 == 0 ? r.lower[face / 2] : r.upper[face / 2]),
          sign((face % 2 == 0) != bool(r.is_box) ? 1 : -1) {}
    /// Of a node, as `WallLine::place`.
    MPM_INLINE std::int64_t place(std::int64_t cell) const {
        return sign > 0 ? cell - plane : plane - 1 - cell;
    }
};

/// Is a node on the rows of a face: those that end in it?
template <int D>
MPM_INLINE bool on_rows(const BoundaryRecord<D>& r, int axis, const std::int64_t (&cell)[D]) {
    for (int t = 0; t < D && r.is_box; ++t)
        if (t != axis && (cell[t] < r.rows_lower[t] || cell[t] >= r.rows_upper[t])) return false;
    return true;
}

/// Is a node too far from a box for its faces and edges?
template <int D>
MPM_INLINE bool far_from(const BoundaryRecord<D>& r, const std::int64_t (&cell)[D]) {
    bool far = false;
    for (int a = 0; a < D; ++a) far = far || cell[a] < r.lower[a] - 2 || cell[a] > r.upper[a] + 1;
    return r.is_box && far;
}

/// Cells of room before a plane on the row of a node, up to 4.
template <int D>
MPM_INLINE int room_before(const BoundaryView<D>& all, const WallPlane<D>& wall, int axis,
                           const std::int64_t (&cell)[D]) {
    std::int64_t least = 4;
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active || r.surface > 0) continue;
        for (int f = 2 * axis; f < 2 * axis + 2; ++f) {
            if (!r.present[f] || !r.law[f].linear) continue;
            const WallPlane<D> other(r, f);
            if (other.sign == wall.sign || !on_rows(r, axis, cell)) continue;
            const std::int64_t room =
                wall.sign > 0 ? other.plane - wall.plane : wall.plane - other.plane;
            if (room > 0 && room < least) least = room;
        }
    }
    return int(least);
}

/// Does a node stand right before a face across an axis whose normal has this sign?
template <int D>
MPM_CALL bool before_face(const BoundaryView<D>& all, const std::int64_t (&cell)[D], int axis,
                          int sign) {
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active || r.surface > 0 || far_from(r, cell)) continue;
        for (int f = 2 * axis; f < 2 * axis + 2; ++f) {
            if (!r.present[f] || !r.law[f].linear) continue;
            const WallPlane<D> wall(r, f);
            if (wall.sign == sign && wall.place(cell[axis]) == 0 && on_rows(r, axis, cell))
                return true;
        }
    }
    return false;
}

/// Distance of the nearest linear surface that faces a wall, from the node right before the wall,
/// in cells up to 4. `cell` is on the wall's line, at `place`.
template <int D>
MPM_INLINE double surface_before(const BoundaryView<D>& all, const WallPlane<D>& wall, int axis,
                                 const std::int64_t (&cell)[D], std::int64_t place) {
    double least = 4;
    for (int b = 0; b < all.count && all.surface_lines; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active || r.surface == 0 || !r.law[0].linear) continue;
        std::int64_t there[D];
        moved_along<D>(cell, axis, -place * wall.sign, there);
        const SurfaceView<D> seen(all, all.surfaces[r.surface - 1], there);
        if (seen.known && seen.axis == axis && seen.away == -wall.sign && seen.distance > 0 &&
            seen.distance < least)
            least = seen.distance;
    }
    return least;
}

/// Does a wall across an axis lie inside a body whose surface faces the same way? Then nothing is
/// before it on this row; its lines would take the nodes of those towards the surface. Of `cell`, a
/// node at `place`.
template <int D>
MPM_INLINE bool inside_surface(const BoundaryView<D>& all, const WallPlane<D>& wall, int axis,
                               const std::int64_t (&cell)[D], std::int64_t place) {
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active || r.surface == 0 || r.share != 0 || r.limited ||
            r.law[0].response == Response::prescribed)
            continue;
        std::int64_t there[D];
        moved_along<D>(cell, axis, -place * wall.sign, there);
        const SurfaceView<D> seen(all, all.surfaces[r.surface - 1], there);
        // The node right before the wall stands half a cell off it; what lies on it changes
        // nothing.
        if (seen.known && (seen.axis < 0 || (seen.axis == axis && seen.away == wall.sign)) &&
            seen.distance < 0.45)
            return true;
    }
    return false;
}

/// The line on which a node is across an axis. Where two claim it, the first that is defined does.
template <int D>
MPM_CALL WallLine find_line(const BoundaryView<D>& all, int axis, const std::int64_t (&cell)[D]) {
    WallLine line;
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active || r.surface > 0 || far_from(r, cell)) continue;
        for (int f = 2 * axis; f < 2 * axis + 2; ++f) {
            if (!r.present[f] || !r.law[f].linear) continue;
            const WallPlane<D> wall(r, f);
            const std::int64_t place = wall.place(cell[axis]);
            if (place < -1 || place > 1 || !on_rows(r, axis, cell)) continue;
            if (inside_surface(all, wall, axis, cell, place)) continue;
            int room = room_before(all, wall, axis, cell);
            const double surface = surface_before(all, wall, axis, cell, place);
            if (surface < 3.5 && room > 3) room = 3;
            if (surface < 1.5) room = 1;
            line.boundary = b;
            line.face = f;
            line.sign = wall.sign;
            line.place = int(place);
            const bool thin = r.is_box && r.upper[axis] - r.lower[axis] < 2;
            line.form = room < 2 || thin ? WallLine::held
                        : room < 4       ? WallLine::pair
                                         : WallLine::linear;
            if (place <= (line.form == WallLine::linear ? 1 : 0)) return line;
            line.form = WallLine::none;
        }
    }
    return line;
}

/// Rows beside the edge of a box do not vanish on the last half cell of its faces, and no node is
/// held there. What even pressure does to such a node is what the face gives back: the integral of
/// the node's spline over the face. f(boundary, face, axis, area with the sign of the normal), the
/// area in faces of a cell.
template <int D, class F>
MPM_INLINE void each_edge(const BoundaryView<D>& all, const std::int64_t (&cell)[D], const F& f) {
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active || !r.is_box || r.surface > 0 || far_from(r, cell)) continue;
        for (int face = 0; face < 2 * D; ++face) {
            const int axis = face / 2;
            if (!r.present[face] || !r.law[face].linear || on_rows(r, axis, cell)) continue;
            if (r.upper[axis] - r.lower[axis] < 2) continue;
            const WallPlane<D> wall(r, face);
            const std::int64_t place = wall.place(cell[axis]);
            if (place != 0 && place != -1) continue;
            double area = 0.5;
            for (int t = 0; t < D; ++t) {
                if (t == axis) continue;
                const double at = double(cell[t]) + 0.5;
                area *= spline_up_to(double(r.face_upper[t]) - at) -
                        spline_up_to(double(r.face_lower[t]) - at);
            }
            if (!(area > 0)) continue;
            // Another box that goes on where this one ends holds the row, or fills it.
            if (find_line<D>(all, axis, cell).form != WallLine::none) continue;
            f(b, face, axis, area * wall.sign);
        }
    }
}

/// Pressure that the grid knows of a group of bodies: of their averaged volume loss.
struct GroupPressure {
    int sum, weight;  // channels
    double stiffness, exponent;
    double full;  // mass of a full node, kg

    MPM_INLINE double at(double j) const { return stiffness * (exp(-exponent * log1p(-j)) - 1); }
};

/// What the lines leave of one node's velocity. `Node` is a `NodeUpdate`.
template <class Node, class T, int D>
struct FollowLines {
    const Node& node;

    struct Seat {
        T mass = 0;
        Vec<T, D> velocity{};  // of the node by itself
    };
    /// Sums over the nodes of a line, velocities relative to the wall.
    struct Sums {
        T leader = 0;           // mass
        T mass = 0, led = 0;    // sum of m, of T m
        T push = 0, inert = 0;  // sum of T m v, of T^2 m
        Vec<T, D> momentum{};
        MPM_INLINE T lead() const { return push / inert; }
    };
    struct Wall {
        const SurfaceLaw& law;
        Vec<T, D> velocity;
    };

    MPM_INLINE Wall wall(const WallLine& line) const {
        const BoundaryRecord<D>& r = node.boundaries.records[line.boundary];
        Wall out{r.law[line.face], {}};
        for (int a = 0; a < D; ++a) out.velocity[a] = T(r.velocity[a]);
        return out;
    }
    /// What a node would do by itself, edges of boxes included.
    MPM_CALL Seat seat(std::int32_t slot, int number, const std::int64_t (&cell)[D]) const {
        Seat out;
        out.mass = node.mass(slot, number);
        if (!(out.mass > T(0))) return out;
        out.velocity = node.free_velocity(out.mass, node.momentum(slot, number));
        push_at_edges(slot, number, cell, out.mass, out.velocity, NothingSeen{});
        return out;
    }
    template <class Seen>
    MPM_INLINE void push_at_edges(std::int32_t slot, int number, const std::int64_t (&cell)[D],
                                  T mass, Vec<T, D>& v, const Seen& seen) const {
        if (node.pressure_count == 0) return;
        each_edge<D>(node.boundaries, cell, [&](int b, int face, int axis, double area) {
            double size = node.pressure(slot, number) * node.clock->dt * area;
            for (int a = 1; a < D; ++a) size *= node.boundaries.cell_size;
            const Vec<T, D> before = v;
            v[axis] += T(size / double(mass));
            seen(b, face, before, v);
        });
    }
    /// In the same order from wherever on the line, so that all its nodes find the same numbers.
    MPM_CALL Sums sum(const WallLine& line, int axis, const std::int64_t (&cell)[D],
                      const Seat& own, const Vec<T, D>& moving) const {
        Sums out;
        for (int at = line.first(); at >= -1; --at) {
            Seat s = own;
            if (at != line.place) {
                std::int64_t there[D];
                for (int a = 0; a < D; ++a)
                    there[a] = cell[a] + (a == axis ? (at - line.place) * line.sign : 0);
                int number = 0;
                const std::int32_t slot = find_node<D>(node.grid.table, there, number);
                s = slot < 0 ? Seat{} : seat(slot, number, there);
            }
            if (at == line.first()) out.leader = s.mass;
            const T t = line.template share<T>(at);
            out.mass += s.mass;
            out.led += t * s.mass;
            out.inert += t * t * s.mass;
            out.push += t * s.mass * (s.velocity[axis] - moving[axis]);
            for (int a = 0; a < D; ++a) out.momentum[a] += s.mass * (s.velocity[a] - moving[a]);
        }
        return out;
    }
    /// `v` is the node's velocity by itself.
    template <class Seen>
    MPM_CALL void operator()(std::int32_t slot, int number, const std::int64_t (&cell)[D], T mass,
                             Vec<T, D>& v, const Seen& seen) const {
        push_at_edges(slot, number, cell, mass, v, seen);
        const Seat own{mass, v};
        WallLine lines[D];
        Vec<T, D> slid[D];  // of the line's mass along the wall
        T pressed[D];       // speed that the wall takes from the line's mass by pressing
        for (int a = 0; a < D; ++a) {
            WallLine& line = lines[a] = find_line<D>(node.boundaries, a, cell);
            pressed[a] = 0;
            if (line.form == WallLine::none) continue;
            const Wall by = wall(line);
            const Vec<T, D> before = v;
            Sums s;
            if (line.form != WallLine::held) s = sum(line, a, cell, own, by.velocity);
            const bool alone = line.form == WallLine::held || !(s.leader > T(0));
            const T impulse = alone ? T(0) : T(line.sign) * (s.lead() * s.led - s.momentum[a]);
            // Without a leader there is no field, and no wall pulls where material may leave it.
            // But drops that stand next to the plane, or fall where others rise, would pass it if
            // the nodes at the plane were free: these are held one by one.
            if (alone || (by.law.response == Response::separable && !(impulse > T(0)))) {
                if (line.form == WallLine::held || line.place <= 0) {
                    v = respond(by.law, a, T(line.sign), before, by.velocity);
                    seen(line.boundary, line.face, before, v);
                }
                line.form = WallLine::none;
                continue;
            }
            v[a] = by.velocity[a] + line.template share<T>(line.place) * s.lead();
            seen(line.boundary, line.face, before, v);
            if (impulse > T(0)) pressed[a] = impulse / s.mass;
            for (int c = 0; c < D; ++c) slid[a][c] = c == a ? T(0) : s.momentum[c] / s.mass;
        }
        for (int a = 0; a < D; ++a)
            if (lines[a].form != WallLine::none) rub(lines, a, slid[a], pressed[a], v, seen);
        if (!node.boundaries.surface_lines) return;
        bool bound[D];
        for (int a = 0; a < D; ++a) bound[a] = lines[a].form != WallLine::none;
        for (int b = 0; b < node.boundaries.count; ++b) {
            const BoundaryRecord<D>& r = node.boundaries.records[b];
            if (r.active && r.surface > 0 && r.law[0].linear)
                follow_surface(b, cell, own, bound, v, seen);
        }
    }
    /// A surface across its own normal. What walls on cell faces hold (`bound`) is left alone.
    template <class Seen>
    MPM_INLINE void follow_surface(int b, const std::int64_t (&cell)[D], const Seat& own,
                                   const bool (&bound)[D], Vec<T, D>& v, const Seen& seen) const {
        const BoundaryView<D>& all = node.boundaries;
        const BoundaryRecord<D>& r = all.records[b];
        const SurfaceRecord<D>& s = all.surfaces[r.surface - 1];
        const SurfaceLaw& law = r.law[0];
        const SurfaceLine<D> line(all, s, cell,
                                  [&](const std::int64_t(&at)[D], int axis, int sign) {
                                      return before_face<D>(all, at, axis, sign);
                                  });
        const Vec<T, D> before = v;
        if (line.state == SurfaceLine<D>::held) {
            double x[D];
            node_position<D>(cell, all.cell_size, x);
            Vec<T, D> wall;
            for (int a = 0; a < D; ++a) wall[a] = T(r.velocity[a]);
            if (respond_to_surface<T, D>(s, law, x, wall, v)) seen(b, 0, before, v);
            return;
        }
        if (line.state != SurfaceLine<D>::on) return;
        T mass = 0, led = 0, push = 0, inert = 0, leader = 0;
        Vec<T, D> momentum{}, here{};
        std::int64_t at[D];
        moved_along<D>(cell, line.axis, line.leader, at);
        const SurfaceView<D> first(all, s, at);
        for (int step = 0; step < 8; ++step) {
            moved_along<D>(cell, line.axis, line.leader - step * line.sign, at);
            const SurfaceView<D> view(all, s, at);
            if (!view.along(first) || view.deep()) break;
            const bool self = line.leader == step * line.sign;
            Seat seat_here = own;
            if (!self) {
                int number = 0;
                const std::int32_t slot = find_node<D>(node.grid.table, at, number);
                seat_here = slot < 0 ? Seat{} : seat(slot, number, at);
            }
            double x[D], moving[D];
            node_position<D>(at, all.cell_size, x);
            s.velocity_at(x, moving);
            const T t = T(view.distance / line.lead);
            T along = 0;
            for (int a = 0; a < D; ++a) {
                const T w = T(moving[a] + r.velocity[a]);
                if (self) here[a] = w;
                along += T(line.normal[a]) * (seat_here.velocity[a] - w);
                momentum[a] += seat_here.mass * (seat_here.velocity[a] - w);
            }
            if (step == 0) leader = seat_here.mass;
            mass += seat_here.mass;
            led += t * seat_here.mass;
            inert += t * t * seat_here.mass;
            push += t * seat_here.mass * along;
        }
        if (!(leader > T(0))) return;
        const T lead = push / inert;
        T along = 0, is = 0, open = 0;
        for (int a = 0; a < D; ++a) {
            along += T(line.normal[a]) * momentum[a];
            is += T(line.normal[a]) * (v[a] - here[a]);
            if (!bound[a]) open += T(line.normal[a] * line.normal[a]);
        }
        const T impulse = lead * led - along;
        if (law.response == Response::separable && !(impulse > T(0))) return;
        if (!(open > T(0.1))) return;
        const T change = (T(line.share) * lead - is) / open;
        for (int a = 0; a < D; ++a)
            if (!bound[a]) v[a] += change * T(line.normal[a]);
        if (law.static_friction > 0 || law.dynamic_friction > 0) {
            T speed = 0;
            for (int a = 0; a < D; ++a) {
                momentum[a] = (momentum[a] - along * T(line.normal[a])) / mass;
                speed += momentum[a] * momentum[a];
            }
            const T pressed = impulse > T(0) ? impulse / mass : T(0);
            const T lost = T(1) - kept_of_sliding<T>(law, square_root(speed), pressed);
            for (int a = 0; a < D; ++a)
                if (!bound[a]) v[a] -= lost * momentum[a];
        }
        seen(b, 0, before, v);
    }
    /// Coulomb friction: one tangential impulse on the whole line, by mass.
    template <class Seen>
    MPM_INLINE void rub(const WallLine (&lines)[D], int axis, const Vec<T, D>& slid, T pressed,
                        Vec<T, D>& v, const Seen& seen) const {
        const SurfaceLaw& law = wall(lines[axis]).law;
        if (!(law.static_friction > 0 || law.dynamic_friction > 0)) return;
        T speed = 0;
        for (int a = 0; a < D; ++a) speed += slid[a] * slid[a];
        const T lost = T(1) - kept_of_sliding<T>(law, square_root(speed), pressed);
        const Vec<T, D> before = v;
        for (int a = 0; a < D; ++a)
            if (lines[a].form == WallLine::none) v[a] -= lost * slid[a];
        seen(lines[axis].boundary, lines[axis].face, before, v);
    }
};

}  // namespace mpm
