// Functions between particles and nodes, and the rule by which particles move with what they keep.
#include <gtest/gtest.h>

#include <cmath>

#include "mpm/physics/shape/kernel.hpp"
#include "mpm/physics/transfer/scheme.hpp"

namespace mpm {
namespace {

constexpr Kernel kernels[] = {Kernel::linear, Kernel::quadratic, Kernel::cubic, Kernel::ugimp,
                              Kernel::cpgimp};
constexpr std::int64_t middle[2] = {20, 20};

KernelChoice choice(Kernel kernel, bool clamped = false) {
    KernelChoice k;
    k.kernel = kernel;
    k.clamped = clamped;
    k.half_edge = 0.25;
    for (int& n : k.cells) n = 40;
    return k;
}
template <class T>
Stencil<T, 2, 5> at(const KernelChoice& k, T x, const std::int64_t (&cell)[2] = middle) {
    return stencil_of<5>(k, Vec<T, 2>{{x, T(0.1)}}, Vec<T, 2>{{T(0.25), T(0.4)}}, cell);
}
double sum(const double (&w)[5], const double (&by)[5]) {
    double s = 0;
    for (int n = 0; n < 5; ++n) s += w[n] * by[n];
    return s;
}
constexpr double one[5] = {1, 1, 1, 1, 1};

TEST(Kernel, partition_of_unity_linear_fields_and_gradients) {
    for (Kernel kernel : kernels) {
        for (double x = -0.5; x <= 0.5; x += 0.03125) {
            const auto s = at(choice(kernel), x);
            for (int a = 0; a < 2; ++a) {
                EXPECT_NEAR(sum(s.weight[a], one), 1, 1e-15);
                EXPECT_NEAR(sum(s.weight[a], s.distance[a]), 0, 1e-15);
                EXPECT_NEAR(sum(s.slope[a], one), 0, 1e-14);
            }
            EXPECT_NEAR(sum(s.slope[0], s.distance[0]), 1, 1e-14) << int(kernel) << " " << x;
        }
    }
}

/// Just beside a node distances round. The slopes are those of one side all the same, the lower one
/// where the node there has weight.
TEST(Kernel, linear_slopes_beside_a_node) {
    for (float x : {-1e-3f, -1e-7f, -5e-8f, -1e-8f, -1e-30f, 0.0f, 1e-30f, 1e-8f, 1e-3f}) {
        const auto s = at(choice(Kernel::linear), x);
        const bool below = s.weight[0][1] > 0;
        EXPECT_EQ(below, x < -4e-8f) << x;
        const float lower[5] = {0, -1, 1, 0, 0}, upper[5] = {0, 0, -1, 1, 0};
        float weights = 0;
        for (int n = 0; n < 5; ++n) {
            EXPECT_EQ(s.slope[0][n], below ? lower[n] : upper[n]) << x;
            weights += s.weight[0][n];
        }
        EXPECT_EQ(weights, 1) << x;
    }
}

TEST(Kernel, slopes_are_derivatives) {
    const double h = 1e-6;
    for (bool clamped : {false, true}) {
        for (Kernel kernel : kernels) {
            if (clamped && (kernel == Kernel::ugimp || kernel == Kernel::cpgimp)) continue;
            const std::int64_t cells[][2] = {{20, 20}, {0, 20},  {1, 20},
                                             {2, 20},  {38, 20}, {39, 20}};
            for (const auto& cell : cells) {
                for (double x : {-0.43, -0.21, 0.07, 0.33}) {
                    const auto k = choice(kernel, clamped);
                    const auto s = at(k, x, cell), up = at(k, x + h, cell),
                               down = at(k, x - h, cell);
                    for (int n = 0; n < 5; ++n)
                        EXPECT_NEAR(s.slope[0][n], (up.weight[0][n] - down.weight[0][n]) / (2 * h),
                                    1e-8);
                }
            }
        }
    }
}

/// 1/4 and 1/3 for B-splines wherever the particle stands; of GIMP on a node half the half-edge.
TEST(Kernel, second_moments) {
    for (double x = -0.5; x <= 0.5; x += 0.0625) {
        EXPECT_NEAR(at(choice(Kernel::quadratic), x).inverse[0], 4, 1e-13);
        EXPECT_NEAR(at(choice(Kernel::cubic), x).inverse[0], 3, 1e-13);
    }
    EXPECT_NEAR(at(choice(Kernel::ugimp), 0.0).inverse[0], 8, 1e-13);
    EXPECT_EQ(at(choice(Kernel::linear), 0.0).inverse[0], 0);
}

TEST(Kernel, clamped_splines_end_with_the_domain) {
    for (Kernel kernel : {Kernel::linear, Kernel::quadratic, Kernel::cubic}) {
        const auto k = choice(kernel, true);
        const int outermost = kernel == Kernel::cubic ? 0 : 1;  // node -2 or -1 of cell 0
        const auto wall = at(k, -0.5, {0, 20});
        for (int n = 0; n < 5; ++n) EXPECT_NEAR(wall.weight[0][n], n == outermost, 1e-15);
        for (std::int64_t c : {0, 1, 2, 3, 36, 37, 38, 39}) {
            for (double x = -0.47; x < 0.5; x += 0.06) {
                const auto s = at(k, x, {c, 20});
                EXPECT_NEAR(sum(s.weight[0], one), 1, 1e-14);
                // Linear fields, from where the functions stand.
                EXPECT_NEAR(sum(s.weight[0], s.distance[0]), 0, 1e-14);
                EXPECT_NEAR(sum(s.slope[0], s.distance[0]), 1, 1e-12);
                for (double w : s.weight[0]) EXPECT_GE(w, 0);
            }
        }
    }
}

TEST(Kernel, single_precision) {
    for (Kernel kernel : kernels) {
        for (double x = -0.46875; x <= 0.5; x += 0.0625) {
            const auto s = at(choice(kernel), x);
            const auto f = at(choice(kernel), float(x));
            for (int n = 0; n < 5; ++n) EXPECT_NEAR(f.weight[0][n], s.weight[0][n], 3e-7);
        }
    }
}

TEST(Shift, binary_smooth_and_below) {
    SchemeNumbers s;
    EXPECT_EQ(shift_share(s, 0.0), 0);
    s.rule = ShiftRule::full;
    EXPECT_EQ(shift_share(s, 0.0), 1);
    s.rule = ShiftRule::binary;
    s.shift_max = 0.2;
    s.shift_min = 0.05;
    EXPECT_EQ(shift_share(s, -1e-6), 0.2);  // J above J_c
    EXPECT_EQ(shift_share(s, 0.0), 0.05);
    EXPECT_EQ(shift_share(s, 1e-6), 0.05);
    s.rule = ShiftRule::smooth;
    s.width = 0.01;
    s.power = 2;
    EXPECT_EQ(shift_share(s, 0.0), 0.05);
    EXPECT_NEAR(shift_share(s, -0.005), 0.05 + 0.15 / 4, 1e-15);
    EXPECT_NEAR(shift_share(s, -0.01), 0.2, 1e-15);
    EXPECT_NEAR(shift_share(s, -0.5), 0.2, 1e-15);
    EXPECT_EQ(shift_share(s, 1e-9), 0.05);
    s.zero_below = true;
    EXPECT_EQ(shift_share(s, 1e-9), 0);
}

}  // namespace
}  // namespace mpm
