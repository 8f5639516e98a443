// Linear triangles and tetrahedra, total Lagrangian (design/elements.md). With the edges of an
// element at rest and now,
//
//   D_m = [X_1 - X_0, ..., X_D - X_0],   D_s = [x_1 - x_0, ..., x_D - x_0],   F = D_s D_m^-1,
//
// the energy V Psi(F) gives the forces [f_1 .. f_D] = -V P D_m^-T, f_0 = -(f_1 + ... + f_D), with
// P = dPsi/dF = tau F^-T (Irving, Teran, Fedkiw 2004; a published form has the sign wrong). Two
// dimensions are plane strain.
//
// H = F - I comes from differences of displacements, never from F: strains of 1e-6 survive single
// precision.
//
// Towards nu = 1/2 elements lock. Volumes of vertices take the place of their own (average nodal
// pressure, Bonet and Burton 1998): with V_a = sum V/(D+1) and J_a = sum (V J/(D+1)) / V_a, the
// volumetric energy U is that of J_a in V_a, so that
//
//   p_a = U'(J_a),   p_e = mean of p_a over its vertices,   P = P_dev(F) + p_e J F^-T
//
// is still the derivative of an energy. A share of each element's own U stays as a brake on the
// modes that volumes of vertices do not see (Puso and Solberg 2006).
//
// A law that flows keeps what has flowed before F and not after it: with F = F_e F_p,
//
//   C_p^-1 = F_p^-1 F_p^-T,   b_trial = F C_p^-1 F^T,   after the law's return  C_p^-1 <- F^-1 b
//   F^-T
//
// (Simo 1992, Simo and Hughes 1998, 9.3). As long as nothing flows C_p^-1 stays as it is and the
// stress follows from F alone, so that nothing is summed up from step to step.
#pragma once

#include <type_traits>

#include "mpm/core/linalg.hpp"
#include "mpm/physics/material/logarithmic_volume.hpp"

namespace mpm {

/// An element whose volume has shrunk to this part of that at rest counts as turned inside out.
inline constexpr double least_element_ratio = 0.05;
/// Share of an element's own volumetric energy that is kept beside that of its vertices.
inline constexpr double own_volume_share = 0.05;

/// Materials whose stress is the derivative of an energy of F alone, and that say which part of it
/// is one of J.
template <class Material>
inline constexpr bool hyperelastic = requires {
    Material::hyperelastic;
};
/// Materials whose state is an elastic B and numbers of what has flowed.
template <class Material>
inline constexpr bool flows = std::is_base_of_v<HenckyFlow<Material>, Material>;
/// Those of them whose flow keeps the volume, so that J is elastic.
template <class Material>
inline constexpr bool flows_at_constant_volume =
    flows<Material>&& ScalesVolume<Material, double, 3>;
/// What elements are built for, and with volumes of vertices.
template <class Material>
inline constexpr bool for_elements = hyperelastic<Material> || flows<Material>;
template <class Material>
inline constexpr bool for_vertex_volumes =
    hyperelastic<Material> || flows_at_constant_volume<Material>;

/// Numbers that an element keeps.
template <class Material, int D>
inline constexpr int kept_reals = [] {
    if constexpr (flows<Material>)
        return Material::template reals<D>;
    else
        return 0;
}();

/// What a law stores at F = I + H: it starts from rest and takes all of H in one update, which is
/// exact for laws without a memory, whatever it is that they store.
template <class Material, class V, int D, class Constants>
MPM_INLINE void state_at(V (&state)[Material::template reals<D>], const Mat<V, D>& h,
                         const Constants& k) {
    using T = ScalarOf<V>;
    MPM_UNROLL for (int r = 0; r < Material::template reals<D>; ++r) state[r] = V(T(0));
    Material::advance(state, h, k);
}
template <class Material, class V, int D, class Constants>
MPM_INLINE Mat<V, D> kirchhoff_at(const Mat<V, D>& h, const Constants& k) {
    using T = ScalarOf<V>;
    V state[Material::template reals<D>];
    state_at<Material>(state, h, k);
    Mat<V, D> still;
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) still.e[a][b] =
        V(T(0));
    return Material::kirchhoff(state, still, k);
}

/// U' of J - 1, Pa, and U, J/m^3. Laws that flow have Hencky's energy.
template <class Material, class V, class Constants>
MPM_INLINE V volume_pressure_of(V change, const Constants& k) {
    if constexpr (flows<Material>)
        return LogarithmicVolume::volume_pressure(change, k.elastic);
    else
        return Material::volume_pressure(change, k);
}
template <class Material, class V, class Constants>
MPM_INLINE V volume_energy_of(V change, const Constants& k) {
    if constexpr (flows<Material>)
        return LogarithmicVolume::volume_energy(change, k.elastic);
    else
        return Material::volume_energy(change, k);
}

