// What isotropic elastic solids share: moduli, symmetric tensors as particles store them, and the
// kinematics of materials whose state is the elastic left Cauchy-Green tensor less the identity,
// B = b_e - I: the strain itself, so that small strains keep their digits in single precision.
// Two dimensions are plane strain.
#pragma once

#include "mpm/core/eigen.hpp"
#include "mpm/physics/material/description.hpp"

namespace mpm {

/// Lame's constants, Pa.
template <class T>
struct Elasticity {
    T shear;  // mu
    T lame;   // lambda

    /// From Young's modulus in Pa and Poisson's ratio.
    MPM_HD static Elasticity of(double young, double poisson) {
        return {T(young / (2 * (1 + poisson))),
                T(young * poisson / ((1 + poisson) * (1 - 2 * poisson)))};
    }
    MPM_HD T bulk() const { return lame + T(2.0 / 3) * shear; }
};
/// What every isotropic solid is given first.
inline constexpr Parameter solid_density = {
    "density", "ρ", "kg/m³", required, 0.0, unbounded, true, true, "density at zero strain"};
inline constexpr Parameter youngs_modulus = {"youngs_modulus", "E",  "Pa", required,         0.0,
                                             unbounded,        true, true, "Young's modulus"};
inline constexpr Parameter poissons_ratio = {"poissons_ratio", "ν", "1", 0.3, -1.0, 0.5, true, true,
                                             "Poisson's ratio"};

/// Speed of the pressure wave, m/s.
inline double pressure_wave_speed(double young, double poisson, double density) {
    const auto e = Elasticity<double>::of(young, poisson);
    return std::sqrt((e.lame + 2 * e.shear) / density);
}

/// What a material says whose only parameters are these three.
struct IsotropicElastic {
    static constexpr bool volumetric = false;
    static constexpr Parameter parameters[] = {solid_density, youngs_modulus, poissons_ratio};
    template <class T>
    using Constants = Elasticity<T>;
    template <class T>
    static Constants<T> constants(const double* p) {
        return Elasticity<T>::of(p[1], p[2]);
    }
    static double density(const double* p) { return p[0]; }
    static double wave_speed(const double* p) { return pressure_wave_speed(p[1], p[2], p[0]); }
    static double shear_modulus(const double* p) { return p[1] / (2 * (1 + p[2])); }
};

/// Numbers of a symmetric tensor: xx, yy, xy or xx, yy, zz, yz, xz, xy.
template <int D>
inline constexpr int symmetric_reals = (D * (D + 1) / 2);

template <int D>
MPM_INLINE constexpr int symmetric_place(int i, int j) {
    return i == j ? i : (D == 2 ? 2 : 6 - i - j);
}
template <int D, class V, int R>
MPM_INLINE Mat<V, D> load_symmetric(const V (&state)[R]) {
    Mat<V, D> m;
    MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j < D; ++j) m.e[i][j] =
        state[symmetric_place<D>(i, j)];
    return m;
}
template <int D, class V, int R>
MPM_INLINE void store_symmetric(V (&state)[R], const Mat<V, D>& m) {
    MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j <= i; ++j) {
        state[symmetric_place<D>(i, j)] = m.e[i][j];
    }
}

/// B of (I + strain) F_e, from B of F_e: no difference of nearly equal matrices is formed. Not a
/// number where the step would turn the particle inside out, which b alone cannot tell.
template <class V, int D>
MPM_INLINE Mat<V, D> advance_left_cauchy_green(const Mat<V, D>& b, const Mat<V, D>& strain) {
    using T = ScalarOf<V>;
    Mat<V, D> moved = product(strain, b);
    MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j < D; ++j) {
        moved.e[i][j] = moved.e[i][j] + strain.e[i][j];
    }
    const Mat<V, D> square = product_transposed(moved, strain);
    const V inverted =
        select(V(T(-1)) < volume_change(strain), V(T(0)), V(std::numeric_limits<T>::quiet_NaN()));
    Mat<V, D> out;
    MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j <= i; ++j) {
        out.e[i][j] = out.e[j][i] = b.e[i][j] + (moved.e[i][j] + moved.e[j][i]) +
                                    T(0.5) * (square.e[i][j] + square.e[j][i]) + inverted;
    }
    return out;
}

/// Principal logarithmic strains, the one out of the plane too in two dimensions.
template <class V, int D>
struct LogStrain {
    Vec<V, 3> e;
    Mat<V, D> axes;
    MPM_INLINE V volumetric() const { return e[0] + e[1] + e[2]; }
    MPM_INLINE Vec<V, 3> deviator() const {
        using T = ScalarOf<V>;
        const V mean = T(1.0 / 3) * volumetric();
        return {{e[0] - mean, e[1] - mean, e[2] - mean}};
    }
};
template <class V, int D>
MPM_INLINE LogStrain<V, D> log_strain(const Mat<V, D>& b, V out_of_plane) {
    using T = ScalarOf<V>;
    const Spectrum<V, D> s = spectrum(b);
    LogStrain<V, D> out;
    MPM_UNROLL for (int i = 0; i < D; ++i) out.e[i] = T(0.5) * log1p_of(s.value[i]);
    if constexpr (D == 2) out.e[2] = out_of_plane;
    out.axes = s.axes;
    return out;
}
/// B of the strains.
template <class V, int D>
MPM_INLINE Mat<V, D> left_cauchy_green(const LogStrain<V, D>& s) {
    using T = ScalarOf<V>;
    Vec<V, D> value;
    MPM_UNROLL for (int i = 0; i < D; ++i) value[i] = expm1_of(T(2) * s.e[i]);
    return compose(value, s.axes);
}
/// Kirchhoff stress of the quadratic energy in the logarithmic strain (Hencky), Pa:
/// tau = 2 mu e + lambda tr(e) I.
template <class V, int D, class T>
MPM_INLINE Mat<V, D> hencky_stress(const LogStrain<V, D>& s, const Elasticity<T>& k) {
    const V all = k.lame * s.volumetric();
    Vec<V, D> value;
    MPM_UNROLL for (int i = 0; i < D; ++i) value[i] = (T(2) * k.shear) * s.e[i] + all;
    return compose(value, s.axes);
}
/// Equivalent strain of a flow by one along a unit deviator.
inline constexpr double equivalent_share = 0.81649658092772603;  // sqrt(2/3)

