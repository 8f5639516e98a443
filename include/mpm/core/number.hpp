// What a physics formula may ask of its number type V: float, double, or a pack of either. Formulae
// never branch on values; they select. exp, log, expm1 and log1p are our own, without branches or
// tables, so that a lane, a GPU thread and a scalar compute the same thing; tests hold them to 4
// units in the last place.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "mpm/core/config.hpp"
#include "mpm/core/pack.hpp"

namespace mpm {

MPM_INLINE float select(bool m, float a, float b) { return m ? a : b; }
MPM_INLINE double select(bool m, double a, double b) { return m ? a : b; }
MPM_INLINE bool any(bool m) { return m; }
MPM_INLINE bool all(bool m) { return m; }
MPM_INLINE float square_root(float x) { return ::sqrtf(x); }
MPM_INLINE double square_root(double x) { return ::sqrt(x); }

template <class V>
struct NumberTraits {
    using Scalar = V;
    using Mask = bool;
    static constexpr int lanes = 1;
};
template <class V>
using ScalarOf = typename NumberTraits<V>::Scalar;
template <class V>
using MaskOf = typename NumberTraits<V>::Mask;

MPM_INLINE float absolute(float x) { return ::fabsf(x); }
MPM_INLINE double absolute(double x) { return ::fabs(x); }
template <class V>
MPM_INLINE V absolute(V x) {
    return select(x < V(ScalarOf<V>(0)), -x, x);
}
template <class V>
MPM_INLINE V larger(V a, V b) {
    return select(a < b, b, a);
}
template <class V>
MPM_INLINE V smaller(V a, V b) {
    return select(b < a, b, a);
}

namespace detail {

template <class T>
struct Format;
template <>
struct Format<float> {
    using Bits = std::uint32_t;
    static constexpr int mantissa = 23, bias = 127;
    static constexpr Bits sqrt_half = 0x3f3504f3u;
    static constexpr float magic = 12582912.0f;        // 1.5 * 2^23: adding it rounds to an integer
    static constexpr float two_mantissa = 8388608.0f;  // 2^23
    static constexpr float ln2_high = 0.693359375f, ln2_low = -2.12194440e-4f;
    static constexpr float exp_low = -103.972f, exp_high = 88.7229f;
    static constexpr int exp_terms = 7, log_terms = 6;
};
template <>
struct Format<double> {
    using Bits = std::uint64_t;
    static constexpr int mantissa = 52, bias = 1023;
    static constexpr Bits sqrt_half = 0x3fe6a09e667f3bcdull;
    static constexpr double magic = 6755399441055744.0;
    static constexpr double two_mantissa = 4503599627370496.0;
    static constexpr double ln2_high = 6.93147180369123816490e-01,
                            ln2_low = 1.90821492927058770002e-10;
    static constexpr double exp_low = -745.1332, exp_high = 709.7827;
    static constexpr int exp_terms = 14, log_terms = 12;
};

}  // namespace detail

#if !defined(__CUDACC__)
template <class T, int W>
struct NumberTraits<Pack<T, W>> {
    using Scalar = T;
    using Mask = PackMask<T, W>;
    static constexpr int lanes = W;
};
#endif

namespace detail {

template <class V>
struct BitsOf {
    using type = typename Format<V>::Bits;
};
#if !defined(__CUDACC__)
template <class T, int W>
struct BitsOf<Pack<T, W>> {
    typedef typename Format<T>::Bits type __attribute__((vector_size(W * sizeof(T))));
};
#endif

template <class V>
MPM_INLINE typename BitsOf<V>::type to_bits(V x) {
    typename BitsOf<V>::type b;
    static_assert(sizeof(b) == sizeof(V));
    memcpy(&b, &x, sizeof(b));
    return b;
}
template <class V>
MPM_INLINE V from_bits(typename BitsOf<V>::type b) {
    V x;
    memcpy(&x, &b, sizeof(b));
    return x;
}

// 2^k for integral k held in `shifted` = k + magic; k must be in the normal exponent range.
template <class V>
MPM_INLINE V power_of_two(V shifted) {
    using F = Format<ScalarOf<V>>;
    using Bits = typename F::Bits;
    return from_bits<V>((to_bits(shifted) + Bits(F::bias)) << F::mantissa);
}

// expm1(r) for |r| <= ln2 / 2 by its Taylor series.
template <class V>
MPM_INLINE V expm1_reduced(V r) {
    using T = ScalarOf<V>;
    constexpr int n = Format<T>::exp_terms;
    T factor[n + 1] = {};
    factor[0] = 1;
    MPM_UNROLL for (int k = 1; k <= n; ++k) factor[k] = factor[k - 1] / T(k);
    V p = V(factor[n]);
    MPM_UNROLL for (int k = n - 1; k >= 2; --k) p = p * r + factor[k];
    return r + r * r * p;
}

// log(1 + f) for 1 + f in [sqrt(1/2), sqrt(2)): 2 atanh(f / (2 + f)).
template <class V>
MPM_INLINE V log_reduced(V f) {
    using T = ScalarOf<V>;
    constexpr int n = Format<T>::log_terms;
    V s = f / (f + T(2));
    V z = s * s;
    V p = V(T(2) / T(2 * n + 1));
    MPM_UNROLL for (int k = n - 1; k >= 1; --k) p = p * z + T(2) / T(2 * k + 1);
    // f - s f = 2 s exactly in exact arithmetic and loses less than forming 2 s.
    return f - s * (f - z * p);
}

template <class V>
struct Split {
    V factor;    // in [sqrt(1/2), sqrt(2))
    V exponent;  // integral
    V inverse;   // 2^(2 - exponent): a normal number for every x
};

template <class V>
MPM_INLINE Split<V> split(V x) {
    using T = ScalarOf<V>;
    using F = Format<T>;
    using Bits = typename F::Bits;
    auto bits = to_bits(x);
    auto biased =
        (bits - F::sqrt_half + (Bits(F::bias) << F::mantissa)) >> F::mantissa;  // exponent + bias
    Split<V> out;
    out.factor = from_bits<V>(bits - (biased << F::mantissa) + (Bits(F::bias) << F::mantissa));
    auto magic = to_bits(V(F::two_mantissa));
    out.exponent = from_bits<V>(biased | magic) - T(F::two_mantissa + F::bias);
    out.inverse = from_bits<V>((Bits(2 * F::bias + 2) - biased) << F::mantissa);
    return out;
}

}  // namespace detail

/// e^x - 1, accurate near zero. Overflow gives infinity, underflow -1.
template <class V>
MPM_INLINE V expm1_of(V x) {
    using T = ScalarOf<V>;
    using F = detail::Format<T>;
    V c = smaller(larger(x, V(T(F::exp_low))), V(T(F::exp_high)));
    V shifted = c * T(1.4426950408889634074) + T(F::magic);
    V k = shifted - T(F::magic);
    V r = (c - k * T(F::ln2_high)) - k * T(F::ln2_low);
    V em1 = detail::expm1_reduced(r);
    // Two factors keep each power of two in the normal range at both ends.
    V half = (k * T(0.5)) + T(F::magic);
    V first = detail::power_of_two(half);
    V second = detail::power_of_two((k - (half - T(F::magic))) + T(F::magic));
    V inverse = detail::power_of_two(T(F::magic) - (half - T(F::magic)));
    V y = first * (second * em1 + (second - inverse));
    y = select(x > V(T(F::exp_high)), V(std::numeric_limits<T>::infinity()), y);
    return select(x == x, y, x);
}

/// e^x. Overflow gives infinity, results below the normal range lose bits as usual.
template <class V>
MPM_INLINE V exp_of(V x) {
    using T = ScalarOf<V>;
    using F = detail::Format<T>;
    V c = smaller(larger(x, V(T(F::exp_low))), V(T(F::exp_high)));
    V shifted = c * T(1.4426950408889634074) + T(F::magic);
    V k = shifted - T(F::magic);
    V r = (c - k * T(F::ln2_high)) - k * T(F::ln2_low);
    V half = (k * T(0.5)) + T(F::magic);
    V first = detail::power_of_two(half);
    V second = detail::power_of_two((k - (half - T(F::magic))) + T(F::magic));
    V y = (detail::expm1_reduced(r) + T(1)) * second * first;
    y = select(x > V(T(F::exp_high)), V(std::numeric_limits<T>::infinity()), y);
    y = select(x < V(T(F::exp_low)), V(T(0)), y);
    return select(x == x, y, x);
}

/// log(1 + x), accurate near zero; -infinity at -1, not-a-number below.
template <class V>
MPM_INLINE V log1p_of(V x) {
    using T = ScalarOf<V>;
    using F = detail::Format<T>;
    V u = x + T(1);
    V lost = select(absolute(x) < V(T(1)), x - (u - T(1)), T(1) - (u - x));
    auto s = detail::split(u);
    V f = (s.factor - T(1)) + T(0.25) * (lost * s.inverse);
    V y = s.exponent * T(F::ln2_high) + (detail::log_reduced(f) + s.exponent * T(F::ln2_low));
    y = select(u == V(T(0)), V(-std::numeric_limits<T>::infinity()), y);
    y = select(u < V(T(0)), V(std::numeric_limits<T>::quiet_NaN()), y);
    y = select(x > V(std::numeric_limits<T>::max()), x, y);
    return select(x == x, y, x);
}

/// Natural logarithm of a normal positive number; -infinity at 0, not-a-number below.
template <class V>
MPM_INLINE V log_of(V x) {
    using T = ScalarOf<V>;
    using F = detail::Format<T>;
    auto s = detail::split(x);
    V f = s.factor - T(1);
    V y = s.exponent * T(F::ln2_high) + (detail::log_reduced(f) + s.exponent * T(F::ln2_low));
    y = select(x == V(T(0)), V(-std::numeric_limits<T>::infinity()), y);
    y = select(x < V(T(0)), V(std::numeric_limits<T>::quiet_NaN()), y);
    y = select(x > V(std::numeric_limits<T>::max()), x, y);
    return select(x == x, y, x);
}

/// Neither infinite nor not-a-number, lane by lane. By comparison: x * 0 is not safe, as GCC takes
/// it for 0 in packs when zeros need no sign.
template <class V>
MPM_INLINE MaskOf<V> is_finite(V x) {
    using T = ScalarOf<V>;
    constexpr T most = std::numeric_limits<T>::max();
    return (V(-most) <= x) & (x <= V(most));
}

}  // namespace mpm
