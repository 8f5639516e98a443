// Sums over the nodes of a line towards a surface (surface_lines.hpp). All nodes of a line need the
// same: where it is known which lines there are, a pass of the leaders makes them
// (`SumSurfaceLines` of wall_nodes.hpp) and the others take them.
#pragma once

#include "mpm/kernels/wall_places.hpp"

namespace mpm {

/// Velocities are relative to the surface, along the leader's normal.
template <class T, int D>
struct SurfaceSums {
    T leader = 0;           // mass
    T mass = 0, led = 0;    // sum of m, of T m
    T push = 0, inert = 0;  // sum of T m v, of T^2 m
    T arm = 0;              // sum of m times the cells from the leader along the axis
    T in_plane = 0;         // velocity where the distance is zero
    bool across = false;    // there are nodes with mass on both sides of it
    Vec<T, D> momentum{};

    static constexpr int numbers = 8 + D;
    MPM_INLINE void put(T* to) const {
        const T all[] = {leader, mass, led, push, inert, arm, in_plane, T(across ? 1 : 0)};
        for (int k = 0; k < 8; ++k) to[k] = all[k];
        for (int a = 0; a < D; ++a) to[8 + a] = momentum[a];
    }
    MPM_INLINE static SurfaceSums get(const T* from) {
        SurfaceSums s;
        s.leader = from[0];
        s.mass = from[1];
        s.led = from[2];
        s.push = from[3];
        s.inert = from[4];
        s.arm = from[5];
        s.in_plane = from[6];
        s.across = from[7] > T(0);
        for (int a = 0; a < D; ++a) s.momentum[a] = from[8 + a];
        return s;
    }
};

/// Of the line that a node is on, from its leader inwards. `lines` is a `FollowLines`, `own` what
/// the node would do by itself.
template <class T, int D, class Lines>
MPM_INLINE SurfaceSums<T, D> sum_surface_line(const Lines& lines, int b, std::int32_t slot,
                                              const std::int64_t (&cell)[D],
                                              const typename Lines::Seat& own,
                                              const SurfaceLine<D>& line) {
    const BoundaryView<D>& all = lines.node.boundaries;
    const BoundaryRecord<D>& r = all.records[b];
    const SurfaceRecord<D>& s = all.surfaces[r.surface - 1];
    SurfaceSums<T, D> out;
    T last = 0, last_share = 0;
    std::int64_t there[D];
    PlaceOnLine first, place;
    for (int step = 0; step < 8; ++step) {
        const std::int64_t by = line.leader - step * line.sign;
        moved_along<D>(cell, line.axis, by, there);
        int number = 0;
        const std::int32_t of =
            node_beside<D>(lines.node.grid.table, slot, cell, line.axis, by, number);
        if (const SurfaceNode<D>* is = lines.known.of(of, number, b))
            place = is->place;
        else
            place = PlaceOnLine(SurfaceView<D>(all, s, there));
        if (step == 0) first = place;
        if (!place.along(first) || place.deep) break;
        typename Lines::Seat here = own;
        if (by != 0) here = of < 0 ? typename Lines::Seat{} : lines.other_seat(of, number, there);
        double moving[D] = {};
        if (!s.at_rest()) {
            double x[D];
            node_position<D>(there, all.cell_size, x);
            s.velocity_at(x, moving);
        }
        const T t = T(place.distance / line.lead);
        T along = 0;
        for (int a = 0; a < D; ++a) {
            const T w = T(moving[a] + r.velocity[a]);
            along += T(line.normal[a]) * (here.velocity[a] - w);
            out.momentum[a] += here.mass * (here.velocity[a] - w);
        }
        if (step == 0) out.leader = here.mass;
        if (t <= T(0) && last_share > T(0) && here.mass > T(0)) {
            out.in_plane = (along * last_share - last * t) / (last_share - t);
            out.across = true;
        }
        last = along;
        last_share = here.mass > T(0) ? t : T(0);
        out.mass += here.mass;
        out.arm -= T(step * line.sign) * here.mass;
        out.led += t * here.mass;
        out.inert += t * t * here.mass;
        out.push += t * here.mass * along;
    }
    return out;
}

}  // namespace mpm
