// Cubic Powell-Sabin splines: VAL-14 of the digest, and an evaluation of their own ordinates that
// shares nothing with the one of the library.
#include "mpm/triangular/cubic_powell_sabin.hpp"

#include <gtest/gtest.h>

#include "meshes.hpp"
#include "properties.hpp"

namespace mpm::triangular {
namespace {

const Field sines = [](const Point& x) { return std::sin(M_PI * x[0]) * std::sin(M_PI * x[1]); };

/// A square with three vertices inside: 7 vertices, 8 triangles, 4 outer edges.
std::shared_ptr<const Mesh> small() {
    const std::vector<Point> vertices = {{0, 0},       {1, 0},       {1, 1},      {0, 1},
                                         {0.31, 0.27}, {0.72, 0.41}, {0.44, 0.76}};
    return std::make_shared<const Mesh>(vertices, std::vector<std::array<int, 3>>{{0, 1, 4},
                                                                                  {1, 5, 4},
                                                                                  {1, 2, 5},
                                                                                  {2, 6, 5},
                                                                                  {2, 3, 6},
                                                                                  {3, 4, 6},
                                                                                  {3, 0, 4},
                                                                                  {4, 5, 6}});
}
std::vector<std::shared_ptr<const Mesh>> meshes() {
    return {small(),         square(3),
            square(4, true), blocks(3, 2, 2.5, 0.7),
            perturbed(5, 1), turned(*perturbed(4, 2), 0.7)};
}

/// Values and gradients of all functions by de Casteljau's scheme on the polynomials of a piece,
/// also on its sides and outside of it.
struct Polynomials {
    Vector value;
    Matrix gradient;

