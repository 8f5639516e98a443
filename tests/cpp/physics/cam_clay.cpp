// Non-associative Cam-Clay: closed forms along simple paths, and along random ones an independent
// reference in three dimensions (Eigen's eigenvalues; where the yield surface is met, and the mean
// that keeps the volume, by bisection).
#include "mpm/physics/material/cam_clay.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "support/random.hpp"

namespace mpm {
namespace {

using M3 = Eigen::Matrix3d;
using V3 = Eigen::Vector3d;

struct Clay {
    double young = 1e7, poisson = 0.3, alpha = -0.02, phi = 30, beta = 0.5, xi = 2, hardens = 1;

    std::vector<double> q() const { return {1500, young, poisson, alpha, phi, beta, xi, hardens}; }
    double mu() const { return young / (2 * (1 + poisson)); }
    double bulk() const { return young / (3 * (1 - 2 * poisson)); }
    double slope() const {
        const double s = std::sin(phi * M_PI / 180);
        return 6 * s / (3 - s);
    }
    double p0(double a) const { return bulk() * (1e-5 + std::sinh(xi * std::max(-a, 0.0))); }
    double p0() const { return p0(alpha); }
    double surface(double p, double q, double crush) const {
        return (1 + 2 * beta) * q * q + slope() * slope() * (p + beta * crush) * (p - crush);
    }
    double pressure(double j) const { return -0.5 * bulk() * (j * j - 1); }
};

/// The elastic state: invariants and energy of b by its eigenvalues.
struct Elastic {
    V3 w;  // of b
    M3 axes;
    double square, p, q, energy;  // J^2

