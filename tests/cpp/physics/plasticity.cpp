// Elastic-plastic solids: closed forms along simple paths, and along random ones an independent
// reference in three dimensions (Eigen's eigenvalues, the flow found by bisection).
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <functional>
#include <vector>

#include "mpm/physics/material/drucker_prager.hpp"
#include "mpm/physics/material/von_mises.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

using M3 = Eigen::Matrix3d;
using V3 = Eigen::Vector3d;

/// A particle of a material, driven by increments dt grad v.
template <class Material, int D>
struct Particle {
    std::vector<double> q;
    double state[Material::template reals<D>] = {};
    Mat<double, D> tau{};

    explicit Particle(std::vector<double> parameters) : q(std::move(parameters)) {}
    void move(const Mat<double, D>& strain) {
        tau = Material::template respond<double, D, double>(
            state, strain, Material::template constants<double>(q.data()));
    }
    /// dt grad v of the stretch by exp(rate_i) along the axes.
    void stretch(const std::vector<double>& rate) {
        Mat<double, D> e{};
        for (int a = 0; a < D; ++a) e(a, a) = std::expm1(rate[std::size_t(a)]);
        move(e);
    }
    Observation<D> see() const {
        const double still[D][D] = {};
        return Material::template observe<D>(state, still, q.data());
    }
};

/// |dev tau| sqrt(3/2) of principal Kirchhoff stresses.
double equivalent(const V3& t) {
    const V3 s = t.array() - t.mean();
    return std::sqrt(1.5) * s.norm();
}
V3 diagonal(const Mat<double, 3>& m) { return {m(0, 0), m(1, 1), m(2, 2)}; }

constexpr double young = 2e11, poisson = 0.3, yield = 4e8, hardening = 2e9;
const auto steel = Elasticity<double>::of(young, poisson);

/// Isochoric stretch: q = 3 mu e up to the yield stress, then the slope 3 mu H / (3 mu + H).
TEST(VonMises, uniaxial_and_cyclic) {
    const double modulus = 3 * steel.shear;
    for (double h : {0.0, hardening}) {
        for (int steps : {10, 1000}) {
            Particle<VonMises, 3> p({7850, young, poisson, yield, h});
            const double plastic = modulus * h / (modulus + h), turn = 0.02;
            const double de = turn / steps;
            for (int k = 1; k <= steps; ++k) {
                p.stretch({de, -de / 2, -de / 2});
                const double e = k * de, at_yield = yield / modulus;
                const double expected =
                    e < at_yield ? modulus * e : yield + plastic * (e - at_yield);
                ASSERT_NEAR(equivalent(diagonal(p.tau)), expected, 1e-9 * yield);
                ASSERT_EQ(p.see().yields, e > at_yield * (1 + 1e-9));
            }
            // Isotropic hardening: the other side yields at what this one reached.
            const double reached = equivalent(diagonal(p.tau));
            const double before = p.see().plastic_strain;
            EXPECT_NEAR(before, turn - reached / modulus, 1e-9 * turn);
            const int back = int(std::floor(1.999 * reached / modulus / de));
            for (int k = 0; k < back; ++k) p.stretch({-de, de / 2, de / 2});
            EXPECT_EQ(p.see().plastic_strain, before) << "unloading is elastic";
            for (int k = 0; k < steps; ++k) p.stretch({-de, de / 2, de / 2});
            EXPECT_GT(p.see().plastic_strain, before + 0.5 * turn);
            EXPECT_NEAR(equivalent(diagonal(p.tau)), yield + h * p.see().plastic_strain,
                        1e-9 * yield);
        }
    }
}

/// Stretched far and unloaded, and pressed as far and unloaded: the same is stored, nothing but how
/// much has flown, while the total strains are 0.02 and -0.02 less what is given back. A smoothed
/// total strain, whose plastic part stays, is therefore no function of the state.
TEST(VonMises, what_is_stored_does_not_tell_the_total_strain) {
    double total[2], flown[2];
    for (int sign : {0, 1}) {
        Particle<VonMises, 3> p({7850, young, poisson, yield, hardening});
        const double de = (sign == 0 ? 1 : -1) * 0.02 / 100;
        for (int k = 0; k < 100; ++k) p.stretch({de, -de / 2, -de / 2});
        const double back = -0.5 * std::log1p(p.state[0]);
        p.stretch({back, -back / 2, -back / 2});
        for (int r = 0; r < VonMises::hardened<3>; ++r) EXPECT_NEAR(p.state[r], 0, 1e-14);
        total[sign] = 100 * de + back;
        flown[sign] = p.state[VonMises::hardened<3>];
    }
    EXPECT_GT(total[0], 0.015);
    EXPECT_NEAR(total[1], -total[0], 1e-12);
    EXPECT_NEAR(flown[0], total[0], 1e-12);
    EXPECT_NEAR(flown[1], flown[0], 1e-12);
}

