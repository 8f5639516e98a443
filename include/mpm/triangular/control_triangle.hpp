// The triangle of control points of a vertex and the three functions that belong to them.
// De Koster (2018), section 3.5.2.
#pragma once

#include "mpm/triangular/mesh.hpp"

namespace mpm::triangular {

using ControlTriangle = std::array<Point, 3>;

/// A triangle around the points, of nearly the smallest area: the smallest of all that share two or
/// three sides with their convex hull. The first of equals is kept, so that the choice does not
/// depend on rounding.
ControlTriangle control_triangle(const std::vector<Point>& points);

/// Value and gradient of one of the three functions at its vertex.
struct Triplet {
    double value;
    Point gradient;
    /// The plane with this value and gradient at the vertex.
    double plane(const Point& from_vertex) const { return value + gradient.dot(from_vertex); }
};
/// The functions' triplets: the planes that are 1 at one corner and 0 at the others.
std::array<Triplet, 3> triplets(const ControlTriangle& corners, const Point& vertex);

}  // namespace mpm::triangular
