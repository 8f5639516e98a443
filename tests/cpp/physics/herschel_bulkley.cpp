// Herschel-Bulkley fluid: the law's closed forms, its regularisation and its bounds.
#include "mpm/physics/material/herschel_bulkley_fluid.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "support/random.hpp"

namespace mpm {
namespace {

using Mud = HerschelBulkleyFluid;

constexpr double K = 1e8, yield_stress = 40, consistency = 8, largest_viscosity = 1e4;

struct Law {
    double p[7];
    explicit Law(double index, double yield = yield_stress, double k = consistency,
                 double most = largest_viscosity)
        : p{1600, K, 7.15, yield, k, index, most} {}
    double viscosity(double g) const {
        return Mud::effective_viscosity(g, Mud::shear_law<double>(p));
    }
    double stress(double g) const { return g * viscosity(g); }
    /// The law as it is written, in a wider type.
    double written(double g) const {
        const long double m = (long double)(p[6]) / p[3];
        const long double mu =
            (p[3] > 0 ? -p[3] * expm1l(-m * g) / g : 0.0L) + p[4] * powl(g, p[5] - 1.0L);
        return double(std::fmin(mu, (long double)(p[6])));
    }
    template <int D>
    Mat<double, D> kirchhoff(const Mat<double, D>& rate, double j = 0) const {
        const double state[1] = {j};
        return Mud::kirchhoff<double, D, double>(state, rate, Mud::constants<double>(p));
    }
};

template <int D>
double contract(const Mat<double, D>& a, const Mat<double, D>& b) {
    double s = 0;
    for (int i = 0; i < D; ++i)
        for (int j = 0; j < D; ++j) s += a(i, j) * b(i, j);
    return s;
}

TEST(HerschelBulkley, viscosity_is_the_law) {
    for (double index : {0.1, 0.5, 1.0, 1.7, 2.0}) {
        const Law law(index);
        for (double g = 1e-12; g < 1e8; g *= 1.3) {
            const double mu = law.written(g);
            EXPECT_NEAR(law.viscosity(g), mu, 1e-13 * mu) << "n " << index << ", rate " << g;
        }
    }
}

/// Above a few tau_y / mu_max the regularised law is Bingham's, to exp(-m g).
TEST(HerschelBulkley, bingham_closed_form) {
    const Law law(1);
    const double slow = yield_stress / largest_viscosity;
    for (double g = 10 * slow; g < 1e3; g *= 1.7) {
        const double bingham = yield_stress + consistency * g;
        EXPECT_NEAR(law.stress(g), bingham,
                    1.01 * yield_stress * std::exp(-g / slow) + 1e-15 * bingham);
    }
    EXPECT_NEAR(law.stress(3 * slow), yield_stress + 3 * slow * consistency, 0.06 * yield_stress);
    // Far below it creeps at the largest viscosity.
    EXPECT_NEAR(law.stress(1e-3 * slow), 1e-3 * yield_stress, 1e-6 * yield_stress);
}

/// Simple shear in the plane: the only stress is the law's own, with its sign.
TEST(HerschelBulkley, simple_shear) {
    const Law law(0.6);
    for (double g : {1e-4, 1e-2, 1.0, 50.0}) {
        for (double sign : {1.0, -1.0}) {
            const auto plane = law.kirchhoff<2>({{{0, sign * g}, {0, 0}}});
            EXPECT_NEAR(plane(0, 1), sign * law.stress(g), 1e-12 * law.stress(g));
            EXPECT_DOUBLE_EQ(plane(1, 0), plane(0, 1));
            EXPECT_EQ(plane(0, 0), 0);
            const auto space = law.kirchhoff<3>({{{0, 0, 0}, {0, 0, sign * g}, {0, 0, 0}}});
            EXPECT_NEAR(space(1, 2), sign * law.stress(g), 1e-12 * law.stress(g));
            EXPECT_EQ(space(0, 1), 0);
        }
    }
}

/// Squeezed in one direction: 2 dev D : dev D = 4/3 e^2, whether in plane strain or in space.
TEST(HerschelBulkley, deviator_is_three_dimensional) {
    const Law law(1.3);
    const double e = 3, g = e * std::sqrt(4.0 / 3), mu = law.viscosity(g);
    const auto plane = law.kirchhoff<2>({{{e, 0}, {0, 0}}});
    const auto space = law.kirchhoff<3>({{{e, 0, 0}, {0, 0, 0}, {0, 0, 0}}});
    EXPECT_NEAR(plane(0, 0), 4.0 / 3 * mu * e, 1e-12 * mu);
    EXPECT_NEAR(plane(1, 1), -2.0 / 3 * mu * e, 1e-12 * mu);
    EXPECT_NEAR(space(0, 0), plane(0, 0), 1e-12 * mu);
    EXPECT_NEAR(space(2, 2), plane(1, 1), 1e-12 * mu);
    // An even change of volume has no shear at all.
    const auto swell = law.kirchhoff<3>({{{e, 0, 0}, {0, e, 0}, {0, 0, e}}});
    EXPECT_NEAR(swell(0, 0), 0, 1e-12 * mu);
}

template <int D>
void check_against_newton(double j) {
    test::Random random{5};
    const double mu = 3;
    const Law law(1, 0, mu);
    const double fluid[] = {law.p[0], law.p[1], law.p[2], mu}, state[1] = {j};
    for (int round = 0; round < 100; ++round) {
        auto rate = random.matrix<D>(10);
        const double divergence = trace(rate);
        const auto found = law.kirchhoff<D>(rate, j);
        const auto newton = TaitFluid::kirchhoff<double, D, double>(
            state, rate, TaitFluid::constants<double>(fluid));
        const double scale = test::largest<D>(newton);
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) {
                const double mean = a == b ? 2.0 / 3 * mu * divergence * (1 - j) : 0;
                EXPECT_NEAR(found(a, b), newton(a, b) - mean, 1e-13 * scale);
            }
    }
}

/// With n = 1 and no yield stress it is TaitFluid, less the mean of the viscous stress.
TEST(HerschelBulkley, newtonian) {
    check_against_newton<2>(0);
    check_against_newton<3>(0);
    check_against_newton<2>(1e-3);
    check_against_newton<3>(-0.2);
}

template <class T>
void check_finite(T bound) {
    for (double index : {0.1, 1.0, 2.0}) {
        for (double yield : {0.0, 1e-6, 1e6}) {
            const Law law(index, yield);
            const auto k = Mud::shear_law<T>(law.p);
            for (T g : {T(0), std::numeric_limits<T>::denorm_min(), std::numeric_limits<T>::min(),
                        T(1e-20), T(1e-9), T(1), T(1e9), T(1e18)}) {
                const T mu = Mud::effective_viscosity(g, k);
                EXPECT_GE(mu, 0) << "n " << index << ", yield stress " << yield << ", rate " << g;
                EXPECT_LE(mu, T(largest_viscosity));
            }
            const T still[1] = {T(0)};
            const auto tau = Mud::kirchhoff<T, 3, T>(still, {}, Mud::constants<T>(law.p));
            for (const auto& row : tau.e)
                for (T x : row) EXPECT_EQ(x, 0);
        }
    }
    // At rest the yield term is the largest viscosity, with all its digits beside it.
    const auto k = Mud::shear_law<T>(Law(2.0).p);
    for (T g : {T(0), T(1e-25), T(1e-12)})
        EXPECT_NEAR(Mud::effective_viscosity(g, k), largest_viscosity, bound * largest_viscosity);
}

TEST(HerschelBulkley, finite_at_rest_and_at_any_rate) {
    check_finite<float>(2e-7f);
    check_finite<double>(1e-9);
}

/// The shear stress never falls as the rate grows, so that a stress belongs to one rate.
TEST(HerschelBulkley, stress_grows_with_the_rate) {
    for (double index : {0.1, 0.5, 1.0, 2.0}) {
        const Law law(index);
        double before = 0;
        for (double g = 1e-10; g < 1e6; g *= 1.05) {
            const double stress = law.stress(g);
            EXPECT_GE(stress, before * (1 - 1e-12)) << "n " << index << ", rate " << g;
            before = stress;
        }
    }
}

template <int D>
void check_dissipation_and_turns() {
    test::Random random{17};
    for (double index : {0.3, 1.0, 1.8}) {
        const Law law(index);
        for (double size : {1e-6, 1e-2, 1.0, 100.0}) {
            for (int round = 0; round < 50; ++round) {
                const auto rate = random.matrix<D>(size);
                const auto tau = law.kirchhoff<D>(rate);
                const auto shear = Mud::shear(rate);
                const double work = contract<D>(tau, rate);
                ASSERT_GT(work, 0);
                ASSERT_NEAR(work, law.stress(shear.rate) * shear.rate, 1e-12 * work);

                const auto turn = random.rotation<D>();
                const auto rotate = [&](const Mat<double, D>& m) {
                    return product_transposed(product(turn, m), turn);
                };
                // A spin beside it changes nothing.
                auto spun = rotate(rate);
                spun(0, 1) += 7;
                spun(1, 0) -= 7;
                const auto expected = rotate(tau), found = law.kirchhoff<D>(spun);
                // Taking a spin of 7/s off again leaves its rounding in the rates.
                const double bound = 1e-12 * test::largest<D>(tau) + 1e-14 * largest_viscosity;
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) ASSERT_NEAR(found(a, b), expected(a, b), bound);
            }
        }
    }
}