TEST(VonMises, pressure_causes_no_flow) {
    Particle<VonMises, 3> p({7850, young, poisson, yield, hardening});
    for (int k = 0; k < 100; ++k) p.stretch({-1e-3, -1e-3, -1e-3});
    const double bulk = steel.lame + 2.0 / 3 * steel.shear;
    EXPECT_EQ(p.see().plastic_strain, 0);
    EXPECT_NEAR(p.see().volume_ratio, std::exp(-0.3), 1e-12);
    EXPECT_NEAR(p.tau(0, 0), -0.3 * bulk, 1e-10 * bulk);
}

/// Simple shear without hardening: the shear stress stays at sigma_y / sqrt(3), up to what the
/// rotation of the elastic strain adds, and the work done is lost.
TEST(VonMises, shear) {
    Particle<VonMises, 2> p({7850, young, poisson, yield, 0});
    const int steps = 4000;
    Mat<double, 2> e{};
    e(0, 1) = 1.0 / steps;
    double work = 0;
    for (int k = 0; k < steps; ++k) {
        const auto before = p.tau;
        p.move(e);
        work += 0.5 * (before(0, 1) + p.tau(0, 1)) * e(0, 1);
    }
    const double limit = yield / std::sqrt(3.0);
    EXPECT_NEAR(p.tau(0, 1), limit, 1e-3 * limit);
    EXPECT_NEAR(p.tau(0, 1), p.tau(1, 0), 1e-9 * limit);
    EXPECT_NEAR(work, limit * 1.0, 4e-3 * limit);
    EXPECT_NEAR(p.see().plastic_strain, 1 / std::sqrt(3.0), 4e-3);
    EXPECT_NEAR(p.see().volume_ratio, 1, 1e-12);
}

/// Reference particle in three dimensions: trial by b <- f b f^T, return of the principal strains.
struct Reference {
    M3 b = M3::Identity();
    std::vector<double> memory = {0, 0, 0};
    using Return = std::function<void(V3& strain, std::vector<double>& memory)>;

    M3 move(const M3& strain, const Elasticity<double>& k, const Return& back) {
        const M3 f = M3::Identity() + strain;
        const Eigen::SelfAdjointEigenSolver<M3> solver(f * b * f.transpose());
        V3 e = 0.5 * solver.eigenvalues().array().log();
        back(e, memory);
        const M3 n = solver.eigenvectors();
        b = n * (2 * e).array().exp().matrix().asDiagonal() * n.transpose();
        const V3 t = (2 * k.shear * e).array() + k.lame * e.sum();
        return n * t.asDiagonal() * n.transpose();
    }
};
/// The root of a falling function, from 0 on.
double root(const std::function<double(double)>& f, double top) {
    double low = 0;
    for (int k = 0; k < 200; ++k) {
        const double middle = 0.5 * (low + top);
        (f(middle) > 0 ? low : top) = middle;
    }
    return 0.5 * (low + top);
}

/// Random paths of `size` a step: stresses of the material and of the reference.
template <class Material, int D>
void follow(const std::vector<double>& parameters, const Elasticity<double>& k, double size,
            const Reference::Return& back, double tolerance) {
    test::Random random(19);
    double flowed = 0;
    for (int path = 0; path < 20; ++path) {
        Particle<Material, D> p(parameters);
        Reference r;
        double most = 0;
        Mat<double, D> direction = random.template matrix<D>(1);
        for (int step = 0; step < 60; ++step) {
            if (step % 12 == 0) direction = random.template matrix<D>(1);
            Mat<double, D> e = direction;
            M3 wide = M3::Zero();
            for (int a = 0; a < D; ++a)
                for (int c = 0; c < D; ++c) {
                    e(a, c) *= size;
                    wide(a, c) = e(a, c);
                }
            p.move(e);
            const M3 expected = r.move(wide, k, back);
            most = std::max(most, expected.cwiseAbs().maxCoeff());
            flowed = std::max(flowed, p.see().plastic_strain);
            for (int a = 0; a < D; ++a)
                for (int c = 0; c < D; ++c)
                    ASSERT_NEAR(p.tau(a, c), expected(a, c), tolerance * most)
                        << path << ' ' << step;
            ASSERT_NEAR(p.see().plastic_strain, r.memory[0], tolerance);
        }
    }
    EXPECT_GT(flowed, 10 * size) << "they flow";
}

