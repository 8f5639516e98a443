// Lines of nodes towards a surface of any shape: along the grid axis that lies nearest to its
// normal. As before a wall on cell faces (wall_lines.hpp), with the shares T = phi_i / phi_k of the
// signed distances, in cells, of a node and of its leader, the first with phi >= 1. The velocity
// along the leader's normal is linear in the distance and meets the surface's where that is zero.
#pragma once

#include "mpm/kernels/boundaries.hpp"

namespace mpm {

/// What a node sees of a surface.
template <int D>
struct SurfaceView {
    bool known = false;   // near enough for a distance
    double distance = 0;  // cells
    double normal[D];
    int axis = -1;  // nearest to the normal; -1: there is no direction
    int away = 0;   // the sign of the normal along it

    SurfaceView() = default;
    MPM_CALL SurfaceView(const BoundaryView<D>& all, const SurfaceRecord<D>& s,
                         const std::int64_t (&cell)[D]) {
        const Reconverge at_return;
        double x[D], there[D], own[D];
        node_position<D>(cell, all.cell_size, x);
        s.to_body(x, there);
        known = s.field.at(there, distance, own);
        if (!known) return;
        distance /= all.cell_size;
        double most = 0;
        for (int a = 0; a < D; ++a) {
            normal[a] = 0;
            for (int b = 0; b < D; ++b) normal[a] += s.rotation[a][b] * own[b];
            const double size = normal[a] < 0 ? -normal[a] : normal[a];
            // A tie goes to the first axis, whatever rounding says.
            if (size > most + 1e-6) {
                most = size;
                axis = a;
                away = normal[a] < 0 ? -1 : 1;
            }
        }
    }
    MPM_INLINE bool along(const SurfaceView& other) const {
        return known && axis >= 0 && axis == other.axis && away == other.away;
    }
    /// Cosine of the angle between the normals, where both are known.
    MPM_INLINE double cosine(const SurfaceView& other) const {
        double along = 0;
        for (int a = 0; a < D; ++a) along += normal[a] * other.normal[a];
        return along;
    }
    /// Does it see another face? Neighbours before a round body see normals that differ by less.
    MPM_INLINE bool turned_from(const SurfaceView& other) const {
        return known && cosine(other) < 0.8;
    }
    /// No particle before the surface reaches a node further behind it.
    MPM_INLINE bool deep() const {
        double reach = 0;
        for (int a = 0; a < D; ++a) reach += normal[a] < 0 ? -normal[a] : normal[a];
        return distance <= -1.5 * reach;
    }
};

/// Is a node within some cells of a box, or of where a surface may come?
template <int D>
MPM_INLINE bool near_cells(const BoundaryRecord<D>& r, const std::int64_t (&cell)[D], int cells) {
    bool near = true;
    for (int a = 0; a < D; ++a)
        near = near && cell[a] >= r.lower[a] - cells && cell[a] < r.upper[a] + cells;
    return near;
}

/// Is a node within some cells of where a boundary that moves may come?
template <int D>
MPM_INLINE bool moving_near(const BoundaryView<D>& all, const std::int64_t (&cell)[D], int cells) {
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (r.surface == 0) continue;
        const SurfaceRecord<D>& s = all.surfaces[r.surface - 1];
        if (!s.at_rest() && near_cells(r, cell, cells)) return true;
    }
    return false;
}

/// Is a node within some cells of a boundary that moves, where that is now?
template <int D>
MPM_INLINE bool moved_near(const BoundaryView<D>& all, const std::int64_t (&cell)[D], int cells) {
    double x[D], there[D];
    node_position<D>(cell, all.cell_size, x);
    bool near = false;
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (r.surface == 0) continue;
        const SurfaceRecord<D>& s = all.surfaces[r.surface - 1];
        if (s.at_rest()) continue;
        s.to_body(x, there);
        near = near || s.field.reaches(there, cells * all.cell_size);
    }
    return near;
}

template <int D>
MPM_INLINE void moved_along(const std::int64_t (&cell)[D], int axis, std::int64_t by,
                            std::int64_t (&out)[D]) {
    for (int a = 0; a < D; ++a) out[a] = cell[a] + (a == axis ? by : 0);
}