TEST(HerschelBulkley, dissipates_and_knows_no_direction) {
    check_dissipation_and_turns<2>();
    check_dissipation_and_turns<3>();
}

template <int D>
void check_precisions() {
    using V = Pack<float, 8>;
    test::Random random{29};
    for (double index : {0.1, 0.5, 1.0, 2.0}) {
        const Law law(index);
        const auto single = Mud::constants<float>(law.p);
        for (int round = 0; round < 50; ++round) {
            Mat<double, D> rate[8];
            float alone[8][D][D], column[D][D][8], none[8] = {};
            for (int l = 0; l < 8; ++l) {
                rate[l] = random.matrix<D>(l == 0 ? 0 : std::pow(10.0, 4 - 2 * l));
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) {
                        alone[l][a][b] = column[a][b][l] = float(rate[l](a, b));
                        rate[l](a, b) = alone[l][a][b];
                    }
            }
            Mat<V, D> packed;
            for (int a = 0; a < D; ++a)
                for (int b = 0; b < D; ++b) packed(a, b) = V::load(column[a][b]);
            const V still[1] = {V::load(none)};
            const auto together = Mud::kirchhoff<V, D, float>(still, packed, single);
            for (int l = 0; l < 8; ++l) {
                Mat<float, D> r;
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) r(a, b) = alone[l][a][b];
                const float zero[1] = {0};
                const auto one = Mud::kirchhoff<float, D, float>(zero, r, single);
                const auto exact = law.kirchhoff<D>(rate[l]);
                // exp((n - 1) log g): the logarithm's rounding grows with its size.
                const double scale = test::largest<D>(exact);
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) {
                        ASSERT_NEAR(one(a, b), exact(a, b), 5e-6 * scale) << "n " << index;
                        ASSERT_NEAR(together(a, b)[l], one(a, b), 5e-6 * scale);
                    }
            }
        }
    }
}

