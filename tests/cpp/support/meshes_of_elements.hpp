// Meshes of boxes for tests of bodies of elements: triangles with alternating diagonals, and cubes
// of six tetrahedra, mirrored so that their diagonals alternate.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "support/scene.hpp"

namespace mpm::test {

struct Mesh {
    int dimension;
    std::vector<double> vertex;         // (n, dimension) m
    std::vector<std::int32_t> element;  // (m, dimension + 1)
    std::size_t vertices() const { return vertex.size() / std::size_t(dimension); }
    std::size_t elements() const { return element.size() / std::size_t(dimension + 1); }
};

/// A box from `lower` of so many edges an axis.
inline Mesh box_of_elements(std::vector<double> lower, std::vector<double> size,
                            std::vector<int> edges) {
    const int D = int(lower.size());
    Mesh m{D, {}, {}};
    if (D == 2) edges.push_back(0);
    const auto at = [&](int i, int j, int k) {
        return std::int32_t((k * (edges[1] + 1) + j) * (edges[0] + 1) + i);
    };
    for (int k = 0; k <= edges[2]; ++k)
        for (int j = 0; j <= edges[1]; ++j)
            for (int i = 0; i <= edges[0]; ++i) {
                const int c[3] = {i, j, k};
                for (int a = 0; a < D; ++a)
                    m.vertex.push_back(lower[std::size_t(a)] +
                                       size[std::size_t(a)] * c[a] / edges[std::size_t(a)]);
            }
    const auto volume = [&](const std::vector<std::int32_t>& e) {
        double d[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
        for (int k = 0; k < D; ++k)
            for (int a = 0; a < D; ++a)
                d[a][k] = m.vertex[std::size_t(e[std::size_t(k + 1)] * D + a)] -
                          m.vertex[std::size_t(e[0] * D + a)];
        return d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) -
               d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
               d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
    };
    static constexpr int path3[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2},
                                        {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    static constexpr int path2[2][2] = {{0, 1}, {1, 0}};
    for (int k = 0; k < std::max(edges[2], 1); ++k)
        for (int j = 0; j < edges[1]; ++j)
            for (int i = 0; i < edges[0]; ++i)
                for (int p = 0; p < (D == 2 ? 2 : 6); ++p) {
                    int b[3] = {i & 1, j & 1, D == 2 ? 0 : k & 1};
                    const auto corner = [&] { return at(i + b[0], j + b[1], k + b[2]); };
                    std::vector<std::int32_t> e = {corner()};
                    for (int s = 0; s < D; ++s) {
                        const int axis = D == 2 ? path2[p][s] : path3[p][s];
                        b[axis] = 1 - b[axis];
                        e.push_back(corner());
                    }
                    if (volume(e) < 0) std::swap(e[std::size_t(D - 1)], e[std::size_t(D)]);
                    m.element.insert(m.element.end(), e.begin(), e.end());
                }
    return m;
}

/// A body of this mesh; the mass that a vertex has on average follows from `size`, its volume.
inline BodySpec body_of_elements(const Spec& s, std::string name, std::string material,
                                 std::vector<double> parameters, const Mesh& mesh, double volume,
                                 bool vertex_volumes = false) {
    BodySpec b =
        body(s, std::move(name), std::move(material), std::move(parameters), mesh.vertex, 1);
    b.particle_mass = b.parameters[0] * volume / double(mesh.vertices());
    b.elements = mesh.element;
    b.vertex_volumes = vertex_volumes;
    return b;
}

}  // namespace mpm::test