template <class V>
MPM_INLINE V norm(const Vec<V, 3>& v) {
    return square_root(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/// 1 - J from B and the elastic strain out of the plane.
template <class V, int D>
MPM_INLINE V volume_loss_of(const Mat<V, D>& b, V out_of_plane) {
    using T = ScalarOf<V>;
    return -expm1_of(T(0.5) * log1p_of(volume_change(b)) + out_of_plane);
}
/// Adds the same to all logarithmic strains that B holds.
template <int D, class V, int R>
MPM_INLINE void add_to_log_strains(V (&state)[R], V strain) {
    using T = ScalarOf<V>;
    const V more = expm1_of(T(2) * strain);
    Mat<V, D> b = load_symmetric<D>(state);
    MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j < D; ++j) {
        b.e[i][j] = b.e[i][j] + more * (i == j ? T(1) + b.e[i][j] : b.e[i][j]);
    }
    store_symmetric<D>(state, b);
}

/// Volume ratio between 0.05 and 20, from B; false for what is not a number.
template <class V, int D>
MPM_INLINE MaskOf<V> admissible_left_cauchy_green(const Mat<V, D>& b, V out_of_plane) {
    using T = ScalarOf<V>;
    const V square = volume_change(b);  // J^2 - 1
    MaskOf<V> fine = is_finite(out_of_plane) & (V(T(-0.9975)) < square) & (square < V(T(399)));
    MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j <= i; ++j) {
        fine = fine & is_finite(b.e[i][j]);
    }
    return fine;
}

/// What laws share that flow and answer with Hencky's stress: B first among what they store, in two
/// dimensions followed by the elastic strain out of the plane. `Law::respond` updates and answers.
template <class Law>
struct HenckyFlow {
    static constexpr bool volumetric = false;
    static constexpr const char* needs = "elastic_strain";
    static constexpr Column elastic_column = {
        "B", {4, 6}, "elastic left Cauchy-Green tensor less 1; 2D: and the strain e_zz", "1"};
    static double density(const double* p) { return p[0]; }
    static double wave_speed(const double* p) { return pressure_wave_speed(p[1], p[2], p[0]); }
    static double shear_modulus(const double* p) { return p[1] / (2 * (1 + p[2])); }

    template <int D, class V, int R>
    MPM_INLINE static LogStrain<V, D> elastic_strain(const V (&state)[R]) {
        return log_strain(load_symmetric<D>(state), D == 2 ? state[3] : V(ScalarOf<V>(0)));
    }
    /// Keeps the elastic strain after a return: what did not change keeps the B of the trial.
    template <int D, class V, int R>
    MPM_INLINE static void keep(V (&state)[R], MaskOf<V> changed, const Mat<V, D>& trial,
                                const LogStrain<V, D>& s) {
        Mat<V, D> b = left_cauchy_green(s);
        MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j < D; ++j) {
            b.e[i][j] = select(changed, b.e[i][j], trial.e[i][j]);
        }
        store_symmetric<D>(state, b);
        if constexpr (D == 2) state[3] = s.e[2];
    }
    /// Finite, and of an elastic volume ratio between 0.05 and 20.
    template <int D, class V, int R>
    MPM_INLINE static MaskOf<V> admissible_strain(const V (&state)[R]) {
        return admissible_left_cauchy_green(load_symmetric<D>(state),
                                            D == 2 ? state[3] : V(ScalarOf<V>(0)));
    }
    template <class V, int D, class T = ScalarOf<V>, int R, class Constants>
    MPM_INLINE static void advance(V (&state)[R], const Mat<V, D>& strain, const Constants& k) {
        Law::template respond<V, D, T>(state, strain, k);
    }
    template <class V, int D, class T = ScalarOf<V>, int R, class Constants>
    MPM_INLINE static Mat<V, D> kirchhoff(const V (&state)[R], const Mat<V, D>&,
                                          const Constants& k) {
        return hencky_stress(elastic_strain<D>(state), k.elastic);
    }
};

/// What a reader sees of a Hencky material; `ratio` is J, of which plastic flow may hold a part.
template <int D>
MPM_HD inline Observation<D> observe_hencky(const LogStrain<double, D>& s,
                                            const Elasticity<double>& k, double ratio) {
    Observation<D> o{};
    o.volume_ratio = ratio;
    const Mat<double, D> tau = hencky_stress(s, k);
    const double volumetric = s.volumetric();
    double squares = 0;
    for (int i = 0; i < 3; ++i) squares += s.e[i] * s.e[i];
    for (int a = 0; a < D; ++a)
        for (int b = 0; b < D; ++b) {
            o.stress[a][b] = tau.e[a][b] / ratio;
            o.deformation[a][b] = a == b ? 1.0 : 0.0;
        }
    o.pressure = -k.bulk() * volumetric / ratio;
    o.elastic_energy = k.shear * squares + 0.5 * k.lame * volumetric * volumetric;
    return o;
}

}  // namespace mpm
