// Lagrange polynomials on triangles, de Koster (2018) equation 3.11: order 1 is the linear basis,
// the higher ones are there for demonstration.
#pragma once

#include <memory>
#include <vector>

#include "mpm/triangular/on_mesh.hpp"

namespace mpm::triangular {

/// One function for each node: the vertices, order - 1 nodes on each edge and the ones inside each
/// triangle, shared between neighbours. Gradients jump across edges. From order 2 on functions are
/// negative in places, so that a lumped mass can be 0 or negative: those orders show what the
/// method asks of a basis, and are no choice for computing.
class Lagrange final : public OnMesh {
public:
    static constexpr int highest = 5;

    Lagrange(std::shared_ptr<const Mesh> mesh, int order);

    const char* name() const override { return order_ == 1 ? "linear" : "Lagrange"; }
    int degree() const override { return order_; }
    int functions() const override { return int(nodes_.size()); }
    const std::vector<int>& on_cell(int cell) const override { return on_cell_[std::size_t(cell)]; }
    void evaluate(int cell, const Point& x, double* value, Point* gradient) const override;
    std::vector<Point> control_points() const override { return nodes_; }
    std::vector<Functional> along(int edge) const override;

private:
    int on_edge(int edge, int place) const;

    int order_;
    std::vector<Point> nodes_;
    std::vector<std::array<int, 3>> index_;  // of a triangle's nodes: order * barycentric
    std::vector<std::vector<int>> on_cell_;
    std::vector<std::array<Point, 3>> gradients_;  // of the barycentric coordinates
};

}  // namespace mpm::triangular
