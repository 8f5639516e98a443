// The law in rates: its formulae with all indices written out, and closed forms along simple paths,
// which it reaches with the first order of the step.
#include "mpm/physics/material/hypoelastic.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <vector>

#include "mpm/core/number.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

using M3 = Eigen::Matrix3d;

constexpr double density = 1600, young = 1e6;

/// A particle driven by increments dt grad v.
template <int D, class T = double>
struct Particle {
    double q[3];
    T state[Hypoelastic::reals<D>] = {};

    explicit Particle(double poisson = 0.3) : q{density, young, poisson} {}
    Elasticity<double> elastic() const { return Elasticity<double>::of(q[1], q[2]); }
    void move(const Mat<double, D>& strain) {
        Mat<T, D> e;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) e(a, b) = T(strain(a, b));
        Hypoelastic::advance<T, D, T>(state, e, Hypoelastic::constants<T>(q));
    }
    Mat<T, D> kirchhoff() const {
        return Hypoelastic::kirchhoff<T, D, T>(state, {}, Hypoelastic::constants<T>(q));
    }
    bool admissible() const { return Hypoelastic::admissible<T, D>(state); }
    Observation<D> see() const {
        const double still[D][D] = {};
        double wide[Hypoelastic::reals<D>];
        for (int r = 0; r < Hypoelastic::reals<D>; ++r) wide[r] = state[r];
        return Hypoelastic::observe<D>(wide, still, q);
    }
};
/// Along the first axis, or along all, to the stretch `to` in steps of one ratio.
template <int D>
Particle<D> stretched(double poisson, double to, int steps, bool all) {
    Particle<D> p(poisson);
    Mat<double, D> e{};
    for (int a = 0; a < (all ? D : 1); ++a) e(a, a) = std::expm1(std::log(to) / steps);
    for (int k = 0; k < steps; ++k) p.move(e);
    return p;
}
/// Twice the steps, half the error: `error` of a number of steps.
template <class Error>
void is_of_first_order(const Error& error, int steps) {
    double before = error(steps);
    EXPECT_NE(before, 0);
    for (int k = 0; k < 4; ++k) {
        const double after = error(steps *= 2);
        EXPECT_NEAR(before / after, 2, 60.0 / steps) << steps;
        before = after;
    }
}

/// sigma = M (1 - 1/F), M = lambda + 2 mu, across it lambda (1 - 1/F), and so tau = M (F - 1).
template <int D>
void uniaxial() {
    for (double poisson : {0.0, 0.3})
        for (double to : {0.5, 0.9, 1.1, 2.0}) {
            const auto k = Elasticity<double>::of(young, poisson);
            const double modulus = k.lame + 2 * k.shear, sum = 1 - 1 / to;
            if (poisson == 0) {
                ASSERT_DOUBLE_EQ(modulus, young);
            }
            is_of_first_order(
                [&](int steps) {
                    const auto p = stretched<D>(poisson, to, steps, false);
                    const auto o = p.see();
                    EXPECT_NEAR(o.volume_ratio, to, 1e-12 * steps);
                    EXPECT_NEAR(o.stress[1][1] * modulus, o.stress[0][0] * k.lame,
                                1e-11 * young * young);
                    EXPECT_EQ(o.stress[0][1], 0);
                    EXPECT_NEAR(o.pressure,
                                -(modulus + 2 * k.lame) / (3 * modulus) * o.stress[0][0],
                                1e-9 * young);
                    EXPECT_NEAR(p.kirchhoff()(0, 0), to * o.stress[0][0], 1e-9 * young);
                    return (o.stress[0][0] - modulus * sum) / modulus;
                },
                200);
            const auto end = stretched<D>(poisson, to, 100000, false).see();
            EXPECT_NEAR(end.stress[0][0], modulus * sum, 1e-5 * modulus);
        }
}
TEST(Hypoelastic, uniaxial_strain) {
    uniaxial<2>();
    uniaxial<3>();
}

