// exp, log, expm1 and log1p against a wider type, as scalars and packs, in the baseline instruction
// set and in the clones that the passes over particles run in.
#include "mpm/core/number.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <vector>

namespace mpm {
namespace {

#if defined(LIBMPM_SANITIZED) || defined(__clang__)
#define MPM_TEST_CLONES __attribute__((noinline))
#else
#define MPM_TEST_CLONES \
    __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4"), flatten, noinline))
#endif

struct Exp {
    template <class V>
    MPM_INLINE V operator()(V x) const {
        return exp_of(x);
    }
    template <class R>
    static R exact(R x) {
        return std::exp(x);
    }
};
struct Expm1 {
    template <class V>
    MPM_INLINE V operator()(V x) const {
        return expm1_of(x);
    }
    template <class R>
    static R exact(R x) {
        return std::expm1(x);
    }
};
struct Log {
    template <class V>
    MPM_INLINE V operator()(V x) const {
        return log_of(x);
    }
    template <class R>
    static R exact(R x) {
        return std::log(x);
    }
};
struct Log1p {
    template <class V>
    MPM_INLINE V operator()(V x) const {
        return log1p_of(x);
    }
    template <class R>
    static R exact(R x) {
        return std::log1p(x);
    }
};

template <class T>
struct Wider;
template <>
struct Wider<float> {
    using type = double;
};
template <>
struct Wider<double> {
    using type = long double;
};

template <class F, class V>
MPM_INLINE void evaluate_all(const ScalarOf<V>* in, ScalarOf<V>* out, std::size_t n) {
    if constexpr (NumberTraits<V>::lanes == 1) {
        for (std::size_t i = 0; i < n; ++i) out[i] = F{}(in[i]);
    } else {
        for (std::size_t i = 0; i < n; i += V::lanes) F{}(V::load(in + i)).store(out + i);
    }
}
template <class F, class V>
__attribute__((noinline)) void evaluate(const ScalarOf<V>* in, ScalarOf<V>* out, std::size_t n) {
    evaluate_all<F, V>(in, out, n);
}
template <class F, class V>
MPM_TEST_CLONES void evaluate_cloned(const ScalarOf<V>* in, ScalarOf<V>* out, std::size_t n) {
    evaluate_all<F, V>(in, out, n);
}

/// Error in units in the last place of the exact result; infinite where the kinds differ.
template <class T>
double error_in_ulp(T found, typename Wider<T>::type exact) {
    if (std::isnan(exact) || std::isnan(found)) {
        return std::isnan(exact) && std::isnan(found) ? 0 : HUGE_VAL;
    }
    if (std::isinf(found) || std::isinf(T(exact))) return found == T(exact) ? 0 : HUGE_VAL;
    if (exact == 0) return found == 0 ? 0 : HUGE_VAL;
    int e;
    std::frexp(exact, &e);
    e = std::max(e, std::numeric_limits<T>::min_exponent);
    const auto ulp = std::ldexp(typename Wider<T>::type(1), e - std::numeric_limits<T>::digits);
    return double(std::fabs((typename Wider<T>::type)(found)-exact) / ulp);
}

template <class T>
std::vector<T> spaced(double low, double high, int n) {
    std::vector<T> out;
    const double ratio = std::log(high / low);
    for (int i = 0; i < n; ++i) {
        const double x = low * std::exp(ratio * i / (n - 1));
        out.push_back(T(std::fmin(std::fmax(x, low), high)));
    }
    return out;
}

/// Both signs of numbers spaced evenly in their logarithm.
template <class T>
void add(std::vector<T>& to, double low, double high, double sign) {
    for (T x : spaced<T>(low, high, 20000)) to.push_back(T(sign * x));
}

template <class T>
class Number : public ::testing::Test {
protected:
    static constexpr bool single = sizeof(T) == 4;
    static constexpr T largest = std::numeric_limits<T>::max();
    static constexpr T least = std::numeric_limits<T>::min();
    static constexpr T infinity = std::numeric_limits<T>::infinity();
    static constexpr T nan = std::numeric_limits<T>::quiet_NaN();
    using Lanes = Pack<T, single ? 8 : 4>;

