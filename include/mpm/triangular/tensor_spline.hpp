// Products of B-splines on a rectangle, de Koster (2018) equation 3.15.
#pragma once

#include <vector>

#include "mpm/triangular/basis.hpp"
#include "mpm/triangular/bspline.hpp"

namespace mpm::triangular {

/// Function j * x().count() + i is N_i(x) N_j(y); cell j * x().spans() + i is the rectangle of the
/// spans i and j. A single span of degree 0 in y leaves functions of x alone: the method on a line
/// with B-splines, in a strip as thick as the span. Each function is then not zero on the strip's
/// lower and upper side, so that giving the field there gives it everywhere: leave those sides
/// free, or give them the component across the strip only.
class TensorSpline final : public Basis {
public:
    TensorSpline(BSpline x, BSpline y);

    const BSpline& x() const { return x_; }
    const BSpline& y() const { return y_; }
    const char* name() const override { return "tensor-spline"; }
    /// Of the products, as polynomials of two variables.
    int degree() const override { return x_.degree() + y_.degree(); }
    int functions() const override { return x_.count() * y_.count(); }
    int cells() const override { return x_.spans() * y_.spans(); }
    const std::vector<int>& on_cell(int cell) const override { return on_cell_[std::size_t(cell)]; }
    void evaluate(int cell, const Point& x, double* value, Point* gradient) const override;
    /// Looks the cell up in the knots: the guess is not needed.
    int locate(const Point& x, int guess) const override;
    std::vector<std::array<Point, 3>> pieces(int cell) const override;
    double area(int cell) const override;
    Point centre(int cell) const override;
    /// Greville points; a direction of degree 0 cannot reproduce its coordinate.
    std::vector<Point> control_points() const override;
    /// Sides of cells: lower, upper, left, right.
    const std::vector<OuterEdge>& outline() const override { return outline_; }
    std::vector<Functional> along(int edge) const override;
    Point lower() const override { return {x_.lower(), y_.lower()}; }
    Point upper() const override { return {x_.upper(), y_.upper()}; }
    double spacing() const override;

private:
    std::array<Point, 2> box(int cell) const;

    BSpline x_, y_;
    std::vector<std::vector<int>> on_cell_;
    std::vector<OuterEdge> outline_;
    std::vector<std::vector<int>> along_;  // functions that do not vanish on an outer edge
};

}  // namespace mpm::triangular
