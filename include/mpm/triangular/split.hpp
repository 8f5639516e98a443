// The Powell-Sabin split of a triangulation: every triangle is cut into six by an inner point and
// one point on each side, so that the lines between the inner points of neighbours pass through the
// points on their common sides. De Koster (2018), section 3.5.1.
#pragma once

#include <memory>
#include <vector>

#include "mpm/triangular/mesh.hpp"

namespace mpm::triangular {

class Split {
public:
    /// Pieces of a triangle, each (corner, point on a side, inner point): piece 2k lies at corner k
    /// on side k, piece 2k + 1 at corner k + 1 on side k. Neighbouring pieces turn in opposite
    /// directions.
    static constexpr int pieces = 6;
    static int corner_of(int piece) { return (piece + 1) / 2 % 3; }
    static int side_of(int piece) { return piece / 2; }

    /// Inner points at the incentres, or where given, one for each triangle. Throws SceneError
    /// where the line between the inner points of neighbours misses their common side.
    explicit Split(std::shared_ptr<const Mesh> mesh, const std::vector<Point>& inner = {});

    const Mesh& mesh() const { return *mesh_; }
    const Point& inner(int t) const { return inner_[std::size_t(t)]; }
    /// Barycentric coordinates of the inner point.
    const std::array<double, 3>& weights(int t) const { return weights_[std::size_t(t)]; }
    /// Point on side k: share * corner k + (1 - share) * corner k + 1.
    const Point& on_side(int t, int k) const { return on_side_[std::size_t(t)][std::size_t(k)]; }
    double share(int t, int k) const { return share_[std::size_t(t)][std::size_t(k)]; }
    /// The same point between the inner points: part * own + (1 - part) * neighbour's; 1 on the
    /// outline.
    double part(int t, int k) const { return part_[std::size_t(t)][std::size_t(k)]; }

    std::array<Point, 3> piece(int t, int p) const {
        const auto v = std::size_t(mesh_->triangles()[std::size_t(t)][std::size_t(corner_of(p))]);
        return {mesh_->vertices()[v], on_side(t, side_of(p)), inner(t)};
    }
    /// Gradients of the barycentric coordinates in a piece.
    const std::array<Point, 3>& gradients(int t, int p) const {
        return gradients_[std::size_t(t * pieces + p)];
    }
    /// The piece of a point of triangle t, and its barycentric coordinates there.
    int locate(int t, const Point& x, std::array<double, 3>& inside) const;

    /// Vertex v, and its neighbours along the refined edges that end in it, moved `part` of the way
    /// towards them: the points that must lie in its control triangle.
    std::vector<Point> shell(int vertex, double part) const;

private:
    std::shared_ptr<const Mesh> mesh_;
    std::vector<Point> inner_;
    std::vector<std::array<double, 3>> weights_;
    std::vector<std::array<Point, 3>> on_side_;
    std::vector<std::array<double, 3>> share_, part_;
    std::vector<std::array<Point, 3>> gradients_;
};

}  // namespace mpm::triangular
