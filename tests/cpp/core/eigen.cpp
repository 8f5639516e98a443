// Spectra of small symmetric matrices.
#include "mpm/core/eigen.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "support/random.hpp"

namespace mpm {
namespace {

template <class T, int N>
void check_spectrum(double tolerance) {
    test::Random random(3);
    for (double size : {1e-18, 1e-6, 1.0, 1e6}) {
        for (int round = 0; round < 400; ++round) {
            // Every third has two equal eigenvalues, every fifth is diagonal, every seventh zero.
            const auto axes = random.template rotation<N>();
            Vec<double, N> value;
            for (int i = 0; i < N; ++i) value[i] = size * random.between(-1, 1);
            if (round % 3 == 0) value[1] = value[0];
            if (round % 7 == 0)
                for (int i = 0; i < N; ++i) value[i] = 0;
            Mat<double, N> wide = compose(value, axes);
            Mat<T, N> a;
            for (int i = 0; i < N; ++i)
                for (int j = 0; j < N; ++j)
                    a.e[i][j] = round % 5 == 0 && i != j ? T(0) : T(wide.e[i][j]);
            const auto s = spectrum(a);
            const auto back = compose(s.value, s.axes);
            const auto unit = product_transposed(s.axes, s.axes);
            for (int i = 0; i < N; ++i)
                for (int j = 0; j < N; ++j) {
                    ASSERT_NEAR(back.e[i][j], a.e[i][j], tolerance * size) << size;
                    ASSERT_NEAR(unit.e[i][j], i == j, tolerance);
                }
        }
    }
}
TEST(Spectrum, float_2d) { check_spectrum<float, 2>(2e-6); }
TEST(Spectrum, float_3d) { check_spectrum<float, 3>(2e-6); }
TEST(Spectrum, double_2d) { check_spectrum<double, 2>(4e-15); }
TEST(Spectrum, double_3d) { check_spectrum<double, 3>(4e-15); }

/// A graded matrix: the small eigenvalue keeps its own digits.
TEST(Spectrum, small_beside_large) {
    Mat<double, 3> a{};
    a.e[0][0] = 1;
    a.e[1][1] = 1e-12;
    a.e[2][2] = 3e-12;
    a.e[1][2] = a.e[2][1] = 1e-12;
    const auto s = spectrum(a);
    double product = 1;
    for (int i = 0; i < 3; ++i) product *= s.value[i];
    EXPECT_NEAR(product, 2e-24, 1e-12 * 2e-24);
}

/// Entries of any size down to the smallest number: no square of theirs need exist.
template <class T, int N>
void check_any_size() {
    test::Random random(5);
    const int least = std::ilogb(std::numeric_limits<T>::denorm_min());
    constexpr double tolerance = sizeof(T) == 4 ? 2e-6 : 4e-15;
    for (int round = 0; round < 20000; ++round) {
        Mat<T, N> a;
        double size = 0;
        for (int i = 0; i < N; ++i)
            for (int j = 0; j <= i; ++j) {
                // Some differ from others by the smallest number alone.
                const bool near = random.integer(0, 3) == 0;
                const double x =
                    std::ldexp(random.between(-1, 1), near ? least / 2 : random.integer(least, 0));
                a.e[i][j] = a.e[j][i] = T(x);
                if (i == j && i > 0 && random.integer(0, 2) == 0)
                    a.e[i][i] = a.e[i - 1][i - 1] + T(std::ldexp(1.0, least));
                size = std::fmax(size, std::fabs(double(a.e[i][j])));
            }
        const auto s = spectrum(a);
        const auto back = compose(s.value, s.axes);
        const auto unit = product_transposed(s.axes, s.axes);
        for (int i = 0; i < N; ++i)
            for (int j = 0; j < N; ++j) {
                ASSERT_NEAR(back.e[i][j], a.e[i][j],
                            tolerance * size + 8 * std::numeric_limits<T>::denorm_min());
                ASSERT_NEAR(unit.e[i][j], i == j, tolerance);
            }
    }
}
TEST(Spectrum, any_size_float_2d) { check_any_size<float, 2>(); }
TEST(Spectrum, any_size_float_3d) { check_any_size<float, 3>(); }
TEST(Spectrum, any_size_double_2d) { check_any_size<double, 2>(); }
TEST(Spectrum, any_size_double_3d) { check_any_size<double, 3>(); }

}  // namespace
}  // namespace mpm
