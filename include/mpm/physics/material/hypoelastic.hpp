// Isotropic linear law in rates, with the spin terms of Jaumann and the volume term of Hill (de
// Koster 2018, eqs 2.4-2.8 and 2.40-2.45):
//
//   de, dw = sym, skew of dt grad v,   sigma, J on the right those before the step
//   sigma <- sigma + 2 mu de + lambda tr(de) I - tr(de) sigma + dw sigma - sigma dw
//   J <- J (1 + tr(de))
//
// Up to the second order of a step this is d tau = J D:de + dw tau - tau dw in Kirchhoff's stress.
// One explicit step of first order, as in the source. A step that turns by an angle a keeps the
// pressure and the volume and stretches the rest of the stress by up to sqrt(1 + 4 a^2): the law is
// objective for small steps only.
#pragma once

#include "mpm/physics/material/elasticity.hpp"

namespace mpm {

struct Hypoelastic : IsotropicElastic {
    static constexpr const char* name = "Hypoelastic";
    static constexpr const char* summary =
        "Linear elastic law in rates, Jaumann and Hill terms; for small steps";
    static constexpr const char* source = "de Koster (2018), equations 2.4 and 2.40 to 2.45";
    static constexpr const char* needs = "stress";
    static constexpr Column columns[] = {
        {"sigma", {4, 6}, "Cauchy stress; 2D: and the one out of the plane", "Pa"},
        {"dJ", {1, 1}, "volume change J - 1", "1"}};

    /// Stress in the plane, in two dimensions sigma_zz, then J - 1, which keeps the digits of small
    /// changes in single precision.
    template <int D>
    static constexpr int reals = D == 2 ? 5 : 7;
    template <int D>
    static constexpr int volume = reals<D> - 1;

    template <class V, int D, class T>
    MPM_INLINE static void advance(V (&state)[reals<D>], const Mat<V, D>& strain,
                                   const Constants<T>& k) {
        const V change = trace(strain);
        Mat<V, D> sigma = load_symmetric<D>(state), spin;
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
            spin.e[a][b] = T(0.5) * (strain.e[a][b] - strain.e[b][a]);
        }
        // Its transpose is -sigma dw.
        const Mat<V, D> turned = product(spin, sigma);
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b <= a; ++b) {
            V gain = k.shear * (strain.e[a][b] + strain.e[b][a]);
            if (a == b) gain = gain + k.lame * change;
            gain = gain + (turned.e[a][b] + turned.e[b][a]);
            sigma.e[a][b] = sigma.e[a][b] + (gain - change * sigma.e[a][b]);
        }
        store_symmetric<D>(state, sigma);
        if constexpr (D == 2) state[3] = state[3] + change * (k.lame - state[3]);
        state[volume<D>] = state[volume<D>] + (change + change * state[volume<D>]);
    }
    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> kirchhoff(const V (&state)[reals<D>], const Mat<V, D>&,
                                          const Constants<T>&) {
        Mat<V, D> tau = load_symmetric<D>(state);
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
            tau.e[a][b] = tau.e[a][b] + state[volume<D>] * tau.e[a][b];
        }
        return tau;
    }
    /// Volume ratio between 0.05 and 20, and all that is stored a number.
    template <class V, int D>
    MPM_INLINE static MaskOf<V> admissible(const V (&state)[reals<D>]) {
        using T = ScalarOf<V>;
        const V change = state[volume<D>];
        MaskOf<V> fine = (V(T(-0.95)) < change) & (change < V(T(19)));
        MPM_UNROLL for (int r = 0; r < volume<D>; ++r) fine = fine & is_finite(state[r]);
        return fine;
    }
    static constexpr const char* limits =
        "its volume ratio left the range 0.05 to 20 (crushed, inverted or torn), or its stress is "
        "not a number";

    template <int D, class V>
    MPM_INLINE static V volume_loss(const V (&state)[reals<D>]) {
        return -state[volume<D>];
    }

    template <int D>
    MPM_HD static Observation<D> observe(const double* state, const double (&)[D][D],
                                         const double* q) {
        double own[reals<D>];
        for (int r = 0; r < reals<D>; ++r) own[r] = state[r];
        const auto k = Elasticity<double>::of(q[1], q[2]);
        const Mat<double, D> sigma = load_symmetric<D>(own);
        const double out_of_plane = D == 2 ? own[3] : 0.0, mean = (trace(sigma) + out_of_plane) / 3;
        Observation<D> o{};
        o.volume_ratio = 1 + own[volume<D>];
        o.pressure = -mean;
        // The square of the deviator.
        double squares = D == 2 ? (out_of_plane - mean) * (out_of_plane - mean) : 0.0;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) {
                const double part = sigma.e[a][b] - (a == b ? mean : 0.0);
                squares += part * part;
                o.stress[a][b] = sigma.e[a][b];
                o.deformation[a][b] = a == b ? 1.0 : 0.0;
            }
        // A law in rates stores no energy: the work along a path depends on the path. This is what
        // linear elasticity stores at this stress; it grows by the work done less tr(de) times
        // itself.
        o.elastic_energy =
            o.volume_ratio * (squares / (4 * k.shear) + 0.5 * mean * mean / k.bulk());
        return o;
    }
};

}  // namespace mpm
