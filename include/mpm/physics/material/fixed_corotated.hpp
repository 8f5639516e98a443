// Hyperelastic solid with the fixed corotated energy (Bonus 2023, section 5.7):
//
//   Psi = mu sum (sigma_i - 1)^2 + lambda / 2 (J - 1)^2
//   tau = P F^T = 2 mu (F - R) F^T + lambda (J - 1) J I
//
// The state is H = F - I, so that small strains keep their digits in single precision. With
// V = F R^T the left stretch and b - I = H + H^T + H H^T,
//
//   (F - R) F^T = (V - I) V = (b - I) - (b - I) (V + I)^-1
//
// and no difference of nearly equal matrices is formed. Two dimensions are plane strain.
#pragma once

#include "mpm/physics/material/displacement.hpp"
#include "mpm/physics/material/elasticity.hpp"

namespace mpm {

namespace detail {

/// Rotation of the polar decomposition of a matrix with positive determinant by Newton's iteration,
/// which doubles the correct digits each round. Each lane stops for itself, when it moves no more:
/// what it gets does not depend on its neighbours.
template <class V>
MPM_INLINE Mat<V, 3> polar_rotation(const Mat<V, 3>& f) {
    using T = ScalarOf<V>;
    constexpr T still = sizeof(T) == 4 ? T(1e-4) : T(1e-8);  // squared by the round that follows it
    Mat<V, 3> r = f;
    MaskOf<V> active = V(T(0)) <= V(T(0));
    for (int round = 0; round < 12; ++round) {
        const Mat<V, 3> c = cofactors(r);
        const V own = select(active, V(T(0.5)), V(T(1)));
        const V other = select(active, T(0.5) / determinant(r, c), V(T(0)));
        V moved = V(T(0));
        MPM_UNROLL for (int i = 0; i < 3; ++i) MPM_UNROLL for (int j = 0; j < 3; ++j) {
            const V next = own * r.e[i][j] + other * c.e[i][j];
            moved = larger(moved, absolute(next - r.e[i][j]));
            r.e[i][j] = next;
        }
        active = moved > V(still);
        if (!any(active)) break;
    }
    return r;
}

template <class V>
MPM_INLINE Mat<V, 3> left_stretch(const Mat<V, 3>& f, V) {
    return product_transposed(f, polar_rotation(f));
}

/// Closed form: V = (b + J I) / sqrt(tr b + 2 J).
template <class V>
MPM_INLINE Mat<V, 2> left_stretch(const Mat<V, 2>& f, V J) {
    using T = ScalarOf<V>;
    Mat<V, 2> b = product_transposed(f, f);
    const V scale = T(1) / square_root(trace(b) + T(2) * J);
    b.e[0][0] = (b.e[0][0] + J) * scale;
    b.e[1][1] = (b.e[1][1] + J) * scale;
    b.e[0][1] = b.e[0][1] * scale;
    b.e[1][0] = b.e[0][1];
    return b;
}

}  // namespace detail

struct FixedCorotated : IsotropicElastic, StoresDisplacement {
    static constexpr const char* name = "FixedCorotated";
    static constexpr const char* summary = "Hyperelastic solid, fixed corotated energy";
    static constexpr const char* source = "Bonus (2023), section 5.7";

    template <class T>
    struct Constants {
        T twice_shear;  // 2 mu
        T lame;         // lambda
    };
    template <class T>
    MPM_HD static Constants<T> constants(const double* p) {
        const auto e = Elasticity<double>::of(p[1], p[2]);
        return {T(2 * e.shear), T(e.lame)};
    }

    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> kirchhoff(const V (&state)[D * D], const Mat<V, D>&,
                                          const Constants<T>& k) {
        const Mat<V, D> h = displacement_gradient<D>(state);
        const V dJ = volume_change(h);
        const V J = dJ + T(1);
        Mat<V, D> f = h;
        MPM_UNROLL for (int a = 0; a < D; ++a) f.e[a][a] = f.e[a][a] + T(1);
        const Mat<V, D> excess = left_cauchy_green_excess(h);
        Mat<V, D> s = detail::left_stretch(f, J);
        MPM_UNROLL for (int a = 0; a < D; ++a) s.e[a][a] = s.e[a][a] + T(1);
        const Mat<V, D> c = cofactors(s);
        const V scale = T(1) / determinant(s, c);
        const Mat<V, D> x =
            product_transposed(excess, c);  // (b - I) (V + I)^-1 times the determinant
        const V volumetric_part = k.lame * (dJ * J);
        Mat<V, D> tau;
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
            V t = k.twice_shear * (excess.e[a][b] - scale * (T(0.5) * (x.e[a][b] + x.e[b][a])));
            tau.e[a][b] = a == b ? t + volumetric_part : t;
        }
        return tau;
    }

    // For elements: U' and U of the part of the energy that is one of J alone, of J - 1.
    static constexpr bool hyperelastic = true;
    template <class V, class T>
    MPM_INLINE static V volume_pressure(V change, const Constants<T>& k) {
        return k.lame * change;
    }
    template <class V, class T>
    MPM_INLINE static V volume_energy(V change, const Constants<T>& k) {
        return T(0.5) * k.lame * change * change;
    }

    template <int D>
    MPM_HD static Observation<D> observe(const double* state, const double (&)[D][D],
                                         const double* q) {
        double h[D * D];
        for (int a = 0; a < D * D; ++a) h[a] = state[a];
        const auto k = Elasticity<double>::of(q[1], q[2]);
        Mat<double, D> none{};
        const Mat<double, D> tau = kirchhoff<double, D, double>(h, none, constants<double>(q));
        const Mat<double, D> H = displacement_gradient<D>(h);
        const double dJ = volume_change(H), J = 1 + dJ;
        // Plane strain: tau_33 = lambda (J - 1) J.
        Observation<D> o = observe_displacement<D>(H, tau, D == 2 ? k.lame * dJ * J : 0.0);
        // |V - I|^2 from V - I = (b - I)(V + I)^-1, the same route as the stress.
        Mat<double, D> f = H;
        for (int a = 0; a < D; ++a) f.e[a][a] += 1;
        Mat<double, D> v = detail::left_stretch(f, J);
        double distance = 0;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) {
                const double e = v.e[a][b] - (a == b ? 1.0 : 0.0);
                distance += e * e;
            }
        o.elastic_energy = k.shear * distance + 0.5 * k.lame * dJ * dJ;
        return o;
    }
};

}  // namespace mpm
