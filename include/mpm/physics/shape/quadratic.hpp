// Quadratic B-splines on a grid whose node i is the centre of cell i (Bonus 2023, eq. 2.28). A
// particle in cell c touches the nodes c-1, c, c+1 on each axis; xi is its offset from the centre
// of c in cells. The formulae hold for any xi in [-1/2, 1/2].
#pragma once

#include "mpm/core/linalg.hpp"

namespace mpm {

template <class V, int D>
struct Weights {
    V value[D][3];
    V xi[D];
    MPM_INLINE const V& offset(int axis) const { return xi[axis]; }
};

template <class V, int D>
MPM_INLINE Weights<V, D> quadratic_weights(const Vec<V, D>& xi) {
    using T = ScalarOf<V>;
    Weights<V, D> w;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        w.xi[a] = xi[a];
        V below = T(0.5) - xi[a], above = T(0.5) + xi[a];
        w.value[a][0] = (T(0.5) * below) * below;
        w.value[a][1] = T(0.75) - xi[a] * xi[a];
        w.value[a][2] = (T(0.5) * above) * above;
    }
    return w;
}

/// 1 / D_p in cells: the second moment of the quadratic spline is 1/4 everywhere, so four times a
/// first moment is a slope.
inline constexpr double quadratic_inverse_moment = 4.0;

template <int D>
inline constexpr int stencil_nodes = D == 2 ? 9 : 27;

}  // namespace mpm
