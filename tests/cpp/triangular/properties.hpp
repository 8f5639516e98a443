// What every basis must do, measured: the tests of each name the bounds.
#pragma once

#include <Eigen/Dense>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/triangular/basis.hpp"
#include "mpm/triangular/quadrature.hpp"
#include "support/random.hpp"

namespace mpm::triangular {

using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;
using Field = std::function<double(const Point&)>;

/// The functions of a cell at a point.
struct Alive {
    std::vector<int> function;
    std::vector<double> value;
    std::vector<Point> gradient;

    Alive(const Basis& basis, int cell, const Point& x)
        : function(basis.on_cell(cell)), value(function.size()), gradient(function.size()) {
        basis.evaluate(cell, x, value.data(), gradient.data());
    }
    double of(const Vector& coefficient) const {
        double out = 0;
        for (std::size_t i = 0; i < value.size(); ++i) out += value[i] * coefficient[function[i]];
        return out;
    }
    /// Values of all functions.
    Vector all(int functions) const {
        Vector out = Vector::Zero(functions);
        for (std::size_t i = 0; i < value.size(); ++i) out[function[i]] += value[i];
        return out;
    }
};

/// A point of a triangle, `from_sides` away from them in barycentric coordinates.
inline Point random_in(const std::array<Point, 3>& triangle, test::Random& random,
                       double from_sides) {
    double a = random.between(0, 1), b = random.between(0, 1);
    if (a + b > 1) {
        a = 1 - a;
        b = 1 - b;
    }
    const double size = 1 - 3 * from_sides;
    a = from_sides + size * a;
    b = from_sides + size * b;
    return a * triangle[0] + b * triangle[1] + (1 - a - b) * triangle[2];
}

/// Largest errors over random points of all pieces; gradients times the basis's spacing.
struct Worst {
    double sum = 0, gradient_sum = 0, difference = 0, precision = 0, lowest = 1, area = 0;
    bool lost = false;  // locate gave another cell
};
inline Worst worst_of(const Basis& basis, unsigned seed, int points_a_piece = 4) {
    test::Random random(seed);
    Worst w;
    const double h = basis.spacing(), step = 1e-5 * h;
    const auto control = basis.control_points();
    for (int cell = 0; cell < basis.cells(); ++cell) {
        double area = 0;
        for (const auto& piece : basis.pieces(cell)) {
            area += std::abs(twice_area(piece[0], piece[1], piece[2])) / 2;
            for (int n = 0; n < points_a_piece; ++n) {
                const Point x = random_in(piece, random, 0.02);
                const Alive here(basis, cell, x);
                double sum = -1;
                Point gradient_sum = Point::Zero(), position = -x;
                for (std::size_t i = 0; i < here.value.size(); ++i) {
                    sum += here.value[i];
                    gradient_sum += here.gradient[i];
                    position += here.value[i] * control[std::size_t(here.function[i])];
                    w.lowest = std::min(w.lowest, here.value[i]);
                }
                w.sum = std::max(w.sum, std::abs(sum));
                w.gradient_sum = std::max(w.gradient_sum, h * gradient_sum.norm());
                w.precision = std::max(w.precision, position.norm() / h);
                for (Eigen::Index a = 0; a < 2; ++a) {
                    const Point e = step * Point::Unit(a);
                    const Alive up(basis, cell, x + e), down(basis, cell, x - e);
                    for (std::size_t i = 0; i < here.value.size(); ++i) {
                        const double slope = (up.value[i] - down.value[i]) / (2 * step);
                        w.difference =
                            std::max(w.difference, h * std::abs(slope - here.gradient[i][a]));
                    }
                }
                const int guess = random.integer(-3, basis.cells() + 3);
                w.lost = w.lost || basis.locate(x, guess) != cell;
            }
        }
        w.area = std::max(w.area, std::abs(area / basis.area(cell) - 1));
    }
    return w;
}

struct Projection {
    Vector coefficient;
    double error;  // root of the integral of the square
};
inline Projection project(const Basis& basis, const Field& field, int points = 6) {
    std::vector<Eigen::Triplet<double>> entries;
    Vector right = Vector::Zero(basis.functions());
    each_point(basis, points, [&](int cell, const Point& x, double weight) {
        const Alive here(basis, cell, x);
        for (std::size_t i = 0; i < here.value.size(); ++i) {
            right[here.function[i]] += weight * here.value[i] * field(x);
            for (std::size_t j = 0; j < here.value.size(); ++j)
                entries.emplace_back(here.function[i], here.function[j],
                                     weight * here.value[i] * here.value[j]);
        }
    });
    Eigen::SparseMatrix<double> mass(basis.functions(), basis.functions());
    mass.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(mass);
    Projection out{solver.solve(right), 0};
    each_point(basis, points, [&](int cell, const Point& x, double weight) {
        out.error += weight * std::pow(Alive(basis, cell, x).of(out.coefficient) - field(x), 2);
    });
    out.error = std::sqrt(out.error);
    return out;
}

/// One side of the outline: the outer edges with a normal.
struct Side {
    Matrix given;   // a row for each functional
    Matrix values;  // a row for each of many points: values of all functions
    int slopes = 0;
    double constant = 0;  // largest error of the functionals of a field constant along the side