TEST(VonMises, random_paths) {
    const Reference::Return back = [](V3& e, std::vector<double>& memory) {
        const V3 dev = e.array() - e.mean();
        const auto excess = [&](double flow) {
            return 2 * steel.shear * (dev.norm() - flow) -
                   std::sqrt(2.0 / 3) *
                       (yield + hardening * (memory[0] + std::sqrt(2.0 / 3) * flow));
        };
        if (excess(0) <= 0) return;
        const double flow = root(excess, dev.norm());
        e -= flow * dev / dev.norm();
        memory[0] += std::sqrt(2.0 / 3) * flow;
    };
    const std::vector<double> q = {7850, young, poisson, yield, hardening};
    follow<VonMises, 2>(q, steel, 1e-3, back, 1e-9);
    follow<VonMises, 3>(q, steel, 1e-3, back, 1e-9);
    follow<VonMises, 3>(q, steel, 3e-2, back, 1e-9);
}

constexpr double stiff = 1e7, loose = 0.25;
const auto sand_elastic = Elasticity<double>::of(stiff, loose);
std::vector<double> sand(double friction, double cohesion, double dilatancy, double cutoff = 0,
                         double correction = 1) {
    return {1600, stiff, loose, friction, cohesion, dilatancy, cutoff, correction};
}

/// Compressed by pressure, then shortened along one axis at constant lateral stress: the strength
/// is Mohr-Coulomb's, sigma_1 = N sigma_3 + 2 c sqrt(N), N = (1 + sin phi) / (1 - sin phi).
TEST(DruckerPrager, triaxial_compression_reaches_mohr_coulomb) {
    for (double phi : {15.0, 30.0, 40.0})
        for (double c : {0.0, 500.0}) {
            Particle<DruckerPrager, 3> p(sand(phi, c, 0));
            const double bulk = sand_elastic.lame + 2.0 / 3 * sand_elastic.shear, confine = 1e4;
            const double e = -confine / (3 * bulk);
            p.stretch({e, e, e});
            EXPECT_NEAR(p.tau(0, 0), -confine, 1e-9 * confine);
            // Lateral strain that keeps the lateral stress, by secant steps of the response.
            for (int step = 0; step < 400; ++step) {
                const double da = -2e-4;
                double lateral = 0, slope = sand_elastic.lame + 2 * sand_elastic.shear;
                for (int k = 0; k < 60; ++k) {
                    Particle<DruckerPrager, 3> guess = p;
                    guess.stretch({da, lateral, lateral});
                    const double miss = guess.tau(1, 1) + confine;
                    if (std::fabs(miss) < 1e-8 * confine) break;
                    lateral -= miss / (2 * slope);
                }
                p.stretch({da, lateral, lateral});
            }
            const double sine = std::sin(phi * M_PI / 180), n = (1 + sine) / (1 - sine);
            EXPECT_TRUE(p.see().yields);
            EXPECT_NEAR(-p.tau(1, 1), confine, 1e-6 * confine);
            EXPECT_NEAR(-p.tau(0, 0), n * confine + 2 * c * std::sqrt(n), 1e-5 * n * confine)
                << phi << ' ' << c;
        }
}