/// The Hill term alone: tau = K (J - 1), that is p = -K (1 - 1/J). In the plane J is the square of
/// the stretch, the stress there (lambda + mu) (1 - 1/J) and across it lambda (1 - 1/J).
TEST(Hypoelastic, isotropic_stretch) {
    for (double poisson : {-0.3, 0.0, 0.3})
        for (double to : {0.5, 0.9, 1.1, 2.0}) {
            const auto k = Elasticity<double>::of(young, poisson);
            const double in_space = 1 - 1 / (to * to * to), in_plane = 1 - 1 / (to * to);
            is_of_first_order(
                [&](int steps) {
                    const auto o = stretched<3>(poisson, to, steps, true).see();
                    // Each step multiplies J by 1 + 3 d, the stretch by 1 + d.
                    const double log = std::log(to), J = to * to * to;
                    EXPECT_NEAR(o.volume_ratio, J, 4 * log * log * J / steps);
                    EXPECT_NEAR(o.stress[0][0], o.stress[2][2], 1e-9 * young);
                    return (-o.pressure - k.bulk() * in_space) / k.bulk();
                },
                400);
            is_of_first_order(
                [&](int steps) {
                    const auto p = stretched<2>(poisson, to, steps, true);
                    EXPECT_NEAR(p.see().stress[0][0] * k.lame, p.state[3] * (k.lame + k.shear),
                                1e-11 * young * young);
                    EXPECT_NEAR(-3 * p.see().pressure, 2 * p.see().stress[0][0] + p.state[3],
                                1e-9 * young);
                    return p.see().stress[0][0] / (k.lame + k.shear) - in_plane;
                },
                400);
        }
}

/// sigma_xy = mu sin g, sigma_xx = -sigma_yy = mu (1 - cos g): Jaumann's rate swings in simple
/// shear. No volume changes, so that the Hill term is silent.
template <int D>
void shear() {
    for (double to : {0.1, 1.0, 4.0}) {
        const double mu = young / 2.6;
        is_of_first_order(
            [&](int steps) {
                Particle<D> p;
                Mat<double, D> e{};
                e(0, 1) = to / steps;
                for (int k = 0; k < steps; ++k) p.move(e);
                const auto o = p.see();
                EXPECT_EQ(o.volume_ratio, 1);
                EXPECT_NEAR(o.pressure, 0, 1e-9 * mu);
                EXPECT_NEAR(o.stress[0][0], -o.stress[1][1], 1e-9 * mu);
                EXPECT_EQ(o.stress[0][1], o.stress[1][0]);
                // The step of Euler is that of (1 + i dg)^n in sigma_xx - mu + i sigma_xy.
                EXPECT_NEAR(o.stress[0][1] / mu, std::sin(to), to * to * std::exp(to) / steps);
                return o.stress[0][0] / mu - (1 - std::cos(to));
            },
            400);
    }
}
TEST(Hypoelastic, simple_shear) {
    shear<2>();
    shear<3>();
}

