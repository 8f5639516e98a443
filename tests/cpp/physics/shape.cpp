// Quadratic splines: the sums that every transfer relies on.
#include "mpm/physics/shape/quadratic.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "support/random.hpp"

namespace mpm {
namespace {

template <class T, int D>
void check_moments() {
    constexpr double eps = std::numeric_limits<T>::epsilon();
    test::Random random(3);
    for (int round = 0; round < 20000; ++round) {
        Vec<T, D> xi;
        for (int a = 0; a < D; ++a) {
            xi[a] = round < 3 ? T(0.5 * (round - 1)) : T(random.between(-0.5, 0.5));
        }
        const auto w = quadratic_weights<T, D>(xi);
        for (int a = 0; a < D; ++a) {
            double sum = 0, first = 0, second = 0;
            for (int k = 0; k < 3; ++k) {
                const double distance = (k - 1) - double(xi[a]), n = w.value[a][k];
                ASSERT_GE(n, 0);
                sum += n;
                first += n * distance;
                second += n * distance * distance;
            }
            ASSERT_NEAR(sum, 1, 2 * eps) << xi[a];
            ASSERT_NEAR(first, 0, 2 * eps) << xi[a];
            ASSERT_NEAR(second, 0.25, 2 * eps) << xi[a];
            ASSERT_NEAR(second * quadratic_inverse_moment, 1, 8 * eps);
            ASSERT_EQ(w.offset(a), xi[a]);
        }
    }
}

TEST(Quadratic, moments_in_single_precision) {
    check_moments<float, 2>();
    check_moments<float, 3>();
}
TEST(Quadratic, moments_in_double_precision) {
    check_moments<double, 2>();
    check_moments<double, 3>();
}

TEST(Quadratic, known_values) {
    const auto centre = quadratic_weights<double, 2>({{0.0, 0.5}});
    EXPECT_EQ(centre.value[0][0], 0.125);
    EXPECT_EQ(centre.value[0][1], 0.75);
    EXPECT_EQ(centre.value[0][2], 0.125);
    // On the face between two cells both share it and the third node sees nothing.
    EXPECT_EQ(centre.value[1][0], 0.0);
    EXPECT_EQ(centre.value[1][1], 0.5);
    EXPECT_EQ(centre.value[1][2], 0.5);
}

/// Weights do not jump where a particle changes its cell.
TEST(Quadratic, continuous_across_cells) {
    const auto left = quadratic_weights<double, 2>({{0.5, 0.5}});
    const auto right = quadratic_weights<double, 2>({{-0.5, -0.5}});
    for (int k = 0; k < 2; ++k) EXPECT_EQ(left.value[0][k + 1], right.value[0][k]);
    EXPECT_EQ(right.value[0][2], 0.0);
}

TEST(Quadratic, stencil_sizes) {
    EXPECT_EQ(stencil_nodes<2>, 9);
    EXPECT_EQ(stencil_nodes<3>, 27);
}

}  // namespace
}  // namespace mpm
