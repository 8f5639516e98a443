// Why nodal sums in integers cannot overflow: the bound on nodal masses, found anew here and put to
// clouds of particles, and the factors made of it.
#include "mpm/kernels/fixed_point.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <vector>

#include "mpm/core/number.hpp"
#include "mpm/kernels/body_common.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

double spline(double x) {
    x = std::fabs(x);
    return x < 0.5 ? 0.75 - x * x : (x < 1.5 ? 0.5 * (1.5 - x) * (1.5 - x) : 0);
}
/// The most that a node at distance `x` may get from a particle that moves by up to `moved`.
double moved_spline(double x, double moved) { return spline(std::fmax(std::fabs(x) - moved, 0)); }

/// Bound of one axis.
double axis_growth(double moved) { return std::sqrt(mass_growth(moved, 2)); }

/// moved_spline(x) <= side w(x - 1) + middle w(x) + side w(x + 1) for all x.
struct Domination {
    double middle, side;
    double sum() const { return middle + 2 * side; }
    double at(double x) const {
        return middle * spline(x) + side * (spline(x - 1) + spline(x + 1));
    }
};

constexpr int intervals = 3000;  // of an axis of symmetry, [0, 1.5 + moved]
double place(int k, double moved) { return (1.5 + moved) * k / intervals; }

/// The least middle that goes with a side.
Domination with_side(double side, double moved) {
    Domination d{0, side};
    for (int k = 0; k <= intervals; ++k) {
        const double x = place(k, moved), own = spline(x);
        if (own < 1e-6) break;  // from here on `side` alone must do
        const double others = side * (spline(x - 1) + spline(x + 1));
        d.middle = std::fmax(d.middle, (moved_spline(x, moved) - others) / own);
    }
    return d;
}

/// The one with the least sum, which is convex in the side.
Domination least_domination(double moved) {
    double low = 0, high = 3;
    for (int k = 0; k <= intervals; ++k) {
        const double x = place(k, moved), beside = spline(x - 1);
        if (spline(x) < 1e-6 && beside > 1e-12)
            low = std::fmax(low, moved_spline(x, moved) / beside);
    }
    for (int round = 0; round < 50; ++round) {
        const double a = low + (high - low) / 3, b = high - (high - low) / 3;
        if (with_side(a, moved).sum() < with_side(b, moved).sum())
            high = b;
        else
            low = a;
    }
    return with_side(high, moved);
}

TEST(MassGrowth, spline_is_that_of_the_weights) {
    for (double xi = -0.5; xi <= 0.5; xi += 0.01) {
        const auto w = quadratic_weights<double, 2>({{xi, 0.0}});
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(w.value[0][k], spline(k - 1 - xi), 1e-15);
    }
}

/// The proof: a moved particle gives no node more than particles that stayed give it and its
/// neighbours, in shares whose sum is the bound.
TEST(MassGrowth, dominates_moved_splines) {
    std::vector<double> distances = {0.001, 0.002, 1.0};
    for (int k = 1; k < 100; ++k) distances.push_back(0.01 * k);
    for (double moved : distances) {
        const Domination least = least_domination(moved);
        EXPECT_LE(least.sum(), axis_growth(moved)) << "moved " << moved;
        EXPECT_DOUBLE_EQ(mass_growth(moved, 3), std::pow(axis_growth(moved), 3));
        // A finer grid, and every move instead of the worst one.
        for (int k = -4001; k <= 4001; ++k) {
            const double x = (1.5 + moved) * k / 4001;
            for (int m = -4; m <= 4; ++m)
                ASSERT_LE(spline(x + moved * m / 4), least.at(x) + 1e-6) << x << ' ' << moved;
        }
    }
    EXPECT_EQ(mass_growth(0, 2), 1);
    EXPECT_EQ(mass_growth(0, 3), 1);
}

/// Two heaps, one each side of a node, that fall into one: no smaller bound holds.
TEST(MassGrowth, two_heaps_reach_the_least_bound) {
    const double at = (5 - std::sqrt(5.0)) / 4;  // where the node between has as much as the others
    EXPECT_NEAR(2 * spline(at), spline(1 - at), 1e-15);
    for (double moved : {0.01, 0.05, 0.1, 0.2, 0.235, 0.25, 0.3, 0.4, 0.5}) {
        const double grown = spline(at - moved) / spline(at);
        EXPECT_NEAR(least_domination(moved).sum(), grown, 1e-3 * grown);
        EXPECT_LE(grown, axis_growth(moved)) << "moved " << moved;
    }
}

