// What solids share whose state is the displacement gradient H = F - I. Two dimensions are plane
// strain.
#pragma once

#include "mpm/core/linalg.hpp"
#include "mpm/physics/material/description.hpp"

namespace mpm {

template <int D, class V>
MPM_INLINE Mat<V, D> displacement_gradient(const V (&state)[D * D]) {
    Mat<V, D> h;
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) h.e[a][b] =
        state[a * D + b];
    return h;
}

/// H <- H + dt grad v (I + H)
template <class V, int D>
MPM_INLINE void advance_displacement_gradient(V (&state)[D * D], const Mat<V, D>& strain) {
    const Mat<V, D> h = displacement_gradient<D>(state);
    const Mat<V, D> change = product(strain, h);
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
        state[a * D + b] = h.e[a][b] + (strain.e[a][b] + change.e[a][b]);
    }
}

/// b - I = H + H^T + H H^T
template <class V, int D>
MPM_INLINE Mat<V, D> left_cauchy_green_excess(const Mat<V, D>& h) {
    Mat<V, D> excess = product_transposed(h, h);
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
        excess.e[a][b] = excess.e[a][b] + (h.e[a][b] + h.e[b][a]);
    }
    return excess;
}

/// Volume ratio between 0.05 and 20; false for what is not a number.
template <int D, class V>
MPM_INLINE MaskOf<V> admissible_displacement_gradient(const V (&state)[D * D]) {
    using T = ScalarOf<V>;
    const V dJ = volume_change(displacement_gradient<D>(state));
    return (V(T(-0.95)) < dJ) & (dJ < V(T(19)));
}

/// What materials share whose state is H alone.
struct StoresDisplacement {
    static constexpr const char* needs = "deformation_gradient";
    static constexpr bool stores_gradient = true;
    static constexpr Column columns[] = {{"H", {4, 9}, "displacement gradient F - I", "1"}};
    template <int D>
    static constexpr int reals = (D * D);

    template <class V, int D, class T = ScalarOf<V>, class Constants>
    MPM_INLINE static void advance(V (&state)[D * D], const Mat<V, D>& strain, const Constants&) {
        advance_displacement_gradient(state, strain);
    }
    template <class V, int D>
    MPM_INLINE static MaskOf<V> admissible(const V (&state)[D * D]) {
        return admissible_displacement_gradient<D>(state);
    }
    static constexpr const char* limits =
        "its volume ratio left the range 0.05 to 20 (crushed, inverted or torn)";

    // For F-bar: 1 - J, and F scaled to another one, in plane strain within the plane.
    template <int D, class V>
    MPM_INLINE static V volume_loss(const V (&state)[D * D]) {
        return -volume_change(displacement_gradient<D>(state));
    }
    template <int D, class V>
    MPM_INLINE static void scale_volume(V (&state)[D * D], V from, V to) {
        using T = ScalarOf<V>;
        const V more = expm1_of(T(1.0 / D) * (log1p_of(-to) - log1p_of(-from)));
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
            V& h = state[a * D + b];
            h = h + more * (a == b ? T(1) + h : h);
        }
    }
};

/// What a reader sees, but for the energy; `out_of_plane` is tau_33 in two dimensions.
template <int D>
MPM_HD inline Observation<D> observe_displacement(const Mat<double, D>& h,
                                                  const Mat<double, D>& tau, double out_of_plane) {
    Observation<D> o{};
    const double J = 1 + volume_change(h);
    o.volume_ratio = J;
    double sum = out_of_plane / J;
    for (int a = 0; a < D; ++a)
        for (int b = 0; b < D; ++b) {
            o.stress[a][b] = tau.e[a][b] / J;
            o.deformation[a][b] = h.e[a][b] + (a == b ? 1.0 : 0.0);
            if (a == b) sum += o.stress[a][b];
        }
    o.pressure = -sum / 3;
    return o;
}

}  // namespace mpm