TEST(HerschelBulkley, float_double_and_lanes) {
    check_precisions<2>();
    check_precisions<3>();
}

/// What a reader sees: pressure of the volume alone, the stress of the law, and whether it flows.
TEST(HerschelBulkley, observed) {
    const Law law(1);
    const double j[1] = {2e-3};
    const double p = TaitFluid::pressure(j[0], Mud::constants<double>(law.p));
    const double fast[2][2] = {{0.3, 2.0}, {1.0, 0.1}}, slow[2][2] = {{0, 1e-4}, {0, 0}};
    const auto flows = Mud::observe<2>(j, fast, law.p), creeps = Mud::observe<2>(j, slow, law.p);
    EXPECT_NEAR(flows.pressure, p, 1e-12 * p);
    EXPECT_TRUE(flows.yields);
    EXPECT_FALSE(creeps.yields);
    EXPECT_DOUBLE_EQ(creeps.stress[0][1], law.stress(1e-4));
    const Mat<double, 2> rate = {{{0.3, 2.0}, {1.0, 0.1}}};
    const auto tau = law.kirchhoff<2>(rate, j[0]);
    for (int a = 0; a < 2; ++a)
        for (int b = 0; b < 2; ++b)
            EXPECT_NEAR(flows.volume_ratio * flows.stress[a][b], tau(a, b), 1e-12 * p);
    EXPECT_GT(flows.elastic_energy, 0);
    // A plastic law without consistency flows as well.
    EXPECT_TRUE(Mud::observe<2>(j, fast, Law(1, yield_stress, 0).p).yields);
}

TEST(HerschelBulkley, what_the_time_step_is_told) {
    const Law law(0.5);
    EXPECT_EQ(Mud::viscosity(law.p), largest_viscosity);
    EXPECT_EQ(Mud::wave_speed(law.p), std::sqrt(K / 1600));
}

}  // namespace
}  // namespace mpm
