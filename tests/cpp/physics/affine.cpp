// Affine transfers against the plain sums that define them, and what they conserve.
#include "mpm/physics/transfer/affine.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "mpm/core/number.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

template <int D>
struct Lattice {  // one stencil, last axis fastest
    static void coordinates(int node, int (&k)[D]) {
        for (int a = D - 1; a >= 0; --a) {
            k[a] = node % 3;
            node /= 3;
        }
    }
};

/// Nodes of 2^D cells, and the lines that `gather` reads of them.
template <class T, int D, int C>
struct Patch {
    static constexpr int edge = 4, cells = 2;
    static constexpr int nodes = D == 2 ? edge * edge : edge * edge * edge;
    T value[nodes][C];

    static constexpr int stride(int axis) { return axis == D - 1 ? 1 : edge * stride(axis + 1); }
    /// Node 0 .. 3^D - 1 of the stencil of a cell.
    static int place(const int (&cell)[D], int node) {
        int k[D], at = 0;
        Lattice<D>::coordinates(node, k);
        for (int a = 0; a < D; ++a) at += (cell[a] + k[a]) * stride(a);
        return at;
    }
};

template <class T, int D, int C>
struct Lines {
    using From = Patch<T, D, C>;
    T at[From::nodes / From::edge][From::cells][3][C];

