// Forces of elements against differences of their energy, what rigid motions leave, and the patch
// test.
#include "mpm/physics/element.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <vector>

#include "mpm/physics/material/drucker_prager.hpp"
#include "mpm/physics/material/fixed_corotated.hpp"
#include "mpm/physics/material/linear_elastic.hpp"
#include "mpm/physics/material/neo_hookean.hpp"
#include "mpm/physics/material/st_venant_kirchhoff_hencky.hpp"
#include "mpm/physics/material/von_mises.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

static_assert(hyperelastic<FixedCorotated> && hyperelastic<NeoHookean> &&
              hyperelastic<StVenantKirchhoffHencky>);
// Small strain is the derivative of no energy of F, and flow has a memory.
static_assert(!hyperelastic<LinearElastic> && !hyperelastic<VonMises>);
static_assert(!for_elements<LinearElastic> && for_elements<VonMises> &&
              for_elements<DruckerPrager> && !flows<NeoHookean>);
static_assert(for_vertex_volumes<VonMises> && !for_vertex_volumes<DruckerPrager>);

const double parameters[] = {1000.0, 1e6, 0.3};

/// One element: vertices at rest and now, by columns.
template <int D>
struct Simplex {
    double rest[D + 1][D], now[D + 1][D];

    Mat<double, D> edges(const double (&x)[D + 1][D]) const {
        Mat<double, D> m;
        for (int k = 0; k < D; ++k)
            for (int a = 0; a < D; ++a) m.e[a][k] = x[k + 1][a] - x[0][a];
        return m;
    }
    ElementAtRest<D> at_rest() const { return ElementAtRest<D>(edges(rest)); }
    template <class T>
    Mat<T, D> gradient() const {
        Mat<T, D> moved, inverse;
        const auto r = at_rest();
        const auto s = edges(now), m = edges(rest);
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) {
                moved.e[a][b] = T(s.e[a][b] - m.e[a][b]);
                inverse.e[a][b] = T(r.inverse.e[a][b]);
            }
        return element_gradient(moved, inverse);
    }
};

template <int D>
Simplex<D> random_simplex(test::Random& random) {
    Simplex<D> s;
    while (true) {
        for (auto& x : s.rest)
            for (double& c : x) c = random.between(-0.5, 0.5);
        const double volume = s.at_rest().volume;
        if (volume > 0.02) break;
    }
    while (true) {
        const auto turn = random.rotation<D>();
        const auto stretch = random.matrix<D>(0.4);
        for (int k = 0; k <= D; ++k)
            for (int a = 0; a < D; ++a) {
                s.now[k][a] = 3;
                for (int b = 0; b < D; ++b)
                    for (int c = 0; c < D; ++c)
                        s.now[k][a] +=
                            turn.e[a][b] * ((b == c ? 1.0 : 0.0) + stretch.e[b][c]) * s.rest[k][c];
            }
        const double ratio = 1 + volume_change(s.template gradient<double>());
        if (ratio > 0.3) return s;
    }
}

template <class Material, int D>
double energy_of(const Simplex<D>& s) {
    const auto k = Material::template constants<double>(parameters);
    double state[Material::template reals<D>];
    state_at<Material>(state, s.template gradient<double>(), k);
    const double still[D][D] = {};
    return s.at_rest().volume *
           Material::template observe<D>(state, still, parameters).elastic_energy;
}
/// By vertex, the first one too.
template <class Material, int D>
std::vector<double> forces_of(const Simplex<D>& s) {
    const auto k = Material::template constants<double>(parameters);
    const auto h = s.template gradient<double>();
    const auto rest = s.at_rest();
    const Mat<double, D> pull = element_pull(kirchhoff_at<Material>(h, k), h, rest.inverse);
    std::vector<double> f((D + 1) * D, 0.0);
    for (int n = 0; n < D; ++n)
        for (int a = 0; a < D; ++a) {
            f[std::size_t((n + 1) * D + a)] = -rest.volume * pull.e[a][n];
            f[std::size_t(a)] += rest.volume * pull.e[a][n];
        }
    return f;
}

template <class Material>
class ElementLaws : public ::testing::Test {};
using Laws = ::testing::Types<FixedCorotated, NeoHookean, StVenantKirchhoffHencky>;
TYPED_TEST_SUITE(ElementLaws, Laws);