/// Does a node two cells or less along an axis from one see another face? `but`: an axis that does
/// not count.
template <int D>
MPM_CALL bool near_edge(const BoundaryView<D>& all, const SurfaceRecord<D>& s,
                        const std::int64_t (&cell)[D], const SurfaceView<D>& here, int but = -1) {
    const Reconverge at_return;
    bool turned = false;
    for (int t = 0; t < D; ++t)
        for (int by = -2; by < 3; ++by) {
            if (t == but) continue;
            std::int64_t there[D];
            moved_along<D>(cell, t, by, there);
            turned = turned || SurfaceView<D>(all, s, there).turned_from(here);
        }
    return turned;
}

/// The line towards a surface on which a node is.
template <int D>
struct SurfaceLine {
    enum State { away, held, on };
    State state = away;
    int axis = 0, sign = 1;
    std::int64_t leader = 0;  // cells from the node along the axis
    double lead = 1;          // distance of the leader, cells
    double share = 1;
    double normal[D] = {};  // at the leader
    // The surface is a plane that leans, and gravity is along the line: its nodes move along the
    // plane as one (`FollowLines::follow_surface`).
    bool slides = false;

    SurfaceLine() = default;
    /// `walls`: as `OtherWalls`. `cautious`: as `SurfaceLaw` has it. `alone`: as
    /// `BoundaryView::holds` has it.
    template <class Walls>
    MPM_INLINE SurfaceLine(const BoundaryView<D>& all, const SurfaceRecord<D>& s,
                           const std::int64_t (&cell)[D], bool cautious, bool alone,
                           const Walls& walls) {
        const SurfaceView<D> here(all, s, cell);
        if (!here.known || here.distance >= 2) return;
        if (here.axis < 0 || here.deep() || (cautious && alone)) {
            state = held;
            return;
        }
        axis = here.axis;
        sign = here.away;
        // Held surfaces have a layer, whose end `hold` knows.
        const State otherwise = cautious || here.distance < 1 ? held : away;
        if (beside_edge(all, s, cell)) {
            state = otherwise;
            return;
        }
        const double before = before_wall(all, s, cell, here, walls);
        if (before < 1.5) {
            state = otherwise;
            return;
        }
        const double least = before < 3.5 ? 0.5 : 1.0;
        for (int step = 0; step < 5; ++step) {
            std::int64_t there[D];
            moved_along<D>(cell, axis, step * sign, there);
            const SurfaceView<D> seen(all, s, there);
            if (!seen.along(here)) break;
            if (seen.distance < least) continue;
            leader = step * sign;
            lead = seen.distance;
            share = here.distance / lead;
            for (int a = 0; a < D; ++a) normal[a] = seen.normal[a];
            // All nodes of a line ask at its leader. In a corner of two faces it sees the other one
            // where what is under the line does not.
            slides = leans() && all.slides(axis) && plane(all, s, there, seen);
            if (near_edge<D>(all, s, there, seen, axis) ||
                (cautious && !accepted(all, s, there, seen, walls))) {
                state = otherwise;
                return;
            }
            state = on;
            if (step > 0) return;
            // A leader leads only what is nearer.
            moved_along<D>(cell, axis, -sign, there);
            const SurfaceView<D> next(all, s, there);
            if (!next.along(here) || next.distance >= least) state = away;
            return;
        }
        state = otherwise;
    }
    /// Is a line with this leader one of those that were measured to be right?
    template <class Walls>
    MPM_INLINE bool accepted(const BoundaryView<D>& all, const SurfaceRecord<D>& s,
                             const std::int64_t (&there)[D], const SurfaceView<D>& seen,
                             const Walls& walls) const {
        if (moving_near<D>(all, there, 3)) return false;
        return leans() ? slides && !walls.near(there, normal, axis) : plane(all, s, there, seen);
    }
    /// Is the surface not across the axis?
    MPM_INLINE bool leans() const { return !(normal[axis] * sign > cos_of_a_degree); }
    /// Is the surface a plane, to a degree, for two cells around a leader, and no other part of it
    /// before it?
    MPM_CALL bool plane(const BoundaryView<D>& all, const SurfaceRecord<D>& s,
                        const std::int64_t (&cell)[D], const SurfaceView<D>& here) const {
        const Reconverge at_return;
        bool flat = true;
        for (int t = 0; t < D; ++t)
            for (int by = -2; by < 3; by += 4) {
                if (t == axis && by * sign < 0) continue;
                std::int64_t there[D];
                moved_along<D>(cell, t, by, there);
                const SurfaceView<D> seen(all, s, there);
                // What is before it may be too far off to be known.
                flat = flat && (seen.known ? seen.cosine(here) > cos_of_a_degree : t == axis);
            }
        return flat;
    }
    /// Does another face meet this one within two cells of the line? Splines there do not vanish on
    /// it, and what even pressure does to their nodes is not along its normal.
    MPM_CALL bool beside_edge(const BoundaryView<D>& all, const SurfaceRecord<D>& s,
                              const std::int64_t (&cell)[D]) const {
        const Reconverge at_return;
        std::int64_t foot[D], there[D];
        for (int step = 0; step < 5; ++step) {
            moved_along<D>(cell, axis, -step * sign, foot);
            const SurfaceView<D> inside(all, s, foot);
            if (!inside.known) return false;
            if (inside.distance >= 0) continue;
            for (int t = 0; t < D; ++t)
                for (int by = -2; by < 3; ++by) {
                    if (t == axis || by == 0) continue;
                    moved_along<D>(foot, t, by, there);
                    if (SurfaceView<D>(all, s, there).turned_from(inside)) return true;
                }
            return false;
        }
        return false;
    }
    /// Distance of the first node on the way out that stands right before another wall, up to 4.
    template <class Walls>
    MPM_INLINE double before_wall(const BoundaryView<D>& all, const SurfaceRecord<D>& s,
                                  const std::int64_t (&cell)[D], const SurfaceView<D>& here,
                                  const Walls& walls) const {
        for (int step = -4; step <= 6; ++step) {
            std::int64_t there[D];
            moved_along<D>(cell, axis, step * sign, there);
            if (!walls.right_before(there, axis, -sign)) continue;
            const SurfaceView<D> seen(all, s, there);
            if (seen.along(here) && seen.distance > 0 && seen.distance < 4) return seen.distance;
        }
        return 4;
    }
};

