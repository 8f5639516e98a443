// Points and weights for integrals over the domain of a basis: products of Gauss points on every
// piece, so that the lines on which functions have kinks are no obstacle.
#pragma once

#include <cmath>
#include <utility>
#include <vector>

#include "mpm/triangular/basis.hpp"

namespace mpm::triangular {

/// Points and weights of n Gauss points on [0, 1], exact to degree 2n - 1.
std::vector<std::pair<double, double>> gauss(int n);

/// Calls visit(cell, point, weight) for n * n points of every piece, exact to degree 2n - 2: one
/// degree is lost to the factor with which the square is folded into a triangle.
template <class Visit>
void each_point(const Basis& basis, int n, const Visit& visit) {
    const auto rule = gauss(n);
    for (int cell = 0; cell < basis.cells(); ++cell) {
        for (const auto& [a, b, c] : basis.pieces(cell)) {
            const double twice = std::abs(twice_area(a, b, c));
            for (const auto& [u, of_u] : rule) {
                for (const auto& [v, of_v] : rule) {
                    const Point x = a + u * (b - a) + u * v * (c - b);
                    visit(cell, x, twice * u * of_u * of_v);
                }
            }
        }
    }
}

}  // namespace mpm::triangular
