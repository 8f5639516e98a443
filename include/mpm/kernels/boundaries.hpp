// What the boundaries leave of a node's velocity. `special` compiles in what only some scenes have:
// surfaces of any shape, regions with a prescribed velocity, limits in space or to some bodies,
// mirrored nodes.
#pragma once

#include "mpm/kernels/views.hpp"

namespace mpm {

/// Solids of particles touch what lets go once the gap is closed (`NodeUpdate::closing_speed`),
/// rigid bodies and those of elements wherever nodes are held: they feel walls at points of their
/// own, or fill nodes otherwise than their masses say.
enum SolidField : std::int32_t { closes_gaps = 1, held_by_nodes = 2 };

template <int D>
struct BoundaryView {
    const BoundaryRecord<D>* records;
    int count;
    const SurfaceRecord<D>* surfaces;
    double cell_size;
    int reach;           // nodes beyond a face of the domain that particles inside can reach
    bool lines = false;  // any face is linear
    bool surface_lines = false;  // any surface is
    bool mirrors = false;        // any face is a mirror
    int down = -1;               // the axis along which gravity is largest
    bool restricted = false;     // any is for some bodies alone
    // (fields,): `SolidField` of those whose velocities are of solids alone, beside contacts; 0 of
    // others; null without contacts.
    const std::int32_t* solid_fields = nullptr;

