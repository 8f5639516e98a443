// Hyperelastic solid, quadratic in the logarithmic strain (Bonus 2023, section 5.7, the elastic
// part of its sand; Hencky 1928):
//
//   Psi = mu sum e_i^2 + lambda / 2 (sum e_i)^2,   e_i = ln sigma_i
//   tau = 2 mu e + lambda tr(e) I
#pragma once

#include "mpm/physics/material/logarithmic_volume.hpp"

namespace mpm {

struct StVenantKirchhoffHencky : IsotropicElastic, LogarithmicVolume {
    static constexpr const char* name = "StVenantKirchhoffHencky";
    static constexpr const char* summary =
        "Hyperelastic solid, quadratic in the logarithmic strain";
    static constexpr const char* source = "Bonus (2023), section 5.7; Hencky (1928)";
    static constexpr const char* needs = "elastic_strain";
    static constexpr Column columns[] = {
        {"B", {3, 6}, "left Cauchy-Green tensor less the identity", "1"}};

    template <int D>
    static constexpr int reals = symmetric_reals<D>;

    template <class V, int D, class T>
    MPM_INLINE static void advance(V (&state)[reals<D>], const Mat<V, D>& strain,
                                   const Constants<T>&) {
        store_symmetric<D>(state, advance_left_cauchy_green(load_symmetric<D>(state), strain));
    }
    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> kirchhoff(const V (&state)[reals<D>], const Mat<V, D>&,
                                          const Constants<T>& k) {
        return hencky_stress(log_strain(load_symmetric<D>(state), V(T(0))), k);
    }
    template <class V, int D>
    MPM_INLINE static MaskOf<V> admissible(const V (&state)[reals<D>]) {
        return admissible_left_cauchy_green(load_symmetric<D>(state), V(ScalarOf<V>(0)));
    }
    static constexpr const char* limits =
        "its volume ratio left the range 0.05 to 20 (crushed, inverted or torn)";

    // For F-bar: 1 - J, and F scaled to another one, in plane strain within the plane.
    template <int D, class V>
    MPM_INLINE static V volume_loss(const V (&state)[reals<D>]) {
        return volume_loss_of(load_symmetric<D>(state), V(ScalarOf<V>(0)));
    }
    template <int D, class V>
    MPM_INLINE static void scale_volume(V (&state)[reals<D>], V from, V to) {
        add_to_log_strains<D>(state, ScalarOf<V>(1.0 / D) * (log1p_of(-to) - log1p_of(-from)));
    }

    template <int D>
    MPM_HD static Observation<D> observe(const double* state, const double (&)[D][D],
                                         const double* q) {
        double own[reals<D>];
        for (int r = 0; r < reals<D>; ++r) own[r] = state[r];
        const auto s = log_strain(load_symmetric<D>(own), 0.0);
        return observe_hencky<D>(s, Elasticity<double>::of(q[1], q[2]), std::exp(s.volumetric()));
    }
};

}  // namespace mpm
