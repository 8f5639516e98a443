// Functions of particles that are parallelepipeds (CPDI) and gradients of the dual domain (DDMP):
// what they reproduce, what they are means of, and where they must not jump.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "mpm/physics/shape/dual_domain.hpp"
#include "mpm/physics/shape/parallelepiped.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

template <int D>
using Key = std::array<int, D>;

/// Weight and gradient of each node, by its numbers along the axes.
template <int D>
struct Functions {
    std::map<Key<D>, std::array<double, D + 1>> of;

    template <class Node>
    void add(const Node& node, double w, const std::array<double, D>& gradient) {
        Key<D> key;
        for (int a = 0; a < D; ++a) key[std::size_t(a)] = node[a];
        auto& to = of[key];
        to[0] += w;
        for (int a = 0; a < D; ++a) to[std::size_t(a) + 1] += gradient[std::size_t(a)];
    }
    /// Sums over the nodes of f(place) times the weight and the gradient.
    template <class F>
    std::array<double, D + 1> seen(const F& f) const {
        std::array<double, D + 1> out{};
        for (const auto& [key, w] : of) {
            std::array<double, D> place;
            for (std::size_t a = 0; a < D; ++a) place[a] = key[a] - 2.0;
            for (std::size_t k = 0; k <= D; ++k) out[k] += w[k] * f(place);
        }
        return out;
    }
    double at(const Key<D>& key, std::size_t k) const {
        const auto found = of.find(key);
        return found == of.end() ? 0 : found->second[k];
    }
};

/// One, and linear functions of the place, are reproduced with their gradients.
template <int D>
void expect_linear(const Functions<D>& w, const Vec<double, D>& x) {
    const auto one = w.seen([](const auto&) { return 1.0; });
    EXPECT_NEAR(one[0], 1, 1e-13);
    for (std::size_t a = 0; a < D; ++a) {
        EXPECT_NEAR(one[a + 1], 0, 1e-12);
        const auto line = w.seen([&](const auto& place) { return place[a]; });
        EXPECT_NEAR(line[0], x[int(a)], 1e-13);
        for (std::size_t b = 0; b < D; ++b) EXPECT_NEAR(line[b + 1], a == b ? 1 : 0, 1e-12);
    }
}

template <int D>
Functions<D> functions(const CornerStencil<double, D>& s) {
    Functions<D> out;
    s.for_each([&](const CornerNode<D>& node, double w) {
        std::array<double, D> g;
        for (int a = 0; a < D; ++a) g[std::size_t(a)] = s.gradient(node, w, a);
        out.add(node, w, g);
    });
    return out;
}
template <int D>
Functions<D> functions(const DualStencil<double, D>& s) {
    Functions<D> out;
    s.for_each_around([&](const DualNode<D>& node) {
        double w = 1;
        std::array<double, D> g;
        for (int a = 0; a < D; ++a) {
            w *= s.weight[a][node[a]];
            g[std::size_t(a)] = s.gradients[node.number][a];
        }
        out.add(node, w, g);
    });
    return out;
}

template <int D>
CornerStencil<double, D> corners_of(const Vec<double, D>& xi, const Mat<double, D>& edges) {
    CornerStencil<double, D> s;
    s.find(xi, edges);
    return s;
}
template <int D>
Mat<double, D> random_edges(test::Random& random) {
    return half_edges_of(0.25, random.matrix<D>(0.5));
}
template <int D>
Vec<double, D> random_offset(test::Random& random) {
    Vec<double, D> xi;
    for (double& e : xi.e) e = random.between(-0.5, 0.5);
    return xi;
}