    Elastic(const Clay& c, const M3& b) {
        const Eigen::SelfAdjointEigenSolver<M3> solver(b);
        w = solver.eigenvalues();
        axes = solver.eigenvectors();
        square = w.prod();
        const double unit = std::cbrt(1 / square);
        p = -0.5 * c.bulk() * (square - 1);
        q = std::sqrt(1.5) * (c.mu() * unit * (w.array() - w.mean())).matrix().norm();
        energy =
            0.5 * c.mu() * (unit * w.sum() - 3) + 0.25 * c.bulk() * (square - 1 - std::log(square));
    }
    M3 stress(const Clay& c) const {
        const V3 t = c.mu() * std::cbrt(1 / square) * (w.array() - w.mean()) - p;
        return axes * t.asDiagonal() * axes.transpose();
    }
};

/// Where a function that rises through zero between two places does so.
double root(const std::function<double(double)>& f, double low, double high) {
    for (int k = 0; k < 64; ++k) {
        const double middle = 0.5 * (low + high);
        (f(middle) < 0 ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

struct Reference {
    Clay c;
    M3 b = M3::Identity();
    double change = 0, dilation = 0, plastic = 0;
    bool flows = false;

    M3 move(const M3& strain) {
        const M3 f = M3::Identity() + strain;
        const Elastic trial(c, f * b * f.transpose());
        const double p = trial.p, q = trial.q, mean = trial.w.mean();
        double crush = c.p0(c.alpha + change);
        const bool crushed = p > crush, torn = p < -c.beta * crush, bursts = crushed || torn;
        flows = bursts || c.surface(p, q, crush) > 0;
        const auto tip = [&](double at) { return crushed ? at : -c.beta * at; };
        // ln(J_trial / J) with J on the surface of a p0.
        const auto jump = [&](double at) {
            const double centre = 0.5 * (1 - c.beta) * at, off = p - centre;
            const auto away = [&](double t) { return c.surface(centre + t * off, t * q, at); };
            const double to = bursts ? tip(at) : centre + root(away, 0, 1) * off;
            return 0.5 * std::log(trial.square / std::max(0.0025, 1 - 2 * to / c.bulk()));
        };
        V3 w = trial.w;
        if (flows) {
            double step = c.hardens * jump(crush);
            if (step < 0) {
                const auto miss = [&](double x) {
                    return x - c.hardens * jump(c.p0(c.alpha + change + x));
                };
                step = root(miss, step, 0);
                crush = c.p0(c.alpha + change + step);
            }
            change += step;
            const double keep =
                bursts ? 0 : root([&](double t) { return c.surface(p, t * q, crush); }, 0, 1);
            const double opened = bursts ? jump(crush) : 0;
            dilation += opened;
            plastic += std::hypot((1 - keep) * q / (3 * c.mu()), std::sqrt(2.0 / 9) * opened);
            const double square = bursts ? 1 - 2 * tip(crush) / c.bulk() : trial.square;
            const V3 dev = keep * (trial.w.array() - mean);
            const auto volume = [&](double m) { return (dev.array() + m).prod() - square; };
            const double middle = root(volume, -dev.minCoeff(), mean + std::cbrt(square));
            w = dev.array() + middle;
        }
        b = trial.axes * w.asDiagonal() * trial.axes.transpose();
        return Elastic(c, b).stress(c);
    }
};

template <class T, int D>
M3 widened(const Mat<T, D>& m) {
    M3 out = M3::Zero();
    for (int a = 0; a < D; ++a)
        for (int c = 0; c < D; ++c) out(a, c) = double(m(a, c));
    return out;
}
/// A particle of the material, driven by increments dt grad v.
template <int D, class T = double>
struct Particle {
    Clay c;
    T state[CamClay::reals<D>] = {};
    Mat<T, D> tau{};

    explicit Particle(const Clay& clay) : c(clay) {}
    void move(const Mat<double, D>& strain) {
        Mat<T, D> e;
        for (int a = 0; a < D; ++a)
            for (int s = 0; s < D; ++s) e(a, s) = T(strain(a, s));
        tau = CamClay::respond<T, D, T>(state, e, CamClay::constants<T>(c.q().data()));
    }
    /// dt grad v of the stretch by exp(rate_i) along the axes.
    void stretch(const std::vector<double>& rate) {
        Mat<double, D> e{};
        for (int a = 0; a < D; ++a) e(a, a) = std::expm1(rate[std::size_t(a)]);
        move(e);
    }
    Observation<D> see() const {
        double own[CamClay::reals<D>];
        std::copy(std::begin(state), std::end(state), own);
        const double still[D][D] = {};
        return CamClay::observe<D>(own, still, c.q().data());
    }
    M3 left() const {  // b
        M3 b = M3::Identity() + widened(load_symmetric<D>(state));
        if (D == 2) b(2, 2) += double(state[3]);
        return b;
    }
    Elastic elastic() const { return {c, left()}; }
    double change() const { return double(state[CamClay::hardened<D>]); }
    double flow() const { return double(state[CamClay::sheared<D>]); }
    double gain() const { return double(state[CamClay::gained<D>]); }
    double crush() const { return c.p0(c.alpha + change()); }
};
/// Largest difference of two tensors, in two dimensions in the plane.
template <int D, class T>
double apart(const Mat<T, D>& m, const M3& other) {
    return (widened(m) - other).template topLeftCorner<D, D>().cwiseAbs().maxCoeff();
}

const Clay snow = {}, loose = {1e7, 0.25, -0.005, 35, 0, 10, 1},
           brittle = {1e6, 0.2, -0.05, 45, 2, 1, 1}, fixed_size = {1e7, 0.3, -0.02, 30, 0.5, 2, 0},
           half = {1e7, 0.4, -0.03, 20, 0.1, 3, 0.5};
/// The ends of the ranges.
const Clay edges[] = {{1e7, 0.3, -0.02, 0.1, 0.5, 2, 1},   {1e7, 0.3, -0.02, 80, 0.5, 2, 1},
                      {1e7, 0.3, -0.02, 89, 0, 2, 1},      {1e7, 0.3, -0.02, 30, 100, 2, 1},
                      {1e7, 0.3, -0.02, 30, 0.5, 1e-3, 1}, {1e7, 0.3, -0.02, 30, 0.5, 1e3, 1},
                      {1e7, 0.3, -1e-9, 30, 0.5, 2, 1},    {1e7, 0.3, -5, 30, 0.5, 2, 1},
                      {1e7, 0.49, -0.02, 30, 1, 2, 1},     {1e7, -0.9, -0.02, 30, 1, 2, 1},
                      {1e7, 0.3, -0.02, 80, 0, 50, 0}};

template <int D>
void follow(const Clay& c, double size, double bias) {
    test::Random random(41);
    int crushed = 0, sheared = 0, torn = 0;
    for (int path = 0; path < 20; ++path) {
        Particle<D> p(c);
        Reference r{c};
        double ratio = 1;
        Mat<double, D> e{};
        for (int step = 0; step < 80; ++step) {
            if (step % 16 == 0) {
                e = random.template matrix<D>(size);
                for (int a = 0; a < D; ++a) e(a, a) += (path % 2 ? bias : -bias) * size;
            }
            const double dilation = r.dilation;
            p.move(e);
            const M3 expected = r.move(widened(e));
            if (!CamClay::admissible<double, D>(p.state)) break;
            ratio *= (M3::Identity() + widened(e)).determinant();
            const auto o = p.see();
            crushed += r.dilation < dilation;
            torn += r.dilation > dilation;
            sheared += r.flows && r.dilation == dilation;
            ASSERT_LT(apart(p.tau, expected), 1e-10 * c.young) << step;
            ASSERT_NEAR(o.stress[0][1] * o.volume_ratio, expected(0, 1), 1e-10 * c.young);
            ASSERT_NEAR(p.change(), r.change, 1e-9);
            ASSERT_NEAR(o.plastic_strain, r.plastic, 1e-9);
            ASSERT_NEAR(o.volume_ratio, ratio, 1e-11 * ratio);
            ASSERT_NEAR(o.pressure * o.volume_ratio, Elastic(c, r.b).p, 1e-10 * c.young);
            ASSERT_NEAR(o.elastic_energy, p.elastic().energy,
                        1e-14 * c.young + 4e-14 * o.elastic_energy);
            ASSERT_TRUE(o.yields || !r.flows) << step;
        }
    }
    EXPECT_GT(std::min({crushed, sheared, torn}), 20);
}
TEST(CamClay, random_paths) {
    for (const Clay& c : {snow, loose, brittle, fixed_size, half}) {
        follow<2>(c, 2e-3, 0.5);
        follow<3>(c, 2e-3, 0.5);
        follow<3>(c, 2e-2, 0.2);
    }
}

/// What holds after any step: inside the surface it was returned to, and on it where it flowed; no
/// more elastic energy than the trial's, which holds all the work; volumes that add up.
template <int D>
void holds(const Clay& c, double size, int& flowed) {
    test::Random random(7);
    for (int path = 0; path < 20; ++path) {
        Particle<D> p(c);
        Mat<double, D> e{};
        double ratio = 1, rough = 1;
        for (int step = 0; step < 200; ++step) {
            if (step % 20 == 0) e = random.template matrix<D>(size);
            for (double& x : e.e[0]) x *= step % 20 == 10 ? -1 : 1;  // and back in part
            const M3 f = M3::Identity() + widened(e);
            const Elastic trial(c, f * p.left() * f.transpose());
            const double begin = p.crush(), was = p.change(), flow = p.flow();
            p.move(e);
            ratio *= f.determinant();
            if (!CamClay::admissible<double, D>(p.state)) break;  // as is reported
            const Elastic now = p.elastic();
            // The last digit of b, and what it is in J^2, p and q.
            rough = std::max(rough, std::pow(std::max(1.0, now.w.maxCoeff()), 3) / now.square);
            if (rough > 1e6) break;  // there is none left
            const double digit = 2e-14 * (c.bulk() + c.mu()) * rough * std::max(1.0, now.square);
            // The p0 of the return: the step's end where it hardened, else its start.
            const double crush = p.change() < was ? p.crush() : begin, tip = c.beta * crush;
            ASSERT_TRUE(now.p <= crush + digit && now.p >= -tip - digit) << step;
            // q^2 on the ellipse, and how much of it a digit of p is.
            const double share = c.slope() * c.slope() / (1 + 2 * c.beta);
            const double edge = share * (now.p + tip) * (crush - now.p);
            const double slack = 2 * (share * (tip + crush) + now.q + digit) * digit;
            ASSERT_LE(now.q * now.q, edge + slack) << step;
            ASSERT_LE(now.energy, trial.energy + digit);
            ASSERT_NEAR(p.see().volume_ratio, ratio, 1e-12 * rough * ratio);
            flowed += p.flow() > flow;
            if (p.flow() == flow) {
                ASSERT_EQ(p.change(), was);
                ASSERT_NEAR(now.q, trial.q, digit);
            } else if (std::min(crush - now.p, now.p + tip) > digit) {
                ASSERT_NEAR(now.q * now.q, edge, slack);
                ASSERT_NEAR(now.p, trial.p, digit);
            } else {
                ASSERT_LT(now.q, 1e-7 * c.young);
            }
        }
    }
}
TEST(CamClay, stays_inside_and_never_gains_energy) {
    int flowed = 0;
    std::vector<Clay> all = {snow, loose, brittle, fixed_size, half};
    all.insert(all.end(), std::begin(edges), std::end(edges));
    for (const Clay& c : all)
        for (double size : {1e-4, 5e-3, 0.1}) {
            SCOPED_TRACE(::testing::Message() << "clay " << &c - all.data() << " size " << size);
            holds<2>(c, size, flowed);
            holds<3>(c, size, flowed);
        }
    EXPECT_GT(flowed, 50000);
}

/// p = -K/2 (J^2 - 1) until p0, then p0(alpha_0 + h ln J_p) in any steps; unloading is elastic.
TEST(CamClay, isotropic_compression) {
    for (const Clay& c : {snow, loose, half, fixed_size})
        for (int steps : {15, 300}) {
            const double end = -0.15, d = end / steps / 3;  // of ln J
            Particle<3> p(c);
            for (int k = 1; k <= steps; ++k) {
                const double log_j = 3 * d * k;
                p.stretch({d, d, d});
                // The volume lost for good.
                const auto excess = [&](double lost) {
                    return c.p0(c.alpha - c.hardens * lost) - c.pressure(std::exp(log_j + lost));
                };
                const double lost = excess(0) < 0 ? root(excess, 0, -log_j) : 0;
                ASSERT_NEAR(-p.tau(0, 0), c.pressure(std::exp(log_j + lost)), 1e-10 * c.bulk());
                ASSERT_NEAR(p.gain(), -lost, 1e-10);
                ASSERT_NEAR(p.change(), -c.hardens * lost, 1e-10);
                ASSERT_NEAR(p.flow(), std::sqrt(2.0 / 9) * lost, 1e-10);
                ASSERT_EQ(p.see().yields, lost > 0);
            }
            const double gain = p.gain(), kept = p.change();
            for (int k = 1; k <= 10; ++k) {
                p.stretch({1e-4, 1e-4, 1e-4});
                const double back = c.pressure(std::exp(end + 3e-4 * k - gain));
                ASSERT_NEAR(-p.tau(0, 0), back, 1e-12 * c.bulk());
                ASSERT_TRUE(p.change() == kept && !p.see().yields);
            }
        }
}

/// Strain along one axis: tau_1 = 2/3 mu (J^2 - 1) J^(-2/3) + K/2 (J^2 - 1), plane strain alike.
TEST(CamClay, oedometer_in_the_elastic_range) {
    Clay c = snow;
    c.alpha = -0.2;
    Particle<3> solid(c);
    Particle<2> flat(c);
    for (int k = 1; k <= 100; ++k) {
        const double d = k <= 60 ? -1e-3 : 1e-3, j = std::exp(-1e-3 * (k <= 60 ? k : 120 - k));
        solid.stretch({0, d, 0});
        flat.stretch({0, d});
        const double mean = -c.pressure(j), shear = c.mu() * (j * j - 1) * std::pow(j, -2.0 / 3);
        ASSERT_NEAR(solid.tau(1, 1), mean + 2.0 / 3 * shear, 1e-12 * c.young);
        ASSERT_NEAR(solid.tau(0, 0), mean - 1.0 / 3 * shear, 1e-12 * c.young);
        ASSERT_LT(apart(flat.tau, widened(solid.tau)), 1e-12 * c.young);
        ASSERT_NEAR(flat.see().pressure * j, -mean, 1e-12 * c.young);
        ASSERT_EQ(flat.flow() + solid.flow(), 0);
    }
}

/// Sheared without change of volume p stays, so that q ends on the ellipse there; and where p0 may
/// move, at the critical state, from the side that hardens and from the one that softens.
template <int D>
void shears(const Clay& c, double depth) {
    const double p = depth * c.p0(), j = std::sqrt(1 - 2 * p / c.bulk()), step = 2e-4;
    const int steps = 20000;
    Particle<D> clay(c);
    clay.stretch(std::vector<double>(D, std::log(j) / D));
    std::vector<double> rate = {step, -step, 0};
    for (int k = 0; k < steps; ++k) {
        clay.stretch(rate);
        ASSERT_NEAR(clay.elastic().p, p, 1e-10 * c.bulk());
    }
    double q = c.slope() * std::sqrt((p + c.beta * c.p0()) * (c.p0() - p) / (1 + 2 * c.beta));
    if (c.hardens > 0) {
        q = c.slope() * p * (1 + c.beta) / ((1 - c.beta) * std::sqrt(1 + 2 * c.beta));
        EXPECT_NEAR(clay.crush(), 2 * p / (1 - c.beta), 4e-3 * clay.crush());
        EXPECT_EQ(clay.change() < 0, 2 * p > (1 - c.beta) * c.p0());
    }
    EXPECT_NEAR(clay.elastic().q, q, 2e-3 * q);
    // 2/sqrt(3) of the stretch less its elastic part, up to the elastic strain.
    const double flowed = 2 / std::sqrt(3.0) * steps * step - q / (3 * c.mu());
    EXPECT_NEAR(clay.flow(), flowed, 0.02 * flowed);
}
TEST(CamClay, shear_at_constant_pressure) {
    for (double beta : {0.0, 0.5})
        for (double depth : {0.2, 0.35, 0.8})
            for (double hardens : {0.0, 1.0}) {
                SCOPED_TRACE(::testing::Message() << beta << ' ' << depth << ' ' << hardens);
                Clay c = snow;
                c.beta = beta;
                c.hardens = hardens;
                shears<2>(c, depth);
                shears<3>(c, depth);
            }
}

/// In tension beta p0 is borne at first and, as alpha rises, nothing but the rest of p0 = 1e-5 K;
/// pressed again it bears next to nothing until what opened has closed.
TEST(CamClay, tension) {
    for (double beta : {0.0, 0.5, 2.0}) {
        Clay c = snow;
        c.beta = beta;
        Particle<3> p(c);
        const double d = 1e-4;
        double most = 0;
        for (int k = 0; k < 1000; ++k) {
            p.stretch({d, d, d});
            most = std::max(most, trace(p.tau) / 3);
        }
        EXPECT_LE(most, beta * c.p0() + 1e-12 * c.bulk());
        EXPECT_GE(most, beta * c.p0() * (1 - 3 * d / 0.02));
        EXPECT_NEAR(trace(p.tau) / 3, 1e-5 * beta * c.bulk(), 1e-12 * c.bulk());
        const double open = c.alpha + p.change();
        EXPECT_GT(open, 0.25);
        for (int k = 0; k < int(open / (3 * d)); ++k) {
            p.stretch({-d, -d, -d});
            ASSERT_LE(-trace(p.tau) / 3, 1.0001e-5 * c.bulk());
        }
        for (int k = 0; k < 200; ++k) p.stretch({-d, -d, -d});
        EXPECT_GT(-trace(p.tau) / 3, 1e-2 * c.bulk());
    }
}

/// A turn of everything in the middle of a path turns the stress and nothing else. Where the last
/// step softened a turn softens on, being a step more; pressed clay hardens.
template <int D>
void turns(const Clay& c, double size, double pressed) {
    test::Random random(37);
    for (int path = 0; path < 20; ++path) {
        Particle<D> still(c), turned(c);
        const auto turn = random.template rotation<D>();
        for (int step = 0; step < 40; ++step) {
            auto e = random.template matrix<D>(size);
            for (int a = 0; a < D; ++a) e(a, a) -= pressed * size;
            still.move(e);
            if (step == 20) {
                auto increment = turn;
                for (int a = 0; a < D; ++a) increment(a, a) -= 1;
                turned.move(increment);
            }
            turned.move(step < 20 ? e : product_transposed(product(turn, e), turn));
        }
        const auto expected = product_transposed(product(turn, still.tau), turn);
        ASSERT_LT(apart(turned.tau, widened(expected)), 1e-9 * c.young);
        ASSERT_NEAR(turned.flow(), still.flow(), 1e-9);
        ASSERT_NEAR(turned.change(), still.change(), 1e-9);
        ASSERT_GT(still.flow(), 0);
    }
}
TEST(CamClay, turns) {
    turns<2>(fixed_size, 5e-3, 0.5);
    turns<3>(fixed_size, 5e-3, 0.5);
    for (const Clay& c : {snow, loose, half}) {
        turns<2>(c, 2e-3, 1.5);
        turns<3>(c, 2e-3, 1.5);
    }
}

/// Single precision follows double, and strains of 1e-6 keep their digits.
template <int D>
void single(const Clay& c, double size, double bound) {
    test::Random random(47);
    for (int path = 0; path < 20; ++path) {
        Particle<D> wide(c);
        Particle<D, float> narrow(c);
        double most = 0, worst = 0;
        auto e = random.template matrix<D>(size);
        for (int step = 0; step < 60; ++step) {
            if (step % 12 == 0) e = random.template matrix<D>(size);
            wide.move(e);
            narrow.move(e);
            most = std::max(most, test::largest<D>(wide.tau));
            worst = std::max(worst, apart(narrow.tau, widened(wide.tau)));
        }
        ASSERT_LT(worst, bound * most) << "strain " << size << " path " << path;
        ASSERT_NEAR(narrow.flow(), wide.flow(), bound * (wide.flow() + size));
    }
}
TEST(CamClay, single_precision) {
    Clay weak = snow;
    weak.alpha = -1e-5;
    for (const Clay& c : {snow, fixed_size, half, weak})
        for (double size : {1e-6, 1e-4, 2e-3}) {
            single<2>(c, size, 1e-4);
            single<3>(c, size, 1e-4);
        }
}

/// Lanes that are elastic, crushed, torn and sheared side by side do what each does alone.
template <int D>
void lanes() {
    using V = Pack<float, 4>;
    test::Random random(53);
    const auto k = CamClay::constants<float>(snow.q().data());
    int crushed = 0, torn = 0, sheared = 0;
    for (int round = 0; round < 500; ++round) {
        std::vector<Particle<D, float>> alone(4, Particle<D, float>(snow));
        V packed[CamClay::reals<D>] = {};
        for (int step = 0; step < 3; ++step) {
            Mat<V, D> strain;
            for (int l = 0; l < 4; ++l) {
                auto e = random.template matrix<D>(l == 0 ? 1e-5 : 3e-2);
                for (int a = 0; a < D; ++a) e(a, a) += l == 1 ? -0.03 : l == 2 ? 0.03 : 0;
                alone[std::size_t(l)].move(e);
                for (int a = 0; a < D; ++a)
                    for (int s = 0; s < D; ++s) strain(a, s).raw[l] = float(e(a, s));
            }
            CamClay::respond<V, D, float>(packed, strain, k);
            for (int l = 0; l < 4; ++l)
                for (int r = 0; r < CamClay::reals<D>; ++r)
                    ASSERT_NEAR(packed[r][l], alone[std::size_t(l)].state[r], 2e-6) << l;
        }
        ASSERT_EQ(alone[0].flow(), 0);
        crushed += alone[1].gain() < 0;
        torn += alone[2].gain() > 0;
        sheared += alone[3].flow() > 0;
    }
    EXPECT_GT(std::min({crushed, torn, sheared}), 250);
}
TEST(CamClay, lanes) {
    lanes<2>();
    lanes<3>();
}

}  // namespace
}  // namespace mpm
