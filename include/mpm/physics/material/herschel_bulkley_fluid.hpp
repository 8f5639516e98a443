// Mud, debris flow, lahar: Herschel-Bulkley fluid, whose volume follows the law of TaitFluid
// (Herschel and Bulkley 1926; yield regularised after Papanastasiou 1987).
//
//   tau = J sigma,  sigma = -p(j) I + 2 mu(g) dev(D),   D = (grad v + grad v^T) / 2    [Pa]
//   g = sqrt(2 dev(D) : dev(D))                                    shear rate          [1/s]
//   mu(g) = min(mu_max, tau_y (1 - exp(-m g)) / g + k g^(n-1)),    m = mu_max / tau_y  [Pa s]
//
// mu_max bounds the law at both ends. As g -> 0 the yield term tends to mu_max: what should stand
// still creeps like a fluid of that viscosity, at less than tau_y / mu_max, and stresses within
// exp(-m g) of the yield stress are the ideal law's. At large rates it bounds n > 1. Deviators are
// three-dimensional, in plane strain with the part out of the plane; mu g is the shear stress
// sqrt(s : s / 2), which is held against tau_y. TaitFluid's viscous term is 2 mu D without the
// deviator: with n = 1 and no yield stress the two differ by -2/3 mu tr(D) I.
#pragma once

#include "mpm/physics/material/tait_fluid.hpp"

namespace mpm {

/// State, volume law, its limits and its inverse are TaitFluid's own.
struct HerschelBulkleyFluid : TaitFluid {
    static constexpr const char* name = "HerschelBulkleyFluid";
    static constexpr const char* summary =
        "Mud or lahar: Herschel-Bulkley shear law over TaitFluid's volume law";
    static constexpr const char* source =
        "Herschel and Bulkley (1926); Papanastasiou (1987); volume: Bonus (2023), section 5.12";
    static constexpr Parameter parameters[] = {
        {"density", "ρ", "kg/m³", required, 0.0, unbounded, true, true, "density at zero pressure"},
        {"bulk_modulus", "K", "Pa", 2.2e9, 0.0, unbounded, true, true,
         "bulk modulus at zero pressure; the sound speed is √(K/ρ)"},
        {"exponent", "γ", "1", 7.15, 1.0, 20.0, false, false,
         "growth of the bulk modulus with pressure"},
        {"yield_stress", "τ_y", "Pa", required, 0.0, unbounded, false, true,
         "shear stress below which it only creeps"},
        {"consistency", "k", "Pa·sⁿ", required, 0.0, unbounded, false, true,
         "shear stress above the yield stress at 1/s; the plastic viscosity where n = 1"},
        {"index", "n", "1", 1.0, 0.1, 2.0, false, false,
         "flow index: 1 Bingham, less thins with the shear rate, more thickens"},
        {"largest_viscosity", "μ_max", "Pa·s", required, 0.0, unbounded, true, true,
         "bound of the viscosity at any rate, and that of creep below the yield stress "
         "(m = μ_max/τ_y after Papanastasiou); limits the time step"},
    };

    /// What the viscosity depends on.
    template <class T>
    struct ShearLaw {
        T plateau;      // of the yield term at rest: mu_max, or 0 without a yield stress
        T sharpness;    // m, s
        T consistency;  // k
        T power;        // n - 1
        T largest;      // mu_max
    };
    template <class T>
    MPM_HD static ShearLaw<T> shear_law(const double* p) {
        const bool yields = p[3] > 0;
        return {T(yields ? p[6] : 0.0), T(yields ? p[6] / p[3] : 0.0), T(p[4]), T(p[5] - 1),
                T(p[6])};
    }
    template <class T>
    struct Constants : TaitFluid::Constants<T> {
        ShearLaw<T> law;
    };
    template <class T>
    static Constants<T> constants(const double* p) {
        const double volume[] = {p[0], p[1], p[2], 0.0};
        return {TaitFluid::constants<T>(volume), shear_law<T>(p)};
    }
    static constexpr bool yields = true;  // `observe` says whether it does
    /// Largest dynamic viscosity, Pa s.
    static double viscosity(const double* p) { return p[6]; }

    /// dev(D), 1/s, and the shear rate that belongs to it.
    template <class V, int D>
    struct Shear {
        Mat<V, D> deviator;
        V rate;
    };
    template <class V, int D>
    MPM_INLINE static Shear<V, D> shear(const Mat<V, D>& rate) {
        using T = ScalarOf<V>;
        const V mean = T(1.0 / 3) * trace(rate);
        Shear<V, D> s;
        // In plane strain the deviator has -mean out of the plane.
        V square = V(T(0));
        if constexpr (D == 2) square = mean * mean;
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            MPM_UNROLL for (int b = 0; b < D; ++b) {
                const V d = T(0.5) * (rate.e[a][b] + rate.e[b][a]);
                s.deviator.e[a][b] = a == b ? d - mean : d;
                square = square + s.deviator.e[a][b] * s.deviator.e[a][b];
            }
        }
        s.rate = square_root(T(2) * square);
        return s;
    }

    /// mu(g), Pa s, finite for every g >= 0.
    template <class V, class T>
    MPM_INLINE static V effective_viscosity(V g, const ShearLaw<T>& k) {
        const V zero = V(T(0)), one = V(T(1));
        const V x = k.sharpness * g;
        const auto moves = zero < x;
        const V yield = k.plateau * select(moves, -expm1_of(-x) / select(moves, x, one), one);
        // The logarithm needs a normal number; at slower rates the stress is nothing.
        const V power = exp_of(k.power * log_of(larger(g, V(T(1e-30)))));
        return smaller(yield + k.consistency * power, V(k.largest));
    }

    /// Kirchhoff stress, Pa; `rate` is grad v in 1/s.
    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> kirchhoff(const V (&state)[1], const Mat<V, D>& rate,
                                          const Constants<T>& k) {
        const V j = state[0];
        const V ratio = T(1) - j;
        const V p = pressure(j, k);
        const Shear<V, D> s = shear(rate);
        const V twice = T(2) * effective_viscosity(s.rate, k.law);
        Mat<V, D> tau;
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
            const V t = twice * s.deviator.e[a][b];
            tau.e[a][b] = ratio * (a == b ? t - p : t);
        }
        return tau;
    }

    template <int D>
    MPM_HD static Observation<D> observe(const double* state, const double (&rate)[D][D],
                                         const double* q) {
        const double volume[] = {q[0], q[1], q[2], 0.0};
        Observation<D> o = TaitFluid::observe<D>(state, rate, volume);
        Mat<double, D> gradient;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) gradient.e[a][b] = rate[a][b];
        const Shear<double, D> s = shear(gradient);
        const double mu = effective_viscosity(s.rate, shear_law<double>(q));
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) o.stress[a][b] += 2 * mu * s.deviator.e[a][b];
        // The regularised law reaches the yield stress only in the limit.
        o.yields = mu * s.rate > 0.999 * q[3];
        return o;
    }
};

}  // namespace mpm
