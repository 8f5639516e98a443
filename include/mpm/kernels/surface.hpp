// Rigid bodies of any shape as boundaries: where they are at a time, and how far a node is from
// them.
#pragma once

#include "mpm/data/distance_field.hpp"
#include "mpm/data/time_table.hpp"
#include "mpm/physics/boundary/decay.hpp"
#include "mpm/physics/boundary/response.hpp"

namespace mpm {

/// A prescribed motion: a table of places, or of speeds with what they have travelled by each row.
struct MotionView {
    TimeTableView table;
    const double* travelled;  // (count, components) since time 0; null: the table is of places

    MPM_HD bool given() const { return table.count > 0; }
    MPM_HD void at(double t, double* place, double* speed) const {
        const int n = table.components, rows = table.count;
        const double first = table.time[0], last = table.time[rows - 1];
        double cycles = 0;
        if (t > last && table.end == TableEnd::repeat && rows > 1) {
            cycles = floor((t - first) / (last - first));
            t -= cycles * (last - first);
        }
        int low = 0, high = rows;
        while (high - low > 1) {
            const int middle = (low + high) / 2;
            if (table.time[middle] <= t)
                low = middle;
            else
                high = middle;
        }
        const bool inside = low + 1 < rows && t > table.time[low];
        const double since = t - table.time[low];
        const double length = inside ? table.time[low + 1] - table.time[low] : 1;
        for (int c = 0; c < n; ++c) {
            const double a = table.value[low * n + c];
            const double rise = inside ? table.value[(low + 1) * n + c] - a : 0;
            if (!travelled) {
                place[c] = a + rise * (since / length);
                speed[c] = rise / length;
                continue;
            }
            const double v = t > last && table.end == TableEnd::zero ? 0 : a;
            speed[c] = v + rise * (since / length);
            place[c] = travelled[low * n + c] + (v + 0.5 * rise * (since / length)) * since +
                       cycles * (travelled[(rows - 1) * n + c] - travelled[c]);
        }
    }
};

template <int D>
struct SurfaceRecord {
    DistanceField<D> field;
    Decay decay;
    double thickness;  // of the layer, m
    MotionView path;   // m
    MotionView turn;   // of the angle, rad
    double about[D];   // what it turns about, at time 0, m
    double axis[3];    // unit vector; 2D: z
    // Evaluated each step:
    double moved[D], velocity[D], spin[3], rotation[D][D];

    MPM_HD bool at_rest() const { return !path.given() && !turn.given(); }
    MPM_HD void set(double time) {
        for (int a = 0; a < D; ++a) moved[a] = velocity[a] = 0;
        if (path.given()) path.at(time, moved, velocity);
        double angle = 0, rate = 0;
        if (turn.given()) turn.at(time, &angle, &rate);
        for (int a = 0; a < 3; ++a) spin[a] = rate * axis[a];
        const double c = cos(angle), s = sin(angle);
        if constexpr (D == 2) {
            rotation[0][0] = rotation[1][1] = c;
            rotation[0][1] = -s;
            rotation[1][0] = s;
        } else {
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j) {
                    const int k = 3 - i - j;  // the third axis where i != j
                    const double cross = i == j ? 0 : ((j - i + 3) % 3 == 1 ? -1 : 1) * axis[k % 3];
                    rotation[i][j] = (i == j ? c : 0) + s * cross + (1 - c) * axis[i] * axis[j];
                }
        }
    }

    /// A place of the world as the body had it at time 0.
    MPM_HD void to_body(const double (&x)[D], double (&own)[D]) const {
        for (int a = 0; a < D; ++a) {
            own[a] = about[a];
            for (int b = 0; b < D; ++b) own[a] += rotation[b][a] * (x[b] - about[b] - moved[b]);
        }
    }

    MPM_HD void velocity_at(const double (&x)[D], double (&v)[D]) const {
        double r[3] = {0, 0, 0};
        for (int a = 0; a < D; ++a) r[a] = x[a] - about[a] - moved[a];
        const double swept[3] = {spin[1] * r[2] - spin[2] * r[1], spin[2] * r[0] - spin[0] * r[2],
                                 spin[0] * r[1] - spin[1] * r[0]};
        for (int a = 0; a < D; ++a) v[a] = velocity[a] + swept[a];
    }
};

/// Planes that differ by less than a degree are one.
inline constexpr double cos_of_a_degree = 0.99985, sin_of_a_degree = 0.0175;

/// Across which axes lines of nodes towards walls on cell faces have a node
/// (kernels/wall_lines.hpp). Another boundary that changed it there would open the plane of the
/// wall: the field in it is zero only if all nodes of the line follow it.
template <int D>
struct BoundAxes {
    bool on[D] = {};
    bool shut[D] = {};   // and the node is held there: it has the velocity of the wall
    double off[D] = {};  // of the node from the plane, along its normal, m
    int sign[D] = {};    // of the normal

