// Which nodes lie on lines towards walls on cell faces, and at which places of these
// (wall_lines.hpp); nodes beside the edges of boxes.
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
    // `shut`: held as well, and surfaces leave it alone.
    enum Form { none, held, shut, pair, linear };
    Form form = none;
    int boundary = 0, face = 0;
    int sign = 1;   // of the normal, which points into the material
    int place = 0;  // of the node

    MPM_INLINE bool holds() const { return form == held || form == shut; }
    MPM_INLINE int first() const { return form == linear ? 1 : 0; }
    template <class T>
    MPM_INLINE T share(int at) const {
        if (at == first()) return 1;
        return T(at == 0 ? 1 : -1) / T(form == linear ? 3 : 1);
    }

    /// In one number, 0 for none, as tables of lines keep it.
    MPM_INLINE std::uint32_t packed() const {
        if (form == none) return 0;
        return std::uint32_t(form) | std::uint32_t(place + 1) << 3 | std::uint32_t(sign > 0) << 5 |
               std::uint32_t(face) << 6 | std::uint32_t(boundary) << 9;
    }
    MPM_INLINE static WallLine unpacked(std::uint32_t from) {
        WallLine line;
        line.form = Form(from & 7);
        line.place = int(from >> 3 & 3) - 1;
        line.sign = from >> 5 & 1 ? 1 : -1;
        line.face = int(from >> 6 & 7);
        line.boundary = int(from >> 9);
        return line;
    }
};
/// Boundaries that a packed line can tell apart.
inline constexpr std::size_t most_packed_boundaries = std::size_t(1) << 23;

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
    return r.is_box && !near_cells(r, cell, 2);
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

/// Whether f(boundary, face, plane) is true of any linear face across an axis on whose rows a node
/// is and that is near to it; asks in the order in which they are defined, until it is.
template <int D, class F>
MPM_INLINE bool any_face(const BoundaryView<D>& all, int axis, const std::int64_t (&cell)[D],
                         const F& f) {
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active || r.surface > 0 || far_from(r, cell)) continue;
        for (int face = 2 * axis; face < 2 * axis + 2; ++face) {
            if (!r.present[face] || !r.law[face].linear || !on_rows(r, axis, cell)) continue;
            if (f(b, face, WallPlane<D>(r, face))) return true;
        }
    }
    return false;
}

/// Does a node stand right before a face across an axis whose normal has this sign?
template <int D>
MPM_CALL bool before_face(const BoundaryView<D>& all, const std::int64_t (&cell)[D], int axis,
                          int sign) {
    const Reconverge at_return;
    return any_face<D>(all, axis, cell, [&](int, int, const WallPlane<D>& wall) {
        return wall.sign == sign && wall.place(cell[axis]) == 0;
    });
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

/// Does a wall across an axis lie inside a body whose surface is before it on this row? Then its
/// lines would take the nodes of those towards the surface, and it leaves these alone (`yes`).
/// But within two cells of where the wall comes out of the body, what is before it reaches these
/// nodes, and the surface lets them slide through its plane: it holds those at the plane
/// (`beside`). Of `cell`, a node at `place`.
enum class InBody { no, yes, beside };
template <int D>
MPM_INLINE InBody inside_surface(const BoundaryView<D>& all, const WallPlane<D>& wall, int axis,
                                 const std::int64_t (&cell)[D], std::int64_t place) {
    InBody found = InBody::no;
    std::int64_t row[D];
    moved_along<D>(cell, axis, -place * wall.sign, row);
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active || r.surface == 0 || r.share != 0 || r.limited ||
            r.law[0].response == Response::prescribed)
            continue;
        const SurfaceRecord<D>& s = all.surfaces[r.surface - 1];
        // What lies on the wall changes nothing.
        const auto covered = [&](int along, int by) {
            std::int64_t there[D];
            double x[D], own[D], normal[D], distance;
            moved_along<D>(row, along, by, there);
            node_position<D>(there, all.cell_size, x);
            x[axis] -= 0.5 * wall.sign * all.cell_size;
            s.to_body(x, own);
            return s.field.at(own, distance, normal) && distance < -0.05 * all.cell_size;
        };
        const auto seen = [&](int at) {
            std::int64_t there[D];
            moved_along<D>(row, axis, at * wall.sign, there);
            return SurfaceView<D>(all, s, there);
        };
        const auto faces = [&](const SurfaceView<D>& v) {
            return v.known && (v.axis < 0 || (v.axis == axis && v.away == wall.sign));
        };
        if (!covered(axis, 0)) continue;
        // Behind a face that rises straight from the wall, further than its nodes reach, lines go
        // on: nothing else holds these nodes against the wall.
        const SurfaceView<D> leader = seen(1);
        const bool leans =
            leader.known && leader.distance < 0 && leader.normal[axis] * wall.sign > 0.1;
        if (!leans && !faces(leader) && !faces(seen(0))) continue;
        if (place > 0) return InBody::yes;
        bool comes_out = false;
        for (int t = 0; t < D; ++t)
            for (int by = -2; by < 3 && t != axis; ++by) comes_out = comes_out || !covered(t, by);
        if (!comes_out) return InBody::yes;
        found = InBody::beside;
    }
    return found;
}