    Polynomials(const CubicPowellSabin& basis, int cell, int piece, const Point& x)
        : value(Vector::Zero(basis.functions())), gradient(Matrix::Zero(2, basis.functions())) {
        const auto corners = basis.split().piece(cell, piece);
        const auto at = barycentric(corners, x);
        const auto slope = barycentric_gradients(corners);
        const auto ordinates = basis.ordinates(cell, piece);
        for (std::size_t f = 0; f < basis.on_cell(cell).size(); ++f) {
            const auto row = ordinates.row(Eigen::Index(f));
            // By how often each corner appears in the place's name: [of B][of C].
            const double net[4][4] = {{row[0], row[8], row[7], row[2]},
                                      {row[3], row[9], row[6], 0},
                                      {row[4], row[5], 0, 0},
                                      {row[1], 0, 0, 0}};
            double level[4][4];
            std::copy(&net[0][0], &net[0][0] + 16, &level[0][0]);
            for (int size = 3; size > 1; --size)
                for (int b = 0; b < size; ++b)
                    for (int c = 0; b + c < size; ++c)
                        level[b][c] =
                            at[0] * level[b][c] + at[1] * level[b + 1][c] + at[2] * level[b][c + 1];
            const int i = basis.on_cell(cell)[f];
            const double plane[3] = {level[0][0], level[1][0], level[0][1]};
            for (std::size_t k = 0; k < 3; ++k) {
                value[i] += at[k] * plane[k];
                gradient.col(i) += 3 * plane[k] * slope[k];
            }
        }
    }
};

TEST(CubicPowellSabin, sums_gradients_and_positions) {
    for (const auto& mesh : meshes()) {
        const CubicPowellSabin basis(mesh);
        int outer = 0;
        for (const auto& e : mesh->edges()) outer += e.outer();
        EXPECT_EQ(basis.functions(),
                  3 * int(mesh->vertices().size()) + 6 * int(mesh->triangles().size()) + 2 * outer);
        const Worst w = worst_of(basis, 1);
        EXPECT_LT(w.sum, 2e-13);
        EXPECT_LT(w.gradient_sum, 1e-11);
        EXPECT_LT(w.precision, 2e-13);
        EXPECT_LT(w.difference, 1e-7);
        EXPECT_GT(w.lowest, -1e-12);
        EXPECT_LT(w.area, 1e-13);
        EXPECT_FALSE(w.lost);
        double lowest = 1;
        for (int t = 0; t < basis.cells(); ++t) {
            auto alive = basis.on_cell(t);
            ASSERT_EQ(int(alive.size()), CubicPowellSabin::on_triangle);
            std::sort(alive.begin(), alive.end());
            EXPECT_EQ(std::unique(alive.begin(), alive.end()), alive.end());
            for (int p = 0; p < Split::pieces; ++p)
                lowest = std::min(lowest, basis.ordinates(t, p).minCoeff());
        }
        EXPECT_GT(lowest, -1e-10);
    }
}

TEST(CubicPowellSabin, evaluation) {
    test::Random random(5);
    for (const auto& mesh : meshes()) {
        const CubicPowellSabin basis(mesh);
        for (int t = 0; t < basis.cells(); ++t) {
            for (int p = 0; p < Split::pieces; ++p) {
                const Point x = random_in(basis.pieces(t)[std::size_t(p)], random, 0.01);
                const Polynomials expected(basis, t, p, x);
                const Alive here(basis, t, x);
                Matrix gradient = Matrix::Zero(2, basis.functions());
                for (std::size_t i = 0; i < here.value.size(); ++i)
                    gradient.col(here.function[i]) += here.gradient[i];
                const double size = expected.gradient.lpNorm<Eigen::Infinity>();
                EXPECT_LT((here.all(basis.functions()) - expected.value).lpNorm<Eigen::Infinity>(),
                          1e-12);
                EXPECT_LT((gradient - expected.gradient).lpNorm<Eigen::Infinity>(), 1e-12 * size);
            }
        }
    }
}

/// Largest jumps of all functions between two pieces along their common side; of the gradient as a
/// part of the largest one.
struct Jump {
    double value = 0, gradient = 0;
    void add(const CubicPowellSabin& basis, std::array<int, 2> one, std::array<int, 2> two,
             const Point& from, const Point& to) {
        for (double part : {0.0, 0.2, 0.5, 0.9, 1.0}) {
            const Point x = from + part * (to - from);
            const Polynomials a(basis, one[0], one[1], x), b(basis, two[0], two[1], x);
            value = std::max(value, (a.value - b.value).lpNorm<Eigen::Infinity>());
            gradient = std::max(gradient, (a.gradient - b.gradient).lpNorm<Eigen::Infinity>() /
                                              a.gradient.lpNorm<Eigen::Infinity>());
        }
    }
};

TEST(CubicPowellSabin, smooth) {
    for (const auto& mesh : meshes()) {
        const CubicPowellSabin basis(mesh);
        Jump inside, between;
        for (int t = 0; t < basis.cells(); ++t) {
            for (int p = 0; p < Split::pieces; ++p) {
                const int next = (p + 1) % Split::pieces;
                const auto corners = basis.split().piece(t, p);
                // Piece 2k meets the next along R Z, piece 2k + 1 along V Z.
                inside.add(basis, {t, p}, {t, next}, corners[p % 2 == 0 ? 1 : 0], corners[2]);
            }
        }
        for (const auto& e : mesh->edges()) {
            if (e.outer()) continue;
            for (int h = 0; h < 2; ++h) {
                const int one = 2 * e.sides[0].side + h, two = 2 * e.sides[1].side + 1 - h;
                const auto corners = basis.split().piece(e.sides[0].triangle, one);
                between.add(basis, {e.sides[0].triangle, one}, {e.sides[1].triangle, two},
                            corners[0], corners[1]);
            }
        }
        EXPECT_LT(std::max(inside.value, between.value), 1e-12);
        EXPECT_LT(inside.gradient, 1e-11);
        EXPECT_LT(between.gradient, 1e-11);
    }
}

/// Piecewise cubics in the monomials of each piece, less what continuity of value and gradient at
/// four points of each common side takes from them.
TEST(CubicPowellSabin, dimension) {
    const auto mesh = small();
    const CubicPowellSabin basis(mesh);
    const Split& split = basis.split();
    const int unknowns = basis.cells() * Split::pieces * 10;
    std::vector<Vector> rows;
    const auto glue = [&](int t, int p, int u, int q, const Point& from, const Point& to) {
        for (int n = 0; n < 4; ++n) {
            const Point x = from + n / 3.0 * (to - from);
            for (int kind = 0; kind < 3; ++kind) {
                Vector row = Vector::Zero(unknowns);
                double sign = 1;
                for (int piece : {t * Split::pieces + p, u * Split::pieces + q}) {
                    const auto c = split.piece(piece / Split::pieces, piece % Split::pieces);
                    const Point y = 4 * (x - (c[0] + c[1] + c[2]) / 3);
                    for (int i = 0, at = piece * 10; i <= 3; ++i) {
                        for (int j = 0; i + j <= 3; ++j, ++at) {
                            const double value =
                                kind == 0 ? std::pow(y[0], i) * std::pow(y[1], j)
                                : kind == 1
                                    ? (i > 0 ? i * std::pow(y[0], i - 1) : 0) * std::pow(y[1], j)
                                    : std::pow(y[0], i) * (j > 0 ? j * std::pow(y[1], j - 1) : 0);
                            row[at] = sign * value;
                        }
                    }
                    sign = -1;
                }
                rows.push_back(std::move(row));
            }
        }
    };
    for (int t = 0; t < basis.cells(); ++t) {
        for (int p = 0; p < Split::pieces; ++p) {
            const auto c = split.piece(t, p);
            glue(t, p, t, (p + 1) % Split::pieces, c[p % 2 == 0 ? 1 : 0], c[2]);
        }
    }
    for (const auto& e : mesh->edges()) {
        if (e.outer()) continue;
        for (int h = 0; h < 2; ++h) {
            const int p = 2 * e.sides[0].side + h, q = 2 * e.sides[1].side + 1 - h;
            const auto c = split.piece(e.sides[0].triangle, p);
            glue(e.sides[0].triangle, p, e.sides[1].triangle, q, c[0], c[1]);
        }
    }
    Matrix conditions(Eigen::Index(rows.size()), unknowns);
    for (std::size_t r = 0; r < rows.size(); ++r) conditions.row(Eigen::Index(r)) = rows[r];
    EXPECT_EQ(unknowns - Side::rank(conditions), 77);
    EXPECT_EQ(basis.functions(), 77);

    // As many functions as the space has dimensions, and independent.
    Matrix mass = Matrix::Zero(77, 77);
    each_point(basis, 4, [&](int cell, const Point& x, double weight) {
        const Vector all = Alive(basis, cell, x).all(77);
        mass += weight * all * all.transpose();
    });
    const Vector diagonal = mass.diagonal().cwiseSqrt().cwiseInverse();
    const Matrix scaled = diagonal.asDiagonal() * mass * diagonal.asDiagonal();
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<Matrix>(scaled).eigenvalues()[0], 1e-4);
}

TEST(CubicPowellSabin, cubics) {
    const Field cubic = [](const Point& x) {
        return std::pow(x[0], 3) - 2 * x[0] * x[0] * x[1] + std::pow(x[1], 3) - x[1] + 0.2;
    };
    for (const auto& mesh : meshes())
        EXPECT_LT(project(CubicPowellSabin(mesh), cubic, 5).error, 5e-14);
}

/// VAL-14, whose numbers 8.73e-4, 7.57e-5 and 5.62e-6 are up to 0.6 % low: its rule of degree 5
/// leaves out a part of the error. With it, instead of an exact one, this basis gives the same.
TEST(CubicPowellSabin, convergence) {
    const int sizes[] = {3, 5, 9};
    const double expected[] = {8.7782e-4, 7.5906e-5, 5.6357e-6};
    double error[3];
    for (int k = 0; k < 3; ++k) {
        error[k] = project(CubicPowellSabin(square(sizes[k])), sines, 6).error;
        EXPECT_NEAR(error[k] / expected[k], 1, 1e-4) << error[k];
    }
    EXPECT_NEAR(std::log2(error[0] / error[1]), 3.53, 0.01);
    EXPECT_NEAR(std::log2(error[1] / error[2]), 3.75, 0.01);
}

TEST(CubicPowellSabin, sides) {
    const double angle = 0.7;
    for (unsigned seed : {2u, 3u}) {
        const CubicPowellSabin basis(turned(*perturbed(4, seed), angle));
        for (int quarter = 0; quarter < 4; ++quarter) {
            const double a = angle + quarter * M_PI / 2;
            const Side side(basis, Point(std::cos(a), std::sin(a)));
            EXPECT_EQ(side.given.rows(), 3 * 6);
            EXPECT_EQ(side.slopes, 3 * 2);
            // 4 vertices with value and slope, and 2 functions on each of 3 edges.
            EXPECT_EQ(Side::rank(side.given), 4 * 2 + 3 * 2);
            EXPECT_LT(side.constant, 1e-11);
            EXPECT_LT(side.left_over(seed), 1e-12);
            EXPECT_TRUE(side.exact());
        }
    }
}

/// Other inner points than the incentres give another space with the same properties.
TEST(CubicPowellSabin, other_inner_points) {
    const auto mesh = square(3);
    std::vector<Point> centroids;
    for (int t = 0; t < int(mesh->triangles().size()); ++t) {
        const auto c = mesh->corners(t);
        centroids.push_back((c[0] + c[1] + c[2]) / 3);
    }
    const CubicPowellSabin basis(mesh, centroids);
    const Worst w = worst_of(basis, 1);
    EXPECT_LT(std::max({w.sum, w.gradient_sum, w.precision}), 1e-11);
    EXPECT_GT(w.lowest, -1e-12);
    EXPECT_NEAR(project(basis, sines, 5).error, 8.7e-4, 2e-4);
}

}  // namespace
}  // namespace mpm::triangular
