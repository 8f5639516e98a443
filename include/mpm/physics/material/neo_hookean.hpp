// Hyperelastic solid with the compressible neo-Hookean energy (Bonet & Wood 2008, section 6.4.3;
// named by Bonus 2023, section 5.7):
//
//   Psi = mu / 2 (tr F^T F - 3) - mu ln J + lambda / 2 (ln J)^2
//   tau = mu (b - I) + lambda ln J I
//
// Its energy grows without bound as J -> 0. The state is H = F - I, so that small strains keep
// their digits in single precision.
#pragma once

#include "mpm/physics/material/displacement.hpp"
#include "mpm/physics/material/logarithmic_volume.hpp"

namespace mpm {

struct NeoHookean : IsotropicElastic, StoresDisplacement, LogarithmicVolume {
    static constexpr const char* name = "NeoHookean";
    static constexpr const char* summary = "Hyperelastic solid, compressible neo-Hookean energy";
    static constexpr const char* source = "Bonet and Wood (2008), section 6.4.3";

    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> kirchhoff(const V (&state)[D * D], const Mat<V, D>&,
                                          const Constants<T>& k) {
        const Mat<V, D> h = displacement_gradient<D>(state), excess = left_cauchy_green_excess(h);
        const V volumetric_part = k.lame * log1p_of(volume_change(h));
        Mat<V, D> tau;
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
            tau.e[a][b] = k.shear * excess.e[a][b];
            if (a == b) tau.e[a][b] = tau.e[a][b] + volumetric_part;
        }
        return tau;
    }

    template <int D>
    MPM_HD static Observation<D> observe(const double* state, const double (&)[D][D],
                                         const double* q) {
        double own[D * D];
        for (int r = 0; r < D * D; ++r) own[r] = state[r];
        const auto k = Elasticity<double>::of(q[1], q[2]);
        const Mat<double, D> h = displacement_gradient<D>(own);
        const Mat<double, D> tau = kirchhoff<double, D, double>(own, Mat<double, D>{}, k);
        const double log_J = std::log1p(volume_change(h));
        // Plane strain: tau_33 = lambda ln J.
        Observation<D> o = observe_displacement<D>(h, tau, D == 2 ? k.lame * log_J : 0.0);
        // In principal strains, where nothing small is left of large numbers that cancel.
        const auto strain = log_strain(left_cauchy_green_excess(h), 0.0);
        double distance = 0;
        for (int a = 0; a < D; ++a) distance += excess_of_exponential(2 * strain.e[a]);
        o.elastic_energy = 0.5 * k.shear * distance + 0.5 * k.lame * log_J * log_J;
        return o;
    }

private:
    /// exp(x) - 1 - x, by its series where the difference loses digits.
    MPM_HD static double excess_of_exponential(double x) {
        if (std::fabs(x) > 1e-2) return std::expm1(x) - x;
        return x * x * (0.5 + x * (1.0 / 6 + x * (1.0 / 24 + x * (1.0 / 120 + x / 720))));
    }
};

}  // namespace mpm
