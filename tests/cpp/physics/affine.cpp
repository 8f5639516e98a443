// Affine transfers against the plain sums that define them, and what they conserve.
#include "mpm/physics/transfer/affine.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "mpm/core/number.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

template <int D>
struct Lattice {  // one stencil, last axis fastest
    static constexpr int stride(int axis) { return axis == D - 1 ? 1 : 3 * stride(axis + 1); }
    static void coordinates(int node, int (&k)[D]) {
        for (int a = D - 1; a >= 0; --a) {
            k[a] = node % 3;
            node /= 3;
        }
    }
};

template <class T, int D, int C>
struct Nodes {
    T value[stencil_nodes<D>][C];
    static constexpr int stride(int axis) { return Lattice<D>::stride(axis); }
    template <int N>
    Vec<T, N> load(int node) const {
        Vec<T, N> v;
        for (int c = 0; c < N; ++c) v[c] = value[node][c];
        return v;
    }
};

template <class T, int D, int C>
struct Sums {
    T value[stencil_nodes<D>][C] = {};
    T mass[stencil_nodes<D>] = {};
    void add(int node, int channel, T v) { value[node][channel] += v; }
    void add_mass(int node, T v) { mass[node] += v; }
};

template <class T, int D>
class Transfer {
public:
    static constexpr int C = D + 1;
    static constexpr double eps = 64 * std::numeric_limits<T>::epsilon();
    test::Random random{5};

    Vec<T, D> position() {
        Vec<T, D> xi;
        for (int a = 0; a < D; ++a) xi[a] = T(random.between(-0.5, 0.5));
        return xi;
    }
    double weight(const Weights<T, D>& w, int node) {
        int k[D];
        Lattice<D>::coordinates(node, k);
        double n = 1;
        for (int a = 0; a < D; ++a) n *= double(w.value[a][k[a]]);
        return n;
    }
    double distance(const Vec<T, D>& xi, int node, int axis) {
        int k[D];
        Lattice<D>::coordinates(node, k);
        return k[axis] - 1 - double(xi[axis]);
    }

    void gather_is_its_definition() {
        for (int round = 0; round < 300; ++round) {
            const auto xi = position();
            const auto w = quadratic_weights<T, D>(xi);
            Nodes<T, D, C> nodes;
            for (auto& node : nodes.value)
                for (T& v : node) v = T(random.between(-1, 1));
            const auto u = gather<C, T, D>(nodes, w, 0);
            for (int c = 0; c < C; ++c) {
                double value = 0, slope[D] = {};
                for (int n = 0; n < stencil_nodes<D>; ++n) {
                    value += weight(w, n) * nodes.value[n][c];
                    for (int a = 0; a < D; ++a) {
                        slope[a] += weight(w, n) * nodes.value[n][c] * distance(xi, n, a);
                    }
                }
                ASSERT_NEAR(u.value[c], value, eps);
                for (int a = 0; a < D; ++a) ASSERT_NEAR(u.slope[a][c], slope[a], eps);
            }
        }
    }

    void scatter_is_its_definition() {
        for (int round = 0; round < 300; ++round) {
            const auto xi = position();
            const auto w = quadratic_weights<T, D>(xi);
            Affine<T, D, C> q;
            for (int c = 0; c < C; ++c) {
                q.value[c] = T(random.between(-1, 1));
                for (int a = 0; a < D; ++a) q.slope[a][c] = T(random.between(-1, 1));
            }
            Sums<T, D, C> sums, absent;
            scatter<T, D, C>(sums, w, T(1), q);
            scatter<T, D, C>(absent, w, T(0), q);
            for (int n = 0; n < stencil_nodes<D>; ++n) {
                ASSERT_NEAR(sums.mass[n], weight(w, n), eps);
                ASSERT_EQ(absent.mass[n], T(0));
                for (int c = 0; c < C; ++c) {
                    double v = q.value[c];
                    for (int a = 0; a < D; ++a) v += q.slope[a][c] * distance(xi, n, a);
                    ASSERT_NEAR(sums.value[n][c], weight(w, n) * v, eps);
                    ASSERT_EQ(absent.value[n][c], T(0));
                }
            }
        }
    }

