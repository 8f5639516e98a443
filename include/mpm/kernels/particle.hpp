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

/// A volume loss of the material's kind advanced by dt grad v.
template <class Material, class V, int D>
MPM_INLINE V advance_loss(V loss, const Mat<V, D>& strain) {
    if constexpr (Material::volumetric)
        return Material::advance_volume(loss, trace(strain));
    else
        return loss - volume_change(strain) * (ScalarOf<V>(1) - loss);
}

/// A particle's volume loss 1 - J, of which its stress follows; `SaysVolume`.
template <class Material, Smoothing S, class V, int D>
MPM_INLINE V volume_loss_in(const V (&state)[state_reals<Material, D, S>]) {
    constexpr int reals = Material::template reals<D>;
    if constexpr (S == Smoothing::two_volumes) {
        return state[reals];
    } else if constexpr (Material::volumetric) {
        return state[0];
    } else {
        V own[reals];
        MPM_UNROLL for (int r = 0; r < reals; ++r) own[r] = state[r];
        return Material::template volume_loss<D>(own);
    }
}

/// Advances a particle's state by what was gathered, and returns its Kirchhoff stress. The slopes
/// of `u` are those of the velocity per cell. With F-bar, `out` gets what the particle deposits of
/// its volume. `every_form`: also those that only the phased step has.
template <class Material, Smoothing S, bool every_form, class V, int D, class G, class T>
MPM_INLINE Mat<V, D> update_state(const Affine<G, D, transfer_channels<D, S>>& u,
                                  V (&state)[state_reals<Material, D, S>],
                                  const StepNumbers<T, Material>& k,
                                  Affine<G, D, transfer_channels<D, S>>& out) {
    constexpr int reals = Material::template reals<D>;
    Mat<V, D> strain, rate;
    MPM_UNROLL for (int c = 0; c < D; ++c) MPM_UNROLL for (int a = 0; a < D; ++a) {
        strain.e[c][a] = k.move * u.slope[a][c];
        rate.e[c][a] = k.rate * u.slope[a][c];
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
        V loss;  // of volume, advanced
        if constexpr (Material::volumetric)
            loss = own[0];
        else
            loss = Material::template volume_loss<D>(own);
        const auto advanced = [&](V j) { return advance_loss<Material>(j, strain); };
        V average = V(u.value[D]);
        if (!every_form || !k.smoothing.lags) average = advanced(average);
        Vec<V, D> gradient;
        MPM_UNROLL for (int a = 0; a < D; ++a) gradient[a] = V(u.slope[a][D]);
        auto s = smooth_volume(S, loss, average, gradient, k.smoothing);
        if constexpr (every_form) {
            if (k.smoothing.leads) s.deposited = advanced(s.deposited);
        }
        if constexpr (Material::volumetric) {
            state[0] = s.stored;
            own[0] = s.blended;
        } else {
            MPM_UNROLL for (int r = 0; r < reals; ++r) state[r] = own[r];
            Material::template scale_volume<D>(own, loss, s.blended);
            if (S == Smoothing::one_volume && !k.smoothing.stress_only) {
                MPM_UNROLL for (int r = 0; r < reals; ++r) state[r] = own[r];
            }
        }
        if constexpr (S == Smoothing::two_volumes) state[reals] = s.blended;
        out.value[D] = G(s.deposited);
        MPM_UNROLL for (int a = 0; a < D; ++a) out.slope[a][D] = G(s.slope[a]);
    }
    if constexpr (!Responds<Material, V, D, T> || S != Smoothing::none)
        tau = Material::kirchhoff(own, rate, k.material);
    return tau;
}

/// What comes from the grid and goes to it is in G, which a particle's V may exceed: mixed
/// precision. `xi` is the offset from the centre of the cell whose stencil starts at node `origin`;
/// it is advanced in place and may leave [-1/2, 1/2]. `state` holds the material's reals, then the
/// blended volume where two are stored.
template <class Material, Smoothing S, class V, int D, class G = V, class T, class Lines>
MPM_INLINE Affine<G, D, transfer_channels<D, S>> advance_particle(
    const Lines& lines, int origin, Vec<V, D>& xi, V (&state)[state_reals<Material, D, S>],
    const StepNumbers<T, Material>& k) {
    constexpr int C = transfer_channels<D, S>;
    const Weights<G, D> w = quadratic_weights<G, D>(as<G>(xi));
    const Affine<G, D, C> u = gather<C, G, D>(lines, w, origin);
    Affine<G, D, C> out;
    MPM_UNROLL for (int c = 0; c < D; ++c) {
        out.value[c] = u.value[c];
        xi[c] = xi[c] + k.move * u.value[c];
    }
    const Mat<V, D> tau = update_state<Material, S, false, V, D, G>(u, state, k, out);
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
    if constexpr (S == Smoothing::two_volumes && Material::volumetric) own[0] = state[reals];
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
        if constexpr (Material::volumetric)
            out.value[D] = G(own[0]);
        else
            out.value[D] = G(Material::template volume_loss<D>(own));
        MPM_UNROLL for (int a = 0; a < D; ++a) out.slope[a][D] = G(V(T(0)));
    }
    return out;
}

}  // namespace mpm
