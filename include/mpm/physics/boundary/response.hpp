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
#pragma once

#include "mpm/core/linalg.hpp"

namespace mpm {

enum class Response : int { sticky = 0, slip = 1, separable = 2 };

struct SurfaceLaw {
    Response response = Response::slip;
    double static_friction = 0;
    double dynamic_friction = 0;
};

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
        T keep = 1;
        if (tangential <= T(law.static_friction) * removed)
            keep = 0;
        else if (tangential > T(0)) {
            keep = T(1) - T(law.dynamic_friction) * removed / tangential;
            keep = keep < T(0) ? T(0) : keep;
        }
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            if (a != axis) out[a] = wall[a] + keep * (velocity[a] - wall[a]);
        }
    }
    return out;
}

}  // namespace mpm
