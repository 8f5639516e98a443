// What the method asks of its functions: which live on a cell, their values and gradients, and
// which of their coefficients a boundary takes. A basis is a family of functions phi_i over the
// cells of a plane domain with sum phi_i = 1.
#pragma once

#include <algorithm>
#include <vector>

#include "mpm/triangular/mesh.hpp"

namespace mpm::triangular {

/// A piece of the domain's outline.
struct OuterEdge {
    Point start, end;
    Point normal;  // unit, outwards
};

/// What must be given so that a field is given on an outer edge: the sum of weight * coefficient.
/// Of a field that is constant along the edge it is that constant, or 0 for a slope.
struct Functional {
    std::vector<int> function;
    std::vector<double> weight;
    bool slope = false;
};

class Basis {
public:
    Basis() = default;
    Basis(const Basis&) = delete;
    Basis& operator=(const Basis&) = delete;
    virtual ~Basis() = default;

    virtual const char* name() const = 0;
    virtual int degree() const = 0;
    virtual int functions() const = 0;
    virtual int cells() const = 0;

    /// Numbers of the functions that do not vanish on a cell; `most` is the largest count.
    virtual const std::vector<int>& on_cell(int cell) const = 0;
    static constexpr int most = 36;
    /// The largest count of this basis.
    std::size_t widest() const {
        std::size_t width = 0;
        for (int c = 0; c < cells(); ++c) width = std::max(width, on_cell(c).size());
        return width;
    }

    /// Values and gradients (1/m) at a point of a cell, in the order of on_cell.
    virtual void evaluate(int cell, const Point& x, double* value, Point* gradient) const = 0;

    /// Cell of a point, by a search that starts at `guess` (any number), or -1 outside.
    virtual int locate(const Point& x, int guess) const = 0;

    /// Triangles that make up a cell, on each of which all functions are polynomials.
    virtual std::vector<std::array<Point, 3>> pieces(int cell) const = 0;
    virtual double area(int cell) const = 0;
    virtual Point centre(int cell) const = 0;

    /// Points Q_i with sum Q_i phi_i(x) = x.
    virtual std::vector<Point> control_points() const = 0;

    virtual const std::vector<OuterEdge>& outline() const = 0;
    /// What gives a field along outer edge number `edge`.
    virtual std::vector<Functional> along(int edge) const = 0;

    virtual Point lower() const = 0;
    virtual Point upper() const = 0;
    /// Shortest edge of a cell, m.
    virtual double spacing() const = 0;
};

}  // namespace mpm::triangular
