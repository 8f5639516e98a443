// Formulae of contact: the distance that a volume fraction implies, normals of turned planes, and
// what the impulse of a pair may and may not do.
#include "mpm/physics/contact.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "support/random.hpp"

namespace mpm {
namespace {

/// The quadratic spline.
double spline(double x) {
    x = std::abs(x);
    return x < 0.5 ? 0.75 - x * x : (x < 1.5 ? 0.5 * (1.5 - x) * (1.5 - x) : 0.0);
}

TEST(Contact, filled_at_smooths_a_half_space) {
    // Midpoints of the inside, x < s, under the spline around a node at 0.
    for (double s = -1.7; s <= 1.7; s += 0.1) {
        double sum = 0;
        const int n = 20000;
        for (int k = 0; k < n; ++k) {
            const double part = (s + 2.0) / n;
            sum += spline(-2.0 + (k + 0.5) * part) * part;
        }
        EXPECT_NEAR(filled_at(s), sum, 1e-6) << s;
        EXPECT_NEAR(filled_at(s) + filled_at(-s), 1.0, 1e-15) << s;
    }
}

TEST(Contact, depth_inverts_filled_at) {
    for (double s = -1.4999; s <= 1.4999; s += 1e-3) {
        EXPECT_NEAR(depth_of(filled_at(s)), s, 2e-9) << s;
        EXPECT_NEAR(depth_of(float(filled_at(s))), s, std::abs(s) > 1.4 ? 6e-3 : 1e-5) << s;
    }
    EXPECT_EQ(depth_of(0.0), -1.5);
    EXPECT_EQ(depth_of(-1e-9), -1.5);
    EXPECT_EQ(depth_of(1.0), 1.5);
    EXPECT_EQ(depth_of(1.1), 1.5);
}

TEST(Contact, gap_is_the_distance_of_flat_faces) {
    for (double face = -1.2; face <= 1.2; face += 0.1)
        for (double gap = 0; gap <= 0.25; gap += 0.05)
            EXPECT_NEAR(contact_gap(filled_at(face), filled_at(-face - gap)), gap, 1e-8)
                << face << ' ' << gap;
    EXPECT_NEAR(contact_gap(0.6, 0.6), depth_of(0.4) * 2, 1e-12);  // deeper than 1 - 1.2
    EXPECT_LE(contact_gap(0.99, 0.2), 1 - 0.99 - 0.2);
}

/// Largest angle between the normal found and that of planes in random directions.
template <int D>
double worst_angle(int points, int planes) {
    test::Random random(7);
    double worst = 0;
    for (int plane = 0; plane < planes; ++plane) {
        const Mat<double, D> turn = random.rotation<D>();
        double n[D];
        for (int a = 0; a < D; ++a) n[a] = turn.e[0][a];
        const double at = random.between(-0.5, 0.5);
        const auto fraction = [&](const int(&k)[D]) {
            double sum = 0;
            int all = 1;
            for (int a = 0; a < D; ++a) all *= points;
            for (int p = 0; p < all; ++p) {
                double weight = 1, along = 0;
                for (int a = 0, rest = p; a < D; ++a, rest /= points) {
                    const double x = -1.5 + 3.0 * (rest % points + 0.5) / points;
                    weight *= spline(x) * 3.0 / points;
                    along += n[a] * (x + k[a] - 1);
                }
                if (along < at) sum += weight;
            }
            return 2 * sum - 1;  // of one body less that of the other
        };
        Vec<double, D> found{};
        EXPECT_TRUE((descent<double, D>(fraction, found)));
        double dot = 0;
        for (int a = 0; a < D; ++a) dot += n[a] * found[a];
        worst = std::max(worst, std::acos(std::min(dot, 1.0)));
    }
    return worst;
}
TEST(Contact, normals_of_turned_planes) {
    // 0.029 and 0.028 rad: differences of a profile that is no cubic.
    EXPECT_LT((worst_angle<2>(60, 40)), 0.032);
    EXPECT_LT((worst_angle<3>(18, 12)), 0.032);
}
TEST(Contact, normals_along_axes_are_exact) {
    for (double at = -0.5; at <= 0.5; at += 0.1) {
        Vec<double, 3> n;
        ASSERT_TRUE((descent<double, 3>(
            [&](const int(&k)[3]) { return 2 * filled_at(at - (k[1] - 1)) - 1; }, n)));
        EXPECT_NEAR(n[0], 0, 1e-15);
        EXPECT_NEAR(n[1], 1, 1e-15);
        EXPECT_NEAR(n[2], 0, 1e-15);
    }
}
TEST(Contact, no_normal_without_a_slope) {
    Vec<double, 3> n;
    EXPECT_FALSE((descent<double, 3>([](const int(&)[3]) { return 0.25; }, n)));
}

TEST(Contact, fluid_meets_where_both_fill_the_node) {
    ContactLaw law;
    law.kind = ContactKind::fluid;
    double allowed = 1;
    EXPECT_FALSE(approach_allowed(law, 0.3, 0.39, 100.0, allowed));
    EXPECT_TRUE(approach_allowed(law, 0.3, 0.41, 100.0, allowed));
    EXPECT_EQ(allowed, 0);
}
TEST(Contact, solids_may_close_their_gap_in_a_step) {
    double allowed = 0;
    EXPECT_TRUE(approach_allowed(ContactLaw{}, filled_at(0.3), filled_at(-0.5), 100.0, allowed));
    EXPECT_NEAR(allowed, 20, 1e-6);
    EXPECT_TRUE(approach_allowed(ContactLaw{}, 0.7, 0.5, 100.0, allowed));
    EXPECT_EQ(allowed, 0);
}

template <int D>
void impulses() {
    test::Random random(3);
    int held = 0, slid = 0, none = 0;
    for (int k = 0; k < 4000; ++k) {
        ContactLaw law;
        law.static_friction = random.between(0, 2);
        law.dynamic_friction = law.static_friction * random.between(0, 1);
        const double of_a = random.between(0.01, 10), of_b = random.between(0.01, 10);
        const double mass = of_a * of_b / (of_a + of_b), allowed = random.between(0, 0.3);
        const Mat<double, D> turn = random.rotation<D>();
        Vec<double, D> n, a, b, w, impulse;
        for (int x = 0; x < D; ++x) {
            n[x] = turn.e[0][x];
            a[x] = random.between(-1, 1);
            b[x] = random.between(-1, 1);
            w[x] = a[x] - b[x];
        }
        double along = 0;
        for (int x = 0; x < D; ++x) along += w[x] * n[x];
        if (!contact_impulse<double, D>(law, n, w, mass, mass, allowed, impulse)) {
            EXPECT_LE(along, allowed);
            ++none;
            continue;
        }
        double before = 0, after = 0, normal = 0, square = 0, left = 0, slide = 0, power = 0;
        for (int x = 0; x < D; ++x) {
            const double now_a = a[x] - impulse[x] / of_a, now_b = b[x] + impulse[x] / of_b;
            EXPECT_NEAR(of_a * now_a + of_b * now_b, of_a * a[x] + of_b * b[x], 1e-13);
            before += of_a * a[x] * a[x] + of_b * b[x] * b[x];
            after += of_a * now_a * now_a + of_b * now_b * now_b;
            normal += impulse[x] * n[x];
            square += impulse[x] * impulse[x];
            left += (now_a - now_b) * n[x];
        }
        for (int x = 0; x < D; ++x) {
            const double t = w[x] - along * n[x];
            const double now = w[x] - impulse[x] / mass - left * n[x];
            slide += now * now;
            power += (impulse[x] - normal * n[x]) * t;
        }
        const double tangential = std::sqrt(std::max(square - normal * normal, 0.0));
        EXPECT_GT(normal, 0);                    // it pushes
        EXPECT_NEAR(left, allowed, 1e-12);       // up to the gap
        EXPECT_LE(after, before * (1 + 1e-12));  // and takes energy
        EXPECT_GE(power, -1e-13);                // against the sliding
        EXPECT_LE(tangential, law.static_friction * normal + 1e-7);
        if (slide < 1e-20) {
            ++held;
        } else {
            EXPECT_NEAR(tangential, law.dynamic_friction * normal, 1e-7);
            ++slid;
        }
    }
    EXPECT_GT(held, 200);
    EXPECT_GT(slid, 200);
    EXPECT_GT(none, 200);
}
TEST(Contact, impulse_keeps_momentum_and_cone_and_takes_energy) {
    impulses<2>();
    impulses<3>();
}

/// Two bodies at walls that leave each some axes: the normal leans against the wall by any angle.
template <int D>
void beside_walls() {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> any(-1, 1), some(0.1, 2);
    int same = 0, bounded = 0;
    for (int k = 0; k < 4000; ++k) {
        const double of_a = some(random), of_b = some(random), allowed = k % 3 == 0 ? 0.05 : 0;
        const double leans = std::pow(10.0, -4.0 * std::abs(any(random)));  // along the wall
        // Walls across the first axis hold both; every second pair meets there without approach.
        const bool at_rest = k % 2 == 0;
        Vec<double, D> n{}, w{}, mobility{};
        n[0] = std::sqrt(1 - leans * leans);
        n[D - 1] = leans;
        for (int a = 0; a < D; ++a) {
            w[a] = a == 0 && at_rest ? 0 : any(random);
            mobility[a] = a == 0 ? 0 : n[a] * (1 / of_a + 1 / of_b);
        }
        double along = 0, inverse = 0;
        for (int a = 0; a < D; ++a) {
            along += w[a] * n[a];
            inverse += mobility[a] * n[a];
        }
        const double speed = along - allowed;
        if (!(speed > 0)) continue;
        const double mass =
            mass_beside_walls<double, D>(mobility, w, inverse, speed, allowed, false);
        EXPECT_GE(mass, 0);
        EXPECT_LE(mass, (1 + 1e-12) / inverse);
        if (at_rest) {  // they part by the gap, as far as walls let them
            EXPECT_NEAR(mass * inverse, 1, 1e-9);
            ++same;
        }
        double before = 0, after = 0;
        for (int a = 0; a < D; ++a) {
            const double now = w[a] - mass * speed * mobility[a];
            before += w[a] * w[a];
            after += now * now;
        }
        EXPECT_LE(after, before * (1 + 1e-12));  // whatever the wall's axis brings
        if (mass < 0.5 / inverse) ++bounded;
    }
    EXPECT_GT(same, 200);
    EXPECT_GT(bounded, 200);
}
TEST(Contact, impulse_beside_walls_takes_no_more_than_they_leave) {
    beside_walls<2>();
    beside_walls<3>();
}

/// A free body of any mass beside another that walls hold across some axes: they part, unless that
/// would move one by more than they approach each other at; energy is taken.
template <int D>
void light_beside_heavy() {
    std::mt19937 random(11);
    std::uniform_real_distribution<double> any(-1, 1);
    int thrown = 0, parted = 0;
    for (int k = 0; k < 8000; ++k) {
        const double of_a = std::pow(10.0, 4 * any(random)), of_b = std::pow(10.0, 4 * any(random));
        const double leans = std::pow(10.0, -4.0 * std::abs(any(random)));
        const int held = D == 3 && k % 2 == 0 ? 2 : 1;  // axes that hold b: a wall, or an edge
        Vec<double, D> n{}, a{}, b{}, w{}, mobility{};
        double norm = 0;
        for (int x = 0; x < D; ++x) {
            n[x] = (x < held ? 1 : leans) * any(random);
            norm += n[x] * n[x];
            a[x] = any(random);
            b[x] = x < held ? 0 : any(random);
            w[x] = a[x] - b[x];
        }
        double along = 0, inverse = 0, square = 0, size = 0;
        for (int x = 0; x < D; ++x) {
            n[x] /= std::sqrt(norm);
            along += w[x] * n[x];
            mobility[x] = n[x] / of_a + (x < held ? 0 : n[x] / of_b);
            inverse += mobility[x] * n[x];
            square += mobility[x] * mobility[x];
            size += w[x] * w[x];
        }
        if (!(along > 0)) continue;
        const double mass = mass_beside_walls<double, D>(mobility, w, inverse, along, 0.0, true);
        const double push = mass * along, whole = along / inverse * std::sqrt(square / size);
        double before = 0, after = 0, moved_b = 0;
        for (int x = 0; x < D; ++x) {
            const double by_a = -push * n[x] / of_a, by_b = x < held ? 0 : push * n[x] / of_b;
            moved_b += by_b * by_b;
            before += of_a * a[x] * a[x] + of_b * b[x] * b[x];
            after += of_a * (a[x] + by_a) * (a[x] + by_a) + of_b * (b[x] + by_b) * (b[x] + by_b);
        }
        EXPECT_LE(moved_b, size * (1 + 1e-9));
        EXPECT_LE(after, before * (1 + 1e-12));
        if (whole < 1) {
            EXPECT_NEAR(mass * inverse, 1, 1e-12);
            ++parted;
        }
        thrown += whole > 3;
    }
    EXPECT_GT(parted, 500);
    EXPECT_GT(thrown, 50);
}
TEST(Contact, nothing_light_is_squeezed_out_beside_walls) {
    light_beside_heavy<2>();
    light_beside_heavy<3>();
}

}  // namespace
}  // namespace mpm