    /// May lines slide along slopes? Not where bodies of other fields push at single nodes of them.
    MPM_INLINE bool slides(int axis) const { return axis == down && !solid_fields; }
    /// Are the nodes of a slot's field held one by one where cells are linear by default? Bodies
    /// that press on each other push at single nodes, which a line would share out along itself.
    MPM_INLINE bool holds(const BlockTableView<D>& table, std::int32_t slot) const {
        return solid_fields && solid_fields[table.keys_of.field(table.keys[slot])];
    }
};

/// Centre of a cell, which is its node, m.
template <int D>
MPM_INLINE void node_position(const std::int64_t (&cell)[D], double cell_size, double (&x)[D]) {
    for (int a = 0; a < D; ++a) x[a] = (double(cell[a]) + 0.5) * cell_size;
}

/// A law, without friction where that is not asked for.
MPM_INLINE SurfaceLaw law_with(SurfaceLaw law, bool friction) {
    if (!friction) law.static_friction = law.dynamic_friction = 0;
    return law;
}

/// Of who asks for a node: how fast what is there closes its gap to a plane
/// (`NodeUpdate::closing_speed`).
template <class Share, int D>
struct ClosingSpeed {
    const Share& share;
    MPM_INLINE double operator()(int axis, int sign, double height,
                                 const double (&leans)[D]) const {
        if constexpr (requires { share.closing_speed(axis, sign, height, leans); })
            return share.closing_speed(axis, sign, height, leans);
        else
            return 0;
    }
};
/// What a face leaves of the velocity of a node so many cells above it.
template <bool special, class T, int D, class Share>
MPM_INLINE Vec<T, D> respond_at_face(const SurfaceLaw& law, int axis, int sign, double height,
                                     const Vec<T, D>& v, const Vec<T, D>& wall,
                                     const Share& share) {
    Vec<T, D> at = wall;
    if constexpr (special) {
        Vec<T, D> normal{};
        normal[axis] = T(sign);
        at = wall_behind_gap(law, normal, v, wall, [&] {
            const double level[D] = {};
            return T(ClosingSpeed<Share, D>{share}(axis, sign, height, level));
        });
    }
    return respond(law, axis, T(sign), v, at);
}

/// Boundaries that only some scenes have; true where the record is one of them and done with.
template <class T, int D, class Seen, class Share>
MPM_CALL bool apply_special(const BoundaryView<D>& all, int b, const std::int64_t (&cell)[D],
                            const Vec<T, D>& wall, const BoundAxes<D>& bound, Vec<T, D>& v,
                            const Seen& seen, bool rubs, const Share& share) {
    const Reconverge at_return;
    const BoundaryRecord<D>& r = all.records[b];
    double x[D];
    node_position<D>(cell, all.cell_size, x);
    for (int a = 0; a < D && r.limited; ++a)
        if (!(x[a] >= r.within_lower[a] && x[a] <= r.within_upper[a])) return true;
    if (r.surface > 0) {
        if (r.law[0].linear) return true;  // wall_lines.hpp
        const Vec<T, D> before = v;
        if (respond_to_surface<T, D>(all.surfaces[r.surface - 1], law_with(r.law[0], rubs), x, wall,
                                     bound, all.cell_size, v, ClosingSpeed<Share, D>{share}))
            seen(b, 0, before, v);
        return true;
    }
    if (!r.is_box || r.law[0].response != Response::prescribed) return false;
    for (int a = 0; a < D; ++a)
        if (cell[a] < r.lower[a] || cell[a] >= r.upper[a]) return true;
    const Vec<T, D> before = v;
    v = respond_along(r.law[0], Vec<T, D>{}, before, wall);
    seen(b, 0, before, v);
    return true;
}

/// Where every body counts.
struct WholeShare {
    MPM_INLINE double operator()(std::uint64_t) const { return 1; }
};

template <bool special, class T, int D, class Seen, class Share = WholeShare>
MPM_INLINE void apply_boundary(const BoundaryView<D>& all, int b, const std::int64_t (&cell)[D],
                               const BoundAxes<D>& bound, Vec<T, D>& v, const Seen& seen,
                               bool rubs = true, const Share& share = {}) {
    const BoundaryRecord<D>& r = all.records[b];
    Vec<T, D> wall;
    for (int a = 0; a < D; ++a) wall[a] = T(r.velocity[a]);
    if constexpr (special) {
        if (apply_special<T, D>(all, b, cell, wall, bound, v, seen, rubs, share)) return;
    }
    if (!r.is_box) {
        // The wall of face x- lies at the lower side of cell 0: nodes 0 and beyond it are held.
        for (int face = 0; face < 2 * D; ++face) {
            const int a = face / 2;
            std::int64_t first = 0;
            if constexpr (special)
                first = r.law[face].linear ? 2 : 0;  // the others: wall_lines.hpp
            const bool held =
                face % 2 == 0 ? cell[a] <= r.lower[a] - first : cell[a] >= r.upper[a] - 1 + first;
            if (!r.present[face] || !held) continue;
            if constexpr (special) {
                if (mirrors(r.law[face].response)) continue;
            }
            const Vec<T, D> before = v;
            const int sign = face % 2 == 0 ? 1 : -1;
            const double height = face % 2 == 0 ? double(cell[a] - r.lower[a]) + 0.5
                                                : double(r.upper[a] - cell[a]) - 0.5;
            v = respond_at_face<special>(law_with(r.law[face], rubs), a, sign, height, before, wall,
                                         share);
            seen(b, face, before, v);
        }
        return;
    }
    // A box holds its inside by its nearest faces and the one layer of cells before each face.
    // Cells that touch it only by an edge or a corner stay free: holding them too would choke
    // gaps beside the box (design/walls.md).
    std::int64_t depth[2 * D], least = 0;
    int outside = 0;
    for (int a = 0; a < D; ++a) {
        depth[2 * a] = cell[a] - r.lower[a];
        depth[2 * a + 1] = r.upper[a] - 1 - cell[a];
        const std::int64_t nearest =
            depth[2 * a] < depth[2 * a + 1] ? depth[2 * a] : depth[2 * a + 1];
        outside += nearest < -1 ? 2 : (nearest < 0 ? 1 : 0);
        if (a == 0 || nearest < least) least = nearest;
    }
    if (outside > 1) return;
    // Inside, all faces at the least depth: with one alone, particles would slide in along the
    // diagonals.
    for (int f = 0; f < 2 * D; ++f) {
        if (depth[f] != least) continue;
        if constexpr (special) {
            if (r.law[f].linear && least < 1) continue;  // wall_lines.hpp
        }
        const Vec<T, D> before = v;
        v = respond_at_face<special>(law_with(r.law[f], rubs), f / 2, f % 2 == 0 ? -1 : 1,
                                     -double(depth[f]) - 0.5, before, wall, share);
        seen(b, f, before, v);
    }
}

/// What a boundary for some bodies alone, `part` of the node's mass, makes of a node's velocity
/// `v` where other walls have changed it from what the node would do by itself, `free`: it responds
/// to that. Of what it takes across itself, that which others have taken is not taken again,
/// nothing of axes on which lines hold the node; along itself it rubs with `rubs`, a part of what
/// presses there, against what others have left the node of its velocity along it, and stops that
/// part at most. So friction beside a wall in the same place is that of what presses on both. One
/// that sticks or prescribes has the node's velocity `v` as it is, without a part for others.
/// `seen` hears of it once, with the last of its faces.
template <class T, int D, class Seen, class Share>
MPM_CALL void respond_beside_others(const BoundaryView<D>& all, int b,
                                    const std::int64_t (&cell)[D], T part, T rubs,
                                    const Vec<T, D>& free, const BoundAxes<D>& lines, Vec<T, D>& v,
                                    const Seen& seen, const Share& share) {
    const Reconverge at_return;
    int face = -1;
    const auto hears = [&](int, int at, const Vec<T, D>&, const Vec<T, D>&) { face = at; };
    const Vec<T, D> before = v;
    Vec<T, D> smooth = free;
    apply_boundary<true>(all, b, cell, BoundAxes<D>{}, smooth, hears, false, share);
    if (face < 0) return;
    const Response law = all.records[b].law[all.records[b].surface > 0 ? 0 : face].response;
    if (law == Response::sticky || law == Response::prescribed) {
        // It acts on whole components: there is no direction that others have taken a part of.
        apply_boundary<true>(all, b, cell, BoundAxes<D>{}, v, hears, false, share);
        for (int a = 0; a < D; ++a) v[a] = before[a] + part * (v[a] - before[a]);
        return seen(b, face, before, v);
    }
    T size = 0, done = 0, lined = 0;  // by others, along what it takes
    for (int a = 0; a < D; ++a) {
        const T across = smooth[a] - free[a], by_others = across * (v[a] - free[a]);
        size += across * across;
        done += by_others;
        lined += lines.on[a] ? across * across : by_others;
    }
    if (!(size > T(0))) return seen(b, face, before, v);  // nothing presses
    T left = T(1) - lined / size;
    left = left > T(0) ? (left < T(1) ? left : T(1)) : T(0);
    // Pressed as the node would press by itself, and sliding as others leave it.
    Vec<T, D> slides, rough;
    for (int a = 0; a < D; ++a) slides[a] = rough[a] = v[a] - done / size * (smooth[a] - free[a]);
    apply_boundary<true>(all, b, cell, BoundAxes<D>{}, slides, hears, false, share);
    apply_boundary<true>(all, b, cell, BoundAxes<D>{}, rough, hears, true, share);
    for (int a = 0; a < D; ++a)
        v[a] += (lines.on[a] ? T(0) : part * left * (smooth[a] - free[a])) +
                rubs * (rough[a] - slides[a]);
    seen(b, face, before, v);
}

/// `seen(boundary, face, before, after)` hears of every response. `share(channels)` is the part of
/// the node's mass that a boundary acts on: the impulse of one that is for some bodies alone is
/// that of their mass, and what rubs on it may be another (`share.rubs`). Those come after all
/// others, whatever their order in the scene, since they ask what others, and those of them before,
/// have taken. `bound`: by lines towards walls, from the velocity `by_itself`.
template <bool special, class T, int D, class Seen, class Share = WholeShare>
MPM_INLINE void apply_boundaries(const BoundaryView<D>& all, const std::int64_t (&cell)[D],
                                 Vec<T, D>& v, const Seen& seen, const Share& share = {},
                                 const BoundAxes<D>& bound = {},
                                 const Vec<T, D>* by_itself = nullptr) {
    [[maybe_unused]] const Vec<T, D> free = by_itself ? *by_itself : v;
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active) continue;
        if constexpr (special) {
            if (r.share != 0) continue;
        }
        apply_boundary<special>(all, b, cell, bound, v, seen, true, share);
    }
    if constexpr (special) {
        if (!all.restricted) return;
        const auto changed = [&] {
            bool any = false;
            for (int a = 0; a < D; ++a) any = any || v[a] != free[a];
            return any;
        };
        for (int b = 0; b < all.count; ++b) {
            const BoundaryRecord<D>& r = all.records[b];
            if (!r.active || r.share == 0) continue;
            const T part = T(share(r.share));
            if (!(part > T(0))) continue;
            if (changed()) {
                T rubs = part;
                if constexpr (requires { share.rubs(b, part); }) rubs = share.rubs(b, part);
                respond_beside_others<T, D>(all, b, cell, part, rubs, free, bound, v, seen, share);
                continue;
            }
            const auto of_part = [&](const Vec<T, D>& from, const Vec<T, D>& to) {
                Vec<T, D> out;
                for (int a = 0; a < D; ++a) out[a] = from[a] + part * (to[a] - from[a]);
                return out;
            };
            const Vec<T, D> before = v;
            apply_boundary<true>(
                all, b, cell, bound, v,
                [&](int k, int face, const Vec<T, D>& x, const Vec<T, D>& y) {
                    seen(k, face, x, of_part(x, y));
                },
                true, share);
            v = of_part(before, v);
        }
    }
}

