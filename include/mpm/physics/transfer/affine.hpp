// Affine transfer between particles and nodes (APIC in its MLS-MPM form; Bonus 2023,
// eqs. 2.46-2.48, 2.58-2.59), for C channels u at once.
//
// gather:  value = sum N_i u_i,  slope = 4 sum N_i u_i (x_i - x_p)
// scatter: node  += N_i (value + slope . (x_i - x_p))
//
// Both contract one axis at a time. What all particles of a cell share is worked out once: along
// the last axis node values come as the coefficients of the quadratic that they span over a cell
// (`expand_line`), so that a particle pays three multiply-adds a line for value and slope together.
// A deposit is linear in the node's number, so each node costs one product. `Lines` supplies
// coefficients, `Sums` takes products: registers of one worker, fixed-point memory, or plain
// memory.
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

/// Three nodes along the last axis -> what `gather` reads: with xi the offset in the cell,
///   sum N_i u_i                = q[0] + xi (q[1] + xi q[2])
///   4 sum N_i u_i (x_i - xi)   = q[1] + 4 xi N_0(xi) q[2]
template <class V>
MPM_INLINE void expand_line(V below, V here, V above, V (&q)[3]) {
    using T = ScalarOf<V>;
    q[1] = T(0.5) * (above - below);
    q[2] = T(0.5) * (above + below) - here;
    q[0] = here + T(0.25) * q[2];
}

/// The coefficients of C channels.
template <class T, int C>
struct Line {
    T q[3][C];
};

namespace detail {

/// Value and, along axes that are still open (all but the last and the first), first moments about
/// the cell's centre; along the last axis the slope.
template <class V, int C, int G>
struct Moments {
    V value[C];
    V slope[G][C];
};

/// One line of nodes along the last axis.
template <class V, int D, int C, class Lines>
MPM_INLINE Moments<V, C, 1> collapse_line(const Lines& lines, const Weights<V, D>& w, int at) {
    constexpr int last = D - 1;
    const V xi = w.offset(last);
    const V bend = ScalarOf<V>(quadratic_inverse_moment) * (xi * w.value[last][1]);
    const auto line = lines.template load<C>(at);
    Moments<V, C, 1> out;
    MPM_UNROLL for (int c = 0; c < C; ++c) {
        out.value[c] = line.q[0][c] + xi * (line.q[1][c] + xi * line.q[2][c]);
        out.slope[0][c] = line.q[1][c] + bend * line.q[2][c];
    }
    return out;
}

/// The middle axis of three.
template <class V, int C, class Lines>
MPM_INLINE Moments<V, C, 2> collapse_plane(const Lines& lines, const Weights<V, 3>& w, int at) {
    const int step = Lines::stride(1);
    const auto below = collapse_line<V, 3, C>(lines, w, at);
    const auto here = collapse_line<V, 3, C>(lines, w, at + step);
    const auto above = collapse_line<V, 3, C>(lines, w, at + 2 * step);
    const V(&n)[3] = w.value[1];
    Moments<V, C, 2> out;
    MPM_UNROLL for (int c = 0; c < C; ++c) {
        const V low = n[0] * below.value[c], high = n[2] * above.value[c];
        out.value[c] = n[1] * here.value[c] + (low + high);
        out.slope[0][c] = high - low;
        out.slope[1][c] =
            n[0] * below.slope[0][c] + n[1] * here.slope[0][c] + n[2] * above.slope[0][c];
    }
    return out;
}

template <int Axis, bool rolled, class V, int D, int C, class Sums>
MPM_INLINE void spread(Sums& sums, const Weights<V, D>& w, V weight, const V (&centre)[C],
                       const V (&slope)[D][C], int node) {
    using T = ScalarOf<V>;
    constexpr int step = (D - 1 - Axis) == 0 ? 1 : ((D - 1 - Axis) == 1 ? 3 : 9);
    const auto plane = [&](int k, V share, const V(&at)[C]) MPM_INLINE_LAMBDA {
        if constexpr (Axis == D - 1) {
            sums.add_mass(node + k, share);
            MPM_UNROLL for (int c = 0; c < C; ++c) sums.add(node + k, c, share * at[c]);
        } else {
            spread<Axis + 1, rolled, V, D, C>(sums, w, share, at, slope, node + k * step);
        }
    };
    if constexpr (rolled && Axis < D - 1) {
        const V below = w.value[Axis][0], here = w.value[Axis][1], above = w.value[Axis][2];
        MPM_NO_UNROLL for (int k = 0; k < 3; ++k) {
            V at[C];
            MPM_UNROLL for (int c = 0; c < C; ++c) at[c] = centre[c] + slope[Axis][c] * T(k - 1);
            plane(k, weight * (k == 0 ? below : (k == 1 ? here : above)), at);
        }
    } else {
        V at[C];
        MPM_UNROLL for (int c = 0; c < C; ++c) at[c] = centre[c] - slope[Axis][c];
        plane(0, weight * w.value[Axis][0], at);
        plane(1, weight * w.value[Axis][1], centre);
        MPM_UNROLL for (int c = 0; c < C; ++c) at[c] = centre[c] + slope[Axis][c];
        plane(2, weight * w.value[Axis][2], at);
    }
}

}  // namespace detail

