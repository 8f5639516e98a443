// Weakly compressible fluid: Tait-Murnaghan equation of state in the precision-accelerated form
// (Bonus 2023, sections 5.4 and 5.12). The state is j = 1 - J [-], positive in compression,
// advanced as itself; J is never formed, so single precision keeps increments down to 1e-38 instead
// of 6e-8.
//
//   p = (K / gamma) (J^-gamma - 1) = (K / gamma) expm1(-gamma log1p(-j))           [Pa]
//   j <- j - eps (1 - j),   eps = dt tr(grad v)
//   tau = J sigma,  sigma = -p I + mu (grad v + grad v^T)
#pragma once

#include "mpm/core/linalg.hpp"
#include "mpm/physics/material/description.hpp"

namespace mpm {

struct TaitFluid {
    static constexpr const char* name = "TaitFluid";
    static constexpr const char* summary =
        "Weakly compressible fluid, Tait-Murnaghan law in j = 1 - J";
    static constexpr const char* source = "Bonus (2023), sections 5.4 and 5.12";
    static constexpr bool volumetric = true;  // stores a volume ratio alone, so F-bar may smooth it
    static constexpr const char* needs = "volume";
    static constexpr Column columns[] = {
        {"j", {1, 1}, "volume loss 1 - J, positive in compression", "1"}};
    static constexpr Parameter parameters[] = {
        {"density", "ρ", "kg/m³", 1000.0, 0.0, unbounded, true, true, "density at zero pressure"},
        {"bulk_modulus", "K", "Pa", 2.2e9, 0.0, unbounded, true, true,
         "bulk modulus at zero pressure; the sound speed is √(K/ρ)"},
        {"exponent", "γ", "1", 7.15, 1.0, 20.0, false, false,
         "growth of the bulk modulus with pressure"},
        {"viscosity", "μ", "Pa·s", 0.001, 0.0, unbounded, false, true, "dynamic viscosity"},
    };

    template <class T>
    struct Constants {
        T stiffness;  // K / gamma
        T exponent;
        T viscosity;
        // Single precision, near J = 1: K j (1 + j (series[0] + j (series[1] + ...))).
        T bulk;
        T series[5];
        T series_limit;  // of |j|
    };
    template <class T>
    static Constants<T> constants(const double* p) {
        Constants<T> c{T(p[1] / p[2]), T(p[2]), T(p[3]), T(p[1]), {}, T(0)};
        double term = 1;
        for (int k = 0; k < 5; ++k) {
            term *= (p[2] + k + 1) / (k + 2);
            c.series[k] = T(term);
        }
        // The first term left out is then below 3e-8 of the sum.
        c.series_limit = T(0.2 / (p[2] + 6));
        return c;
    }
    static double density(const double* p) { return p[0]; }
    /// Sound speed at zero pressure, m/s.
    static double wave_speed(const double* p) { return std::sqrt(p[1] / p[0]); }
    /// Largest dynamic viscosity, Pa s.
    static double viscosity(const double* p) { return p[3]; }

    template <int D>
    static constexpr int reals = 1;

    /// p(j), Pa. Water hardly ever leaves the range where a short series has all the digits of
    /// single precision. Each lane stands in its own range: its neighbours change nothing.
    template <class V, class T>
    MPM_INLINE static V pressure(V j, const Constants<T>& k) {
        if constexpr (sizeof(T) == 4) {
            const MaskOf<V> close = absolute(j) <= V(k.series_limit);
            if (any(close)) {
                V sum = V(k.series[4]);
                MPM_UNROLL for (int n = 3; n >= 0; --n) sum = sum * j + k.series[n];
                const V by_series = (k.bulk * j) * (sum * j + T(1));
                return all(close) ? by_series : select(close, by_series, by_law(j, k));
            }
        }
        return by_law(j, k);
    }

    template <class V, class T>
    MPM_INLINE static V by_law(V j, const Constants<T>& k) {
        return k.stiffness * expm1_of(-k.exponent * log1p_of(-j));
    }

    /// The image of J (1 + eps) without forming J.
    template <class V>
    MPM_INLINE static V advance_volume(V j, V eps) {
        return j - eps * (ScalarOf<V>(1) - j);
    }

    /// `strain` is dt grad v.
    template <class V, int D, class T>
    MPM_INLINE static void advance(V (&state)[1], const Mat<V, D>& strain, const Constants<T>&) {
        state[0] = advance_volume(state[0], trace(strain));
    }

    /// Kirchhoff stress, Pa; `rate` is grad v in 1/s.
    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> kirchhoff(const V (&state)[1], const Mat<V, D>& rate,
                                          const Constants<T>& k) {
        const V j = state[0];
        const V ratio = T(1) - j;
        const V p = pressure(j, k);
        Mat<V, D> tau;
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
            V s = k.viscosity * (rate.e[a][b] + rate.e[b][a]);
            tau.e[a][b] = ratio * (a == b ? s - p : s);
        }
        return tau;
    }

    /// Range in which the law means something: J between 0.05 and 20.
    template <class V, int D>
    MPM_INLINE static MaskOf<V> admissible(const V (&state)[1]) {
        using T = ScalarOf<V>;
        return (state[0] < V(T(0.95))) & (V(T(-19)) < state[0]);
    }
    static constexpr const char* limits = "its volume ratio left the range 0.05 to 20";

    /// The j at which the law gives pressure `p`, Pa.
    static double volume_from_pressure(double p, const double* q) {
        return -std::expm1(-std::log1p(q[2] * p / q[1]) / q[2]);
    }

    template <int D>
    MPM_HD static Observation<D> observe(const double* state, const double (&rate)[D][D],
                                         const double* q) {
        const double j = state[0], J = 1 - j, K = q[1], gamma = q[2], mu = q[3];
        Observation<D> o{};
        o.volume_ratio = J;
        const double p = K / gamma * std::expm1(-gamma * std::log1p(-j));
        double divergence = 0;
        for (int a = 0; a < D; ++a) divergence += rate[a][a];
        o.pressure = p - 2.0 / 3.0 * mu * divergence;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) {
                o.stress[a][b] = mu * (rate[a][b] + rate[b][a]) - (a == b ? p : 0.0);
                o.deformation[a][b] = a == b ? 1.0 : 0.0;
            }
        // The closed form loses all digits near J = 1; the series holds there.
        o.elastic_energy =
            std::abs(j) < 1e-3
                ? K * (0.5 * j * j + (gamma + 1) / 6 * j * j * j)
                : K / gamma * (J + std::pow(J, 1 - gamma) / (gamma - 1) - gamma / (gamma - 1));
        return o;
    }
};

}  // namespace mpm
