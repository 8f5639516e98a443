// A triangulation of a plane domain: who neighbours whom, and in which triangle a point lies.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

namespace mpm::triangular {

using Point = Eigen::Vector2d;

/// u x v
inline double cross(const Point& u, const Point& v) { return u[0] * v[1] - u[1] * v[0]; }
/// Twice the area of a triangle, positive counter-clockwise.
inline double twice_area(const Point& a, const Point& b, const Point& c) {
    return cross(b - a, c - a);
}
/// Barycentric coordinates of a point, de Koster (2018) eq. 3.1.
std::array<double, 3> barycentric(const std::array<Point, 3>& corner, const Point& x);
/// Their gradients.
std::array<Point, 3> barycentric_gradients(const std::array<Point, 3>& corner);

class Mesh {
public:
    /// Side k of a triangle joins its corners k and k + 1.
    struct Side {
        int triangle;
        int side;
    };
    struct Edge {
        std::array<int, 2> vertex;  // ascending
        std::array<Side, 2> sides;  // the second has triangle -1 where the domain ends
        bool outer() const { return sides[1].triangle < 0; }
    };
    struct Corner {
        int triangle;
        int corner;
    };

    /// Vertices in metres; triangles by vertex number, turned counter-clockwise where they are not.
    /// Throws SceneError for what is no triangulation: unknown vertices, triangles without area,
    /// edges shared by more than two, vertices that no triangle uses.
    Mesh(std::vector<Point> vertices, std::vector<std::array<int, 3>> triangles);

    const std::vector<Point>& vertices() const { return vertices_; }
    const std::vector<std::array<int, 3>>& triangles() const { return triangles_; }
    const std::vector<Edge>& edges() const { return edges_; }
    const std::vector<Corner>& around(int vertex) const { return around_[std::size_t(vertex)]; }
    int edge_of(int triangle, int side) const {
        return edge_of_[std::size_t(triangle)][std::size_t(side)];
    }
    std::array<Point, 3> corners(int triangle) const;
    double area(int triangle) const;
    double shortest_edge() const { return shortest_; }
    const Point& lower() const { return lower_; }
    const Point& upper() const { return upper_; }

    /// The triangle of a point, by walking from `guess` (any number), or -1 outside the domain.
    int locate(const Point& x, int guess) const;

private:
    void connect();
    void fill_bins();
    int search(const Point& x) const;

    std::vector<Point> vertices_;
    std::vector<std::array<int, 3>> triangles_;
    std::vector<Edge> edges_;
    std::vector<std::array<int, 3>> edge_of_;
    std::vector<std::vector<Corner>> around_;
    Point lower_, upper_;
    double shortest_ = 0;
    // Triangles whose bounding box meets a bin of a regular grid, for points far from any guess.
    std::array<int, 2> bins_{};
    Point bin_size_;
    std::vector<int> bin_start_, bin_triangles_;
};

}  // namespace mpm::triangular
