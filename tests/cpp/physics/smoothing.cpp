// The forms of F-bar: which number is stored, deposited and seen by the pressure.
#include "mpm/physics/volume_smoothing.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "mpm/core/number.hpp"
#include "mpm/physics/shape/quadratic.hpp"

namespace mpm {
namespace {

constexpr Smoothing one = Smoothing::one_volume, two = Smoothing::two_volumes;

SmoothedVolume<double, 2> smooth(Smoothing form, double own, double average,
                                 SmoothingNumbers<double> k) {
    return smooth_volume<double, 2, double>(form, own, average, {{3, -5}}, k);
}

TEST(VolumeSmoothing, one_volume_stores_deposits_and_shows_the_blend) {
    const auto s = smooth(one, 1, 3, {0.25, 0, false});
    EXPECT_EQ(s.blended, 1.5);
    EXPECT_EQ(s.stored, 1.5);
    EXPECT_EQ(s.deposited, 1.5);
    EXPECT_EQ(s.slope[0], 0);
    EXPECT_EQ(s.slope[1], 0);
}

TEST(VolumeSmoothing, carry_deposits_the_gradient) {
    const auto s = smooth(one, 1, 3, {0.25, 1, false});
    EXPECT_EQ(s.slope[0], 3);
    EXPECT_EQ(s.slope[1], -5);
}

TEST(VolumeSmoothing, two_volumes_keep_their_own) {
    const auto s = smooth(two, 1, 3, {0.25, 0, false});
    EXPECT_EQ(s.stored, 1);
    EXPECT_EQ(s.blended, 1.5);
    EXPECT_EQ(s.deposited, 1.5);
}

TEST(VolumeSmoothing, stress_only_changes_what_the_pressure_sees) {
    const auto s = smooth(one, 1, 3, {0.25, 0, true});
    EXPECT_EQ(s.stored, 1);
    EXPECT_EQ(s.deposited, 1);
    EXPECT_EQ(s.blended, 1.5);
}

TEST(VolumeSmoothing, limits_and_fixed_point) {
    for (Smoothing form : {one, two}) {
        EXPECT_EQ(smooth(form, 0.3, 0.7, {0, 0, false}).blended, 0.3);
        EXPECT_DOUBLE_EQ(smooth(form, 0.3, 0.7, {1, 0, false}).blended, 0.7);
        // Equal volumes stay equal to the last bit: a tank at rest does not drift.
        for (double ratio : {0.1, 0.9, 0.9999}) {
            EXPECT_EQ(smooth(form, 0.3, 0.3, {ratio, 0, false}).blended, 0.3);
        }
    }
}

TEST(VolumeSmoothing, lanes_agree_with_scalars) {
    using V = Pack<float, 8>;
    float own[8], average[8];
    for (int l = 0; l < 8; ++l) {
        own[l] = 1e-3f * float(l);
        average[l] = 2e-3f - own[l];
    }
    const SmoothingNumbers<float> k = {0.3f, 1.0f, false};
    const auto packed =
        smooth_volume<V, 2, float>(two, V::load(own), V::load(average), {{V(1.0f), V(2.0f)}}, k);
    for (int l = 0; l < 8; ++l) {
        const auto alone = smooth_volume<float, 2, float>(two, own[l], average[l], {{1, 2}}, k);
        EXPECT_EQ(packed.blended[l], alone.blended);
        EXPECT_EQ(packed.stored[l], alone.stored);
        EXPECT_EQ(packed.slope[1][l], 2.0f);
    }
}

/// With one particle in the middle of every cell, iterating "average on the grid, blend with the
/// own volume" damps a wave as the Helmholtz filter of length (dx/2) sqrt(psi / (1 - psi)) does.
TEST(VolumeSmoothing, two_volumes_filter_by_the_stated_length) {
    constexpr int n = 400;
    const double psi = 0.99, length = 0.5 * std::sqrt(psi / (1 - psi));  // cells
    const double k = 2 * 3.14159265358979323846 * 4 / n;
    std::vector<double> own(n), blended(n);
    for (int i = 0; i < n; ++i) blended[i] = own[i] = std::cos(k * i);
    const auto w = quadratic_weights<double, 2>({{0.0, 0.0}});
    const auto average = [&](const std::vector<double>& x, int i) {
        double sum = 0;
        for (int d = 0; d < 3; ++d) sum += w.value[0][d] * x[std::size_t((i + d - 1 + n) % n)];
        return sum;
    };
    std::vector<double> nodes(n), next(n);
    for (int round = 0; round < 5000; ++round) {
        for (int i = 0; i < n; ++i) nodes[i] = average(blended, i);
        for (int i = 0; i < n; ++i) {
            next[i] = smooth(two, own[i], average(nodes, i), {psi, 0, false}).blended;
        }
        blended.swap(next);
    }
    EXPECT_NEAR(blended[0], 1 / (1 + k * k * length * length), 2e-3);
}

}  // namespace
}  // namespace mpm