/// Turned in steps of a: the stress turns by atan(2 a) / 2 a step, its deviator in the plane grows
/// by sqrt(1 + 4 a^2), the second order of the step; pressure and volume are kept.
TEST(Hypoelastic, turns_in_small_steps) {
    test::Random random(5);
    const double all = 1.2;
    const auto turn = [&](int steps) {
        Particle<2> p;
        p.move({{{-0.02, 0.03}, {0.01, -0.05}}});
        const auto before = p.see();
        const double half = 0.5 * (before.stress[0][0] - before.stress[1][1]);
        const double size = std::hypot(half, before.stress[0][1]);
        const double towards = std::atan2(before.stress[0][1], half);
        const double a = all / steps;
        for (int k = 0; k < steps; ++k) p.move({{{0, -a}, {a, 0}}});
        const auto after = p.see();
        EXPECT_NEAR(after.pressure, before.pressure, 1e-12 * young);
        EXPECT_EQ(after.volume_ratio, before.volume_ratio);
        const double mean = 0.5 * (before.stress[0][0] + before.stress[1][1]);
        const double found = 0.5 * (after.stress[0][0] - after.stress[1][1]);
        const double grown = size * std::pow(1 + 4 * a * a, 0.5 * steps);
        const double to = towards + steps * std::atan(2 * a);
        EXPECT_NEAR(found, grown * std::cos(to), 1e-11 * young);
        EXPECT_NEAR(after.stress[0][1], grown * std::sin(to), 1e-11 * young);
        EXPECT_NEAR(after.stress[0][0] + after.stress[1][1], 2 * mean, 1e-11 * young);
        // One step is off by the second order, a turn of given angle by the first.
        return std::hypot(found - size * std::cos(towards + 2 * all),
                          after.stress[0][1] - size * std::sin(towards + 2 * all)) /
               size;
    };
    EXPECT_NEAR(turn(1000), 2 * all * all / 1000, 1e-2 * 2 * all * all / 1000);
    is_of_first_order(turn, 100);

    // About any axis in space.
    for (int round = 0; round < 20; ++round) {
        Particle<3> first;
        first.move(random.matrix<3>(0.03));
        const Mat<double, 3> any = random.matrix<3>(1);
        M3 spin, stress;
        const auto start = first.kirchhoff();
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) {
                spin(a, b) = any(a, b) - any(b, a);
                stress(a, b) = start(a, b);
            }
        const double angle = std::sqrt(0.5) * spin.norm();
        const M3 axis = spin / angle;  // Rodrigues
        const M3 q = M3::Identity() + std::sin(angle) * axis + (1 - std::cos(angle)) * axis * axis;
        const M3 expected = q * stress * q.transpose();
        const auto error = [&](int steps) {
            Particle<3> p = first;
            Mat<double, 3> e;
            for (int a = 0; a < 3; ++a)
                for (int b = 0; b < 3; ++b) e(a, b) = spin(a, b) / steps;
            for (int k = 0; k < steps; ++k) p.move(e);
            EXPECT_NEAR(p.see().pressure, first.see().pressure, 1e-11 * young);
            EXPECT_NEAR(p.see().volume_ratio, first.see().volume_ratio, 1e-15);
            M3 found;
            const auto tau = p.kirchhoff();
            for (int a = 0; a < 3; ++a)
                for (int b = 0; b < 3; ++b) found(a, b) = tau(a, b);
            return (found - expected).norm() / stress.norm();
        };
        EXPECT_LT(error(1000), 4 * angle * angle / 1000);
        is_of_first_order(error, 200);
    }
}

/// The thesis' formulae in three dimensions, index by index.
struct Reference {
    M3 sigma = M3::Zero();
    double ratio = 1;

    void move(const M3& g, double poisson) {
        const double bulk = young / (3 * (1 - 2 * poisson)), mu = young / (2 * (1 + poisson));
        const auto same = [](int i, int j) { return i == j ? 1.0 : 0.0; };
        const M3 strain = 0.5 * (g + g.transpose()), spin = 0.5 * (g - g.transpose());
        M3 gain = M3::Zero();
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                for (int k = 0; k < 3; ++k) {
                    for (int l = 0; l < 3; ++l)
                        gain(i, j) += ((bulk - 2 * mu / 3) * same(i, j) * same(k, l) +
                                       mu * (same(i, k) * same(j, l) + same(i, l) * same(j, k))) *
                                      strain(k, l);
                    gain(i, j) += spin(i, k) * sigma(k, j) - sigma(i, k) * spin(k, j);
                    gain(i, j) -= strain(k, k) * sigma(i, j);
                }
        sigma += gain;
        ratio *= 1 + strain.trace();
    }
    /// What linear elasticity stores at this stress, from its compliance.
    double energy(double poisson) const {
        const M3 strain =
            ((1 + poisson) * sigma - poisson * sigma.trace() * M3::Identity()) / young;
        return 0.5 * ratio * sigma.cwiseProduct(strain).sum();
    }
};

