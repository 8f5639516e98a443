// The precision of j = 1 - J (Bonus 2023, section 5.12.5), and the fluid's own closed forms.
#include "mpm/physics/material/tait_fluid.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "mpm/core/number.hpp"

namespace mpm {
namespace {

constexpr double K = 2.2e9, gamma_ = 7.15;
const double parameters[] = {1000.0, K, gamma_, 0.001};

/// The pressure of exactly these numbers. Above 1e-4 digits are lost to nothing; below, the law's
/// series keeps what expm1 and log1p of the wide type keep as well.
template <class T>
long double exact(T j) {
    const long double g = T(gamma_), stiffness = T(T(K) / T(gamma_));
    return stiffness * expm1l(-g * log1pl(-(long double)(j)));
}

template <class T>
std::vector<T> points(double largest) {
    std::vector<T> out;
    for (int i = 0; i < 5000; ++i) {
        const double size = largest * std::pow(10.0, -6.0 * i / 4999);
        out.push_back(T(size));
        out.push_back(T(-size));
    }
    return out;
}

template <class T>
void check_precision(double bound, double median_bound) {
    for (double largest : {1e-15, 1e-7, 1e-2, 0.5}) {
        std::vector<double> errors;
        for (T j : points<T>(largest)) {
            const T p = TaitFluid::pressure(j, T(T(K) / T(gamma_)), T(gamma_));
            errors.push_back(double(std::fabs(((long double)(p)-exact(j)) / exact(j))));
        }
        std::sort(errors.begin(), errors.end());
        EXPECT_LE(errors.back(), largest < 0.1 ? bound : 10 * bound) << "|j| up to " << largest;
        EXPECT_LE(errors[errors.size() / 2], median_bound) << "|j| up to " << largest;
    }
}

TEST(TaitFluidPrecision, single) { check_precision<float>(5e-7, 1.5e-7); }
TEST(TaitFluidPrecision, double_) { check_precision<double>(1e-15, 3e-16); }

/// Negative control: the usual form in single precision is wrong by tens of pascals.
TEST(TaitFluidPrecision, the_usual_form_fails) {
    double worst = 0;
    for (float j : points<float>(1e-7)) {
        const float usual = float(K / gamma_) * (std::pow(1.0f - j, -float(gamma_)) - 1.0f);
        worst = std::max(worst, double(std::fabs((long double)(usual)-exact(j))));
    }
    EXPECT_GT(worst, 60.0);
}

TEST(TaitFluidPrecision, increments_below_the_rounding_of_one_accumulate) {
    const float eps = -1.3e-8f;
    float j = 0, J = 1;
    const int steps = 1000;
    for (int k = 0; k < steps; ++k) {
        j = TaitFluid::advance_volume(j, eps);
        J = J * (1 + eps);
    }
    EXPECT_EQ(J, 1.0f);
    const double expected = -std::expm1(steps * std::log1p(double(eps)));
    EXPECT_NEAR(j, expected, 1e-5 * expected);
}

TEST(TaitFluid, volume_from_pressure_inverts_the_law) {
    for (double size = 1e-9; size < 3e9; size *= 1.7) {
        for (double p : {size, -size}) {
            if (p < -0.9 * K / gamma_) continue;  // no volume has less
            const double j = TaitFluid::volume_from_pressure(p, parameters);
            EXPECT_NEAR(TaitFluid::pressure(j, K / gamma_, gamma_), p, 1e-13 * std::max(size, p));
        }
    }
    EXPECT_EQ(TaitFluid::volume_from_pressure(0, parameters), 0);
}

TEST(TaitFluid, advance_multiplies_the_volume) {
    for (double j : {-0.3, 0.0, 1e-9, 0.4}) {
        for (double eps : {-0.1, -1e-8, 1e-8, 0.2}) {
            const double next = TaitFluid::advance_volume(j, eps);
            EXPECT_NEAR(1 - next, (1 - j) * (1 + eps), 1e-15);
        }
    }
}

TEST(TaitFluid, viscous_part) {
    const double q[] = {1000.0, K, gamma_, 5.0};
    const double j[1] = {0.0};
    const Mat<double, 2> rate = {{{1.0, 2.0}, {4.0, -1.0}}};
    const auto tau =
        TaitFluid::kirchhoff<double, 2, double>(j, rate, TaitFluid::constants<double>(q));
    EXPECT_DOUBLE_EQ(tau(0, 0), 10.0);
    EXPECT_DOUBLE_EQ(tau(1, 1), -10.0);
    EXPECT_DOUBLE_EQ(tau(0, 1), 30.0);
    EXPECT_DOUBLE_EQ(tau(1, 0), 30.0);
}

TEST(TaitFluid, admissible_from_a_twentieth_to_twenty) {
    const auto at = [](double ratio) {
        const double j[1] = {1 - ratio};
        return TaitFluid::admissible<double, 3>(j);
    };
    EXPECT_FALSE(at(0.0499));
    EXPECT_TRUE(at(0.0501));
    EXPECT_TRUE(at(19.99));
    EXPECT_FALSE(at(20.01));
}

/// The energy has no step where its two forms meet, and is positive on both sides of rest.
TEST(TaitFluid, energy_is_continuous) {
    const auto energy = [](double j) {
        const double still[3][3] = {};
        return TaitFluid::observe<3>(&j, still, parameters).elastic_energy;
    };
    for (double sign : {1.0, -1.0}) {
        const double inside = energy(sign * 0.9999999e-3), outside = energy(sign * 1.0000001e-3);
        EXPECT_NEAR(inside, outside, 1e-5 * outside);
        EXPECT_GT(energy(sign * 1e-9), 0);
        EXPECT_GT(energy(sign * 0.3), 0);
    }
}

}  // namespace
}  // namespace mpm
