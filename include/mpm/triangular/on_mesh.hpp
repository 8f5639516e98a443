// What all bases on triangles share: cells are the triangles of a mesh.
#pragma once

#include <memory>

#include "mpm/triangular/basis.hpp"

namespace mpm::triangular {

class OnMesh : public Basis {
public:
    explicit OnMesh(std::shared_ptr<const Mesh> mesh);

    const Mesh& mesh() const { return *mesh_; }
    int cells() const override { return int(mesh_->triangles().size()); }
    int locate(const Point& x, int guess) const override { return mesh_->locate(x, guess); }
    std::vector<std::array<Point, 3>> pieces(int cell) const override {
        return {mesh_->corners(cell)};
    }
    double area(int cell) const override { return mesh_->area(cell); }
    Point centre(int cell) const override {
        const auto c = mesh_->corners(cell);
        return (c[0] + c[1] + c[2]) / 3;
    }
    const std::vector<OuterEdge>& outline() const override { return outline_; }
    Point lower() const override { return mesh_->lower(); }
    Point upper() const override { return mesh_->upper(); }
    double spacing() const override { return mesh_->shortest_edge(); }

protected:
    /// Number in Mesh::edges of an outer edge.
    int edge_number(int outer) const { return outer_[std::size_t(outer)]; }

private:
    std::shared_ptr<const Mesh> mesh_;
    std::vector<OuterEdge> outline_;
    std::vector<int> outer_;
};

}  // namespace mpm::triangular