struct NothingSeen {
    template <class... A>
    MPM_INLINE void operator()(const A&...) const {}
};

/// The mirrored planes near one node: which node inside the domain it is an image of, and which
/// nodes share what lies there.
template <int D>
struct Images {
    int reach;
    std::int64_t inside[D];  // the cell that this node is, or is an image of
    bool mirrored = false;
    double sign[D];         // of the velocity here against that at `inside`
    std::int64_t at[D][3];  // on each axis: `inside`, then its images
    int count[D];           // of `at`
    bool reverses_all[D];   // of the planes of an axis: sticky ones
    int boundary[D], face[D];

    MPM_CALL Images(const BoundaryView<D>& all, const std::int64_t (&cell)[D]) : reach(all.reach) {
        const Reconverge at_return;
        for (int a = 0; a < D; ++a) {
            inside[a] = cell[a];
            sign[a] = 1;
            count[a] = 1;
            reverses_all[a] = false;
            boundary[a] = face[a] = -1;
        }
        for (int pass = 0; pass < 2; ++pass) {
            for (int b = 0; b < all.count; ++b) {
                const BoundaryRecord<D>& r = all.records[b];
                if (!r.active || r.is_box || r.surface > 0) continue;
                for (int f = 0; f < 2 * D; ++f) {
                    if (r.present[f] && mirrors(r.law[f].response)) see(r, b, f, pass);
                }
            }
        }
        for (int a = 0; a < D; ++a) at[a][0] = inside[a];
    }
    MPM_INLINE void see(const BoundaryRecord<D>& r, int b, int f, int pass) {
        const int a = f / 2;
        const std::int64_t plane = f % 2 == 0 ? r.lower[a] : r.upper[a];
        const std::int64_t image = 2 * plane - 1 - inside[a];
        const std::int64_t apart = f % 2 == 0 ? inside[a] - plane : plane - 1 - inside[a];
        const bool all = r.law[f].response == Response::mirror_sticky;
        if (pass == 0 && apart < 0 && apart >= -reach) {
            inside[a] = image;
            for (int c = 0; c < D; ++c)
                if (c == a || all) sign[c] = -sign[c];
        }
        // A face that two records mirror is one plane.
        const bool listed = count[a] > 1 && at[a][count[a] - 1] == image;
        if (pass == 1 && apart >= 0 && apart < reach && !listed && count[a] < 3) {
            mirrored = true;
            at[a][count[a]++] = image;
            reverses_all[a] = all;
            boundary[a] = b;
            face[a] = f;
        }
    }
    /// From here on the node `cell` shares no more by the planes across this axis.
    MPM_INLINE void part(int axis, std::int64_t cell) {
        at[axis][0] = cell;
        count[axis] = 1;
    }
    /// f(cell, sign of each component against that at `inside`) for every node that shares.
    template <class F>
    MPM_INLINE void each(const F& f) const {
        int all = 1;
        for (int a = 0; a < D; ++a) all *= count[a];
        for (int k = 0; k < all; ++k) {
            int rest = k;
            std::int64_t cell[D];
            double s[D];
            for (int a = 0; a < D; ++a) s[a] = 1;
            for (int a = 0; a < D; ++a) {
                const int which = rest % count[a];
                rest /= count[a];
                cell[a] = at[a][which];
                for (int c = 0; c < D && which > 0; ++c)
                    if (c == a || reverses_all[a]) s[c] = -s[c];
            }
            f(cell, s);
        }
    }
};

}  // namespace mpm
