// The corotated stress without forming F - R, against singular values.
#include "mpm/physics/material/fixed_corotated.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>

#include "mpm/core/number.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

const double parameters[] = {1000.0, 1e6, 0.3};
const double mu = 1e6 / 2.6, lambda = 1e6 * 0.3 / (1.3 * 0.4);

/// 2 mu (F - R) F^T + lambda (J - 1) J I with R from the singular value decomposition.
template <int D>
Eigen::Matrix<double, D, D> reference(const Eigen::Matrix<double, D, D>& f) {
    using M = Eigen::Matrix<double, D, D>;
    const Eigen::JacobiSVD<M> svd(f, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const M r = svd.matrixU() * svd.matrixV().transpose();
    const double J = f.determinant();
    return 2 * mu * (f - r) * f.transpose() + lambda * (J - 1) * J * M::Identity();
}

template <int D>
void check_against_singular_values() {
    test::Random random(31);
    using M = Eigen::Matrix<double, D, D>;
    int checked = 0;
    for (int round = 0; round < 2000; ++round) {
        const auto turn = random.rotation<D>();
        const auto stretch = random.matrix<D>(round % 2 ? 0.05 : 0.6);
        M f, q;
        for (int i = 0; i < D; ++i)
            for (int j = 0; j < D; ++j) {
                q(i, j) = turn(i, j);
                f(i, j) = (i == j ? 1 : 0) + stretch(i, j);
            }
        f = q * f;
        if (f.determinant() < 0.06) continue;
        ++checked;
        double state[D * D];
        for (int i = 0; i < D * D; ++i) state[i] = f(i / D, i % D) - (i / D == i % D ? 1 : 0);
        ASSERT_TRUE((FixedCorotated::admissible<double, D>(state)));
        const auto tau = FixedCorotated::kirchhoff<double, D, double>(
            state, {}, FixedCorotated::constants<double>(parameters));
        const M expected = reference<D>(f);
        const double still[D][D] = {};
        const auto o = FixedCorotated::observe<D>(state, still, parameters);
        const Eigen::JacobiSVD<M> svd(f);
        double energy = 0.5 * lambda * std::pow(f.determinant() - 1, 2);
        for (int i = 0; i < D; ++i) energy += mu * std::pow(svd.singularValues()(i) - 1, 2);
        ASSERT_NEAR(o.elastic_energy, energy, 1e-9 * mu);
        for (int i = 0; i < D; ++i)
            for (int j = 0; j < D; ++j) {
                ASSERT_NEAR(tau(i, j), expected(i, j), 1e-9 * mu);
                ASSERT_NEAR(o.deformation[i][j], f(i, j), 1e-14);
            }
    }
    EXPECT_GT(checked, 1000);
}

TEST(FixedCorotated, singular_values_2d) { check_against_singular_values<2>(); }
TEST(FixedCorotated, singular_values_3d) { check_against_singular_values<3>(); }

/// Linear elasticity: the digits of a strain of 1e-7 survive single precision.
TEST(FixedCorotated, tiny_strain_in_single_precision) {
    const float e = 1e-7f;
    float state[9] = {e, 0, 0, 0, 0, 0, 0, 0, 0};
    const auto tau = FixedCorotated::kirchhoff<float, 3, float>(
        state, {}, FixedCorotated::constants<float>(parameters));
    EXPECT_NEAR(tau(0, 0), (2 * mu + lambda) * e, 1e-5 * (2 * mu + lambda) * e);
    EXPECT_NEAR(tau(1, 1), lambda * e, 1e-5 * lambda * e);
    EXPECT_NEAR(tau(2, 2), lambda * e, 1e-5 * lambda * e);
    // Negative control: in F such a strain is one unit in the last place.
    const float f = 1 + e;
    EXPECT_GT(std::fabs((f - 1) / e - 1), 0.1);
}

TEST(FixedCorotated, advance_is_the_product) {
    test::Random random(37);
    for (int round = 0; round < 100; ++round) {
        const auto h = random.matrix<3>(0.3), l = random.matrix<3>(0.1);
        double state[9];
        for (int i = 0; i < 9; ++i) state[i] = h(i / 3, i % 3);
        FixedCorotated::advance<double, 3>(state, l, FixedCorotated::Constants<double>{});
        Mat<double, 3> f = h, g = l;
        for (int a = 0; a < 3; ++a) {
            f(a, a) += 1;
            g(a, a) += 1;
        }
        const auto next = product(g, f);
        for (int i = 0; i < 9; ++i) {
            EXPECT_NEAR(state[i] + (i % 4 == 0 ? 1 : 0), next(i / 3, i % 3), 1e-14);
        }
    }
}

TEST(FixedCorotated, plane_strain_pressure_counts_the_third_axis) {
    const double state[4] = {1e-6, 0, 0, 1e-6}, still[2][2] = {};
    const double thick[9] = {1e-6, 0, 0, 0, 1e-6, 0, 0, 0, 0}, still3[3][3] = {};
    const auto flat = FixedCorotated::observe<2>(state, still, parameters);
    const auto solid = FixedCorotated::observe<3>(thick, still3, parameters);
    EXPECT_NEAR(flat.pressure, solid.pressure, 1e-9 * std::fabs(solid.pressure));
    EXPECT_NEAR(flat.elastic_energy, solid.elastic_energy, 1e-9 * solid.elastic_energy);
}

TEST(FixedCorotated, admissible_from_a_twentieth_to_twenty) {
    const auto at = [](double ratio) {
        const double state[9] = {ratio - 1, 0, 0, 0, 0, 0, 0, 0, 0};
        return FixedCorotated::admissible<double, 3>(state);
    };
    EXPECT_FALSE(at(0.0499));
    EXPECT_TRUE(at(0.0501));
    EXPECT_TRUE(at(19.99));
    EXPECT_FALSE(at(20.01));
    EXPECT_FALSE(at(-1.0));
}

}  // namespace
}  // namespace mpm