    /// A field that is linear over the stencil: gathered exactly, scattered back exactly.
    void linear_fields() {
        for (int round = 0; round < 300; ++round) {
            const auto xi = position();
            const auto w = quadratic_weights<T, D>(xi);
            double level[C], tilt[C][D];
            for (int c = 0; c < C; ++c) {
                level[c] = random.between(-1, 1);
                for (double& t : tilt[c]) t = random.between(-1, 1);
            }
            Nodes<T, D, C> nodes;
            const auto field = [&](int n, int c) {
                double v = level[c];
                for (int a = 0; a < D; ++a) v += tilt[c][a] * distance(xi, n, a);
                return v;
            };
            for (int n = 0; n < stencil_nodes<D>; ++n)
                for (int c = 0; c < C; ++c) nodes.value[n][c] = T(field(n, c));
            auto u = gather<C, T, D>(nodes, w, 0);
            for (int c = 0; c < C; ++c) {
                ASSERT_NEAR(u.value[c], level[c], eps);
                for (int a = 0; a < D; ++a) {
                    u.slope[a][c] *= T(quadratic_inverse_moment);
                    ASSERT_NEAR(u.slope[a][c], tilt[c][a], 4 * eps);
                }
            }
            Sums<T, D, C> sums;
            scatter<T, D, C>(sums, w, T(1), u);
            for (int n = 0; n < stencil_nodes<D>; ++n)
                for (int c = 0; c < C; ++c) {
                    ASSERT_NEAR(sums.value[n][c], double(sums.mass[n]) * field(n, c), 4 * eps);
                }
        }
    }

    /// scatter after gather: mass 1, the gathered momentum, and the angular momentum of the nodal
    /// field about the particle: what the affine part keeps.
    void conservation() {
        for (int round = 0; round < 300; ++round) {
            const auto xi = position();
            const auto w = quadratic_weights<T, D>(xi);
            Nodes<T, D, C> nodes;
            for (auto& node : nodes.value)
                for (T& v : node) v = T(random.between(-1, 1));
            auto u = gather<C, T, D>(nodes, w, 0);
            double before[D][D] = {}, after[D][D] = {}, momentum[C] = {}, mass = 0;
            for (int n = 0; n < stencil_nodes<D>; ++n)
                for (int a = 0; a < D; ++a)
                    for (int c = 0; c < D; ++c) {
                        before[a][c] += weight(w, n) * distance(xi, n, a) * nodes.value[n][c];
                    }
            for (auto& axis : u.slope)
                for (T& s : axis) s *= T(quadratic_inverse_moment);
            Sums<T, D, C> sums;
            scatter<T, D, C>(sums, w, T(1), u);
            for (int n = 0; n < stencil_nodes<D>; ++n) {
                mass += sums.mass[n];
                for (int c = 0; c < C; ++c) momentum[c] += sums.value[n][c];
                for (int a = 0; a < D; ++a)
                    for (int c = 0; c < D; ++c) {
                        after[a][c] += distance(xi, n, a) * double(sums.value[n][c]);
                    }
            }
            ASSERT_NEAR(mass, 1, eps);
            for (int c = 0; c < C; ++c) ASSERT_NEAR(momentum[c], u.value[c], eps);
            for (int a = 0; a < D; ++a)
                for (int c = 0; c < a; ++c) {
                    ASSERT_NEAR(after[a][c] - after[c][a], before[a][c] - before[c][a], eps);
                }
        }
    }

    void all() {
        gather_is_its_definition();
        scatter_is_its_definition();
        linear_fields();
        conservation();
    }
};

TEST(Affine, float_2d) { Transfer<float, 2>().all(); }
TEST(Affine, float_3d) { Transfer<float, 3>().all(); }
TEST(Affine, double_2d) { Transfer<double, 2>().all(); }
TEST(Affine, double_3d) { Transfer<double, 3>().all(); }

}  // namespace
}  // namespace mpm