/// Sheared at constant pressure it gains volume at the rate of its dilatancy, and never without.
TEST(DruckerPrager, dilatancy) {
    for (double psi : {0.0, 10.0}) {
        Particle<DruckerPrager, 3> p(sand(30, 0, psi));
        p.stretch({-1e-3, -1e-3, -1e-3});
        Mat<double, 3> e{};
        double volume = 0;
        const auto pressure = [](const Mat<double, 3>& t) { return -trace(t) / 3; };
        const double kept = pressure(p.tau);
        for (int step = 0; step < 2000; ++step) {
            e(0, 1) = e(1, 0) = 5e-4;
            double open = 0;
            for (int k = 0; k < 60; ++k) {
                auto guess = p;
                auto with = e;
                for (int a = 0; a < 3; ++a) with(a, a) = open / 3;
                guess.move(with);
                const double miss = pressure(guess.tau) - kept;
                if (std::fabs(miss) < 1e-10 * kept) break;
                open += miss / (2 * sand_elastic.lame + 2 * sand_elastic.shear);
            }
            for (int a = 0; a < 3; ++a) e(a, a) = open / 3;
            p.move(e);
            volume = std::log(p.see().volume_ratio) + 3e-3;
            for (int a = 0; a < 3; ++a) e(a, a) = 0;
        }
        const double sine = std::sin(psi * M_PI / 180);
        const double rate = std::sqrt(2.0 / 3) * 6 * sine / (3 - sine) * std::sqrt(1.5);
        EXPECT_GT(p.see().plastic_strain, 0.5);
        EXPECT_NEAR(volume, rate * p.see().plastic_strain, 1e-3 * p.see().plastic_strain);
    }
}

/// Sand pulled apart bears nothing; pushed back, it bears again where it lost touch.
TEST(DruckerPrager, a_gap_closes_where_it_opened) {
    const double bulk = sand_elastic.lame + 2.0 / 3 * sand_elastic.shear;
    for (double correction : {0.0, 0.5, 1.0}) {
        Particle<DruckerPrager, 2> p(sand(35, 0, 0, 0, correction));
        for (int k = 0; k < 100; ++k) {
            p.stretch({1e-3, 1e-3});
            ASSERT_EQ(p.tau(0, 0), 0);
            ASSERT_NEAR(p.see().volume_ratio, std::exp(2e-3 * (k + 1)), 1e-12);
        }
        for (int k = 1; k <= 120; ++k) {
            p.stretch({-1e-3, -1e-3});
            // What is closed beyond the share that must close first.
            const double pressed = std::max(0.0, 2e-3 * k - 0.2 * correction);
            ASSERT_NEAR(p.see().pressure * p.see().volume_ratio, bulk * pressed, 1e-9 * bulk);
            ASSERT_NEAR(std::log(p.see().volume_ratio), 0.2 - 2e-3 * k, 1e-12);
        }
    }
}

TEST(DruckerPrager, cohesion_and_cutoff_bound_the_tension) {
    const double c = 2e3, phi = 30, apex = c / std::tan(phi * M_PI / 180);
    for (double cutoff : {0.0, 1e3, 1e9}) {
        Particle<DruckerPrager, 3> p(sand(phi, c, 0, cutoff));
        for (int k = 0; k < 200; ++k) p.stretch({1e-4, 1e-4, 1e-4});
        EXPECT_NEAR(trace(p.tau) / 3, std::min(cutoff, apex), 1e-8 * apex);
    }
    // Without friction the strength is Tresca's, 2 c, at any pressure.
    Particle<DruckerPrager, 3> clay(sand(0, c, 0, 1e9));
    for (int k = 0; k < 200; ++k) clay.stretch({-1e-4, 5e-5, 5e-5});
    EXPECT_NEAR(equivalent(diagonal(clay.tau)), 2 * c, 1e-9 * c);
}