/// Where a node of a line is.
struct PlaceOnLine {
    double distance = 0;  // cells
    std::int8_t axis = -1, away = 0;
    bool deep = false;

    PlaceOnLine() = default;
    template <int D>
    MPM_INLINE explicit PlaceOnLine(const SurfaceView<D>& v)
        : distance(v.distance),
          axis(std::int8_t(v.known ? v.axis : -1)),
          away(std::int8_t(v.away)),
          deep(v.known && v.deep()) {}
    MPM_INLINE bool along(const PlaceOnLine& other) const {
        return axis >= 0 && axis == other.axis && away == other.away;
    }
};

/// What a surface cuts of a node's spline: the integral of its gradient over the body, which is
/// that of the spline times the normal over the surface, in faces of a cell, and the part before
/// it. By four points a cell and axis.
template <int D>
struct CutSpline {
    double area[D] = {}, before = 0;

    CutSpline() = default;
    MPM_CALL CutSpline(const BoundaryView<D>& all, const SurfaceRecord<D>& s,
                       const std::int64_t (&cell)[D]) {
        const Reconverge at_return;
        constexpr int points = 12;  // along an axis of the stencil
        constexpr double width = 3.0 / points;
        double centre[D];
        node_position<D>(cell, all.cell_size, centre);
        int count = 1;
        for (int a = 0; a < D; ++a) count *= points;
        for (int k = 0; k < count; ++k) {
            double x[D], there[D], own[D], value[D], slope[D], distance, product = 1;
            int rest = k;
            for (int a = 0; a < D; ++a) {
                const double t = (rest % points + 0.5) * width - 1.5, size = t < 0 ? -t : t;
                rest /= points;
                x[a] = centre[a] + t * all.cell_size;
                value[a] = width * (size < 0.5 ? 0.75 - t * t : 0.5 * (1.5 - size) * (1.5 - size));
                slope[a] = width * (size < 0.5 ? -2 * t : (t < 0 ? 1.5 - size : size - 1.5));
                product *= value[a];
            }
            s.to_body(x, there);
            // Across a point's own cell the body is cut evenly.
            double wet = 1;
            if (s.field.at(there, distance, own)) {
                wet = 0.5 + distance / (width * all.cell_size);
                wet = wet < 0 ? 0 : (wet > 1 ? 1 : wet);
            }
            before += product * wet;
            for (int a = 0; a < D; ++a) {
                double across = slope[a];
                for (int t = 0; t < D; ++t) across *= t == a ? 1 : value[t];
                area[a] += (1 - wet) * across;
            }
        }
    }
};