    template <class F>
    void check(std::vector<T> in) {
        while (in.size() % 8 != 0) in.push_back(T(0.5));
        std::vector<T> alone(in.size()), packed(in.size()), fused(in.size()), wide(in.size());
        evaluate<F, T>(in.data(), alone.data(), in.size());
        evaluate<F, Lanes>(in.data(), packed.data(), in.size());
        evaluate_cloned<F, T>(in.data(), fused.data(), in.size());
        evaluate_cloned<F, Lanes>(in.data(), wide.data(), in.size());
        const std::pair<const char*, const std::vector<T>*> routes[] = {
            {"scalar", &alone}, {"pack", &packed}, {"cloned scalar", &fused}, {"clone", &wide}};
        for (const auto& [route, out] : routes) {
            double worst = 0;
            std::size_t at = 0;
            for (std::size_t i = 0; i < in.size(); ++i) {
                const double e =
                    error_in_ulp((*out)[i], F::exact((typename Wider<T>::type)(in[i])));
                if (e > worst) {
                    worst = e;
                    at = i;
                }
            }
            EXPECT_LE(worst, 4.0) << route << " at " << in[at] << " gives " << (*out)[at];
        }
        for (std::size_t i = 0; i < in.size(); ++i) {
            ASSERT_EQ(detail::to_bits(alone[i]), detail::to_bits(packed[i])) << "at " << in[i];
        }
    }
};

using Types = ::testing::Types<float, double>;
TYPED_TEST_SUITE(Number, Types);

TYPED_TEST(Number, exponential) {
    using T = TypeParam;
    std::vector<T> in = {0, T(-0.0), 1, -1};
    add(in, 1e-30, this->single ? 88.72 : 709.78, 1);
    add(in, 1e-30, this->single ? 87.33 : 708.39, -1);  // results in the normal range
    add(in, 1e-3, 2, 1);
    add(in, 1e-3, 2, -1);
    this->template check<Exp>(in);
}

TYPED_TEST(Number, exponential_minus_one) {
    using T = TypeParam;
    std::vector<T> in = {0, T(-0.0), 1, -1};
    add(in, this->single ? 1e-37 : 1e-300, this->single ? 88.72 : 709.78, 1);
    add(in, this->single ? 1e-37 : 1e-300, this->single ? 1e30 : 1e300, -1);
    add(in, 1e-3, 2, 1);
    add(in, 1e-3, 2, -1);
    this->template check<Expm1>(in);
}

TYPED_TEST(Number, logarithm) {
    using T = TypeParam;
    std::vector<T> in = {1, 2, T(0.5), this->least, this->largest};
    add(in, this->least, this->largest, 1);
    for (T x : spaced<T>(std::numeric_limits<T>::epsilon(), 0.5, 20000)) {
        in.push_back(1 + x);
        in.push_back(1 - x);
    }
    this->template check<Log>(in);
}

TYPED_TEST(Number, logarithm_of_one_plus) {
    using T = TypeParam;
    std::vector<T> in = {0, T(-0.0), 1, this->least, -this->least, this->largest};
    add(in, this->single ? 1e-37 : 1e-300, this->largest, 1);
    add(in, this->single ? 1e-37 : 1e-300, 0.999, -1);
    add(in, 1e-3, 4, 1);
    for (T x : spaced<T>(std::numeric_limits<T>::epsilon() / 2, 0.5, 20000)) in.push_back(x - 1);
    this->template check<Log1p>(in);
}

TYPED_TEST(Number, ends_of_the_range) {
    using T = TypeParam;
    const T inf = this->infinity, nan = this->nan, top = this->largest;
    const T over = this->single ? 89 : 710, under = this->single ? -105 : -750;
    EXPECT_EQ(exp_of(T(0)), T(1));
    EXPECT_EQ(exp_of(over), inf);
    EXPECT_EQ(exp_of(inf), inf);
    EXPECT_EQ(exp_of(under), T(0));
    EXPECT_EQ(exp_of(-inf), T(0));
    EXPECT_EQ(exp_of(-top), T(0));
    EXPECT_EQ(expm1_of(T(0)), T(0));
    EXPECT_EQ(expm1_of(over), inf);
    EXPECT_EQ(expm1_of(inf), inf);
    EXPECT_EQ(expm1_of(under), T(-1));
    EXPECT_EQ(expm1_of(-inf), T(-1));
    EXPECT_EQ(log_of(T(1)), T(0));
    EXPECT_EQ(log_of(inf), inf);
    EXPECT_EQ(log_of(T(0)), -inf);
    EXPECT_EQ(log1p_of(T(0)), T(0));
    EXPECT_EQ(log1p_of(inf), inf);
    EXPECT_EQ(log1p_of(T(-1)), -inf);
    const T bad[] = {log_of(T(-1)),  log_of(-inf),   log1p_of(T(-1.5)),
                     log1p_of(-top), log1p_of(-inf), exp_of(nan),
                     expm1_of(nan),  log_of(nan),    log1p_of(nan)};
    for (T x : bad) EXPECT_TRUE(std::isnan(x));
}

TYPED_TEST(Number, ends_of_the_range_in_packs) {
    using T = TypeParam;
    using V = typename TestFixture::Lanes;
    const T special[] = {0,     T(-0.0),       this->infinity, -this->infinity, this->nan, T(-1),
                         T(-2), this->largest, -this->largest, this->least,     T(1),      T(800)};
    const auto same = [](T a, T b) { return std::isnan(a) ? std::isnan(b) : a == b; };
    for (T x : special) {
        V v = V(T(0.25));  // neighbours must not disturb, nor be disturbed
        v.raw[1] = x;
        EXPECT_TRUE(same(exp_of(v)[1], exp_of(x))) << x;
        EXPECT_TRUE(same(expm1_of(v)[1], expm1_of(x))) << x;
        EXPECT_TRUE(same(log_of(v)[1], log_of(x))) << x;
        EXPECT_TRUE(same(log1p_of(v)[1], log1p_of(x))) << x;
        EXPECT_EQ(log1p_of(v)[0], log1p_of(T(0.25)));
        EXPECT_EQ(exp_of(v)[V::lanes - 1], exp_of(T(0.25)));
    }
}

TYPED_TEST(Number, choices) {
    using T = TypeParam;
    EXPECT_EQ(absolute(T(-3)), T(3));
    EXPECT_EQ(absolute(T(3)), T(3));
    EXPECT_EQ(larger(T(2), T(-5)), T(2));
    EXPECT_EQ(smaller(T(2), T(-5)), T(-5));
    EXPECT_EQ(select(true, T(1), T(2)), T(1));
    EXPECT_EQ(select(false, T(1), T(2)), T(2));
    EXPECT_EQ(square_root(T(9)), T(3));
}

}  // namespace
}  // namespace mpm