template <int D>
struct Cloud {
    using Place = Vec<double, D>;
    std::vector<Place> at;
    std::vector<double> mass;

    std::map<std::vector<int>, double> nodes() const {
        std::map<std::vector<int>, double> out;
        for (std::size_t p = 0; p < at.size(); ++p) {
            for (int n = 0; n < stencil_nodes<2>; ++n) {
                const int k[2] = {n % 3, n / 3};
                if (D == 1 && k[1] > 0) break;
                std::vector<int> node;
                double m = mass[p];
                for (int a = 0; a < D; ++a) {
                    node.push_back(int(std::floor(at[p][a] + 0.5)) + k[a] - 1);
                    m *= spline(at[p][a] - node.back());
                }
                out[node] += m;
            }
        }
        return out;
    }
    double most() const {
        double m = 0;
        for (const auto& [node, mass] : nodes()) m = std::max(m, mass);
        return m;
    }
};

template <int D>
double bound(double moved) {
    return D == 1 ? axis_growth(moved) : mass_growth(moved, D);
}

/// Clouds of all kinds; moves at random and, worse, all towards one node. Returns the largest share
/// of the allowed growth that was seen.
template <int D>
double largest_growth(int rounds) {
    test::Random random(29);
    double share = 0;
    for (int round = 0; round < rounds; ++round) {
        const double moved =
            round % 3 == 0 ? random.between(0, 1) : std::pow(10.0, random.between(-3, 0));
        Cloud<D> before;
        const int particles = 1 << random.integer(0, 7), heaps = random.integer(0, 4);
        const double size = random.between(0.2, 3), spread = std::pow(10.0, random.between(-3, 0));
        std::vector<Vec<double, D>> heap(std::size_t(heaps) + 1);
        for (auto& h : heap)
            for (int a = 0; a < D; ++a) h[a] = random.between(-size, size);
        for (int p = 0; p < particles; ++p) {
            Vec<double, D> x = heap[std::size_t(random.integer(0, heaps))];
            for (int a = 0; a < D; ++a)
                x[a] = heaps == 0 ? random.between(-size, size)
                                  : x[a] + spread * random.between(-1, 1);
            before.at.push_back(x);
            before.mass.push_back(round % 2 ? 1.0 : std::pow(10.0, random.between(-2, 0)));
        }
        const double most = before.most(), allowed = bound<D>(moved) * most * (1 + 1e-12);
        Cloud<D> after = before;
        for (auto& x : after.at)
            for (int a = 0; a < D; ++a) x[a] += moved * random.between(-1, 1);
        EXPECT_LE(after.most(), allowed) << "moved " << moved;
        share = std::max(share, (after.most() / most - 1) / (bound<D>(moved) - 1));
        for (const auto& [node, mass] : before.nodes()) {
            after = before;
            for (auto& x : after.at)
                for (int a = 0; a < D; ++a)
                    x[a] += std::clamp(node[std::size_t(a)] - x[a], -moved, moved);
            EXPECT_LE(after.most(), allowed) << "moved " << moved;
            share = std::max(share, (after.most() / most - 1) / (bound<D>(moved) - 1));
        }
    }
    return share;
}

TEST(MassGrowth, holds_for_clouds_on_a_line) {
    EXPECT_GT(largest_growth<1>(3000), 0.7) << "the test is too kind";
}
TEST(MassGrowth, holds_for_clouds_in_a_plane) {
    EXPECT_GT(largest_growth<2>(1000), 0.4) << "the test is too kind";
}

bool power_of_two(double x) {
    int e;
    return std::frexp(x, &e) == 0.5;
}

TEST(FixedPoint, power_of_two_below) {
    for (double x : {1e-300, 0.3, 1.0, 1.5, 1024.0, 1e300}) {
        const double p = power_of_two_below(x);
        EXPECT_TRUE(power_of_two(p)) << x;
        EXPECT_LE(p, x);
        EXPECT_GT(2 * p, x);
    }
}