/// Random paths; two dimensions are three without strain out of the plane.
template <int D>
void follow(double size) {
    test::Random random(41);
    for (double poisson : {-0.4, 0.0, 0.3, 0.45})
        for (int path = 0; path < 20; ++path) {
            Particle<D> p(poisson);
            Particle<3> space(poisson);
            Reference r;
            Mat<double, D> direction{};
            for (int step = 0; step < 60; ++step) {
                if (step % 12 == 0) direction = random.matrix<D>(size);
                Mat<double, 3> wide{};
                M3 g = M3::Zero();
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) g(a, b) = wide(a, b) = direction(a, b);
                p.move(direction);
                space.move(wide);
                r.move(g, poisson);
                const auto o = p.see(), full = [&] {
                    const auto seen = space.see();
                    Observation<D> out{};
                    out.pressure = seen.pressure;
                    out.volume_ratio = seen.volume_ratio;
                    out.elastic_energy = seen.elastic_energy;
                    for (int a = 0; a < D; ++a)
                        for (int b = 0; b < D; ++b) out.stress[a][b] = seen.stress[a][b];
                    return out;
                }();
                const double most = r.sigma.cwiseAbs().maxCoeff(), bound = 1e-12 * (most + young);
                const auto tau = p.kirchhoff();
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) {
                        ASSERT_NEAR(o.stress[a][b], r.sigma(a, b), bound);
                        ASSERT_NEAR(o.stress[a][b], full.stress[a][b], bound);
                        ASSERT_NEAR(tau(a, b), r.ratio * r.sigma(a, b), bound);
                        ASSERT_EQ(tau(a, b), tau(b, a));
                        ASSERT_EQ(o.deformation[a][b], a == b ? 1 : 0);
                    }
                if (D == 2) {
                    ASSERT_NEAR(p.state[3], r.sigma(2, 2), bound);
                    ASSERT_NEAR(p.state[3], space.state[2], bound);
                    ASSERT_EQ(space.state[3], 0) << "yz";
                    ASSERT_EQ(space.state[4], 0) << "xz";
                }
                ASSERT_NEAR(o.pressure, -r.sigma.trace() / 3, bound);
                ASSERT_NEAR(o.pressure, full.pressure, bound);
                ASSERT_NEAR(o.volume_ratio, r.ratio, 1e-13);
                ASSERT_NEAR(o.volume_ratio, full.volume_ratio, 1e-13);
                const double energy = r.energy(poisson);
                ASSERT_NEAR(o.elastic_energy, energy, 1e-12 * (energy + young));
                ASSERT_NEAR(o.elastic_energy, full.elastic_energy, 1e-12 * (energy + young));
                ASSERT_GE(o.elastic_energy, 0);
                ASSERT_EQ(o.plastic_strain, 0);
                ASSERT_FALSE(o.yields);
            }
        }
}
TEST(Hypoelastic, random_paths) {
    for (double size : {1e-6, 1e-3, 1e-2}) {
        follow<2>(size);
        follow<3>(size);
    }
}

/// No energy belongs to the law: what a reader sees grows by the work less tr(de) times itself.
template <int D>
void energy_along_a_path() {
    test::Random random(43);
    for (int round = 0; round < 200; ++round) {
        Particle<D> p;
        p.move(random.matrix<D>(0.2));
        const auto direction = random.matrix<D>(1);
        const double h = 1e-5;
        const auto after = [&](double by) {
            Particle<D> moved = p;
            Mat<double, D> e = direction;
            for (auto& row : e.e)
                for (double& x : row) x *= by;
            moved.move(e);
            return moved.see().elastic_energy;
        };
        double work = 0;
        const auto tau = p.kirchhoff();
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) work += tau(a, b) * direction(a, b);
        const double expected = work - trace(direction) * p.see().elastic_energy;
        ASSERT_NEAR((after(h) - after(-h)) / (2 * h), expected, 1e-6 * young);
    }
}
TEST(Hypoelastic, energy_along_a_path) {
    energy_along_a_path<2>();
    energy_along_a_path<3>();
}