    MPM_INLINE void bind(int axis, int side, double from_plane) {
        on[axis] = true;
        off[axis] = from_plane;
        sign[axis] = side;
    }
    /// Without walls that lie behind a surface which faces the same way.
    template <class V>
    MPM_INLINE BoundAxes before(const V& normal, double distance, double cell_size) const {
        BoundAxes out = *this;
        for (int a = 0; a < D; ++a) {
            const bool hidden = !shut[a] && double(normal[a]) * sign[a] > 0.7;
            if (hidden && distance < off[a] - 0.05 * cell_size) out.on[a] = false;
        }
        return out;
    }
    /// Has the node the velocity of walls on all axes of a unit vector that are not free?
    template <class V>
    MPM_INLINE bool stands(const V& n) const {
        bool any = false, all = true;
        for (int a = 0; a < D; ++a) {
            const double part = double(n[a]) * double(n[a]);
            any = any || (on[a] && shut[a]);
            all = all && (!on[a] || shut[a] || part < sin_of_a_degree * sin_of_a_degree);
        }
        return any && all;
    }
    /// Square of the part of a unit vector that is free.
    template <class V>
    MPM_INLINE double open(const V& n) const {
        double part = 0;
        for (int a = 0; a < D; ++a)
            if (!on[a]) part += double(n[a]) * double(n[a]);
        return part;
    }
};
/// With less of a surface's normal than this free, a node can't follow the surface.
inline constexpr double least_open = 0.1;

/// What a surface leaves of the velocity of a node at `x`, so far from it; false where it does not
/// reach it. `normal` is that of the body as it lies. `own` is a velocity that its face has beside
/// its motion. What lines towards walls have of a node is theirs; the rest of it changes as if that
/// were at rest, which gives the node no energy. Where a surface lets go, what is off it comes as
/// near as it can in this step first (`NodeUpdate::closing_speed`).
template <class T, int D, class Closing>
MPM_CALL bool respond_near_surface(const SurfaceRecord<D>& s, const SurfaceLaw& law,
                                   const double (&x)[D], double distance, const double (&normal)[D],
                                   const Vec<T, D>& own, const BoundAxes<D>& walls,
                                   double cell_size, Vec<T, D>& v, const Closing& closing_speed) {
    const Reconverge at_return;
    double wall[D];
    const double share = law.response == Response::prescribed
                             ? (distance <= 0 ? 1.0 : 0.0)
                             : decayed(s.decay, distance / s.thickness);
    if (!(share > 0)) return false;
    s.velocity_at(x, wall);
    Vec<T, D> n, w;
    double length = 0;
    for (int a = 0; a < D; ++a) {
        double turned = 0;
        for (int b = 0; b < D; ++b) turned += s.rotation[a][b] * normal[b];
        n[a] = T(turned);
        w[a] = T(wall[a]) + own[a];
        length += turned * turned;
    }
    const Vec<T, D> face = n;
    // Where there is no direction to leave by, deep inside, nothing moves against the body.
    SurfaceLaw as = law;
    if (!(length > 0) && law.response != Response::prescribed) as.response = Response::sticky;
    const bool slides = as.response == Response::slip || as.response == Response::separable;
    const BoundAxes<D> bound = slides ? walls.before(n, distance, cell_size) : BoundAxes<D>{};
    Vec<T, D> open = v;
    for (int a = 0; a < D; ++a)
        if (bound.on[a]) open[a] = w[a];
    // Of a node that stands in a wall the surface takes all that goes into it. What it has left
    // would run along both into the corner.
    if (bound.stands(n)) {
        const double part = bound.open(n);
        if (!(part > sin_of_a_degree * sin_of_a_degree)) return false;
        const T scale = T(1 / sqrt(part));
        for (int a = 0; a < D; ++a) n[a] = bound.on[a] ? T(0) : n[a] * scale;
    }
    const Vec<T, D> at = wall_behind_gap(as, n, open, w, [&] {
        int across = 0;
        for (int a = 1; a < D; ++a)
            if (absolute(face[a]) > absolute(face[across])) across = a;
        const double lean = absolute(double(face[across]));
        double leans[D];
        for (int a = 0; a < D; ++a) leans[a] = double(face[a]) / lean;
        return T(lean * closing_speed(across, face[across] > T(0) ? 1 : -1,
                                      distance / (lean * cell_size), leans));
    });
    const Vec<T, D> held = respond_along(as, n, open, at);
    for (int a = 0; a < D; ++a)
        if (!bound.on[a]) v[a] = v[a] - T(share) * (v[a] - held[a]);
    return true;
}

/// The same of a node that has to find the surface.
template <class T, int D, class Closing>
MPM_CALL bool respond_to_surface(const SurfaceRecord<D>& s, const SurfaceLaw& law,
                                 const double (&x)[D], const Vec<T, D>& own,
                                 const BoundAxes<D>& walls, double cell_size, Vec<T, D>& v,
                                 const Closing& closing_speed) {
    const Reconverge at_return;
    double there[D], normal[D], distance;
    s.to_body(x, there);
    if (!s.field.at(there, distance, normal)) return false;
    return respond_near_surface<T, D>(s, law, x, distance, normal, own, walls, cell_size, v,
                                      closing_speed);
}

}  // namespace mpm
