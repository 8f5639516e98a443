#include "mpm/triangular/on_mesh.hpp"

namespace mpm::triangular {

OnMesh::OnMesh(std::shared_ptr<const Mesh> mesh) : mesh_(std::move(mesh)) {
    for (std::size_t e = 0; e < mesh_->edges().size(); ++e) {
        const auto& edge = mesh_->edges()[e];
        if (!edge.outer()) continue;
        // Triangles turn counter-clockwise: the domain lies to the left of their sides.
        const auto c = mesh_->corners(edge.sides[0].triangle);
        const auto k = std::size_t(edge.sides[0].side);
        const Point along = (c[(k + 1) % 3] - c[k]).normalized();
        outline_.push_back({c[k], c[(k + 1) % 3], Point(along[1], -along[0])});
        outer_.push_back(int(e));
    }
}

}  // namespace mpm::triangular
