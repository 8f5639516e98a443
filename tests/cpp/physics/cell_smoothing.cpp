// Pairs of cells to the digits that follow from the formulae by hand.
#include <gtest/gtest.h>

#include "mpm/physics/smoothing.hpp"

namespace mpm {
namespace {

using Cell = CellAlong<double>;

TEST(CellPairs, a_constant_flux_leaves_the_mean_by_mass) {
    const Cell minus{2, 0, 0, 1, 0}, plus{1, 1, 0, 0, 0}, none;
    const double F = constant_flux(SmoothingChoice{}, none, minus, plus, none);
    EXPECT_NEAR(minus.mean - F / minus.mass, 2.0 / 3, 1e-15);
    EXPECT_NEAR(plus.mean + F / plus.mass, 2.0 / 3, 1e-15);
    EXPECT_NEAR(pair_energy(minus, plus, F), -2.0 / 3, 1e-15);
}

TEST(CellPairs, a_share_of_it_takes_gamma_times_two_less_gamma_of_the_energy) {
    const Cell minus{2, 0, 0, 1, 0}, plus{1, 1, 0, 0, 0}, none;
    for (double gamma : {0.0, 0.25, 1.0, 1.75, 2.0}) {
        SmoothingChoice k;
        k.gamma = gamma;
        const double F = constant_flux(k, none, minus, plus, none);
        EXPECT_NEAR(pair_energy(minus, plus, F), -gamma * (2 - gamma) * 2 / 3, 1e-15);
    }
}

TEST(CellPairs, a_linear_flux_as_printed) {
    const Cell minus{1, 0, 1.0 / 12, 1, 0}, plus{1, 1, 1.0 / 12, 0, 0};
    const auto f = linear_flux(minus, plus, 0.5, 0.5, least_inertia);
    EXPECT_NEAR(f.flux, 0.0625, 1e-15);
    EXPECT_NEAR(f.slope_minus, -0.375, 1e-15);
    EXPECT_NEAR(f.slope_plus, -0.375, 1e-15);
    EXPECT_NEAR(f.energy, -0.09375, 1e-15);
    // The energy of the pair itself, by its definition.
    const double after = 2 * (0.0625 * 0.0625) + 1 - 2 * 0.0625 + 2 * 0.375 * 0.375 / 12;
    EXPECT_NEAR(after - 1, f.energy, 1e-15);
}

TEST(CellPairs, a_linear_flux_with_the_way_of_the_inertia_takes_half_as_much) {
    // (3.179), (3.180): F = M_r J / 4, -3/8 M_r J^2
    const double I = 0.1, L = std::sqrt(I);
    const Cell minus{1, 0, I, 1, 0.3}, plus{3, 1, 3 * I, 0.2, -0.1};
    const double J = (1 + L * 0.3) - (0.2 + L * 0.1);
    const auto f = linear_flux(minus, plus, L, L, least_inertia);
    EXPECT_NEAR(f.flux, 0.75 * J / 4, 1e-15);
    EXPECT_NEAR(f.energy, -0.375 * 0.75 * J * J, 1e-15);
}

TEST(CellPairs, cells_of_one_particle_have_no_slope_to_give) {
    const Cell minus{1, 0, 0, 1, 0}, plus{1, 1, 0, 0, 0};
    const auto f = linear_flux(minus, plus, 0.5, 0.5, least_inertia);
    EXPECT_NEAR(f.flux, 0.25, 1e-15);
    EXPECT_EQ(f.slope_minus, 0);
    EXPECT_EQ(f.slope_plus, 0);
}

TEST(CellPairs, limiters_let_nothing_flow_that_the_cells_explain) {
    // Means of x^2 over unequal cells, by x_o^2 + I / m.
    const auto of = [](double m, double x, double second, auto f) {
        return Cell{m, x, m * second, f(x, second), 0};
    };
    const auto line = [](double x, double) { return 3 - 2 * x; };
    const auto square = [](double x, double second) { return x * x + second; };
    const Cell none;
    SmoothingChoice one, two;
    one.limiter = FluxLimiter::linear;
    two.limiter = FluxLimiter::quadratic;
    const auto row = [&](auto f) {
        return std::array<Cell, 4>{of(1, -1.1, 0.08, f), of(2, 0.05, 0.05, f), of(3, 0.9, 0.07, f),
                                   of(1.5, 2.2, 0.02, f)};
    };
    const auto a = row(line), b = row(square);
    EXPECT_NEAR(constant_flux(one, a[0], a[1], a[2], a[3]), 0, 1e-14);
    EXPECT_NEAR(constant_flux(two, a[0], a[1], a[2], a[3]), 0, 1e-14);
    EXPECT_NEAR(constant_flux(one, none, a[1], a[2], none), 0, 1e-14);
    EXPECT_NEAR(constant_flux(two, b[0], b[1], b[2], b[3]), 0, 1e-14);
    EXPECT_NEAR(constant_flux(two, none, b[1], b[2], b[3]), 0, 1e-14);
    EXPECT_NEAR(constant_flux(two, b[0], b[1], b[2], none), 0, 1e-14);
}

TEST(CellPairs, limiter_a_opens_faces_of_extrema_alone) {
    const auto at = [](double x, double q) { return Cell{1, x, 0.1, q, 0}; };
    const Cell none;
    SmoothingChoice k;
    k.extrema = true;
    EXPECT_EQ(constant_flux(k, at(0, 0), at(1, 1), at(2, 2), at(3, 5)), 0);
    EXPECT_NE(constant_flux(k, at(0, 0), at(1, 1), at(2, 2), at(3, 1)), 0);
    EXPECT_NE(constant_flux(k, at(0, 3), at(1, 1), at(2, 2), none), 0);
    EXPECT_EQ(constant_flux(k, none, at(1, 1), at(2, 2), none), 0);  // ends cannot be tested
}

TEST(LeastSquares, drops_directions_in_which_nothing_spreads) {
    // Two particles on a line along (1, 1): any slope with the right sum is least.
    const Mat<double, 2> J{{{0.5, 0.5}, {0.5, 0.5}}};
    const auto s = least_squares_slopes<double, 2>(J, {{1, 1}}, 2);
    EXPECT_NEAR(s[0] + s[1], 2, 1e-12);
    const auto none = least_squares_slopes<double, 2>({}, {{0, 0}}, 2);
    EXPECT_EQ(none[0], 0);
    EXPECT_EQ(none[1], 0);
    const Mat<double, 3> K{{{2, 0.5, 0.1}, {0.5, 1, -0.2}, {0.1, -0.2, 3}}};
    const Vec<double, 3> want{{1, -2, 0.5}};
    Vec<double, 3> g;
    for (int a = 0; a < 3; ++a) {
        g[a] = 0;
        for (int b = 0; b < 3; ++b) g[a] += K.e[a][b] * want[b];
    }
    const auto full = least_squares_slopes<double, 3>(K, g, 1);
    for (int a = 0; a < 3; ++a) EXPECT_NEAR(full[a], want[a], 1e-14);
}

}  // namespace
}  // namespace mpm
