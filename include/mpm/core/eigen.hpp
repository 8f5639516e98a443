// Eigenvalues and eigenvectors of small symmetric matrices by Jacobi's rotations: no branches, so
// that a pack of matrices goes as one does, and small eigenvalues keep the digits they came with.
#pragma once

#include "mpm/core/linalg.hpp"

namespace mpm {

/// a = sum_i value[i] axis_i axis_i^T, axis_i the i-th column of `axes`; in no particular order.
template <class V, int N>
struct Spectrum {
    Vec<V, N> value;
    Mat<V, N> axes;
};

namespace detail {

/// Turns the plane of axes p and q so that a(p, q) vanishes.
template <class V, int N>
MPM_INLINE void jacobi_turn(Mat<V, N>& a, Mat<V, N>& axes, int p, int q) {
    using T = ScalarOf<V>;
    const V zero = V(T(0)), apart = a.e[q][q] - a.e[p][p], twice = T(2) * a.e[p][q];
    // Never below what it stands for, also where the squares have vanished: a tangent beyond one
    // would grow until its rotation is none.
    const V reach =
        absolute(apart) + larger(square_root(apart * apart + twice * twice), absolute(twice));
    const V ratio = twice / select(zero < reach, reach, V(T(1)));
    const V tangent = select(apart < zero, -ratio, ratio);
    const V cosine = T(1) / square_root(tangent * tangent + T(1)), sine = tangent * cosine;
    const V moved = tangent * a.e[p][q];
    a.e[p][p] = a.e[p][p] - moved;
    a.e[q][q] = a.e[q][q] + moved;
    a.e[p][q] = a.e[q][p] = zero;
    MPM_UNROLL for (int k = 0; k < N; ++k) {
        if (k != p && k != q) {
            const V x = a.e[k][p], y = a.e[k][q];
            a.e[k][p] = a.e[p][k] = cosine * x - sine * y;
            a.e[k][q] = a.e[q][k] = sine * x + cosine * y;
        }
        const V x = axes.e[k][p], y = axes.e[k][q];
        axes.e[k][p] = cosine * x - sine * y;
        axes.e[k][q] = sine * x + cosine * y;
    }
}

}  // namespace detail

template <class V, int N>
MPM_INLINE Spectrum<V, N> spectrum(const Mat<V, N>& matrix) {
    using T = ScalarOf<V>;
    // Products of entries must not vanish before the entries do. Not below the smallest normal
    // number, as the reciprocal of less is infinite; entries of a matrix that is smaller still keep
    // what digits they have.
    V size = V(std::numeric_limits<T>::min());
    MPM_UNROLL for (int i = 0; i < N; ++i) MPM_UNROLL for (int j = 0; j <= i; ++j) {
        size = larger(size, absolute(matrix.e[i][j]));
    }
    const V unit = T(1) / size;
    Mat<V, N> a;
    Spectrum<V, N> out;
    MPM_UNROLL for (int i = 0; i < N; ++i) MPM_UNROLL for (int j = 0; j < N; ++j) {
        a.e[i][j] = unit * matrix.e[i][j];
        out.axes.e[i][j] = V(T(i == j ? 1 : 0));
    }
    if constexpr (N == 2) {
        detail::jacobi_turn(a, out.axes, 0, 1);
    } else {
        // What is left of the other entries is squared by every sweep.
        constexpr T still = sizeof(T) == 4 ? T(1e-9) : T(1e-18);
        for (int sweep = 0; sweep < 8; ++sweep) {
            const V left =
                larger(absolute(a.e[0][1]), larger(absolute(a.e[0][2]), absolute(a.e[1][2])));
            const MaskOf<V> active = left > V(still);
            if (!any(active)) break;
            // Each lane stops for itself, so that what it gets does not depend on its neighbours:
            // what is diagonal is turned by nothing.
            MPM_UNROLL for (int i = 0; i < N; ++i) MPM_UNROLL for (int j = 0; j < i; ++j) {
                a.e[i][j] = a.e[j][i] = select(active, a.e[i][j], V(T(0)));
            }
            detail::jacobi_turn(a, out.axes, 0, 1);
            detail::jacobi_turn(a, out.axes, 0, 2);
            detail::jacobi_turn(a, out.axes, 1, 2);
        }
    }
    MPM_UNROLL for (int i = 0; i < N; ++i) out.value[i] = size * a.e[i][i];
    return out;
}

/// sum_i value[i] axis_i axis_i^T
template <class V, int N>
MPM_INLINE Mat<V, N> compose(const Vec<V, N>& value, const Mat<V, N>& axes) {
    Mat<V, N> m;
    MPM_UNROLL for (int i = 0; i < N; ++i) MPM_UNROLL for (int j = 0; j <= i; ++j) {
        V sum = (value[0] * axes.e[i][0]) * axes.e[j][0];
        MPM_UNROLL for (int k = 1; k < N; ++k) {
            sum = sum + (value[k] * axes.e[i][k]) * axes.e[j][k];
        }
        m.e[i][j] = m.e[j][i] = sum;
    }
    return m;
}

}  // namespace mpm
