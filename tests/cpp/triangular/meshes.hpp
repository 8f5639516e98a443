// Triangulations of squares and rectangles for the tests.
#pragma once

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "mpm/triangular/mesh.hpp"
#include "support/random.hpp"

namespace mpm::triangular {

/// Every square of n x n equidistant vertices of the unit square cut by a diagonal: all the same,
/// or alternating.
inline std::shared_ptr<const Mesh> square(int n, bool union_jack = false) {
    std::vector<Point> vertices;
    std::vector<std::array<int, 3>> triangles;
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) vertices.emplace_back(i / (n - 1.0), j / (n - 1.0));
    for (int j = 0; j + 1 < n; ++j) {
        for (int i = 0; i + 1 < n; ++i) {
            const int a = j * n + i, b = a + 1, c = b + n, d = a + n;
            if (union_jack && (i + j) % 2 == 1) {
                triangles.insert(triangles.end(), {{a, b, d}, {b, c, d}});
            } else {
                triangles.insert(triangles.end(), {{a, b, c}, {a, c, d}});
            }
        }
    }
    return std::make_shared<const Mesh>(std::move(vertices), std::move(triangles));
}

/// nx x ny rectangles, each cut into four triangles (bottom, right, top, left) by its centre.
inline std::shared_ptr<const Mesh> blocks(int nx, int ny, double width, double height) {
    std::vector<Point> vertices;
    std::vector<std::array<int, 3>> triangles;
    for (int j = 0; j <= ny; ++j)
        for (int i = 0; i <= nx; ++i) vertices.emplace_back(width * i / nx, height * j / ny);
    for (int j = 0; j < ny; ++j) {
        for (int i = 0; i < nx; ++i) {
            const int a = j * (nx + 1) + i, b = a + 1, d = a + nx + 1, c = d + 1;
            const int middle = int(vertices.size());
            vertices.emplace_back(width * (i + 0.5) / nx, height * (j + 0.5) / ny);
            triangles.insert(triangles.end(),
                             {{a, b, middle}, {b, c, middle}, {c, d, middle}, {d, a, middle}});
        }
    }
    return std::make_shared<const Mesh>(std::move(vertices), std::move(triangles));
}

/// The squares of n x n vertices with random diagonals and the inner vertices moved at random, by
/// so little that no triangle turns over.
inline std::shared_ptr<const Mesh> perturbed(int n, unsigned seed) {
    test::Random random(seed);
    std::vector<Point> vertices = square(n)->vertices();
    std::vector<std::array<int, 3>> triangles;
    const double most = 0.15 / (n - 1);
    for (int j = 1; j + 1 < n; ++j)
        for (int i = 1; i + 1 < n; ++i) {
            const double x = random.between(-most, most), y = random.between(-most, most);
            vertices[std::size_t(j * n + i)] += Point(x, y);
        }
    for (int j = 0; j + 1 < n; ++j) {
        for (int i = 0; i + 1 < n; ++i) {
            const int a = j * n + i, b = a + 1, c = b + n, d = a + n;
            if (random.integer(0, 1) == 0) {
                triangles.insert(triangles.end(), {{a, b, d}, {b, c, d}});
            } else {
                triangles.insert(triangles.end(), {{a, b, c}, {a, c, d}});
            }
        }
    }
    return std::make_shared<const Mesh>(std::move(vertices), std::move(triangles));
}

/// The same mesh, turned by an angle (radians), so that no side lies along an axis.
inline std::shared_ptr<const Mesh> turned(const Mesh& mesh, double angle) {
    std::vector<Point> vertices = mesh.vertices();
    const Point across(std::cos(angle), std::sin(angle)), up(-across[1], across[0]);
    for (Point& v : vertices) v = v[0] * across + v[1] * up;
    return std::make_shared<const Mesh>(std::move(vertices), mesh.triangles());
}

}  // namespace mpm::triangular
