// What one wall does to one node (Bonus 2023, section 5.3 in the consistent form of the
// digest, 1.10): the outward normal n points out of the wall, u is the node's velocity relative to
// the wall, u_n = u . n.
//
//   sticky     u <- 0
//   slip       u <- u - u_n n
//   separable  the same where u_n < 0, nothing where the material leaves
//
// Coulomb friction takes from the tangential part at most static * |removed normal speed| whole,
// else the fraction dynamic * |removed normal speed| / |u_t|.
//
//   mirror     the nodes beyond the plane are images of those before it, so that the plane itself
//              is held (design/walls.md); `mirror_sticky` reverses the tangential part as well
//   prescribed the wall's velocity, on the axes that are named, inside a region and nowhere else
#pragma once

#include "mpm/core/linalg.hpp"

namespace mpm {

enum class Response : int {
    sticky = 0,
    slip = 1,
    separable = 2,
    mirror = 3,
    mirror_sticky = 4,
    prescribed = 5
};

MPM_HD inline bool mirrors(Response r) {
    return r == Response::mirror || r == Response::mirror_sticky;
}

struct SurfaceLaw {
    Response response = Response::slip;
    double static_friction = 0;
    double dynamic_friction = 0;
    int axes = 0;  // prescribed: bit mask of the components that are
    // Slip and separable faces of boxes and of the domain: the cells beside them strain linearly
    // (kernels/wall_lines.hpp), in place of nodes that are held one by one.
    bool linear = false;
    // Linear by default and not by name: held where that is not known to be right, beside round
    // and steep surfaces and within reach of what moves (kernels/surface_lines.hpp).
    bool cautious = false;
};

/// Share of the tangential speed that Coulomb friction leaves where so much normal speed is
/// removed.
template <class T>
MPM_INLINE T kept_of_sliding(const SurfaceLaw& law, T tangential, T removed) {
    if (tangential <= T(law.static_friction) * removed) return 0;
    if (!(tangential > T(0))) return 1;
    const T keep = T(1) - T(law.dynamic_friction) * removed / tangential;
    return keep < T(0) ? T(0) : keep;
}

/// The normal is +1 or -1 along `axis`. Returns the new velocity.
template <class T, int D>
MPM_INLINE Vec<T, D> respond(const SurfaceLaw& law, int axis, T sign, const Vec<T, D>& velocity,
                             const Vec<T, D>& wall) {
    if (law.response == Response::sticky) return wall;
    const T normal = (velocity[axis] - wall[axis]) * sign;
    if (law.response == Response::separable && !(normal < T(0))) return velocity;
    Vec<T, D> out = velocity;
    out[axis] = wall[axis];
    if (law.static_friction > 0 || law.dynamic_friction > 0) {
        const T removed = normal < T(0) ? -normal : T(0);
        T tangential = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            if (a != axis) tangential += (velocity[a] - wall[a]) * (velocity[a] - wall[a]);
        }
        tangential = square_root(tangential);
        const T keep = kept_of_sliding<T>(law, tangential, removed);
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            if (a != axis) out[a] = wall[a] + keep * (velocity[a] - wall[a]);
        }
    }
    return out;
}

/// The velocity of a wall that lets go, to what lies off it and closes a gap first: less that with
/// which the gap closes in a step, `closing_speed()` m/s. Asked only where the wall would act.
template <class T, int D, class Closing>
MPM_INLINE Vec<T, D> wall_behind_gap(const SurfaceLaw& law, const Vec<T, D>& normal,
                                     const Vec<T, D>& velocity, Vec<T, D> wall,
                                     const Closing& closing_speed) {
    if (law.response != Response::separable) return wall;
    T along = 0;
    MPM_UNROLL for (int a = 0; a < D; ++a) along += (velocity[a] - wall[a]) * normal[a];
    if (!(along < T(0))) return wall;
    const T speed = closing_speed();
    MPM_UNROLL for (int a = 0; a < D; ++a) wall[a] -= speed * normal[a];
    return wall;
}

/// The same for a unit normal of any direction.
template <class T, int D>
MPM_INLINE Vec<T, D> respond_along(const SurfaceLaw& law, const Vec<T, D>& normal,
                                   const Vec<T, D>& velocity, const Vec<T, D>& wall) {
    if (law.response == Response::sticky) return wall;
    Vec<T, D> out = velocity;
    if (law.response == Response::prescribed) {
        MPM_UNROLL for (int a = 0; a < D; ++a) out[a] = law.axes >> a & 1 ? wall[a] : velocity[a];
        return out;
    }
    T along = 0;
    MPM_UNROLL for (int a = 0; a < D; ++a) along += (velocity[a] - wall[a]) * normal[a];
    if (law.response == Response::separable && !(along < T(0))) return velocity;
    T keep = 1;
    if (law.static_friction > 0 || law.dynamic_friction > 0) {
        const T removed = along < T(0) ? -along : T(0);
        T tangential = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const T t = velocity[a] - wall[a] - along * normal[a];
            tangential += t * t;
        }
        keep = kept_of_sliding<T>(law, square_root(tangential), removed);
    }
    MPM_UNROLL for (int a = 0; a < D; ++a) out[a] =
        wall[a] + keep * (velocity[a] - wall[a] - along * normal[a]);
    return out;
}

}  // namespace mpm
