// Quadratic Powell-Sabin splines: what de Koster (2018), section 3.5, promises of them, on random
// triangulations (VAL-1 of the digest).
#include "mpm/triangular/powell_sabin.hpp"

#include <gtest/gtest.h>

#include "triangular/meshes.hpp"
#include "triangular/properties.hpp"

namespace mpm::triangular {
namespace {

using Hermite = std::function<std::pair<double, Point>(const Point&)>;

/// Coefficients of a field from its values and gradients: c = f(V) + grad f(V) . (Q - V).
Vector coefficients(const PowellSabin& basis, const Hermite& field) {
    Vector c(basis.functions());
    for (int v = 0; v < int(basis.mesh().vertices().size()); ++v) {
        const Point& at = basis.mesh().vertices()[std::size_t(v)];
        const auto [value, gradient] = field(at);
        for (int q = 0; q < 3; ++q)
            c[3 * v + q] = value + gradient.dot(basis.control(v)[std::size_t(q)] - at);
    }
    return c;
}

/// Value and gradient of a function's polynomial in a piece, from its ordinates.
std::pair<double, Point> polynomial(const PowellSabin& b, int cell, int function, int piece,
                                    const std::array<double, 3>& z) {
    const auto o = b.ordinates(cell, function, piece);
    const auto& g = b.split().gradients(cell, piece);
    const double d[3] = {o[0] * z[0] + o[3] * z[1] + o[5] * z[2],
                         o[3] * z[0] + o[1] * z[1] + o[4] * z[2],
                         o[5] * z[0] + o[4] * z[1] + o[2] * z[2]};
    return {d[0] * z[0] + d[1] * z[1] + d[2] * z[2], 2 * (d[0] * g[0] + d[1] * g[1] + d[2] * g[2])};
}

/// All functions' values and gradients in a piece, as the columns of a matrix.
Matrix all_of(const PowellSabin& b, int cell, int piece, const std::array<double, 3>& z) {
    Matrix out = Matrix::Zero(b.functions(), 3);
    for (int f = 0; f < 9; ++f) {
        const auto [value, gradient] = polynomial(b, cell, f, piece, z);
        out.row(b.on_cell(cell)[std::size_t(f)]) << value, gradient[0], gradient[1];
    }
    return out;
}

/// Largest jumps of value and gradient over all lines between pieces, and the largest gradient.
Eigen::Vector3d jumps(const PowellSabin& b) {
    Eigen::Vector3d worst = Eigen::Vector3d::Zero();
    const auto compare = [&](const Matrix& one, const Matrix& two) {
        worst[0] = std::max(worst[0], (one - two).col(0).cwiseAbs().maxCoeff());
        worst[1] = std::max(worst[1], (one - two).rightCols(2).cwiseAbs().maxCoeff());
        worst[2] = std::max(worst[2], one.rightCols(2).cwiseAbs().maxCoeff());
    };
    for (int t = 0; t < b.cells(); ++t)
        for (int p = 0; p < Split::pieces; ++p)
            for (double s : {0.0, 0.3, 0.7, 1.0}) {
                // Even pieces share the side from the edge point with the next, odd ones that from
                // the corner.
                const std::array<double, 3> z = {p % 2 ? s : 0, p % 2 ? 0 : s, 1 - s};
                compare(all_of(b, t, p, z), all_of(b, t, (p + 1) % Split::pieces, z));
            }
    for (const auto& e : b.mesh().edges()) {
        if (e.outer()) continue;
        for (int v : e.vertex) {
            int piece[2];
            for (std::size_t s = 0; s < 2; ++s) {
                const int k = e.sides[s].side;
                const auto& corners = b.mesh().triangles()[std::size_t(e.sides[s].triangle)];
                piece[s] = 2 * k + (corners[std::size_t(k)] == v ? 0 : 1);
            }
            for (double s : {0.0, 0.4, 1.0}) {
                const std::array<double, 3> z = {s, 1 - s, 0};
                compare(all_of(b, e.sides[0].triangle, piece[0], z),
                        all_of(b, e.sides[1].triangle, piece[1], z));
            }
        }
    }
    return worst;
}

TEST(PowellSabin, is_a_smooth_partition_of_unity) {
    for (unsigned seed : {1u, 2u, 3u}) {
        const PowellSabin b(turned(*perturbed(6, seed), 0.3 * seed));
        EXPECT_EQ(b.functions(), 108);
        const Worst w = worst_of(b, seed);
        EXPECT_LT(w.sum, 1e-12);
        EXPECT_LT(w.gradient_sum, 1e-11);
        EXPECT_LT(w.precision, 1e-12);
        EXPECT_LT(w.difference, 1e-7);
        EXPECT_GT(w.lowest, -1e-10);
        EXPECT_LT(w.area, 1e-12);
        EXPECT_FALSE(w.lost);
        double lowest = 0;
        for (int t = 0; t < b.cells(); ++t)
            for (int f = 0; f < 9; ++f)
                for (int p = 0; p < Split::pieces; ++p)
                    for (double o : b.ordinates(t, f, p)) lowest = std::min(lowest, o);
        EXPECT_GT(lowest, -1e-10);
        const auto worst = jumps(b);
        EXPECT_LT(worst[0], 1e-12);
        EXPECT_LT(worst[1], 1e-10);
        EXPECT_GT(worst[2], 1);  // the gradients that do not jump are there
    }
}

TEST(PowellSabin, reproduces_quadratics) {
    const PowellSabin b(perturbed(7, 5));
    const Hermite fields[] = {[](const Point& x) {
                                  return std::pair{x[0] * x[0], Point(2 * x[0], 0)};
                              },
                              [](const Point& x) {
                                  return std::pair{x[0] * x[1], Point(x[1], x[0])};
                              },
                              [](const Point& x) {
                                  return std::pair{x[1] * x[1], Point(0, 2 * x[1])};
                              }};
    test::Random random(9);
    for (const Hermite& f : fields) {
        const Vector c = coefficients(b, f);
        for (int t = 0; t < b.cells(); ++t)
            for (const auto& piece : b.pieces(t)) {
                const Point x = random_in(piece, random, 0.0);
                EXPECT_NEAR(Alive(b, t, x).of(c), f(x).first, 1e-11);
            }
    }
}

TEST(PowellSabin, triplets_are_values_and_gradients_at_the_vertices) {
    const PowellSabin b(perturbed(5, 4));
    for (int v = 0; v < int(b.mesh().vertices().size()); ++v) {
        const auto& corner = b.mesh().around(v).front();
        const Alive here(b, corner.triangle, b.mesh().vertices()[std::size_t(v)]);
        for (std::size_t f = 0; f < 9; ++f) {
            const int q = here.function[f] - 3 * v;
            const bool own = q >= 0 && q < 3;
            const Triplet t = own ? b.triplet(v)[std::size_t(q)] : Triplet{0, Point(0, 0)};
            EXPECT_NEAR(here.value[f], t.value, 1e-11);
            EXPECT_LT((here.gradient[f] - t.gradient).norm() * b.spacing(), 1e-10);
        }
    }
}

TEST(PowellSabin, takes_other_split_points) {
    const auto mesh = perturbed(5, 6);
    std::vector<Point> inner;
    for (int t = 0; t < int(mesh->triangles().size()); ++t) {
        const auto c = mesh->corners(t);
        inner.push_back((c[0] + c[1] + c[2]) / 3);
    }
    const PowellSabin b(mesh, inner);
    const Worst w = worst_of(b, 1);
    EXPECT_LT(w.sum, 1e-12);
    EXPECT_GT(w.lowest, -1e-10);
    EXPECT_LT(jumps(b)[1], 1e-10);

    std::vector<Point> outside = inner;
    outside[3] += Point(5, 0);
    EXPECT_NE(error_of([&] { PowellSabin bad(mesh, outside); }).find("triangle 3 lies outside"),
              std::string::npos);
    EXPECT_NE(error_of([&] { PowellSabin bad(mesh, {Point(0, 0)}); }).find("1 inner points for 32"),
              std::string::npos);
}

TEST(PowellSabin, sides_are_held_by_value_and_slope) {
    for (const auto& mesh : {perturbed(6, 8), blocks(3, 2, 3.0, 1.0), square(5, true)}) {
        const PowellSabin b(mesh);
        for (const Point& normal : {Point(-1, 0), Point(1, 0), Point(0, -1), Point(0, 1)}) {
            const Side side(b, normal);
            EXPECT_GT(side.slopes, 0);
            EXPECT_LT(side.constant, 1e-12);
            EXPECT_LT(side.left_over(3), 1e-12);
            EXPECT_TRUE(side.exact());
        }
    }
}

TEST(ControlTriangle, of_a_square_block) {
    // The corner of a regular mesh has a right triangle with a corner on it (figure 3.24), and
    // every vertex on a side two control points on that side.
    const PowellSabin b(blocks(2, 2, 1.0, 1.0));
    int pairs = 0;
    for (int v = 0; v < int(b.mesh().vertices().size()); ++v)
        for (Eigen::Index axis = 0; axis < 2; ++axis)
            for (double wall : {0.0, 1.0}) {
                if (std::abs(b.mesh().vertices()[std::size_t(v)][axis] - wall) > 1e-12) continue;
                int on = 0;
                for (const Point& q : b.control(v)) {
                    on += std::abs(q[axis] - wall) < 1e-9;
                    EXPECT_GT(q[axis], -1e-9);
                    EXPECT_LT(q[axis], 1 + 1e-9);
                }
                EXPECT_EQ(on, 2);
                ++pairs;
            }
    EXPECT_EQ(pairs, 12);
}

TEST(ControlTriangle, holds_its_points_and_is_small) {
    test::Random random(7);
    for (int n = 0; n < 200; ++n) {
        std::vector<Point> points;
        for (int k = random.integer(5, 12); k > 0; --k)
            points.emplace_back(random.between(0, 1), random.between(0, 1));
        const ControlTriangle t = control_triangle(points);
        Point low(1, 1), high(0, 0);
        for (const Point& p : points) {
            const auto b = barycentric(t, p);
            EXPECT_GT(std::min({b[0], b[1], b[2]}), -1e-8);
            low = low.cwiseMin(p);
            high = high.cwiseMax(p);
        }
        // A right triangle around the bounding box has twice its area; the smallest is no larger.
        EXPECT_LT(twice_area(t[0], t[1], t[2]) / 2, 2 * (high - low).prod() * (1 + 1e-9));
    }
}

}  // namespace
}  // namespace mpm::triangular