    explicit Lines(const From& from) {
        for (int line = 0; line < From::nodes / From::edge; ++line)
            for (int cell = 0; cell < From::cells; ++cell)
                for (int c = 0; c < C; ++c) {
                    const auto& u = from.value;
                    const int n = line * From::edge + cell;
                    T q[3];
                    expand_line(u[n][c], u[n + 1][c], u[n + 2][c], q);
                    for (int k = 0; k < 3; ++k) at[line][cell][k][c] = q[k];
                }
    }
    static constexpr int stride(int axis) {
        const int cell = 3 * C, line = From::cells * cell;
        return axis == D - 1 ? cell : (axis == D - 2 ? line : From::edge * line);
    }
    static int origin(const int (&cell)[D]) {
        int n = 0;
        for (int a = 0; a < D; ++a) n += cell[a] * stride(a);
        return n;
    }
    template <int N>
    Line<T, N> load(int place) const {
        Line<T, N> line;
        for (int k = 0; k < 3; ++k)
            for (int c = 0; c < N; ++c) line.q[k][c] = (&at[0][0][0][0])[place + k * C + c];
        return line;
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

    /// Calls check(xi, w, cell, patch, gathered) for random places in random fields.
    template <class Fill, class Check>
    void gather_of(const Fill& fill, const Check& check) {
        for (int round = 0; round < 300; ++round) {
            const auto xi = position();
            const auto w = quadratic_weights<T, D>(xi);
            int cell[D];
            for (int& c : cell) c = random.integer(0, 1);
            Patch<T, D, C> patch;
            fill(patch, cell, xi);
            const Lines<T, D, C> lines(patch);
            check(xi, w, cell, patch, gather<C, T, D>(lines, w, lines.origin(cell)));
            if (::testing::Test::HasFatalFailure()) return;
        }
    }
    void draw(Patch<T, D, C>& patch) {
        for (auto& node : patch.value)
            for (T& v : node) v = T(random.between(-1, 1));
    }
    Affine<T, D, C> drawn() {
        Affine<T, D, C> q;
        for (int c = 0; c < C; ++c) {
            q.value[c] = T(random.between(-1, 1));
            for (int a = 0; a < D; ++a) q.slope[a][c] = T(random.between(-1, 1));
        }
        return q;
    }

    void gather_is_its_definition() {
        gather_of([&](auto& patch, auto&, auto&) { draw(patch); },
                  [&](auto& xi, auto& w, auto& cell, auto& patch, auto u) {
                      for (int c = 0; c < C; ++c) {
                          double value = 0, moment[D] = {};
                          for (int n = 0; n < stencil_nodes<D>; ++n) {
                              const double v = patch.value[patch.place(cell, n)][c];
                              value += weight(w, n) * v;
                              for (int a = 0; a < D; ++a)
                                  moment[a] += weight(w, n) * v * distance(xi, n, a);
                          }
                          ASSERT_NEAR(u.value[c], value, eps);
                          for (int a = 0; a < D; ++a)
                              ASSERT_NEAR(u.slope[a][c], 4 * moment[a], eps) << "axis " << a;
                      }
                  });
    }

    /// What moves as one does not deform: a few roundings of the value are all that is left.
    void uniform_fields() {
        gather_of(
            [&](auto& patch, auto&, auto&) {
                for (auto& node : patch.value)
                    for (int c = 0; c < C; ++c) node[c] = T(1000 + c);
            },
            [&](auto&, auto&, auto&, auto&, auto u) {
                for (int c = 0; c < C; ++c) {
                    ASSERT_NEAR(u.value[c], 1000 + c, 1000 * eps / 16);
                    for (int a = 0; a < D; ++a) ASSERT_NEAR(u.slope[a][c], 0, 1000 * eps / 8);
                }
            });
    }

    void scatter_is_its_definition() {
        for (int round = 0; round < 300; ++round) {
            const auto xi = position();
            const auto w = quadratic_weights<T, D>(xi);
            const auto q = drawn();
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

    /// The loop over lines does what the straight code does.
    void rolled_scatter() {
        for (int round = 0; round < 300; ++round) {
            const auto w = quadratic_weights<T, D>(position());
            const auto q = drawn();
            const T unit = T(round % 2);
            Sums<T, D, C> straight, rolled;
            scatter<T, D, C>(straight, w, unit, q);
            scatter<T, D, C, true>(rolled, w, unit, q);
            for (int n = 0; n < stencil_nodes<D>; ++n) {
                ASSERT_NEAR(rolled.mass[n], straight.mass[n], eps / 8 * straight.mass[n]);
                for (int c = 0; c < C; ++c) {
                    // Shares of the node's mass: what cancels in a channel is of its size.
                    ASSERT_NEAR(rolled.value[n][c], straight.value[n][c],
                                eps / 2 * straight.mass[n]);
                }
            }
        }
    }

    /// Node by node: what a lane adds that owns one.
    void single_nodes() {
        for (int round = 0; round < 300; ++round) {
            const auto w = quadratic_weights<T, D>(position());
            const auto q = drawn();
            Sums<T, D, C> sums;
            scatter<T, D, C>(sums, w, T(1), q);
            const Deposit<T, D, C> d = deposit_of(w, q);
            for (int n = 0; n < stencil_nodes<D>; ++n) {
                T value[C];
                const T share = deposit_at(d, n, value);
                ASSERT_NEAR(share, sums.mass[n], eps / 8 * sums.mass[n]);
                for (int c = 0; c < C; ++c)
                    ASSERT_NEAR(share * value[c], sums.value[n][c], eps / 2 * sums.mass[n]);
            }
        }
    }

    /// A field that is linear over the stencil: gathered exactly, scattered back exactly.
    void linear_fields() {
        double level[C], tilt[C][D];
        const auto field = [&](auto& xi, int n, int c) {
            double v = level[c];
            for (int a = 0; a < D; ++a) v += tilt[c][a] * distance(xi, n, a);
            return v;
        };
        gather_of(
            [&](auto& patch, auto& cell, auto& xi) {
                draw(patch);
                for (int c = 0; c < C; ++c) {
                    level[c] = random.between(-1, 1);
                    for (double& t : tilt[c]) t = random.between(-1, 1);
                    for (int n = 0; n < stencil_nodes<D>; ++n)
                        patch.value[patch.place(cell, n)][c] = T(field(xi, n, c));
                }
            },
            [&](auto& xi, auto& w, auto&, auto&, auto u) {
                for (int c = 0; c < C; ++c) {
                    ASSERT_NEAR(u.value[c], level[c], eps);
                    for (int a = 0; a < D; ++a) ASSERT_NEAR(u.slope[a][c], tilt[c][a], 4 * eps);
                }
                Sums<T, D, C> sums;
                scatter<T, D, C>(sums, w, T(1), u);
                for (int n = 0; n < stencil_nodes<D>; ++n)
                    for (int c = 0; c < C; ++c) {
                        ASSERT_NEAR(sums.value[n][c], double(sums.mass[n]) * field(xi, n, c),
                                    4 * eps);
                    }
            });
    }

    /// scatter after gather: mass 1, the gathered momentum, and the angular momentum of the nodal
    /// field about the particle: what the affine part keeps.
    void conservation() {
        gather_of([&](auto& patch, auto&, auto&) { draw(patch); },
                  [&](auto& xi, auto& w, auto& cell, auto& patch, auto u) {
                      double before[D][D] = {}, after[D][D] = {}, momentum[C] = {}, mass = 0;
                      Sums<T, D, C> sums;
                      scatter<T, D, C>(sums, w, T(1), u);
                      for (int n = 0; n < stencil_nodes<D>; ++n) {
                          const auto& node = patch.value[patch.place(cell, n)];
                          mass += sums.mass[n];
                          for (int c = 0; c < C; ++c) momentum[c] += sums.value[n][c];
                          for (int a = 0; a < D; ++a)
                              for (int c = 0; c < D; ++c) {
                                  before[a][c] += weight(w, n) * distance(xi, n, a) * node[c];
                                  after[a][c] += distance(xi, n, a) * double(sums.value[n][c]);
                              }
                      }
                      ASSERT_NEAR(mass, 1, eps);
                      for (int c = 0; c < C; ++c) ASSERT_NEAR(momentum[c], u.value[c], eps);
                      for (int a = 0; a < D; ++a)
                          for (int c = 0; c < a; ++c) {
                              ASSERT_NEAR(after[a][c] - after[c][a], before[a][c] - before[c][a],
                                          eps);
                          }
                  });
    }

    void all() {
        gather_is_its_definition();
        uniform_fields();
        scatter_is_its_definition();
        rolled_scatter();
        single_nodes();
        linear_fields();
        conservation();
    }
};

TEST(Affine, float_2d) { Transfer<float, 2>().all(); }
TEST(Affine, float_3d) { Transfer<float, 3>().all(); }
TEST(Affine, double_2d) { Transfer<double, 2>().all(); }
TEST(Affine, double_3d) { Transfer<double, 3>().all(); }

TEST(Affine, a_line_in_coefficients) {
    double q[3];
    expand_line(1.0, 1.0, 1.0, q);  // constant
    EXPECT_EQ(q[0], 1);
    EXPECT_EQ(q[1], 0);
    EXPECT_EQ(q[2], 0);
    expand_line(-1.0, 0.0, 1.0, q);  // the node's number
    EXPECT_EQ(q[0], 0);
    EXPECT_EQ(q[1], 1);
    EXPECT_EQ(q[2], 0);
    expand_line(1.0, 0.0, 1.0, q);  // its square, which splines see with their own variance
    EXPECT_EQ(q[0], 0.25);
    EXPECT_EQ(q[1], 0);
    EXPECT_EQ(q[2], 1);
}

}  // namespace
}  // namespace mpm