template <class Material, int D>
void check_forces() {
    test::Random random(5);
    for (int round = 0; round < 1000; ++round) {
        Simplex<D> s = random_simplex<D>(random);
        const auto f = forces_of<Material>(s);
        double size = 0;
        for (double x : f) size = std::max(size, std::abs(x));
        for (int k = 0; k <= D; ++k)
            for (int a = 0; a < D; ++a) {
                const double x = s.now[k][a], step = 2e-4;
                // Two differences: what is left is of the fourth order.
                double slope[2];
                for (int half = 0; half < 2; ++half) {
                    const double e = step / (1 + half);
                    s.now[k][a] = x + e;
                    const double up = energy_of<Material>(s);
                    s.now[k][a] = x - e;
                    slope[half] = (up - energy_of<Material>(s)) / (2 * e);
                }
                s.now[k][a] = x;
                const double expected = -(4 * slope[1] - slope[0]) / 3;
                ASSERT_NEAR(f[std::size_t(k * D + a)], expected, 1e-6 * size) << round;
            }
    }
}
TYPED_TEST(ElementLaws, forces_are_differences_of_energy_2d) { check_forces<TypeParam, 2>(); }
TYPED_TEST(ElementLaws, forces_are_differences_of_energy_3d) { check_forces<TypeParam, 3>(); }

/// With two vertices exchanged the volume is below zero, and the forces would have the other sign.
TYPED_TEST(ElementLaws, say_which_order_of_vertices_is_wrong) {
    test::Random random(6);
    Simplex<3> s = random_simplex<3>(random);
    for (int a = 0; a < 3; ++a) {
        std::swap(s.rest[1][a], s.rest[2][a]);
        std::swap(s.now[1][a], s.now[2][a]);
    }
    EXPECT_LT(s.at_rest().volume, 0);
    // F does not know: forces times a volume of the right sign are right again.
    const auto wrong = forces_of<TypeParam>(s);
    for (int a = 0; a < 3; ++a) {
        std::swap(s.rest[1][a], s.rest[2][a]);
        std::swap(s.now[1][a], s.now[2][a]);
    }
    const auto right = forces_of<TypeParam>(s);
    double size = 0;
    for (double x : right) size = std::max(size, std::abs(x));
    for (int a = 0; a < 3; ++a)
        EXPECT_NEAR(wrong[std::size_t(a)], -right[std::size_t(a)], 1e-9 * size);
}

template <class Material, int D>
void check_sums() {
    test::Random random(8);
    for (int round = 0; round < 300; ++round) {
        const Simplex<D> s = random_simplex<D>(random);
        const auto f = forces_of<Material>(s);
        double size = 0, sum[D] = {}, torque[3] = {};
        for (int k = 0; k <= D; ++k) {
            for (int a = 0; a < D; ++a) {
                sum[a] += f[std::size_t(k * D + a)];
                size = std::max(size, std::abs(f[std::size_t(k * D + a)]));
            }
            for (int a = 0; a < D; ++a)
                for (int b = 0; b < a; ++b)
                    torque[D == 2 ? 2 : 3 - a - b] += s.now[k][b] * f[std::size_t(k * D + a)] -
                                                      s.now[k][a] * f[std::size_t(k * D + b)];
        }
        for (double x : sum) EXPECT_NEAR(x, 0, 1e-13 * size);
        for (double x : torque) EXPECT_NEAR(x, 0, 1e-12 * size);
    }
}
TYPED_TEST(ElementLaws, forces_have_no_sum_and_no_torque) {
    check_sums<TypeParam, 2>();
    check_sums<TypeParam, 3>();
}

/// Strains of 1e-6 of an element that has turned by any angle survive single precision.
TYPED_TEST(ElementLaws, small_strains_survive_single_precision) {
    Mat<float, 3> h{};
    h.e[0][0] = 1e-6f;
    const auto tau = kirchhoff_at<TypeParam>(h, TypeParam::template constants<float>(parameters));
    const double mu = 1e6 / 2.6, lambda = 1e6 * 0.3 / (1.3 * 0.4);
    EXPECT_NEAR(tau.e[0][0], 1e-6 * (2 * mu + lambda), 1e-5);
    EXPECT_NEAR(tau.e[1][1], 1e-6 * lambda, 1e-5);
    EXPECT_FLOAT_EQ(volume_change(h), 1e-6f);
}

