// What happens to one particle in one step, for every backend and number type: gather, advance the
// state, move, and hand back what it deposits. No memory is touched here except through `Lines`.
#pragma once

#include "mpm/physics/material/description.hpp"
#include "mpm/physics/transfer/affine.hpp"
#include "mpm/physics/volume_smoothing.hpp"

namespace mpm {

/// Uniform numbers of one body in one step.
template <class T, class Material>
struct StepNumbers {
    T move;  // dt / dx                  velocity -> offset [cells], its slope per cell -> dt grad v
    T rate;  // 1 / dx                   slope of velocity per cell -> grad v [1/s]
    T impulse;  // 4 dt_next / (rho0 dx)    Kirchhoff stress -> velocity per cell
    typename Material::template Constants<T> material;
    SmoothingNumbers<T> smoothing;
};

/// A material whose law needs real branches says `static constexpr bool lane_wise = true`; the CPU
/// then takes its particles one by one instead of a pack at a time.
template <class Material>
inline constexpr bool lane_wise = [] {
    if constexpr (requires { Material::lane_wise; })
        return Material::lane_wise;
    else
        return false;
}();

template <class Material, int D, Smoothing S>
inline constexpr int state_reals = Material::template reals<D> +
                                   (S == Smoothing::two_volumes ? 1 : 0);

/// Channels a particle reads from and adds to a node besides its mass: velocity or momentum, and j
/// with F-bar.
template <int D, Smoothing S>
inline constexpr int transfer_channels = D + (S == Smoothing::none ? 0 : 1);

/// What comes from the grid and goes to it is in G, which a particle's V may exceed: mixed
/// precision. `xi` is the offset from the centre of the cell whose stencil starts at node `origin`;
/// it is advanced in place and may leave [-1/2, 1/2]. `state` holds the material's reals, then the
/// blended volume where two are stored.
template <class Material, Smoothing S, class V, int D, class G = V, class T, class Lines>
MPM_INLINE Affine<G, D, transfer_channels<D, S>> advance_particle(
    const Lines& lines, int origin, Vec<V, D>& xi, V (&state)[state_reals<Material, D, S>],
    const StepNumbers<T, Material>& k) {
    constexpr int C = transfer_channels<D, S>;
    constexpr int reals = Material::template reals<D>;
    const Weights<G, D> w = quadratic_weights<G, D>(as<G>(xi));
    const Affine<G, D, C> u = gather<C, G, D>(lines, w, origin);

    Affine<G, D, C> out;
    Mat<V, D> strain, rate;
    MPM_UNROLL for (int c = 0; c < D; ++c) {
        out.value[c] = u.value[c];
        xi[c] = xi[c] + k.move * u.value[c];
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            strain.e[c][a] = k.move * u.slope[a][c];
            rate.e[c][a] = k.rate * u.slope[a][c];
        }
    }

    V own[reals];
    MPM_UNROLL for (int r = 0; r < reals; ++r) own[r] = state[r];
    Mat<V, D> tau;
    if constexpr (Responds<Material, V, D, T>)
        tau = Material::respond(own, strain, k.material);
    else
        Material::advance(own, strain, k.material);
    if constexpr (S == Smoothing::none) {
        MPM_UNROLL for (int r = 0; r < reals; ++r) state[r] = own[r];
    } else {
        static_assert(Material::volumetric);
        const V average = Material::advance_volume(V(u.value[D]), trace(strain));
        Vec<V, D> gradient;
        MPM_UNROLL for (int a = 0; a < D; ++a) gradient[a] = V(u.slope[a][D]);
        const auto s = smooth_volume(S, own[0], average, gradient, k.smoothing);
        state[0] = s.stored;
        if constexpr (S == Smoothing::two_volumes) state[reals] = s.blended;
        own[0] = s.blended;
        out.value[D] = G(s.deposited);
        MPM_UNROLL for (int a = 0; a < D; ++a) out.slope[a][D] = G(s.slope[a]);
    }

    if constexpr (!Responds<Material, V, D, T>) tau = Material::kirchhoff(own, rate, k.material);
    MPM_UNROLL for (int c = 0; c < D; ++c) MPM_UNROLL for (int a = 0; a < D; ++a) {
        out.slope[a][c] = u.slope[a][c] - G(k.impulse * tau.e[c][a]);
    }
    return out;
}

/// What a particle deposits before the first step: its given velocity, no affine part, the stress
/// of its state.
template <class Material, Smoothing S, class V, int D, class G = V, class T>
MPM_INLINE Affine<G, D, transfer_channels<D, S>> resting_particle(
    const Vec<G, D>& velocity, const V (&state)[state_reals<Material, D, S>],
    const StepNumbers<T, Material>& k) {
    constexpr int reals = Material::template reals<D>;
    V own[reals];
    MPM_UNROLL for (int r = 0; r < reals; ++r) own[r] = state[r];
    if constexpr (S == Smoothing::two_volumes) own[0] = state[reals];
    Mat<V, D> still;
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) still.e[a][b] =
        V(T(0));
    const Mat<V, D> tau = Material::kirchhoff(own, still, k.material);
    Affine<G, D, transfer_channels<D, S>> out;
    MPM_UNROLL for (int c = 0; c < D; ++c) {
        out.value[c] = velocity[c];
        MPM_UNROLL for (int a = 0; a < D; ++a) out.slope[a][c] = G(-k.impulse * tau.e[c][a]);
    }
    if constexpr (S != Smoothing::none) {
        out.value[D] = G(own[0]);
        MPM_UNROLL for (int a = 0; a < D; ++a) out.slope[a][D] = G(V(T(0)));
    }
    return out;
}

}  // namespace mpm
