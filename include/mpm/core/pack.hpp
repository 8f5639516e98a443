// Pack<T, W>: W numbers that move together through the same formulae. The CPU drivers put the
// particles of one cell into the lanes. Built on GCC vector extensions and 32 bytes wide, which is
// what widens correctly inside functions with a `target` attribute (design/number-types.md).
#pragma once

#include "mpm/core/config.hpp"

#if !defined(__CUDACC__)

#include <cstdint>
#include <cstring>

namespace mpm {

template <class T, int W>
struct Pack {
    using value_type = T;
    static constexpr int lanes = W;
    typedef T Raw __attribute__((vector_size(W * sizeof(T))));
    Raw raw;

    Pack() = default;
    MPM_INLINE Pack(T x) { MPM_UNROLL for (int l = 0; l < W; ++l) raw[l] = x; }
    MPM_INLINE static Pack of(Raw r) {
        Pack p;
        p.raw = r;
        return p;
    }
    MPM_INLINE static Pack load(const T* from) {
        Pack p;
        std::memcpy(&p.raw, from, sizeof(Raw));
        return p;
    }
    MPM_INLINE void store(T* to) const { std::memcpy(to, &raw, sizeof(Raw)); }
    MPM_INLINE T operator[](int lane) const { return raw[lane]; }

    MPM_INLINE friend Pack operator+(Pack a, Pack b) { return of(a.raw + b.raw); }
    MPM_INLINE friend Pack operator-(Pack a, Pack b) { return of(a.raw - b.raw); }
    MPM_INLINE friend Pack operator*(Pack a, Pack b) { return of(a.raw * b.raw); }
    MPM_INLINE friend Pack operator/(Pack a, Pack b) { return of(a.raw / b.raw); }
    MPM_INLINE friend Pack operator*(Pack a, T b) { return of(a.raw * b); }
    MPM_INLINE friend Pack operator*(T a, Pack b) { return of(a * b.raw); }
    MPM_INLINE friend Pack operator+(Pack a, T b) { return of(a.raw + b); }
    MPM_INLINE friend Pack operator+(T a, Pack b) { return of(a + b.raw); }
    MPM_INLINE friend Pack operator-(Pack a, T b) { return of(a.raw - b); }
    MPM_INLINE friend Pack operator-(T a, Pack b) { return of(a - b.raw); }
    MPM_INLINE friend Pack operator-(Pack a) { return of(-a.raw); }
    MPM_INLINE Pack& operator+=(Pack b) {
        raw += b.raw;
        return *this;
    }
    MPM_INLINE Pack& operator-=(Pack b) {
        raw -= b.raw;
        return *this;
    }
    MPM_INLINE Pack& operator*=(Pack b) {
        raw *= b.raw;
        return *this;
    }
};

template <int Bytes>
struct LaneInteger;
template <>
struct LaneInteger<4> {
    using Signed = std::int32_t;
    using Unsigned = std::uint32_t;
};
template <>
struct LaneInteger<8> {
    using Signed = std::int64_t;
    using Unsigned = std::uint64_t;
};

// One truth value a lane, as all-ones or all-zeros integers of the lane's width.
template <class T, int W>
struct PackMask {
    using Integer = typename LaneInteger<sizeof(T)>::Signed;
    typedef Integer Raw __attribute__((vector_size(W * sizeof(T))));
    typedef std::int64_t Words __attribute__((vector_size(W * sizeof(T))));
    Raw raw;