template <int D>
void corners_reproduce_linear_fields() {
    test::Random random(3);
    for (int k = 0; k < 200; ++k) {
        const auto xi = random_offset<D>(random);
        const auto s = corners_of<D>(xi, random_edges<D>(random));
        expect_linear(functions(s), xi);
        // By first moments too.
        for (int a = 0; a < D; ++a) {
            double slope[D] = {};
            s.for_each([&](const CornerNode<D>& node, double w) {
                for (int b = 0; b < D; ++b) slope[b] += s.lever(node, w, b) * (node[a] - 2.0);
            });
            for (int b = 0; b < D; ++b) EXPECT_NEAR(slope[b], a == b ? 1 : 0, 1e-11);
        }
    }
}
TEST(Corners, reproduce_linear_fields) {
    corners_reproduce_linear_fields<2>();
    corners_reproduce_linear_fields<3>();
}

/// Gradients are means over the particle: what flows out of a field's sides, by the trapezoidal
/// rule between corners.
TEST(Corners, have_the_gradients_of_the_divergence_theorem) {
    test::Random random(5);
    for (int k = 0; k < 50; ++k) {
        const auto xi = random_offset<2>(random);
        const Mat<double, 2> e = random_edges<2>(random);
        const auto field = [](double x, double y) { return std::sin(x) + x * y - 0.3 * y * y; };
        // The grid's linear interpolation of the field at a point.
        const auto grid = [&](double x, double y) {
            const double i = std::floor(x), j = std::floor(y), s = x - i, t = y - j;
            return (1 - s) * ((1 - t) * field(i, j) + t * field(i, j + 1)) +
                   s * ((1 - t) * field(i + 1, j) + t * field(i + 1, j + 1));
        };
        const int turn[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
        double x[4], y[4], area = 0, out[2] = {}, mean = 0;
        for (int m = 0; m < 4; ++m) {
            x[m] = xi[0] + e.e[0][0] * turn[m][0] + e.e[0][1] * turn[m][1];
            y[m] = xi[1] + e.e[1][0] * turn[m][0] + e.e[1][1] * turn[m][1];
            mean += grid(x[m], y[m]) / 4;
        }
        for (int m = 0; m < 4; ++m) {
            const int n = (m + 1) % 4;
            area += 0.5 * (x[m] * y[n] - x[n] * y[m]);
            const double u = 0.5 * (grid(x[m], y[m]) + grid(x[n], y[n]));
            out[0] += u * (y[n] - y[m]);
            out[1] -= u * (x[n] - x[m]);
        }
        const auto seen =
            functions(corners_of<2>(xi, e)).seen([&](const auto& p) { return field(p[0], p[1]); });
        EXPECT_NEAR(seen[0], mean, 1e-13);
        EXPECT_NEAR(seen[1], out[0] / area, 1e-11);
        EXPECT_NEAR(seen[2], out[1] / area, 1e-11);
    }
}

/// A body of sheared particles fills space without gaps: a uniform stress pushes no node inside it.
/// Boxes along the axes (cpGIMP) overlap and leave gaps.
TEST(Corners, of_neighbours_meet) {
    const Mat<double, 2> f = {{{1.1, 0.45}, {-0.2, 0.9}}};
    Mat<double, 2> h = f;
    for (int a = 0; a < 2; ++a) h.e[a][a] -= 1;
    KernelChoice boxes;
    boxes.kernel = Kernel::cpgimp;
    std::map<Key<2>, std::array<double, 2>> force, of_boxes;
    for (int i = -16; i < 16; ++i) {
        for (int j = -16; j < 16; ++j) {
            const double X[2] = {0.5 * i + 0.25, 0.5 * j + 0.25};
            Vec<double, 2> xi, half;
            int cell[2];
            std::int64_t far[2];
            for (int a = 0; a < 2; ++a) {
                const double x = f.e[a][0] * X[0] + f.e[a][1] * X[1];
                cell[a] = int(std::floor(x + 0.5));
                far[a] = cell[a] + 100;
                xi[a] = x - cell[a];
                half[a] = 0.25 * f.e[a][a];
            }
            const auto s = corners_of<2>(xi, half_edges_of(0.25, h));
            s.for_each([&](const CornerNode<2>& node, double w) {
                auto& to = force[{cell[0] + node[0], cell[1] + node[1]}];
                for (int a = 0; a < 2; ++a) to[std::size_t(a)] += s.gradient(node, w, a);
            });
            const auto box = stencil_of<5>(boxes, xi, half, far);
            for (int m = 0; m < 25; ++m) {
                auto& to = of_boxes[{cell[0] + m / 5, cell[1] + m % 5}];
                to[0] += box.slope[0][m / 5] * box.weight[1][m % 5];
                to[1] += box.weight[0][m / 5] * box.slope[1][m % 5];
            }
        }
    }
    double largest = 0;
    for (int i = -1; i <= 5; ++i) {
        for (int j = -1; j <= 5; ++j) {
            for (double x : force.at({i, j})) EXPECT_NEAR(x, 0, 1e-12);
            for (double x : of_boxes.at({i, j})) largest = std::max(largest, std::abs(x));
        }
    }
    EXPECT_GT(largest, 0.01) << "boxes are no match for shear";
}

/// A particle that is no larger than a point is one of the linear functions.
TEST(Corners, are_linear_functions_where_a_particle_is_small) {
    test::Random random(6);
    for (int k = 0; k < 50; ++k) {
        const auto xi = random_offset<3>(random);
        const auto s = corners_of<3>(xi, half_edges_of(1e-7, Mat<double, 3>{}));
        for (const auto& [key, w] : functions(s).of) {
            double expected = 1;
            for (std::size_t a = 0; a < 3; ++a)
                expected *= std::max(0.0, 1 - std::abs(key[a] - 2 - xi[int(a)]));
            EXPECT_NEAR(w[0], expected, 1e-6);
        }
    }
}

template <int D>
DualStencil<double, D> dual_of(const Vec<double, D>& xi) {
    const std::int64_t cell[3] = {20, 20, 20};
    std::int64_t in_domain[D];
    for (int a = 0; a < D; ++a) in_domain[a] = cell[a];
    KernelChoice choice;
    choice.kernel = Kernel::ddmp;
    choice.gradient = GradientForm::shapes;
    DualStencil<double, D> s;
    static_cast<Stencil<double, D, 5>&>(s) = stencil_of<5>(choice, xi, Vec<double, D>{}, in_domain);
    s.find(xi);
    return s;
}
const auto everywhere = [](const auto&) { return true; };

template <int D>
void duals_reproduce_linear_fields() {
    test::Random random(7);
    for (int k = 0; k < 100; ++k) {
        const auto xi = random_offset<D>(random);
        auto s = dual_of<D>(xi);
        s.find_gradients(everywhere);
        expect_linear(functions(s), xi);
        // Where mass ends too, as long as the particle's own span has some.
        const int end = random.integer(0, 1);
        auto cut = dual_of<D>(xi);
        cut.find_gradients([&](const DualNode<D>& n) {
            bool held = true;
            for (int a = 0; a < D; ++a) {
                const int at = n[a] - cut.first[a];
                held = held && at >= (a == 0 ? end : 0) && at <= (a == 1 ? 2 : 3);
            }
            return held;
        });
        const auto w = functions(cut);
        expect_linear(w, xi);
        for (const auto& [key, value] : w.of) {
            if (key[1] <= cut.first[1] + 2) continue;
            for (std::size_t a = 1; a <= D; ++a) EXPECT_EQ(value[a], 0) << "no mass, yet pushed";
        }
    }
}
TEST(DualDomain, reproduces_linear_fields) {
    duals_reproduce_linear_fields<2>();
    duals_reproduce_linear_fields<3>();
}

/// Gradients by quadrature, where all nodes around have mass and where only some have.
template <int D>
void gradients_are_the_integrals() {
    test::Random random(8);
    for (int k = 0; k < 100; ++k) {
        const auto xi = random_offset<D>(random);
        auto found = dual_of<D>(xi);
        std::map<Key<D>, bool> empty;  // never a node of the particle's own span
        found.for_each_around([&](const DualNode<D>& n) {
            bool own = true;
            Key<D> key;
            for (int a = 0; a < D; ++a) {
                key[std::size_t(a)] = n[a];
                own = own && (n[a] - found.first[a] == 1 || n[a] - found.first[a] == 2);
            }
            empty[key] = !own && k % 2 == 1 && random.integer(0, 4) == 0;
        });
        found.find_gradients([&](const DualNode<D>& n) {
            Key<D> key;
            for (int a = 0; a < D; ++a) key[std::size_t(a)] = n[a];
            return !empty.at(key);
        });
        // By quadrature: two points an axis are exact for N_j times a slope or another N.
        const auto span = dual_of<D>(xi);
        const double g = 0.5 / std::sqrt(3.0);
        const double part = span.alpha();
        Functions<D> expected;
        span.for_each_around([&](const DualNode<D>& i) {
            std::array<double, D> sum{};
            for (int j = 0; j < (1 << D); ++j) {
                double weight = 1;
                int at[D];
                for (int a = 0; a < D; ++a) {
                    at[a] = span.first[a] + 1 + (j >> a & 1);
                    weight *= span.weight[a][at[a]];
                }
                std::vector<int> spans;
                for (int e = 0; e < (1 << D); ++e) {
                    bool held = true;
                    for (int c = 0; c < (1 << D); ++c) {
                        Key<D> key;
                        for (int a = 0; a < D; ++a)
                            key[std::size_t(a)] = at[a] - 1 + (e >> a & 1) + (c >> a & 1);
                        held = held && !empty.at(key);
                    }
                    if (held) spans.push_back(e);
                }
                for (int e : spans) {
                    for (int q = 0; q < (1 << D); ++q) {
                        double n_j = 1, n_i[D], slope[D];
                        for (int a = 0; a < D; ++a) {
                            const double low = at[a] - 1 + (e >> a & 1),
                                         x = low + 0.5 + (q >> a & 1 ? g : -g), r = x - i[a];
                            n_j *= 1 - std::abs(x - at[a]);
                            n_i[a] = std::max(0.0, 1 - std::abs(r));
                            slope[a] = n_i[a] > 0 ? (r < 0 ? 1 : -1) : 0;
                        }
                        for (int a = 0; a < D; ++a) {
                            double grad = slope[a];
                            for (int b = 0; b < D; ++b)
                                if (b != a) grad *= n_i[b];
                            sum[std::size_t(a)] += weight * n_j * grad / double(spans.size());
                        }
                    }
                }
            }
            for (int a = 0; a < D; ++a) {
                double own = span.slope[a][i[a]];
                for (int b = 0; b < D; ++b)
                    if (b != a) own *= span.weight[b][i[b]];
                sum[std::size_t(a)] = part * own + (1 - part) * sum[std::size_t(a)];
            }
            expected.add(i, 0, sum);
        });
        for (const auto& [key, w] : functions(found).of)
            for (std::size_t a = 1; a <= D; ++a) EXPECT_NEAR(w[a], expected.at(key, a), 1e-13);
    }
}
TEST(DualDomain, gradients_are_the_integrals) {
    gradients_are_the_integrals<2>();
    gradients_are_the_integrals<3>();
}

/// Gradients of linear functions jump between spans, these do not.
template <int D>
void gradients_do_not_jump() {
    test::Random random(9);
    for (int k = 0; k < 50; ++k) {
        auto below = random_offset<D>(random), above = below;
        below[0] = -1e-9;
        above[0] = 1e-9;
        auto a = dual_of<D>(below), b = dual_of<D>(above);
        ASSERT_NE(a.first[0], b.first[0]);
        a.find_gradients(everywhere);
        b.find_gradients(everywhere);
        const auto left = functions(a), right = functions(b);
        for (const auto* all : {&left, &right})
            for (const auto& [key, w] : all->of)
                for (std::size_t c = 0; c <= D; ++c)
                    EXPECT_NEAR(left.at(key, c), right.at(key, c), 1e-7);
    }
}
TEST(DualDomain, gradients_do_not_jump_between_spans) {
    gradients_do_not_jump<2>();
    gradients_do_not_jump<3>();
}

}  // namespace
}  // namespace mpm