template <class Material>
void check_volume_part() {
    const auto k = Material::template constants<double>(parameters);
    for (double change : {-0.6, -0.1, -1e-7, 1e-3, 0.5, 3.0}) {
        const double e = 1e-5 * (1 + change);
        const double slope =
            (Material::volume_energy(change + e, k) - Material::volume_energy(change - e, k)) /
            (2 * e);
        // What the difference leaves is of the second order in its step, 1e-10 of lambda.
        EXPECT_NEAR(Material::volume_pressure(change, k), slope, 1e-9 * 5.8e5);
    }
    // It is a part of the law's own stress: without shear stiffness nothing else is left.
    const double soft[] = {1000.0, 3e-3, 0.5 - 1e-9};
    const auto fluid = Material::template constants<double>(soft);
    Mat<double, 3> h{};
    h.e[0][0] = 0.2;
    h.e[1][1] = -0.1;
    h.e[0][1] = 0.05;
    const double change = volume_change(h);
    const auto tau = kirchhoff_at<Material>(h, fluid);
    const double expected = (1 + change) * Material::volume_pressure(change, fluid);
    EXPECT_NEAR(tau.e[0][0], expected, 1e-6 * std::abs(expected));
    EXPECT_NEAR(tau.e[2][2], expected, 1e-6 * std::abs(expected));
}
TYPED_TEST(ElementLaws, pressure_is_the_slope_of_the_volumetric_energy) {
    check_volume_part<TypeParam>();
}

/// A square of triangles with moved inner vertices, alone: energies and forces of the whole.
struct Patch {
    int n;
    std::vector<double> rest, now;
    std::vector<int> element;
    Patch(int edge, double irregular) : n(edge) {
        test::Random random(3);
        for (int j = 0; j <= n; ++j)
            for (int i = 0; i <= n; ++i) {
                const bool inside = i > 0 && j > 0 && i < n && j < n;
                for (int x : {i, j})
                    rest.push_back((x + (inside ? random.between(-irregular, irregular) : 0.0)) /
                                   n);
            }
        const auto at = [&](int i, int j) { return j * (n + 1) + i; };
        for (int j = 0; j < n; ++j)
            for (int i = 0; i < n; ++i) {
                for (int v : {at(i, j), at(i + 1, j), at(i + 1, j + 1)}) element.push_back(v);
                for (int v : {at(i, j), at(i + 1, j + 1), at(i, j + 1)}) element.push_back(v);
            }
        now = rest;
    }
    std::size_t elements() const { return element.size() / 3; }
    Simplex<2> simplex(std::size_t e) const {
        Simplex<2> s;
        for (int k = 0; k < 3; ++k)
            for (int a = 0; a < 2; ++a) {
                const std::size_t at = std::size_t(element[3 * e + std::size_t(k)] * 2 + a);
                s.rest[k][a] = rest[at];
                s.now[k][a] = now[at];
            }
        return s;
    }
    /// J_a - 1 and V_a of vertices.
    void volumes(std::vector<double>& change, std::vector<double>& volume) const {
        change.assign(rest.size() / 2, 0.0);
        volume = change;
        for (std::size_t e = 0; e < elements(); ++e) {
            const auto s = simplex(e);
            const double v = s.at_rest().volume / 3;
            for (int k = 0; k < 3; ++k) {
                const auto a = std::size_t(element[3 * e + std::size_t(k)]);
                change[a] += v * volume_change(s.gradient<double>());
                volume[a] += v;
            }
        }
        for (std::size_t a = 0; a < change.size(); ++a) change[a] /= volume[a];
    }
    template <class Material>
    double energy(bool of_vertices) const {
        const auto k = Material::template constants<double>(parameters);
        const double part = 1 - own_volume_share;
        double sum = 0;
        for (std::size_t e = 0; e < elements(); ++e) {
            const auto s = simplex(e);
            sum += energy_of<Material>(s);
            if (of_vertices)
                sum -= part * s.at_rest().volume *
                       Material::volume_energy(volume_change(s.gradient<double>()), k);
        }
        if (!of_vertices) return sum;
        std::vector<double> change, volume;
        volumes(change, volume);
        for (std::size_t a = 0; a < change.size(); ++a)
            sum += part * volume[a] * Material::volume_energy(change[a], k);
        return sum;
    }
    template <class Material>
    std::vector<double> forces(bool of_vertices) const {
        const auto k = Material::template constants<double>(parameters);
        std::vector<double> f(rest.size(), 0.0), change, volume;
        if (of_vertices) volumes(change, volume);
        for (std::size_t e = 0; e < elements(); ++e) {
            const auto s = simplex(e);
            const auto h = s.gradient<double>();
            const auto r = s.at_rest();
            auto tau = kirchhoff_at<Material>(h, k);
            if (of_vertices) {
                double p = 0;
                for (int c = 0; c < 3; ++c)
                    p += Material::volume_pressure(
                             change[std::size_t(element[3 * e + std::size_t(c)])], k) /
                         3;
                take_vertex_pressure<Material>(tau, volume_change(h), p, k);
            }
            const auto pull = element_pull(tau, h, r.inverse);
            for (int c = 0; c < 2; ++c)
                for (int a = 0; a < 2; ++a) {
                    const auto to = std::size_t(element[3 * e + std::size_t(c) + 1] * 2 + a),
                               from = std::size_t(element[3 * e] * 2 + a);
                    f[to] -= r.volume * pull.e[a][c];
                    f[from] += r.volume * pull.e[a][c];
                }
        }
        return f;
    }
};

