// The fused step of schemes that store a velocity and keep a share of it (the FLIP family of
// physics/transfer/scheme.hpp), on quadratic splines: what happens to one particle beside
// particle.hpp. The discretisation is that of the phased step.
//
// A particle reads D + 1 more numbers of a node, without slopes: the velocity that momentum alone
// gives it, and whether a boundary has changed it. It adds D more sums, momentum without the stress
// of the coming step. Its stored velocity lies behind the columns of its state.
#pragma once

#include <type_traits>

#include "mpm/kernels/body_common.hpp"
#include "mpm/kernels/respond.hpp"

namespace mpm {

/// Sums that a particle adds to a node besides its mass: its transfer channels, then the momentum
/// without stress.
template <int D, Smoothing S>
inline constexpr int kept_sums = transfer_channels<D, S> + D;

/// The numbers of a scheme that keeps a velocity, as its kernels take them.
template <class T>
struct KeepNumbers {
    T keep;  // alpha
    bool affine;
    bool guarded;
    ShiftRule rule;
    T shift_max, shift_min, critical_loss, width, power, below;  // beta; `below` J_c of the smooth
                                                                 // rule
    int before, guard;                                           // channels of nodal velocities
    int plain;  // the first sum of momentum without stress
};
template <class T>
KeepNumbers<T> keep_numbers(const PhaseNumbers& n) {
    const SchemeNumbers& s = n.scheme;
    return {T(s.keep),
            s.affine,
            s.rule != ShiftRule::none && n.guard >= 0,
            s.rule,
            T(s.shift_max),
            T(s.shift_min),
            T(s.critical_loss),
            T(s.width),
            T(s.power),
            T(s.zero_below ? 0.0 : s.shift_min),
            n.before,
            n.guard,
            n.plain};
}

/// `shift_share` for packs too, and without double precision.
template <class V, class T>
MPM_INLINE V share_of(const KeepNumbers<T>& s, V loss) {
    if (s.rule == ShiftRule::none) return V(T(0));
    if (s.rule == ShiftRule::full) return V(T(1));
    const V zero = V(T(0)), beyond = s.critical_loss - loss;  // J - J_c
    if (s.rule == ShiftRule::binary) return select(zero < beyond, V(s.shift_max), V(s.shift_min));
    const V part = smaller(larger(beyond / V(s.width), zero), V(T(1)));
    // The logarithm needs a normal number.
    const V grown =
        s.power == T(2) ? part * part : exp_of(s.power * log_of(larger(part, V(T(1e-30)))));
    return select(zero <= beyond, s.shift_min + (s.shift_max - s.shift_min) * grown, V(s.below));
}

namespace detail {
/// Of two guards, 0 or 1 each. On a device the bits of three take one instruction.
template <class V>
MPM_INLINE V either(V a, V b) {
#if defined(__CUDA_ARCH__)
    if constexpr (std::is_same_v<V, float>)
        return __uint_as_float(__float_as_uint(a) | __float_as_uint(b));
#endif
    return larger(a, b);
}
/// Averages over one line of nodes along the last axis, or over all lines from `Axis` on, and with
/// `guarded` whether any of them is: `guard`. Of nodes whose weight is zero, as a particle on a
/// face of its cell has them, the phased step takes none for it.
template <int Axis, bool guarded, class V, int D, class Nodes>
MPM_INLINE void average_from(const Nodes& nodes, const Weights<V, D>& w, int at, V (&out)[D],
                             V& guard) {
    MPM_UNROLL for (int k = 0; k < 3; ++k) {
        const int place = at + k * Nodes::stride(Axis);
        if constexpr (Axis == D - 1) {
            const auto u = nodes.load(place);
            MPM_UNROLL for (int c = 0; c < D; ++c) {
                const V part = w.value[Axis][k] * u.e[c];
                out[c] = k == 0 ? part : out[c] + part;
            }
            if constexpr (guarded) guard = either(guard, V(u.e[D]));
        } else {
            V line[D];
            average_from<Axis + 1, guarded>(nodes, w, place, line, guard);
            MPM_UNROLL for (int c = 0; c < D; ++c) {
                const V part = w.value[Axis][k] * line[c];
                out[c] = k == 0 ? part : out[c] + part;
            }
        }
    }
}
}  // namespace detail

/// Advances a particle as `advance_particle` does, with the velocity that it stores in the last D
/// numbers of `state`. `nodes` holds the D velocities before forces and boundaries, then the guard;
/// its lowest node of the stencil is `first`. Momentum without stress stands behind the transfer
/// channels of what is returned.
template <class Material, Smoothing S, class V, int D, class G = V, class T, class Lines,
          class Nodes>
MPM_INLINE Affine<G, D, kept_sums<D, S>> advance_keeping(
    const Lines& lines, int origin, const Nodes& nodes, int first, Vec<V, D>& xi,
    V (&state)[state_reals<Material, D, S> + D], const StepNumbers<T, Material>& k,
    const KeepNumbers<T>& s) {
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    const Weights<G, D> w = quadratic_weights<G, D>(as<G>(xi));
    const Affine<G, D, C> u = gather<C, G, D>(lines, w, origin);
    G before[D], guard = G(ScalarOf<G>(0));
    // Few schemes ask for the guard.
    if (s.guarded)
        detail::average_from<0, true>(nodes, w, first, before, guard);
    else
        detail::average_from<0, false>(nodes, w, first, before, guard);

    V own[R];
    MPM_UNROLL for (int r = 0; r < R; ++r) own[r] = state[r];
    Affine<G, D, C> volume;
    const Mat<V, D> tau = update_state<Material, S, false, V, D, G>(u, own, k, volume);
    MPM_UNROLL for (int r = 0; r < R; ++r) state[r] = own[r];

    V share = V(T(0));
    if (s.rule != ShiftRule::none) {
        share = share_of(s, volume_loss_in<Material, S, V, D>(own));
        if (s.guarded) share = select(V(T(0)) < V(guard), V(T(0)), share);
    }
    Affine<G, D, C + D> out;
    MPM_UNROLL for (int c = 0; c < D; ++c) {
        const V seen = V(u.value[c]), unseen = s.keep * (state[R + c] - V(before[c]));
        const V kept = seen + unseen;
        xi[c] = xi[c] + k.move * (seen + share * unseen);
        state[R + c] = kept;
        out.value[c] = out.value[C + c] = G(kept);
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const G tilt = s.affine ? u.slope[a][c] : G(ScalarOf<G>(0));
            out.slope[a][C + c] = tilt;
            out.slope[a][c] = tilt - G(k.impulse * tau.e[c][a]);
        }
    }
    if constexpr (C > D) {
        out.value[D] = volume.value[D];
        MPM_UNROLL for (int a = 0; a < D; ++a) out.slope[a][D] = volume.slope[a][D];
    }
    return out;
}

/// True for a particle that makes the clock sort (`far_from_home`). A step carries it by at most
/// half a cell with the grid, so that it ends below one and a half cells from its home cell's
/// centre, where its weights are those of the splines; shifts have a quarter of a cell more before
/// it is a fault (`sound`). Whatever it does, the arena holds the nodes that it reads and adds to:
/// `cell_shift` takes it for one of its home cell's neighbours at most.
template <class V, int D>
MPM_INLINE MaskOf<V> strays_far(const Vec<V, D>& xi) {
    using T = ScalarOf<V>;
    MaskOf<V> far = absolute(xi[0]) > V(T(far_from_home));
    MPM_UNROLL for (int a = 1; a < D; ++a) far = far | (absolute(xi[a]) > V(T(far_from_home)));
    return far;
}

}  // namespace mpm
