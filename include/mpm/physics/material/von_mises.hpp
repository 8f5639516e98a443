// Elastic-plastic metal: von Mises yield with linear isotropic hardening, in the logarithmic strain
// with Hencky's energy (Simo 1992), so that the return is that of small strains.
//
//   f = |s| - sqrt(2/3) (sigma_y + H a) <= 0,   s = dev tau,  tau = 2 mu e + lambda tr(e) I
//   d gamma = f / (2 mu + 2/3 H),   e <- e - d gamma s / |s|,   a <- a + sqrt(2/3) d gamma
#pragma once

#include "mpm/physics/material/elasticity.hpp"

namespace mpm {

struct VonMises : HenckyFlow<VonMises> {
    static constexpr const char* name = "VonMises";
    static constexpr const char* summary =
        "Elastic-plastic solid, von Mises yield with linear hardening";
    static constexpr const char* source = "Simo (1992)";
    static constexpr Column columns[] = {
        elastic_column, {"plastic_strain", {1, 1}, "accumulated equivalent plastic strain", "1"}};
    static constexpr Parameter parameters[] = {
        solid_density,
        youngs_modulus,
        poissons_ratio,
        {"yield_stress", "σ_y", "Pa", required, 0.0, unbounded, true, true,
         "yield stress in uniaxial tension (Kirchhoff)"},
        {"hardening_modulus", "H", "Pa", 0.0, 0.0, unbounded, false, true,
         "growth of the yield stress with the plastic strain"},
    };

    template <class T>
    struct Constants {
        Elasticity<T> elastic;
        T yield;       // sqrt(2/3) sigma_y
        T hardening;   // sqrt(2/3) H
        T compliance;  // 1 / (2 mu + 2/3 H)
    };
    template <class T>
    static Constants<T> constants(const double* p) {
        const auto e = Elasticity<double>::of(p[1], p[2]);
        const double part = std::sqrt(2.0 / 3);
        return {{T(e.shear), T(e.lame)},
                T(part * p[3]),
                T(part * p[4]),
                T(1 / (2 * e.shear + 2.0 / 3 * p[4]))};
    }

    /// B in the plane, in two dimensions the strain out of the plane, then the plastic strain.
    template <int D>
    static constexpr int reals = D == 2 ? 5 : 7;
    template <int D>
    static constexpr int hardened = reals<D> - 1;

    /// Advances the state and returns the Kirchhoff stress.
    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> respond(V (&state)[reals<D>], const Mat<V, D>& strain,
                                        const Constants<T>& k) {
        const V zero = V(T(0));
        const Mat<V, D> trial = advance_left_cauchy_green(load_symmetric<D>(state), strain);
        LogStrain<V, D> s = log_strain(trial, D == 2 ? state[3] : zero);
        const Vec<V, 3> dev = s.deviator();
        const V size = norm(dev);  // of e; that of s is 2 mu times it
        const V over =
            (T(2) * k.elastic.shear) * size - (k.yield + k.hardening * state[hardened<D>]);
        const auto yields = zero < over;
        const V flow = select(yields, k.compliance * over, zero);
        const V part = flow / select(zero < size, size, V(T(1)));
        MPM_UNROLL for (int i = 0; i < 3; ++i) s.e[i] = s.e[i] - part * dev[i];
        HenckyFlow::template keep<D>(state, yields, trial, s);
        state[hardened<D>] = state[hardened<D>] + T(equivalent_share) * flow;
        return hencky_stress(s, k.elastic);
    }
    template <class V, int D>
    MPM_INLINE static MaskOf<V> admissible(const V (&state)[reals<D>]) {
        using T = ScalarOf<V>;
        const V hard = state[hardened<D>];
        return HenckyFlow::template admissible_strain<D>(state) & (V(T(-1)) < hard) &
               (hard < V(T(1e6)));
    }
    static constexpr const char* limits =
        "its volume ratio left the range 0.05 to 20, or its plastic strain 1e6";

    // For F-bar: 1 - J, all of it elastic as flow keeps the volume, and the elastic strain made
    // that of another volume, alike along all axes: then the deviator stays on the yield surface.
    template <int D, class V>
    MPM_INLINE static V volume_loss(const V (&state)[reals<D>]) {
        return volume_loss_of(load_symmetric<D>(state), D == 2 ? state[3] : V(ScalarOf<V>(0)));
    }
    template <int D, class V>
    MPM_INLINE static void scale_volume(V (&state)[reals<D>], V from, V to) {
        const V each = ScalarOf<V>(1.0 / 3) * (log1p_of(-to) - log1p_of(-from));
        add_to_log_strains<D>(state, each);
        if constexpr (D == 2) state[3] = state[3] + each;
    }

    template <int D>
    MPM_HD static Observation<D> observe(const double* state, const double (&)[D][D],
                                         const double* q) {
        double own[reals<D>];
        for (int r = 0; r < reals<D>; ++r) own[r] = state[r];
        const auto s = elastic_strain<D>(own);
        const auto e = Elasticity<double>::of(q[1], q[2]);
        Observation<D> o = observe_hencky<D>(s, e, std::exp(s.volumetric()));
        o.plastic_strain = own[hardened<D>];
        const double size = 2 * e.shear * norm(s.deviator()),
                     limit = std::sqrt(2.0 / 3) * (q[3] + q[4] * o.plastic_strain);
        o.yields = o.plastic_strain > 0 && size > (1 - 1e-5) * limit;
        return o;
    }
};

}  // namespace mpm