TYPED_TEST(ElementLaws, linear_displacement_leaves_inner_vertices_alone) {
    for (bool of_vertices : {false, true}) {
        Patch patch(5, 0.3);
        for (std::size_t v = 0; v < patch.now.size(); v += 2) {
            const double x = patch.rest[v], y = patch.rest[v + 1];
            patch.now[v] = 0.1 + 0.9 * x - 0.4 * y;
            patch.now[v + 1] = 0.3 + 0.5 * x + 1.05 * y;
        }
        const auto f = patch.forces<TypeParam>(of_vertices);
        double size = 0;
        for (double x : f) size = std::max(size, std::abs(x));
        for (int j = 1; j < patch.n; ++j)
            for (int i = 1; i < patch.n; ++i)
                for (int a = 0; a < 2; ++a)
                    EXPECT_NEAR(f[std::size_t((j * (patch.n + 1) + i) * 2 + a)], 0, 1e-12 * size);
    }
}

TYPED_TEST(ElementLaws, volumes_of_vertices_have_an_energy) {
    test::Random random(12);
    Patch patch(3, 0.2);
    for (double& x : patch.now) x += random.between(-0.03, 0.03);
    const auto f = patch.forces<TypeParam>(true), own = patch.forces<TypeParam>(false);
    double size = 0, different = 0;
    for (double x : f) size = std::max(size, std::abs(x));
    for (std::size_t v = 0; v < patch.now.size(); ++v) {
        const double x = patch.now[v], e = 1e-6;
        patch.now[v] = x + e;
        const double up = patch.energy<TypeParam>(true);
        patch.now[v] = x - e;
        const double slope = (up - patch.energy<TypeParam>(true)) / (2 * e);
        patch.now[v] = x;
        EXPECT_NEAR(f[v], -slope, 1e-6 * size);
        different = std::max(different, std::abs(f[v] - own[v]));
    }
    EXPECT_GT(different, 0.01 * size);
}

/// A path of deformations, as a particle takes it by steps and an element by its places alone.
template <class Law, int D>
void check_path(const double* numbers, double step, double mean) {
    test::Random random(7);
    const auto k = Law::template constants<double>(numbers);
    constexpr int n = kept_reals<Law, D>;
    double particle[n] = {}, element[n] = {};
    Mat<double, D> f{};
    for (int a = 0; a < D; ++a) f.e[a][a] = 1;
    int flowed = 0;
    for (int at = 0; at < 300; ++at) {
        Mat<double, D> strain;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b)
                strain.e[a][b] = random.between(-step, step) + (a == b ? mean : 0);
        Mat<double, D> next = product(strain, f);
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) next.e[a][b] += f.e[a][b];
        f = next;
        Mat<double, D> h = f;
        for (int a = 0; a < D; ++a) h.e[a][a] -= 1;
        double before[n];
        std::copy(element, element + n, before);
        bool fine = false;
        const Mat<double, D> one = Law::template respond<double, D, double>(particle, strain, k),
                             two = flow_to<Law>(element, h, k, fine);
        ASSERT_TRUE(fine) << at;
        flowed += !std::equal(element, element + n, before);
        double size = 0;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) size = std::max(size, std::abs(one.e[a][b]));
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b)
                ASSERT_NEAR(one.e[a][b], two.e[a][b], 1e-9 * size + 1e-6) << at;
        // Of what is no strain both keep the same.
        for (int r = D == 2 ? 3 : 6; r < n; ++r) ASSERT_NEAR(particle[r], element[r], 1e-9) << at;
    }
    EXPECT_GT(flowed, 50);
    EXPECT_LT(flowed, 300);
}

TEST(FlowingElements, see_what_a_particle_of_the_same_path_sees) {
    const double metal[] = {1000.0, 1e6, 0.3, 1e4, 1e5};
    check_path<VonMises, 2>(metal, 1e-2, 0);
    check_path<VonMises, 3>(metal, 1e-2, 0);
    const double sand[] = {1600.0, 1e6, 0.3, 30.0, 500.0, 5.0, 200.0, 0.5};
    check_path<DruckerPrager, 2>(sand, 8e-3, -2e-4);
    check_path<DruckerPrager, 3>(sand, 8e-3, -2e-4);
}