TEST(DruckerPrager, random_paths) {
    const double bulk = sand_elastic.lame + 2.0 / 3 * sand_elastic.shear;
    for (double c : {0.0, 3e3})
        for (double psi : {0.0, 12.0}) {
            const double phi = 33, cutoff = 0.4 * c;
            const auto three_alpha = [](double degrees) {
                const double s = std::sin(degrees * M_PI / 180);
                return 3 * std::sqrt(2.0 / 3) * 2 * s / (3 - s);
            };
            const double sine = std::sin(phi * M_PI / 180), cosine = std::cos(phi * M_PI / 180);
            const double strength = std::sqrt(2.0 / 3) * 6 * c * cosine / (3 - sine);
            const Reference::Return back = [&](V3& e, std::vector<double>& memory) {
                const V3 dev = e.array() - e.mean();
                const double size = dev.norm(), volume = e.sum() + memory[1];
                double new_size = size, new_volume = volume;
                if (bulk * volume > cutoff) {
                    new_volume = cutoff / bulk;
                    new_size = std::min(size, std::max(0.0, strength - three_alpha(phi) * cutoff) /
                                                  (2 * sand_elastic.shear));
                    memory[1] = volume - new_volume;
                } else {
                    const auto excess = [&](double flow) {
                        const double p = -bulk * (volume - three_alpha(psi) * flow);
                        return 2 * sand_elastic.shear * (size - flow) - three_alpha(phi) * p -
                               strength;
                    };
                    if (excess(0) > 0) {
                        const double flow = root(excess, size);
                        new_size = size - flow;
                        new_volume = volume - three_alpha(psi) * flow;
                    }
                    memory[1] = 0;
                }
                memory[0] += std::sqrt(2.0 / 3) * (size - new_size);
                e = (size > 0 ? V3(dev * (new_size / size)) : V3(V3::Zero())).array() +
                    new_volume / 3;
            };
            const auto q = sand(phi, c, psi, cutoff);
            follow<DruckerPrager, 2>(q, sand_elastic, 1e-3, back, 1e-8);
            follow<DruckerPrager, 3>(q, sand_elastic, 1e-3, back, 1e-8);
        }
}

/// Work done on a particle is stored or lost, never gained, along any path.
template <class Material, int D>
void dissipates(const std::vector<double>& q, double size, double scale) {
    test::Random random(29);
    for (int path = 0; path < 20; ++path) {
        Particle<Material, D> p(q);
        Mat<double, D> direction{};
        for (int step = 0; step < 200; ++step) {
            if (step % 20 == 0) direction = random.template matrix<D>(size);
            const double before = p.see().elastic_energy;
            p.move(direction);
            double work = 0;
            for (int a = 0; a < D; ++a)
                for (int b = 0; b < D; ++b) work += p.tau(a, b) * direction(a, b);
            // The stress at the end of the step does at least the work that is stored, up to the
            // second order of the step.
            ASSERT_GT(work - (p.see().elastic_energy - before), -scale * size * size) << step;
        }
    }
}
TEST(VonMises, dissipates) {
    const std::vector<double> q = {7850, young, poisson, yield, hardening};
    dissipates<VonMises, 2>(q, 1e-3, young);
    dissipates<VonMises, 3>(q, 1e-3, young);
}
TEST(DruckerPrager, dissipates) {
    for (double psi : {0.0, 30.0}) {
        dissipates<DruckerPrager, 2>(sand(30, 1e3, psi), 1e-3, stiff);
        dissipates<DruckerPrager, 3>(sand(30, 1e3, psi), 1e-3, stiff);
    }
}

/// A turn of everything in the middle of a path turns the stress and nothing else.
template <class Material, int D>
void turns(const std::vector<double>& q, double size) {
    test::Random random(37);
    for (int path = 0; path < 20; ++path) {
        Particle<Material, D> still(q), turned(q);
        const auto turn = random.template rotation<D>();
        for (int step = 0; step < 40; ++step) {
            const auto e = random.template matrix<D>(size);
            still.move(e);
            if (step == 20) {
                auto increment = turn;
                for (int a = 0; a < D; ++a) increment(a, a) -= 1;
                turned.move(increment);
            }
            turned.move(step < 20 ? e : product_transposed(product(turn, e), turn));
        }
        const auto expected = product_transposed(product(turn, still.tau), turn);
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b)
                ASSERT_NEAR(turned.tau(a, b), expected(a, b),
                            1e-9 * (test::largest<D>(still.tau) + q[1] * size));
        ASSERT_NEAR(turned.see().plastic_strain, still.see().plastic_strain, 1e-12);
    }
}
TEST(VonMises, turns) {
    turns<VonMises, 2>({7850, young, poisson, yield, hardening}, 2e-3);
    turns<VonMises, 3>({7850, young, poisson, yield, hardening}, 2e-3);
}
TEST(DruckerPrager, turns) {
    turns<DruckerPrager, 2>(sand(30, 1e3, 5), 2e-3);
    turns<DruckerPrager, 3>(sand(30, 1e3, 5), 2e-3);
}

}  // namespace
}  // namespace mpm