    MPM_INLINE static PackMask of(Raw r) {
        PackMask m;
        m.raw = r;
        return m;
    }
    // The first `count` lanes are true.
    MPM_INLINE static PackMask first(int count) {
        PackMask m;
        MPM_UNROLL for (int l = 0; l < W; ++l) m.raw[l] = l < count ? Integer(-1) : Integer(0);
        return m;
    }
    MPM_INLINE bool operator[](int lane) const { return raw[lane] != 0; }
    MPM_INLINE friend PackMask operator&(PackMask a, PackMask b) { return of(a.raw & b.raw); }
    MPM_INLINE friend PackMask operator|(PackMask a, PackMask b) { return of(a.raw | b.raw); }
    MPM_INLINE friend PackMask operator!(PackMask a) { return of(~a.raw); }
};

template <class T, int W>
MPM_INLINE PackMask<T, W> operator<(Pack<T, W> a, Pack<T, W> b) {
    return PackMask<T, W>::of(a.raw < b.raw);
}
template <class T, int W>
MPM_INLINE PackMask<T, W> operator<=(Pack<T, W> a, Pack<T, W> b) {
    return PackMask<T, W>::of(a.raw <= b.raw);
}
template <class T, int W>
MPM_INLINE PackMask<T, W> operator>(Pack<T, W> a, Pack<T, W> b) {
    return b < a;
}
template <class T, int W>
MPM_INLINE PackMask<T, W> operator==(Pack<T, W> a, Pack<T, W> b) {
    return PackMask<T, W>::of(a.raw == b.raw);
}

template <class T, int W>
MPM_INLINE Pack<T, W> select(PackMask<T, W> m, Pack<T, W> a, Pack<T, W> b) {
    return Pack<T, W>::of(m.raw ? a.raw : b.raw);
}

template <class T, int W>
MPM_INLINE bool any(PackMask<T, W> m) {
    typename PackMask<T, W>::Words w;
    std::memcpy(&w, &m.raw, sizeof(w));
    std::int64_t out = 0;
    MPM_UNROLL for (unsigned k = 0; k < W * sizeof(T) / 8; ++k) out |= w[k];
    return out != 0;
}
template <class T, int W>
MPM_INLINE bool all(PackMask<T, W> m) {
    return !any(!m);
}

/// Lane k of the result is the sum of the lanes of a[k]: a tree of pairwise sums, three operations
/// a pack.
template <class T>
MPM_INLINE Pack<T, 8> sums_of_lanes(const Pack<T, 8> (&a)[8]) {
    typename Pack<T, 8>::Raw pair[4], quad[2];
    MPM_UNROLL for (int k = 0; k < 4; ++k) {
        const auto x = a[2 * k].raw, y = a[2 * k + 1].raw;
        pair[k] = __builtin_shufflevector(x, y, 0, 8, 1, 9, 4, 12, 5, 13) +
                  __builtin_shufflevector(x, y, 2, 10, 3, 11, 6, 14, 7, 15);
    }
    MPM_UNROLL for (int k = 0; k < 2; ++k) {
        const auto x = pair[2 * k], y = pair[2 * k + 1];
        quad[k] = __builtin_shufflevector(x, y, 0, 1, 8, 9, 4, 5, 12, 13) +
                  __builtin_shufflevector(x, y, 2, 3, 10, 11, 6, 7, 14, 15);
    }
    return Pack<T, 8>::of(__builtin_shufflevector(quad[0], quad[1], 0, 1, 2, 3, 8, 9, 10, 11) +
                          __builtin_shufflevector(quad[0], quad[1], 4, 5, 6, 7, 12, 13, 14, 15));
}
template <class T>
MPM_INLINE Pack<T, 4> sums_of_lanes(const Pack<T, 4> (&a)[4]) {
    typename Pack<T, 4>::Raw pair[2];
    MPM_UNROLL for (int k = 0; k < 2; ++k) {
        const auto x = a[2 * k].raw, y = a[2 * k + 1].raw;
        pair[k] =
            __builtin_shufflevector(x, y, 0, 4, 2, 6) + __builtin_shufflevector(x, y, 1, 5, 3, 7);
    }
    return Pack<T, 4>::of(__builtin_shufflevector(pair[0], pair[1], 0, 1, 4, 5) +
                          __builtin_shufflevector(pair[0], pair[1], 2, 3, 6, 7));
}

template <class T, int W>
MPM_INLINE Pack<T, W> square_root(Pack<T, W> p) {
    Pack<T, W> r;
    MPM_UNROLL for (int l = 0; l < W; ++l) r.raw[l] = __builtin_sqrt(p.raw[l]);
    return r;
}

}  // namespace mpm
#endif