TEST(FlowingElements, keep_nothing_below_yield) {
    const double metal[] = {1000.0, 1e6, 0.3, 1e9, 0.0};
    const auto k = VonMises::constants<double>(metal);
    double kept[kept_reals<VonMises, 3>] = {};
    Mat<double, 3> h{};
    h.e[0][1] = 0.3;
    h.e[2][2] = -0.2;
    bool fine = false;
    const auto tau = flow_to<VonMises>(kept, h, k, fine);
    EXPECT_TRUE(fine);
    for (const double x : kept) EXPECT_EQ(x, 0);
    const auto hencky =
        kirchhoff_at<StVenantKirchhoffHencky>(h, StVenantKirchhoffHencky::constants<double>(metal));
    for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) EXPECT_NEAR(tau.e[a][b], hencky.e[a][b], 1e-9);
}

TEST(FlowingElements, turned_after_flow_have_turned_stress) {
    const double metal[] = {1000.0, 1e6, 0.3, 1e4, 1e5};
    const auto k = VonMises::constants<double>(metal);
    double kept[kept_reals<VonMises, 2>] = {};
    Mat<double, 2> h{};
    h.e[0][0] = 0.08;
    bool fine = false;
    const auto before = flow_to<VonMises>(kept, h, k, fine);
    const double c = std::cos(1.1), s = std::sin(1.1);
    Mat<double, 2> turn{}, f = h;
    turn.e[0][0] = turn.e[1][1] = c;
    turn.e[1][0] = s;
    turn.e[0][1] = -s;
    for (int a = 0; a < 2; ++a) f.e[a][a] += 1;
    Mat<double, 2> turned = product(turn, f);
    for (int a = 0; a < 2; ++a) turned.e[a][a] -= 1;
    const auto after = flow_to<VonMises>(kept, turned, k, fine);
    const auto expected = product_transposed(product(turn, before), turn);
    for (int a = 0; a < 2; ++a)
        for (int b = 0; b < 2; ++b) EXPECT_NEAR(after.e[a][b], expected.e[a][b], 1e-6);
}

/// Numerical damping: across and along as Yang has it, nothing of what only turns, the same in a
/// frame that is turned, and never a gain of energy.
TEST(DampedElements, by_their_rate_of_strain_alone) {
    const ElementDamping<double> k{3.0, 2.0};
    const double dt = 1e-3;
    const auto damped = [&](const Mat<double, 3>& h, const Mat<double, 3>& moved) {
        Mat<double, 3> tau{};
        add_damping(tau, h, moved, volume_change(h), k, dt);
        return tau;
    };
    Mat<double, 3> none{}, stretch{}, shear{};
    stretch.e[0][0] = 1e-4;
    shear.e[0][1] = 1e-4;
    EXPECT_NEAR(damped(none, stretch).e[0][0], k.normal * 0.1, 1e-15);
    EXPECT_NEAR(damped(none, shear).e[0][1], k.shear * 0.5 * 0.1, 1e-15);
    EXPECT_NEAR(damped(none, shear).e[1][0], k.shear * 0.5 * 0.1, 1e-15);

    test::Random random(7);
    for (int trial = 0; trial < 50; ++trial) {
        Mat<double, 3> h{}, rate{}, skew{};
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) {
                h.e[a][b] = 0.2 * random.between(-1, 1);
                rate.e[a][b] = random.between(-1, 1);
            }
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) skew.e[a][b] = rate.e[a][b] - rate.e[b][a];
        Mat<double, 3> f = h;
        for (int a = 0; a < 3; ++a) f.e[a][a] += 1;
        const auto turning = damped(h, product(skew, f));
        const auto moved = product(rate, f);
        const auto tau = damped(h, moved);
        double work = 0;
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) {
                EXPECT_NEAR(turning.e[a][b], 0, 1e-10);
                work += tau.e[a][b] * rate.e[a][b];
            }
        EXPECT_GT(work, 0);
        const double c = std::cos(0.7), n = std::sin(0.7);
        Mat<double, 3> turn{};
        turn.e[0][0] = turn.e[1][1] = c;
        turn.e[1][0] = n;
        turn.e[0][1] = -n;
        turn.e[2][2] = 1;
        Mat<double, 3> turned = product(turn, f);
        for (int a = 0; a < 3; ++a) turned.e[a][a] -= 1;
        const auto after = damped(turned, product(turn, moved));
        const auto expected = product_transposed(product(turn, tau), turn);
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b)
                EXPECT_NEAR(after.e[a][b], expected.e[a][b], 1e-9 * k.normal / dt);
    }
}

}  // namespace
}  // namespace mpm