/// (I + H)^-1 - I.
template <class V, int D>
MPM_INLINE Mat<V, D> inverse_change(const Mat<V, D>& h) {
    using T = ScalarOf<V>;
    Mat<V, D> f = h;
    MPM_UNROLL for (int a = 0; a < D; ++a) f.e[a][a] = f.e[a][a] + T(1);
    const Mat<V, D> c = cofactors(f);
    const V scale = V(T(-1)) / determinant(f, c);
    Mat<V, D> out;
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
        V sum = c.e[0][a] * h.e[0][b];
        MPM_UNROLL for (int k = 1; k < D; ++k) sum = sum + c.e[k][a] * h.e[k][b];
        out.e[a][b] = scale * sum;
    }
    return out;
}

/// Takes an element of a law that flows to F = I + H: what it keeps changes where it flows.
/// Returns the Kirchhoff stress, Pa; `fine`: the law may still have such a state.
template <class Material, class T, int D, class Constants>
MPM_INLINE Mat<T, D> flow_to(T (&kept)[Material::template reals<D>], const Mat<T, D>& h,
                             const Constants& k, bool& fine) {
    T state[Material::template reals<D>];
    MPM_UNROLL for (int r = 0; r < Material::template reals<D>; ++r) state[r] = kept[r];
    const Mat<T, D> trial = advance_left_cauchy_green(load_symmetric<D>(state), h);
    const Mat<T, D> tau = Material::template respond<T, D, T>(state, h, k);
    fine = Material::template admissible<T, D>(state);
    const Mat<T, D> b = load_symmetric<D>(state);
    bool flowed = false;
    MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j <= i; ++j) {
        flowed = flowed || b.e[i][j] != trial.e[i][j];
    }
    if (!flowed) return tau;
    store_symmetric<D>(state, advance_left_cauchy_green(b, inverse_change(h)));
    MPM_UNROLL for (int r = 0; r < Material::template reals<D>; ++r) kept[r] = state[r];
    return tau;
}

/// H from the displacements of vertices 1 to D less that of vertex 0, in columns.
template <class V, int D>
MPM_INLINE Mat<V, D> element_gradient(const Mat<V, D>& displacement, const Mat<V, D>& inverse) {
    return product(displacement, inverse);
}

/// tau as it is with the volumes of vertices: the mean of their pressures in place of the
/// element's own, but for the brake. `change` is J - 1.
template <class Material, class V, int D, class Constants>
MPM_INLINE void take_vertex_pressure(Mat<V, D>& tau, V change, V pressure, const Constants& k) {
    using T = ScalarOf<V>;
    const V more = T(1 - own_volume_share) * (pressure - volume_pressure_of<Material>(change, k)) *
                   (T(1) + change);
    MPM_UNROLL for (int a = 0; a < D; ++a) tau.e[a][a] = tau.e[a][a] + more;
}

/// Numerical damping, Pa s: 2 l xi sqrt(M rho) across and 2 l xi sqrt(G rho) along, as Yang (2016),
/// A.6, has it of normal and shear stresses, in the form that no turn of the axes changes:
/// viscosity of a compressible fluid.
template <class T>
struct ElementDamping {
    T normal = T(0), shear = T(0);
    MPM_INLINE bool any() const { return normal > T(0); }
};
/// Adds J (lambda_v tr d + 2 mu_v d) of the rate d of an element whose gradient H has changed by
/// `moved` within `dt`: forces have no torque, and take energy alone.
template <class V, int D>
MPM_INLINE void add_damping(Mat<V, D>& tau, const Mat<V, D>& h, const Mat<V, D>& moved, V change,
                            const ElementDamping<V>& k, V dt) {
    using T = ScalarOf<V>;
    Mat<V, D> back = inverse_change(h);
    MPM_UNROLL for (int a = 0; a < D; ++a) back.e[a][a] = back.e[a][a] + T(1);
    const Mat<V, D> rate = product(moved, back);
    const V j = (T(1) + change) / dt, all = (k.normal - k.shear) * trace(rate);
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
        const V both = T(0.5) * k.shear * (rate.e[a][b] + rate.e[b][a]);
        tau.e[a][b] = tau.e[a][b] + j * (a == b ? both + all : both);
    }
}

/// P D_m^-T for P = tau F^-T: its column k is what a unit of volume pulls vertex k + 1 back by.
template <class V, int D>
MPM_INLINE Mat<V, D> element_pull(const Mat<V, D>& tau, const Mat<V, D>& h,
                                  const Mat<V, D>& inverse) {
    using T = ScalarOf<V>;
    Mat<V, D> f = h;
    MPM_UNROLL for (int a = 0; a < D; ++a) f.e[a][a] = f.e[a][a] + T(1);
    const Mat<V, D> c = cofactors(f);
    const V scale = T(1) / determinant(f, c);
    Mat<V, D> p = product(tau, c);
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) p.e[a][b] =
        scale * p.e[a][b];
    return product_transposed(p, inverse);
}

/// D_m^-1 and the volume of an element at rest, from its edges in columns; the volume is below zero
/// where the vertices are in the wrong order.
template <int D>
struct ElementAtRest {
    Mat<double, D> inverse;
    double volume;
    explicit ElementAtRest(const Mat<double, D>& edges) {
        const Mat<double, D> c = cofactors(edges);
        const double d = determinant(edges, c);
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) inverse.e[a][b] = c.e[b][a] / d;
        volume = d / (D == 2 ? 2 : 6);
    }
};

}  // namespace mpm