/// What a node sees of the one linear surface near it, where both rest.
template <int D>
struct SurfaceNode {
    PlaceOnLine place;
    std::int8_t state = 0, line_axis = 0, sign = 1, leader = 0;  // as in `SurfaceLine`
    bool slides = false;
    std::int32_t boundary = -1;  // none is near, or more than one, or what is near moves
    double lead = 1, share = 1, normal[D];
    // Beside an edge, where no line runs: what even pressure does to the node, which both faces
    // give back.
    CutSpline<D> cut;

    SurfaceNode() = default;
    MPM_INLINE bool pushed() const { return cut.before > 0; }
    /// With less than this of its spline before the surface, a node knows the pressure of a
    /// particle or two, and is so light that what it is pushed with presses these: the two drive
    /// each other. It rests in the body.
    static constexpr double least_before = 0.02;
    MPM_INLINE SurfaceNode(int b, const SurfaceView<D>& v, const SurfaceLine<D>& l)
        : place(v),
          state(std::int8_t(l.state)),
          line_axis(std::int8_t(l.axis)),
          sign(std::int8_t(l.sign)),
          leader(std::int8_t(l.leader)),
          slides(l.slides),
          boundary(b),
          lead(l.lead),
          share(l.share) {
        for (int a = 0; a < D; ++a) normal[a] = l.normal[a];
    }
    MPM_INLINE SurfaceLine<D> line() const {
        SurfaceLine<D> l;
        l.state = typename SurfaceLine<D>::State(state);
        l.axis = line_axis;
        l.sign = sign;
        l.leader = leader;
        l.slides = slides;
        l.lead = lead;
        l.share = share;
        for (int a = 0; a < D; ++a) l.normal[a] = normal[a];
        return l;
    }
};

/// What a node of a block that boundaries touch asks for (kernels/wall_nodes.hpp), bit by bit.
using WallAsks = std::uint8_t;
struct WallNode {
    static constexpr WallAsks free = 0;
    static constexpr WallAsks on_lines = 1;  // towards walls on cell faces
    static constexpr WallAsks surface = 2;   // on a line towards one, held or pushed by it
    static constexpr WallAsks edges = 4;     // of boxes, beside it or what it shares a line with
    static constexpr WallAsks held = 8;      // by boundaries whose cells are not linear
    static constexpr WallAsks watched = 16;  // a boundary that moves may come near, and is not now
    static constexpr WallAsks unknown = 32;  // it changes with time
    /// Cells from a node within which a boundary that moves changes what is known of it: further
    /// than lines look from any node of its own. What is known lists those that are not so near.
    static constexpr int aware = 20;

    /// Is it moved with those that need all functions?
    MPM_INLINE static bool needs_all(WallAsks asks) { return asks > on_lines && asks != held; }
};
/// Nodes by what they ask for, a pass each.
enum class WallPass { lines, held, all };
inline constexpr int wall_passes = 3;

/// What is known of the nodes of listed blocks as long as the table stands
/// (kernels/wall_nodes.hpp), by (listed block, node).
template <int D>
struct KnownNodes {
    const std::uint32_t* lines = nullptr;      // by axis, packed; null: nothing is known
    const SurfaceNode<D>* surfaces = nullptr;  // null: no surface is linear
    const std::uint32_t* listed = nullptr;     // by slot, 1 + number of the listed block
    const WallAsks* asks = nullptr;

    MPM_INLINE std::int64_t place(std::int32_t slot, int node) const {
        return std::int64_t(listed[slot] - 1) * block_cells + node;
    }
    /// All this, or nothing of a node that has to find out for itself.
    MPM_INLINE KnownNodes at(std::int64_t place, const BoundaryView<D>& all,
                             const std::int64_t (&cell)[D]) const {
        if (!asks || asks[place] == WallNode::unknown) return {};
        const bool near = asks[place] & WallNode::watched && moved_near(all, cell, WallNode::aware);
        return near ? KnownNodes{} : *this;
    }

    MPM_INLINE const SurfaceNode<D>* of(std::int32_t slot, int node) const {
        if (!surfaces || slot < 0 || listed[slot] == 0) return nullptr;
        return surfaces + place(slot, node);
    }
    MPM_INLINE const SurfaceNode<D>* of(std::int32_t slot, int node, int boundary) const {
        const SurfaceNode<D>* found = of(slot, node);
        return found && found->boundary == boundary ? found : nullptr;
    }
};

}  // namespace mpm
