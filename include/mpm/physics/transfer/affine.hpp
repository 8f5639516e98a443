// Affine transfer between particles and nodes (APIC in its MLS-MPM form; Bonus 2023,
// eqs. 2.46-2.48, 2.58-2.59).
//
// gather:  value = sum N_i u_i,  slope = sum N_i u_i (x_i - x_p)     for C channels u
// scatter: node  += N_i (value + slope . (x_i - x_p))
//
// Both contract one axis at a time, so that a node costs two multiply-adds a channel instead of
// four. `Nodes` supplies node values, `Sums` takes them: registers of one worker, fixed-point
// memory, or plain memory.
#pragma once

#include "mpm/physics/shape/quadratic.hpp"

namespace mpm {

/// A quantity that varies linearly around a particle: value at the particle, slope per cell along
/// each axis.
template <class V, int D, int C>
struct Affine {
    V value[C];
    V slope[D][C];
};

namespace detail {

template <class V, int C, int G>
struct Moments {
    V value[C];
    V slope[G > 0 ? G : 1][C];
};

template <int Axis, class V, int D, int C, class Nodes>
MPM_INLINE Moments<V, C, D - Axis> collapse(const Nodes& nodes, const Weights<V, D>& w,
                                            int offset) {
    Moments<V, C, D - Axis> out;
    MPM_UNROLL for (int k = 0; k < 3; ++k) {
        const int at = offset + k * Nodes::stride(Axis);
        const V n = w.value[Axis][k], m = w.moment[Axis][k];
        if constexpr (Axis == D - 1) {
            const auto u = nodes.template load<C>(at);
            MPM_UNROLL for (int c = 0; c < C; ++c) {
                out.value[c] = k == 0 ? n * u[c] : out.value[c] + n * u[c];
                out.slope[0][c] = k == 0 ? m * u[c] : out.slope[0][c] + m * u[c];
            }
        } else {
            const auto u = collapse<Axis + 1, V, D, C>(nodes, w, at);
            MPM_UNROLL for (int c = 0; c < C; ++c) {
                out.value[c] = k == 0 ? n * u.value[c] : out.value[c] + n * u.value[c];
                out.slope[0][c] = k == 0 ? m * u.value[c] : out.slope[0][c] + m * u.value[c];
                MPM_UNROLL for (int g = 0; g < D - 1 - Axis; ++g) {
                    out.slope[g + 1][c] =
                        k == 0 ? n * u.slope[g][c] : out.slope[g + 1][c] + n * u.slope[g][c];
                }
            }
        }
    }
    return out;
}

template <int Axis, class V, int D, int C, class Sums>
MPM_INLINE void spread(Sums& sums, const Weights<V, D>& w, V weight, const V (&value)[C],
                       const V (&slope)[D][C], int node) {
    using T = ScalarOf<V>;
    if constexpr (Axis == D - 1) {
        V level[C], tilt[C];
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            level[c] = weight * value[c];
            tilt[c] = weight * slope[Axis][c];
        }
        MPM_UNROLL for (int k = 0; k < 3; ++k) {
            const V n = w.value[Axis][k], m = w.moment[Axis][k];
            sums.add_mass(node + k, weight * n);
            MPM_UNROLL for (int c = 0; c < C; ++c) {
                // Sums that take the terms one by one save an addition in fused multiply-adds.
                if constexpr (requires { sums.add_terms(node, c, n, m); }) {
                    sums.add_terms(node + k, c, level[c] * n, tilt[c] * m);
                } else {
                    sums.add(node + k, c, level[c] * n + tilt[c] * m);
                }
            }
        }
    } else {
        constexpr int step = (D - 1 - Axis) == 1 ? 3 : 9;
        MPM_UNROLL for (int k = 0; k < 3; ++k) {
            const V distance = T(k - 1) - w.offset(Axis);
            V at[C];
            MPM_UNROLL for (int c = 0; c < C; ++c) at[c] = value[c] + slope[Axis][c] * distance;
            spread<Axis + 1, V, D, C>(sums, w, weight * w.value[Axis][k], at, slope,
                                      node + k * step);
        }
    }
}

}  // namespace detail

/// `origin` is the index in `nodes` of the lowest of the 3^D nodes.
template <int C, class V, int D, class Nodes>
MPM_INLINE Affine<V, D, C> gather(const Nodes& nodes, const Weights<V, D>& w, int origin) {
    const auto m = detail::collapse<0, V, D, C>(nodes, w, origin);
    Affine<V, D, C> out;
    MPM_UNROLL for (int c = 0; c < C; ++c) {
        out.value[c] = m.value[c];
        MPM_UNROLL for (int a = 0; a < D; ++a) out.slope[a][c] = m.slope[a][c];
    }
    return out;
}

/// Adds to node 0 .. 3^D - 1 (last axis fastest); `unit` is 1, or 0 in lanes that hold no particle.
template <class V, int D, int C, class Sums>
MPM_INLINE void scatter(Sums& sums, const Weights<V, D>& w, V unit, const Affine<V, D, C>& q) {
    detail::spread<0, V, D, C>(sums, w, unit, q.value, q.slope, 0);
}

}  // namespace mpm