/// A path in single precision, and in packs, is that in double precision up to the rounding of each
/// step, however small the strain.
template <int D>
void precisions() {
    using V = Pack<float, 8>;
    constexpr int R = Hypoelastic::reals<D>, steps = 100;
    test::Random random(47);
    for (double size : {1e-8, 1e-6, 1e-4, 1e-2}) {
        Particle<D> wide[8];
        Particle<D, float> narrow[8];
        V packed[R];
        for (V& x : packed) x = V(0.0f);
        const auto constants = Hypoelastic::constants<float>(wide[0].q);
        for (int step = 0; step < steps; ++step) {
            float lane[D][D][8];
            for (int l = 0; l < 8; ++l) {
                Mat<double, D> e = random.matrix<D>(size);
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) e(a, b) = lane[a][b][l] = float(e(a, b));
                wide[l].move(e);
                narrow[l].move(e);
            }
            Mat<V, D> together;
            for (int a = 0; a < D; ++a)
                for (int b = 0; b < D; ++b) together(a, b) = V::load(lane[a][b]);
            Hypoelastic::advance<V, D, float>(packed, together, constants);
        }
        const auto good = Hypoelastic::admissible<V, D>(packed);
        const auto tau = Hypoelastic::kirchhoff<V, D, float>(packed, {}, constants);
        // A random walk of `steps` roundings, of a stress that walked as well.
        const double strain = size * std::sqrt(double(steps));
        const double bound = 8 * std::sqrt(double(steps)) * 6e-8 * strain;
        for (int l = 0; l < 8; ++l) {
            EXPECT_TRUE(good[l]);
            for (int r = 0; r < R; ++r) {
                const double unit = r == Hypoelastic::volume<D> ? 1 : young;
                EXPECT_NEAR(narrow[l].state[r], wide[l].state[r], bound * unit) << size;
                EXPECT_NEAR(packed[r][l], wide[l].state[r], bound * unit) << size;
            }
            const auto exact = wide[l].kirchhoff();
            const auto rough = narrow[l].kirchhoff();
            for (int a = 0; a < D; ++a)
                for (int b = 0; b < D; ++b) {
                    EXPECT_NEAR(rough(a, b), exact(a, b), bound * young);
                    EXPECT_NEAR(tau(a, b)[l], exact(a, b), bound * young);
                }
        }
    }
}
TEST(Hypoelastic, single_precision_and_packs) {
    precisions<2>();
    precisions<3>();
}

/// J from 0.05 to 20, finite stress; a lane beside it is judged alone.
template <class T, int D>
void edge() {
    using V = Pack<T, 4>;
    constexpr int R = Hypoelastic::reals<D>;
    constexpr double infinite = std::numeric_limits<double>::infinity();
    const auto judged = [](int place, double value) {
        T column[R][4] = {};
        column[place][2] = T(value);
        V packed[R];
        for (int r = 0; r < R; ++r) packed[r] = V::load(column[r]);
        const auto all = Hypoelastic::admissible<V, D>(packed);
        for (int l : {0, 1, 3}) EXPECT_TRUE(all[l]);
        Particle<D, T> p;
        p.state[place] = T(value);
        EXPECT_EQ(p.admissible(), bool(all[2]));
        return p.admissible();
    };
    for (double ratio : {0.0501, 0.5, 1.0, 19.99})
        EXPECT_TRUE(judged(Hypoelastic::volume<D>, ratio - 1)) << ratio;
    for (double ratio : {0.0499, 0.0, -1.0, 20.01, 1e30, -infinite, infinite, std::nan("")})
        EXPECT_FALSE(judged(Hypoelastic::volume<D>, ratio - 1)) << ratio;
    for (int r = 0; r + 1 < R; ++r) {
        EXPECT_TRUE(judged(r, 1e30));
        for (double bad : {-infinite, infinite, std::nan("")}) EXPECT_FALSE(judged(r, bad)) << r;
    }
}
TEST(Hypoelastic, edge_of_the_range) {
    edge<float, 2>();
    edge<float, 3>();
    edge<double, 2>();
    edge<double, 3>();
    // Turned inside out in one step; torn in many.
    Particle<2> inverted;
    inverted.move({{{-1.5, 0}, {0, 0}}});
    EXPECT_DOUBLE_EQ(inverted.see().volume_ratio, -0.5);
    EXPECT_FALSE(inverted.admissible());
    EXPECT_TRUE(stretched<3>(0.3, 2.7, 1000, true).admissible());
    EXPECT_FALSE(stretched<3>(0.3, 2.73, 1000, true).admissible());
}

}  // namespace
}  // namespace mpm