/// Does a face of a box lie inside another box, or outside the domain, on the row of a node?
/// Nothing is before it there. Where the other's rows go on beyond its own its lines would take
/// nodes that the other holds: of a box that stands on the floor those of the floor, which might
/// then fall.
template <int D>
MPM_INLINE bool buried(const BoundaryView<D>& all, int boundary, const WallPlane<D>& wall, int axis,
                       const std::int64_t (&cell)[D]) {
    const BoundaryRecord<D>& own = all.records[boundary];
    std::int64_t before[D];
    for (int a = 0; a < D; ++a) before[a] = cell[a];
    before[axis] = wall.sign > 0 ? wall.plane : wall.plane - 1;
    for (int b = 0; b < all.count && own.is_box; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (b == boundary || !r.active || r.surface > 0 || r.share != 0 || r.limited ||
            r.law[0].response == Response::prescribed)
            continue;
        const bool above = before[axis] >= r.lower[axis], below = before[axis] < r.upper[axis];
        if (!r.is_box) {
            if ((r.present[2 * axis] && !above) || (r.present[2 * axis + 1] && !below)) return true;
            continue;
        }
        bool inside = above && below;
        for (int t = 0; t < D; ++t)
            inside = inside && (t == axis || (r.rows_lower[t] <= own.rows_lower[t] &&
                                              r.rows_upper[t] >= own.rows_upper[t]));
        if (inside) return true;
    }
    return false;
}

/// The line on which a node is across an axis. Where two claim it, the first that is defined does.
/// `alone`: `BoundaryView::holds`.
template <int D>
MPM_CALL WallLine find_line(const BoundaryView<D>& all, int axis, const std::int64_t (&cell)[D],
                            bool alone = false) {
    const Reconverge at_return;
    WallLine line;
    any_face<D>(all, axis, cell, [&](int b, int face, const WallPlane<D>& wall) {
        const BoundaryRecord<D>& r = all.records[b];
        const std::int64_t place = wall.place(cell[axis]);
        if (place < -1 || place > 1) return false;
        if (buried(all, b, wall, axis, cell)) return false;
        const InBody in_body = inside_surface(all, wall, axis, cell, place);
        if (in_body == InBody::yes) return false;
        int room = room_before(all, wall, axis, cell);
        const double surface = surface_before(all, wall, axis, cell, place);
        if (surface < 3.5 && room > 3) room = 3;
        if (surface < 1.5) room = 1;
        line.boundary = b;
        line.face = face;
        line.sign = wall.sign;
        line.place = int(place);
        if (in_body == InBody::beside) {
            line.form = WallLine::shut;
            return true;
        }
        if (r.law[face].cautious) {
            std::int64_t foot[D];
            moved_along<D>(cell, axis, -place * wall.sign, foot);
            if (alone || moving_near<D>(all, foot, 3)) {  // as a held wall has it
                line.form = place > 0 ? WallLine::none : WallLine::held;
                return place <= 0;
            }
        }
        const bool thin = r.is_box && r.upper[axis] - r.lower[axis] < 2;
        line.form = room < 2 || thin ? WallLine::held
                    : room < 4       ? WallLine::pair
                                     : WallLine::linear;
        if (place <= (line.form == WallLine::linear ? 1 : 0)) return true;
        line.form = WallLine::none;
        return false;
    });
    return line;
}

/// What lines towards a surface ask of other walls.
template <int D>
struct OtherWalls {
    const BoundaryView<D>& all;
    int boundary;  // the surface's

    /// Does a node stand right before another wall across the axis?
    MPM_INLINE bool right_before(const std::int64_t (&cell)[D], int axis, int sign) const {
        return before_face<D>(all, cell, axis, sign);
    }
    /// Is the leader of a line towards a surface that leans near to another one, or to a wall that
    /// is not along the normal? The splines of the line's nodes end at both, and of an even
    /// pressure neither line gives back what the other's wall does.
    MPM_CALL bool near(const std::int64_t (&leader)[D], const double (&normal)[D], int axis) const {
        const Reconverge at_return;
        bool found = false;
        for (int b = 0; b < all.count; ++b) {
            const BoundaryRecord<D>& r = all.records[b];
            if (b == boundary || !r.active) continue;
            if (r.surface > 0) {
                const SurfaceView<D> other(all, all.surfaces[r.surface - 1], leader);
                found = found || (other.known && other.distance < 3);
                continue;
            }
            for (int f = 0; f < 2 * D; ++f) {
                const int a = f / 2;
                const bool pushed_along =
                    normal[a] > sin_of_a_degree || normal[a] < -sin_of_a_degree;
                if (!r.present[f] || !pushed_along) continue;
                bool beside = true;
                for (int t = 0; t < D; ++t)
                    beside =
                        beside && (t == a || !r.is_box ||
                                   (leader[t] >= r.lower[t] - 3 && leader[t] < r.upper[t] + 3));
                // A line ends three cells behind its surface.
                const std::int64_t place = WallPlane<D>(r, f).place(leader[a]);
                found = found || (beside && place >= -3 && place < (a == axis ? 4 : 2));
            }
        }
        return found;
    }
};

