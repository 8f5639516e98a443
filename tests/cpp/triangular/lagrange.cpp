// Lagrange polynomials on triangles, and why the orders above 1 are no choice for the method.
#include "mpm/triangular/lagrange.hpp"

#include <gtest/gtest.h>

#include "meshes.hpp"
#include "properties.hpp"

namespace mpm::triangular {
namespace {

TEST(Lagrange, sums_gradients_and_positions) {
    for (int order = 1; order <= Lagrange::highest; ++order) {
        for (const auto& mesh : {perturbed(4, 1), blocks(3, 1, 2.5, 0.4)}) {
            const Lagrange basis(mesh, order);
            const Worst w = worst_of(basis, unsigned(order));
            EXPECT_LT(w.sum, 1e-13) << order;
            EXPECT_LT(w.gradient_sum, 1e-12) << order;
            EXPECT_LT(w.precision, 1e-13) << order;
            EXPECT_LT(w.difference, 1e-6) << order;
            EXPECT_LT(w.area, 1e-14);
            EXPECT_FALSE(w.lost);
            if (order == 1) {
                EXPECT_GE(w.lowest, 0);
            } else {
                EXPECT_LT(w.lowest, -0.1) << order;
            }
        }
    }
}

TEST(Lagrange, nodes) {
    const auto mesh = perturbed(3, 2);
    const int v = 9, e = int(mesh->edges().size()), t = 8;
    for (int p = 1; p <= Lagrange::highest; ++p) {
        const Lagrange basis(mesh, p);
        EXPECT_EQ(basis.functions(), v + (p - 1) * e + (p - 1) * (p - 2) / 2 * t);
        const auto nodes = basis.control_points();
        for (int cell = 0; cell < basis.cells(); ++cell) {
            ASSERT_EQ(basis.on_cell(cell).size(), std::size_t((p + 1) * (p + 2) / 2));
            for (int node : basis.on_cell(cell)) {
                // Neighbours must agree on where a shared node lies.
                const Alive here(basis, cell, nodes[std::size_t(node)]);
                Vector expected = Vector::Zero(basis.functions());
                expected[node] = 1;
                EXPECT_LT((here.all(basis.functions()) - expected).lpNorm<Eigen::Infinity>(),
                          1e-12);
            }
        }
    }
    EXPECT_STREQ(Lagrange(mesh, 1).name(), "linear");
    EXPECT_STREQ(Lagrange(mesh, 2).name(), "Lagrange");
}

/// Across edges values agree and gradients do not, by as much as the functions' own slopes.
TEST(Lagrange, continuity) {
    const auto mesh = perturbed(4, 3);
    for (int p = 1; p <= Lagrange::highest; ++p) {
        const Lagrange basis(mesh, p);
        double value = 0, gradient = 0;
        for (const auto& e : mesh->edges()) {
            if (e.outer()) continue;
            const Point &a = mesh->vertices()[std::size_t(e.vertex[0])],
                        b = mesh->vertices()[std::size_t(e.vertex[1])];
            for (double part : {0.1, 0.37, 0.8}) {
                const Point x = a + part * (b - a);
                const Alive one(basis, e.sides[0].triangle, x), two(basis, e.sides[1].triangle, x);
                const int n = basis.functions();
                value = std::max(value, (one.all(n) - two.all(n)).lpNorm<Eigen::Infinity>());
                Matrix jump = Matrix::Zero(2, n);
                for (std::size_t i = 0; i < one.value.size(); ++i) {
                    jump.col(one.function[i]) += one.gradient[i];
                    jump.col(two.function[i]) -= two.gradient[i];
                }
                gradient = std::max(gradient, jump.lpNorm<Eigen::Infinity>());
            }
        }
        EXPECT_LT(value, 1e-13) << p;
        EXPECT_GT(gradient, 1 / mesh->shortest_edge()) << p;
    }
}

TEST(Lagrange, polynomials) {
    const auto mesh = perturbed(3, 4);
    for (int p = 1; p <= Lagrange::highest; ++p) {
        const Lagrange basis(mesh, p);
        const Field f = [p](const Point& x) {
            return std::pow(x[0] - 0.3, p) + 2 * std::pow(x[1], p - 1) * x[0] - x[1] + 0.5;
        };
        Vector c(basis.functions());
        for (int i = 0; i < basis.functions(); ++i)
            c[i] = f(basis.control_points()[std::size_t(i)]);
        double worst = 0;
        each_point(basis, 4, [&](int cell, const Point& x, double) {
            worst = std::max(worst, std::abs(Alive(basis, cell, x).of(c) - f(x)));
        });
        EXPECT_LT(worst, 1e-13) << p;
    }
}

TEST(Lagrange, order_one_is_barycentric) {
    const auto mesh = perturbed(4, 5);
    const Lagrange basis(mesh, 1);
    test::Random random(1);
    for (int t = 0; t < basis.cells(); ++t) {
        const auto c = mesh->corners(t);
        const Point x = random_in(c, random, 0);
        const auto b = barycentric(c, x);
        const auto g = barycentric_gradients(c);
        const Alive here(basis, t, x);
        for (std::size_t k = 0; k < 3; ++k) {
            EXPECT_EQ(here.function[k], mesh->triangles()[std::size_t(t)][k]);
            EXPECT_NEAR(here.value[k], b[k], 1e-14);
            EXPECT_EQ(here.gradient[k], g[k]);
        }
    }
}

/// VAL-3 of the digest.
TEST(Lagrange, projection_of_order_one) {
    const Field f = [](const Point& x) { return std::sin(M_PI * x[0]) * std::sin(M_PI * x[1]); };
    const double expected[] = {2.76813e-2, 6.59262e-3, 1.61785e-3};
    const int sizes[] = {5, 9, 17};
    for (int k = 0; k < 3; ++k)
        EXPECT_NEAR(project(Lagrange(square(sizes[k]), 1), f).error / expected[k], 1, 1e-4);
}

/// Functions of order 2 at the vertices have no mass at all, and reach -1/8.
TEST(Lagrange, order_two_has_no_positive_mass) {
    for (const auto& mesh : {square(4), perturbed(4, 6)}) {
        const Lagrange basis(mesh, 2);
        Vector mass = Vector::Zero(basis.functions());
        double lowest = 0;
        each_point(basis, 8, [&](int cell, const Point& x, double weight) {
            const Alive here(basis, cell, x);
            mass += weight * here.all(basis.functions());
            lowest = std::min(lowest, *std::min_element(here.value.begin(), here.value.end()));
        });
        const int vertices = int(mesh->vertices().size());
        EXPECT_LT(mass.head(vertices).lpNorm<Eigen::Infinity>(), 1e-16);
        EXPECT_GT(mass.tail(basis.functions() - vertices).minCoeff(), 1e-3);
        EXPECT_NEAR(mass.sum(), 1, 1e-14);
        EXPECT_NEAR(lowest, -0.125, 1e-3);
    }
}

TEST(Lagrange, sides) {
    const double angle = 0.7;
    const auto mesh = turned(*perturbed(4, 7), angle);
    for (int p = 1; p <= Lagrange::highest; ++p) {
        const Lagrange basis(mesh, p);
        EXPECT_EQ(basis.outline().size(), 12u);
        for (int quarter = 0; quarter < 4; ++quarter) {
            const double a = angle + quarter * M_PI / 2;
            const Side side(basis, Point(std::cos(a), std::sin(a)));
            EXPECT_EQ(side.given.rows(), 3 * (p + 1));
            EXPECT_LT(side.constant, 1e-12);
            EXPECT_LT(side.left_over(unsigned(p)), 1e-12);
            EXPECT_TRUE(side.exact()) << p;
        }
    }
}

TEST(Lagrange, errors) {
    EXPECT_EQ(error_of([] { Lagrange(square(2), 0); }), "Lagrange basis: order 0; expected 1 to 5");
    EXPECT_EQ(error_of([] { Lagrange(square(2), 6); }), "Lagrange basis: order 6; expected 1 to 5");
}

}  // namespace
}  // namespace mpm::triangular
