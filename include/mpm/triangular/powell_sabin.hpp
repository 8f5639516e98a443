// Quadratic Powell-Sabin splines: three functions a vertex, continuously differentiable, none
// negative, exact for quadratic fields. De Koster (2018), section 3.5.
#pragma once

#include "mpm/triangular/basis.hpp"
#include "mpm/triangular/control_triangle.hpp"
#include "mpm/triangular/on_mesh.hpp"
#include "mpm/triangular/split.hpp"

namespace mpm::triangular {

/// Function 3 v + q belongs to control point q of vertex v.
class PowellSabin final : public OnMesh {
public:
    /// Inner points of the split at the incentres, or as given, one for each triangle.
    explicit PowellSabin(std::shared_ptr<const Mesh> mesh, const std::vector<Point>& inner = {});

    const char* name() const override { return "powell-sabin"; }
    int degree() const override { return 2; }
    int functions() const override { return 3 * int(mesh().vertices().size()); }
    const std::vector<int>& on_cell(int cell) const override { return on_cell_[std::size_t(cell)]; }
    void evaluate(int cell, const Point& x, double* value, Point* gradient) const override;
    std::vector<std::array<Point, 3>> pieces(int cell) const override;
    std::vector<Point> control_points() const override;
    std::vector<Functional> along(int edge) const override;

    const Split& split() const { return split_; }
    const ControlTriangle& control(int vertex) const { return control_[std::size_t(vertex)]; }
    const std::array<Triplet, 3>& triplet(int vertex) const {
        return triplet_[std::size_t(vertex)];
    }
    /// Bezier ordinates of the nine functions of a triangle in one of its pieces (A, B, C): at A,
    /// B, C, and between A and B, B and C, C and A. De Koster (2018), figure 3.22.
    std::array<double, 6> ordinates(int cell, int function, int piece) const;

private:
    /// Four numbers from which the ordinates of a function in a triangle follow: the plane of its
    /// triplet at the vertex, half-way to the points on the two sides, and half-way to the inner
    /// point.
    struct Planes {
        double vertex, side, other_side, inner;
    };
    Split split_;
    std::vector<ControlTriangle> control_;
    std::vector<std::array<Triplet, 3>> triplet_;
    std::vector<std::vector<int>> on_cell_;
    std::vector<std::array<Planes, 9>> planes_;
};

}  // namespace mpm::triangular