/// The line towards a linear surface on which a node is.
template <int D>
MPM_INLINE SurfaceLine<D> surface_line(const BoundaryView<D>& all, int boundary,
                                       const std::int64_t (&cell)[D], bool alone) {
    const BoundaryRecord<D>& r = all.records[boundary];
    const SurfaceRecord<D>& s = all.surfaces[r.surface - 1];
    return SurfaceLine<D>(all, s, cell, r.law[0].cautious, alone, OtherWalls<D>{all, boundary});
}

/// Slot of the node of a cell in the field of another slot, -1 where it is not active, and its
/// number.
template <int D>
MPM_INLINE std::int32_t node_of_field(const BlockTableView<D>& table, std::int32_t slot,
                                      const std::int64_t (&cell)[D], int& number) {
    std::int64_t block[D];
    number = block_of_node<D>(cell, block);
    return find_block<D>(table, block,
                         table.keys_of.fields == 1 ? 0 : table.keys_of.field(table.keys[slot]));
}

/// The node some cells along an axis from one of a slot, of the same field, and its slot, -1 where
/// it is not active.
template <int D>
MPM_INLINE std::int32_t node_beside(const BlockTableView<D>& table, std::int32_t slot,
                                    const std::int64_t (&cell)[D], int axis, std::int64_t by,
                                    int& number) {
    constexpr int edge = Block<D>::edge;
    std::int64_t there[D];
    moved_along<D>(cell, axis, by, there);
    // Blocks beside this one are listed; to search for one costs a read for each bit of the
    // table's size, one after another.
    int at[D], neighbour = 0;
    bool near = true;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        const std::int64_t from = there[a] - table.corners[std::int64_t(slot) * D + a] + edge;
        near = near && from >= 0 && from < 3 * edge;
        at[a] = int(from % edge);
        neighbour = neighbour * 3 + int(from / edge);
    }
    if (near) {
        number = Block<D>::cell(at);
        return neighbour == Block<D>::neighbours / 2
                   ? slot
                   : table.neighbours[std::int64_t(slot) * Block<D>::neighbours + neighbour];
    }
    return node_of_field<D>(table, slot, there, number);
}

/// A node on lines towards walls alone, with all that it needs to find the others of its lines.
template <int D>
struct alignas(16) LinedNode {
    std::uint32_t node = 0;       // slot and node in one number
    std::uint32_t lines[D] = {};  // packed
    std::int32_t beside[D] = {};  // slot of those beyond its own block, -1 where it is not active

    LinedNode() = default;
    MPM_INLINE LinedNode(const BlockTableView<D>& table, std::int32_t slot, int number,
                         const std::uint32_t* packed)
        : node(std::uint32_t(slot) * block_cells + std::uint32_t(number)) {
        std::int64_t cell[D];
        table.cell(slot, number, cell);
        for (int a = 0; a < D; ++a) {
            lines[a] = packed[a];
            beside[a] = slot;
            const WallLine line = WallLine::unpacked(packed[a]);
            if (line.form == WallLine::none) continue;
            // All that lie beyond its block do so on one side of it.
            for (int place = -1; place <= line.first(); ++place) {
                int found = 0;
                const std::int32_t of =
                    node_beside<D>(table, slot, cell, a, (place - line.place) * line.sign, found);
                if (of != slot) beside[a] = of;
            }
        }
    }
    MPM_INLINE std::int32_t slot() const { return std::int32_t(node / block_cells); }
    MPM_INLINE int number() const { return int(node % block_cells); }
    /// As `node_beside`, of a node of one of its lines.
    MPM_INLINE std::int32_t beside_along(int axis, int by, int& found) const {
        constexpr int edge = Block<D>::edge;
        int at[D];
        Block<D>::coordinates(number(), at);
        const int to = at[axis] + by;
        at[axis] = (to + edge) % edge;
        found = Block<D>::cell(at);
        return to >= 0 && to < edge ? slot() : beside[axis];
    }
};

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

}  // namespace mpm
