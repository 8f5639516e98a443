// Small vectors and square matrices over any number type. Only what the formulae use.
#pragma once

#include "mpm/core/number.hpp"

namespace mpm {

template <class V, int N>
struct Vec {
    V e[N];
    MPM_INLINE V& operator[](int i) { return e[i]; }
    MPM_INLINE const V& operator[](int i) const { return e[i]; }
};

/// The same vector in another number type.
template <class G, class V, int N>
MPM_INLINE Vec<G, N> as(const Vec<V, N>& v) {
    Vec<G, N> out;
    MPM_UNROLL for (int i = 0; i < N; ++i) out.e[i] = G(v.e[i]);
    return out;
}

template <class V, int N>
struct Mat {
    V e[N][N];
    MPM_INLINE V& operator()(int r, int c) { return e[r][c]; }
    MPM_INLINE const V& operator()(int r, int c) const { return e[r][c]; }
};

template <class V, int N>
MPM_INLINE V trace(const Mat<V, N>& a) {
    V t = a.e[0][0];
    MPM_UNROLL for (int i = 1; i < N; ++i) t = t + a.e[i][i];
    return t;
}

template <class V, int N>
MPM_INLINE Mat<V, N> product(const Mat<V, N>& a, const Mat<V, N>& b) {
    Mat<V, N> c;
    MPM_UNROLL for (int i = 0; i < N; ++i) MPM_UNROLL for (int j = 0; j < N; ++j) {
        V s = a.e[i][0] * b.e[0][j];
        MPM_UNROLL for (int k = 1; k < N; ++k) s = s + a.e[i][k] * b.e[k][j];
        c.e[i][j] = s;
    }
    return c;
}

/// a b^T
template <class V, int N>
MPM_INLINE Mat<V, N> product_transposed(const Mat<V, N>& a, const Mat<V, N>& b) {
    Mat<V, N> c;
    MPM_UNROLL for (int i = 0; i < N; ++i) MPM_UNROLL for (int j = 0; j < N; ++j) {
        V s = a.e[i][0] * b.e[j][0];
        MPM_UNROLL for (int k = 1; k < N; ++k) s = s + a.e[i][k] * b.e[j][k];
        c.e[i][j] = s;
    }
    return c;
}

/// Matrix of cofactors, so that inverse(a) = cofactors(a)^T / det(a).
template <class V>
MPM_INLINE Mat<V, 2> cofactors(const Mat<V, 2>& a) {
    Mat<V, 2> c;
    c.e[0][0] = a.e[1][1];
    c.e[0][1] = -a.e[1][0];
    c.e[1][0] = -a.e[0][1];
    c.e[1][1] = a.e[0][0];
    return c;
}
template <class V>
MPM_INLINE Mat<V, 3> cofactors(const Mat<V, 3>& a) {
    Mat<V, 3> c;
    MPM_UNROLL for (int i = 0; i < 3; ++i) MPM_UNROLL for (int j = 0; j < 3; ++j) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
        c.e[i][j] = a.e[i1][j1] * a.e[i2][j2] - a.e[i1][j2] * a.e[i2][j1];
    }
    return c;
}

template <class V, int N>
MPM_INLINE V determinant(const Mat<V, N>& a, const Mat<V, N>& cof) {
    V d = a.e[0][0] * cof.e[0][0];
    MPM_UNROLL for (int j = 1; j < N; ++j) d = d + a.e[0][j] * cof.e[0][j];
    return d;
}

/// det(I + h) - 1 without forming the difference of nearly equal numbers.
template <class V>
MPM_INLINE V volume_change(const Mat<V, 2>& h) {
    return trace(h) + (h.e[0][0] * h.e[1][1] - h.e[0][1] * h.e[1][0]);
}
template <class V>
MPM_INLINE V volume_change(const Mat<V, 3>& h) {
    Mat<V, 3> c = cofactors(h);
    return trace(h) + (trace(c) + determinant(h, c));
}

}  // namespace mpm
