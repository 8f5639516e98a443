#include "mpm/core/linalg.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "support/random.hpp"

namespace mpm {
namespace {

template <class T, int N>
struct Case {
    using Scalar = T;
    static constexpr int n = N;
};

long double exact_determinant(const Mat<long double, 2>& a) {
    return a(0, 0) * a(1, 1) - a(0, 1) * a(1, 0);
}
long double exact_determinant(const Mat<long double, 3>& a) {
    return a(0, 0) * (a(1, 1) * a(2, 2) - a(1, 2) * a(2, 1)) -
           a(0, 1) * (a(1, 0) * a(2, 2) - a(1, 2) * a(2, 0)) +
           a(0, 2) * (a(1, 0) * a(2, 1) - a(1, 1) * a(2, 0));
}
/// det(I + h) - 1 from its expansion: exact for the numbers given to 1e-19 of the largest term.
long double exact_change(const Mat<long double, 2>& h) {
    return h(0, 0) + h(1, 1) + exact_determinant(h);
}
long double exact_change(const Mat<long double, 3>& h) {
    long double minors = 0;
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3;
        minors += h(i, i) * h(j, j) - h(i, j) * h(j, i);
    }
    return h(0, 0) + h(1, 1) + h(2, 2) + minors + exact_determinant(h);
}

template <class C>
class Linalg : public ::testing::Test {
protected:
    using T = typename C::Scalar;
    static constexpr int N = C::n;
    static constexpr double eps = std::numeric_limits<T>::epsilon();
    test::Random random{11};

    Mat<T, N> matrix(double size) {
        Mat<T, N> out;
        const Mat<double, N> m = random.template matrix<N>(size);
        for (int i = 0; i < N; ++i)
            for (int j = 0; j < N; ++j) out(i, j) = T(m(i, j));
        return out;
    }
    static Mat<long double, N> widen(const Mat<T, N>& m) {
        Mat<long double, N> out;
        for (int i = 0; i < N; ++i)
            for (int j = 0; j < N; ++j) out(i, j) = m(i, j);
        return out;
    }
};
using Types = ::testing::Types<Case<float, 2>, Case<float, 3>, Case<double, 2>, Case<double, 3>>;
TYPED_TEST_SUITE(Linalg, Types);

TYPED_TEST(Linalg, products) {
    using T = typename TypeParam::Scalar;
    constexpr int N = TypeParam::n;
    for (int round = 0; round < 100; ++round) {
        const auto a = this->matrix(1), b = this->matrix(1);
        const auto plain = product(a, b), turned = product_transposed(a, b);
        double t = 0;
        for (int i = 0; i < N; ++i) {
            t += a(i, i);
            for (int j = 0; j < N; ++j) {
                double p = 0, q = 0;
                for (int k = 0; k < N; ++k) {
                    p += double(a(i, k)) * b(k, j);
                    q += double(a(i, k)) * b(j, k);
                }
                EXPECT_NEAR(plain(i, j), p, 4 * this->eps);
                EXPECT_NEAR(turned(i, j), q, 4 * this->eps);
            }
        }
        EXPECT_NEAR(trace(a), T(t), 4 * this->eps);
    }
}

TYPED_TEST(Linalg, cofactors_and_determinant) {
    constexpr int N = TypeParam::n;
    for (int round = 0; round < 1000; ++round) {
        const auto a = this->matrix(2);
        const auto c = cofactors(a);
        const auto wide = cofactors(this->widen(a));
        const long double d = exact_determinant(this->widen(a));
        EXPECT_NEAR(double(determinant(a, c)), double(d), 200 * this->eps);
        for (int i = 0; i < N; ++i) {
            for (int j = 0; j < N; ++j) {
                EXPECT_NEAR(double(c(i, j)), double(wide(i, j)), 20 * this->eps);
                // a cof(a)^T = det(a) I
                long double s = 0;
                for (int k = 0; k < N; ++k) s += (long double)(a(i, k)) * wide(j, k);
                EXPECT_NEAR(double(s), i == j ? double(d) : 0.0, 1e-15);
            }
        }
    }
}

TYPED_TEST(Linalg, volume_change_keeps_its_digits_near_the_identity) {
    for (double size : {1e-12, 1e-9, 1e-6, 1e-3, 0.1}) {
        for (int round = 0; round < 200; ++round) {
            const auto h = this->matrix(size);
            const double exact = double(exact_change(this->widen(h)));
            EXPECT_NEAR(double(volume_change(h)), exact, 20 * this->eps * size) << size;
        }
    }
}

TYPED_TEST(Linalg, volume_change_of_known_deformations) {
    using T = typename TypeParam::Scalar;
    constexpr int N = TypeParam::n;
    Mat<T, N> h{};
    EXPECT_EQ(volume_change(h), T(0));
    h(0, 1) = T(0.5);  // simple shear
    EXPECT_EQ(volume_change(h), T(0));
    h = {};
    for (int i = 0; i < N; ++i) h(i, i) = T(1);
    EXPECT_EQ(volume_change(h), T((1 << N) - 1));
    h(0, 0) = T(-1);  // flat
    EXPECT_EQ(volume_change(h), T(-1));
}

/// Negative control: forming I + h first loses what the test above asks for.
TEST(LinalgControl, difference_of_determinants_loses_digits) {
    const float h = 1e-9f;
    const Mat<float, 3> f = {{{1 + h, 0, 0}, {0, 1 + h, 0}, {0, 0, 1 + h}}};
    EXPECT_EQ(determinant(f, cofactors(f)) - 1, 0.0f);
    const Mat<float, 3> small = {{{h, 0, 0}, {0, h, 0}, {0, 0, h}}};
    EXPECT_FLOAT_EQ(volume_change(small), 3e-9f);
}

}  // namespace
}  // namespace mpm
