// The precision of j = 1 - J (Bonus 2023, section 5.12.5), and the fluid's own closed forms.
#include "mpm/physics/material/tait_fluid.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "mpm/core/number.hpp"

namespace mpm {
namespace {

constexpr double K = 2.2e9, gamma_ = 7.15;
const double parameters[] = {1000.0, K, gamma_, 0.001};

/// The law in a wider type, for the exponent that a computation in T has.
template <class T>
long double exact(T j, double exponent = gamma_) {
    const long double g = T(exponent);
    return K / g * expm1l(-g * log1pl(-(long double)(j)));
}
template <class T>
double error(T pressure, T j, double exponent = gamma_) {
    const long double p = exact(j, exponent);
    return double(std::fabs(((long double)(pressure)-p) / p));
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
    const auto constants = TaitFluid::constants<T>(parameters);
    for (double largest : {1e-15, 1e-7, 1e-2, 0.5}) {
        std::vector<double> errors;
        for (T j : points<T>(largest))
            errors.push_back(error(TaitFluid::pressure(j, constants), j));
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

/// The law without its series.
float general(float j, const TaitFluid::Constants<float>& k) {
    return k.stiffness * expm1_of(-k.exponent * log1p_of(-j));
}

class TaitFluidSeries : public ::testing::TestWithParam<double> {
protected:
    const double gamma = GetParam();
    const double given[4] = {1000.0, K, gamma, 0.001};
    const TaitFluid::Constants<float> k = TaitFluid::constants<float>(given);
    static constexpr double ulp = std::numeric_limits<float>::epsilon();
};

TEST_P(TaitFluidSeries, has_all_digits_up_to_its_limit) {
    std::vector<float> at = {k.series_limit, -k.series_limit};
    for (int i = 1; i < 20000; ++i) {
        at.push_back(k.series_limit * float(i) / 20000);
        at.push_back(-at.back());
        at.push_back(k.series_limit * std::pow(10.0f, -30.0f * float(i) / 20000));
        at.push_back(-at.back());
    }
    double series = 0, law = 0;
    for (float j : at) {
        series = std::max(series, error(TaitFluid::pressure(j, k), j, gamma));
        law = std::max(law, error(general(j, k), j, gamma));
    }
    EXPECT_LE(series, 2.5 * ulp);
    EXPECT_GT(law, series) << "worth its place";
}

TEST_P(TaitFluidSeries, meets_the_general_law) {
    for (float sign : {1.0f, -1.0f}) {
        const float inside = sign * k.series_limit,
                    outside = std::nextafter(inside, sign * HUGE_VALF);
        const double p = exact(inside, gamma);
        EXPECT_NEAR(TaitFluid::pressure(inside, k), general(inside, k), 6 * ulp * std::fabs(p));
        EXPECT_NEAR(TaitFluid::pressure(outside, k), TaitFluid::pressure(inside, k),
                    6 * ulp * std::fabs(p));
    }
}

TEST_P(TaitFluidSeries, is_used_below_its_limit_and_only_there) {
    auto series = k, law = k;
    series.stiffness = law.bulk = std::numeric_limits<float>::quiet_NaN();
    for (float sign : {1.0f, -1.0f}) {
        for (float share : {0.0f, 1e-20f, 0.5f, 1.0f}) {
            const float j = sign * share * k.series_limit;
            EXPECT_EQ(TaitFluid::pressure(j, series), TaitFluid::pressure(j, k)) << j;
        }
        for (float share : {1.001f, 2.0f, 5.0f}) {
            const float j = sign * share * k.series_limit;
            EXPECT_EQ(TaitFluid::pressure(j, law), TaitFluid::pressure(j, k)) << j;
        }
    }
    EXPECT_TRUE(std::isnan(TaitFluid::pressure(std::numeric_limits<float>::quiet_NaN(), k)));
}

/// One lane beyond the limit takes its neighbours along the general way.
TEST_P(TaitFluidSeries, lanes) {
    using V = Pack<float, 8>;
    float j[8], apart[8];
    for (int l = 0; l < 8; ++l) {
        j[l] = k.series_limit * (0.9f - 0.22f * float(l));
        apart[l] = l == 5 ? 3 * k.series_limit : j[l];
    }
    const V together = TaitFluid::pressure(V::load(j), k),
            mixed = TaitFluid::pressure(V::load(apart), k);
    for (int l = 0; l < 8; ++l) {
        EXPECT_LE(error(together[l], j[l], gamma), 2.5 * ulp);
        EXPECT_LE(error(mixed[l], apart[l], gamma), 6 * ulp);
    }
}

INSTANTIATE_TEST_SUITE_P(Exponents, TaitFluidSeries, ::testing::Values(1.0, 7.15, 20.0));

TEST(TaitFluid, volume_from_pressure_inverts_the_law) {
    const auto constants = TaitFluid::constants<double>(parameters);
    for (double size = 1e-9; size < 3e9; size *= 1.7) {
        for (double p : {size, -size}) {
            if (p < -0.9 * K / gamma_) continue;  // no volume has less
            const double j = TaitFluid::volume_from_pressure(p, parameters);
            EXPECT_NEAR(TaitFluid::pressure(j, constants), p, 1e-13 * std::max(size, p));
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