TEST(FixedPoint, factors_fill_the_range_and_no_more) {
    test::Random random(31);
    for (int bits : {23, 31, 52, 62, 63}) {
        const double room = std::ldexp(1.0, bits - 1), least = std::ldexp(1.0, bits - 3);
        for (int round = 0; round < 3000; ++round) {
            const double mass = std::pow(10.0, random.between(-15, 12)),
                         speed = std::pow(10.0, random.between(-12, 8)),
                         volume = std::pow(10.0, random.between(-7, 2));
            const FixedPoint f = fixed_point(bits, mass, speed, volume);
            EXPECT_EQ(f.limit[momentum_sum], speed);
            EXPECT_EQ(f.limit[group_sum], volume);
            for (int q = 0; q < quantities; ++q) {
                const double largest = mass * (q == mass_sum ? 1 : f.limit[q]) * f.scale[q];
                ASSERT_TRUE(power_of_two(f.scale[q]));
                ASSERT_LE(largest, room) << q;
                ASSERT_GT(largest, least) << q;
            }
        }
    }
}

/// What `deposit_size` promises of a particle, at each of its nodes.
template <int D>
void check_deposit_size() {
    constexpr int C = D + 1;
    struct Sums {
        double value[stencil_nodes<D>][C] = {}, mass[stencil_nodes<D>] = {};
        void add(int node, int channel, float v) { value[node][channel] += double(v); }
        void add_mass(int node, float v) { mass[node] += double(v); }
    };
    test::Random random(41);
    double closest = 0;
    for (int round = 0; round < 20000; ++round) {
        Vec<float, D> xi;
        for (int a = 0; a < D; ++a)
            xi[a] =
                round % 4 ? float(random.between(-0.5, 0.5)) : 0.5f * float(random.integer(-1, 1));
        Affine<float, D, C> q;
        for (int c = 0; c < C; ++c) {
            q.value[c] = float(random.between(-1, 1));
            for (int a = 0; a < D; ++a) q.slope[a][c] = float(random.integer(-1, 1));
        }
        Sums sums;
        scatter<float, D, C>(sums, quadratic_weights<float, D>(xi), 1.0f, q);
        const double momentum = deposit_size<0, D>(q), group = deposit_size<D, C>(q);
        for (int n = 0; n < stencil_nodes<D>; ++n)
            for (int c = 0; c < C; ++c) {
                const double most = sums.mass[n] * (c < D ? momentum : group);
                ASSERT_LE(std::fabs(sums.value[n][c]), most * (1 + 1e-6));
                if (most > 0) closest = std::max(closest, std::fabs(sums.value[n][c]) / most);
            }
    }
    EXPECT_GT(closest, 0.8) << "the bound is not a loose one";
}
TEST(FixedPoint, deposit_size_bounds_what_a_node_gets) {
    check_deposit_size<2>();
    check_deposit_size<3>();
}

/// Particles of one node as integers: no sum of them, whole or partial, leaves the range.
TEST(FixedPoint, sums_of_many_deposits_fit) {
    test::Random random(37);
    const int bits = 31;
    for (int round = 0; round < 200; ++round) {
        const int particles = 1 << random.integer(0, 12);
        const double limit = std::pow(10.0, random.between(-3, 3));
        std::vector<double> share;
        double mass = 0;
        for (int p = 0; p < particles; ++p) {
            share.push_back(random.between(0, 0.42));
            mass += share.back();
        }
        const FixedPoint f = fixed_point(bits, mass, limit, 1);
        std::int64_t masses = 0, worst = 0, mixed = 0, most = 0;
        for (double s : share) {
            masses += std::llrint(s * f.scale[mass_sum]);
            worst += std::llrint(s * limit * f.scale[momentum_sum]);
            mixed += std::llrint(s * random.between(-limit, limit) * f.scale[momentum_sum]);
            most = std::max(most, std::abs(mixed));
        }
        const std::int64_t range = (std::int64_t(1) << bits) - 1;
        EXPECT_LE(masses, range);
        EXPECT_LE(worst, range);
        EXPECT_LE(most, range);
    }
}

}  // namespace
}  // namespace mpm