/// `origin` is the lowest of the 3^(D-1) lines, as `Lines` numbers them.
template <int C, class V, int D, class Lines>
MPM_INLINE Affine<V, D, C> gather(const Lines& lines, const Weights<V, D>& w, int origin) {
    using T = ScalarOf<V>;
    constexpr int inner = D - 1;
    constexpr T inverse = T(quadratic_inverse_moment);
    const auto part = [&](int k) {
        const int at = origin + k * Lines::stride(0);
        if constexpr (D == 3)
            return detail::collapse_plane<V, C>(lines, w, at);
        else
            return detail::collapse_line<V, 2, C>(lines, w, at);
    };
    const auto below = part(0);
    const auto here = part(1);
    const auto above = part(2);
    const V xi = w.offset(0), half = T(0.5) * xi, square = xi * xi + T(0.25);
    const V bend = inverse * (xi * w.value[0][1]);
    const V(&n)[3] = w.value[0];
    Affine<V, D, C> out;
    MPM_UNROLL for (int c = 0; c < C; ++c) {
        const V rise = above.value[c] - below.value[c];
        const V bow = T(0.5) * (above.value[c] + below.value[c]) - here.value[c];
        out.value[c] = here.value[c] + half * rise + square * bow;
        out.slope[0][c] = T(0.5) * rise + bend * bow;
        MPM_UNROLL for (int g = 0; g < inner; ++g) {
            out.slope[g + 1][c] =
                n[0] * below.slope[g][c] + n[1] * here.slope[g][c] + n[2] * above.slope[g][c];
        }
        if constexpr (D == 3) {  // from the moment about the cell's centre
            out.slope[1][c] = inverse * out.slope[1][c] - (inverse * w.offset(1)) * out.value[c];
        }
    }
    return out;
}

/// A deposit about the centre of its cell: linear in the node's number, -1, 0 or 1 along each axis.
template <class V, int D, int C>
struct Deposit {
    V weight[D][3];
    V centre[C];
    V slope[D][C];
};

template <class V, int D, int C>
MPM_INLINE Deposit<V, D, C> deposit_of(const Weights<V, D>& w, const Affine<V, D, C>& q) {
    Deposit<V, D, C> d;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        MPM_UNROLL for (int k = 0; k < 3; ++k) d.weight[a][k] = w.value[a][k];
        MPM_UNROLL for (int c = 0; c < C; ++c) d.slope[a][c] = q.slope[a][c];
    }
    MPM_UNROLL for (int c = 0; c < C; ++c) {
        d.centre[c] = q.value[c];
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            d.centre[c] = d.centre[c] - q.slope[a][c] * w.offset(a);
        }
    }
    return d;
}

/// One node of a deposit: its share of the mass, and in `value` what each unit of that carries.
template <class V, int D, int C>
MPM_INLINE V deposit_at(const Deposit<V, D, C>& d, int node, V (&value)[C]) {
    using T = ScalarOf<V>;
    V share = V(T(1));
    MPM_UNROLL for (int c = 0; c < C; ++c) value[c] = d.centre[c];
    MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
        const int k = node % 3;
        node /= 3;
        share = share * d.weight[a][k];
        MPM_UNROLL for (int c = 0; c < C; ++c) value[c] = value[c] + d.slope[a][c] * T(k - 1);
    }
    return share;
}

/// Adds to node 0 .. 3^D - 1 (last axis fastest); `unit` is 1, or 0 in lanes that hold no particle.
/// `rolled` loops over the lines of nodes: a ninth of the code, for sums that are in memory.
template <class V, int D, int C, bool rolled = false, class Sums>
MPM_INLINE void scatter(Sums& sums, const Weights<V, D>& w, V unit, const Affine<V, D, C>& q) {
    const Deposit<V, D, C> d = deposit_of(w, q);
    detail::spread<0, rolled, V, D, C>(sums, w, unit, d.centre, d.slope, 0);
}

}  // namespace mpm