    Side(const Basis& basis, const Point& normal) {
        std::vector<Vector> rows, points;
        const auto control = basis.control_points();
        for (int e = 0; e < int(basis.outline().size()); ++e) {
            const OuterEdge& edge = basis.outline()[std::size_t(e)];
            if ((edge.normal - normal).norm() > 1e-9) continue;
            for (const Functional& f : basis.along(e)) {
                rows.push_back(Vector::Zero(basis.functions()));
                // 1 plus the distance from the side, for all bases that know distances.
                double seen = f.slope ? 0 : -1;
                for (std::size_t i = 0; i < f.function.size(); ++i) {
                    rows.back()[f.function[i]] += f.weight[i];
                    const Point& q = control[std::size_t(f.function[i])];
                    const double away = basis.degree() > 0 ? normal.dot(q - edge.start) : 0;
                    seen += f.weight[i] * (1 + away);
                }
                slopes += f.slope;
                constant = std::max(constant, std::abs(seen));
            }
            for (int n = 0; n <= 24; ++n) {
                const Point x = edge.start + n / 24.0 * (edge.end - edge.start);
                const int cell = basis.locate(x, -1);
                points.push_back(Alive(basis, cell, x).all(basis.functions()));
            }
        }
        given.resize(Eigen::Index(rows.size()), basis.functions());
        for (std::size_t r = 0; r < rows.size(); ++r) given.row(Eigen::Index(r)) = rows[r];
        values.resize(Eigen::Index(points.size()), basis.functions());
        for (std::size_t r = 0; r < points.size(); ++r) values.row(Eigen::Index(r)) = points[r];
    }

    static Eigen::Index rank(Matrix m) {
        for (Eigen::Index r = 0; r < m.rows(); ++r)
            m.row(r) /= std::max(m.row(r).lpNorm<Eigen::Infinity>(), 1e-300);
        Eigen::ColPivHouseholderQR<Matrix> qr(m);
        qr.setThreshold(1e-9);
        return qr.rank();
    }
    /// Largest value on the side of a random field for which all functionals are 0.
    double left_over(unsigned seed) const {
        test::Random random(seed);
        Vector c(given.cols());
        for (double& x : c) x = random.between(-1, 1);
        const Eigen::CompleteOrthogonalDecomposition<Matrix> solver(given);
        c -= solver.solve(given * c);
        return (values * c).lpNorm<Eigen::Infinity>();
    }
    /// The functionals are 0 for those fields that vanish on the side, and for no others.
    bool exact() const {
        Matrix both(given.rows() + values.rows(), given.cols());
        both << given, values;
        const auto r = rank(given);
        return r == rank(values) && r == rank(both);
    }
};

/// Text of the SceneError that an action throws, or "".
inline std::string error_of(const std::function<void()>& action) {
    try {
        action();
    } catch (const SceneError& e) {
        return e.what();
    }
    return "";
}

}  // namespace mpm::triangular
