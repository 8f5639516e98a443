#include "mpm/triangular/split.hpp"

#include <algorithm>
#include <string>

#include "mpm/core/error.hpp"

namespace mpm::triangular {

namespace {

std::array<double, 3> incentre(const std::array<Point, 3>& c) {
    const double a = (c[2] - c[1]).norm(), b = (c[0] - c[2]).norm(), d = (c[1] - c[0]).norm();
    const double sum = a + b + d;
    return {a / sum, b / sum, d / sum};
}

}  // namespace

Split::Split(std::shared_ptr<const Mesh> mesh, const std::vector<Point>& inner)
    : mesh_(std::move(mesh)) {
    const auto count = mesh_->triangles().size();
    if (!inner.empty() && inner.size() != count) {
        throw SceneError("Powell-Sabin split: " + std::to_string(inner.size()) +
                         " inner points for " + std::to_string(count) +
                         " triangles; give one for each");
    }
    for (std::size_t t = 0; t < count; ++t) {
        const auto c = mesh_->corners(int(t));
        const auto w = inner.empty() ? incentre(c) : barycentric(c, inner[t]);
        if (!(std::min({w[0], w[1], w[2]}) > 0)) {
            throw SceneError("Powell-Sabin split: the inner point of triangle " +
                             std::to_string(t) + " lies outside of it; expected inside");
        }
        weights_.push_back(w);
        inner_.push_back(w[0] * c[0] + w[1] * c[1] + w[2] * c[2]);
    }
    on_side_.resize(count);
    share_.resize(count);
    part_.resize(count);
    for (const auto& e : mesh_->edges()) {
        const Point& a = mesh_->vertices()[std::size_t(e.vertex[0])];
        const Point& b = mesh_->vertices()[std::size_t(e.vertex[1])];
        double first = 0.5, own = 1;  // the middle of an outer edge, where any point would do
        if (!e.outer()) {
            // b + first (a - b) = z1 + own (z0 - z1)
            const Point& z0 = inner_[std::size_t(e.sides[0].triangle)];
            const Point& z1 = inner_[std::size_t(e.sides[1].triangle)];
            const double d = cross(a - b, z0 - z1);
            first = cross(z1 - b, z0 - z1) / d;
            own = cross(z1 - b, a - b) / d;
            if (!(first > 0 && first < 1 && own > 0 && own < 1)) {
                throw SceneError(
                    "Powell-Sabin split: the line between the inner points of "
                    "triangles " +
                    std::to_string(e.sides[0].triangle) + " and " +
                    std::to_string(e.sides[1].triangle) +
                    " misses their common side; move the points, or use incentres");
            }
        }
        for (std::size_t s = 0; s < (e.outer() ? 1 : 2); ++s) {
            const auto t = std::size_t(e.sides[s].triangle), k = std::size_t(e.sides[s].side);
            const bool forward = mesh_->triangles()[t][k] == e.vertex[0];
            share_[t][k] = forward ? first : 1 - first;
            part_[t][k] = s == 0 ? own : 1 - own;
            on_side_[t][k] = first * a + (1 - first) * b;
        }
    }
    for (int t = 0; t < int(count); ++t)
        for (int p = 0; p < pieces; ++p) gradients_.push_back(barycentric_gradients(piece(t, p)));
}

// The inner point sees the corners around it: where a coordinate is smallest relative to the inner
// point's own, the point lies beyond the two other corners' rays. Digest of de Koster (2018), 5.7.
int Split::locate(int t, const Point& x, std::array<double, 3>& inside) const {
    const auto b = barycentric(mesh_->corners(t), x);
    const auto& z = weights(t);
    std::size_t k = 0;
    for (std::size_t m = 1; m < 3; ++m)
        if (b[m] * z[k] < b[k] * z[m]) k = m;
    const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
    const double s = b[k] / z[k], to_i = b[i] - z[i] * s, to_j = b[j] - z[j] * s;
    const double at_i = share(t, int(i)), at_j = 1 - at_i;
    if (to_i * at_j >= to_j * at_i) {
        inside = {to_i - at_i * to_j / at_j, to_j / at_j, s};
        return 2 * int(i);
    }
    inside = {to_j - at_j * to_i / at_i, to_i / at_i, s};
    return 2 * int(i) + 1;
}

std::vector<Point> Split::shell(int vertex, double part) const {
    const Point& v = mesh_->vertices()[std::size_t(vertex)];
    std::vector<Point> out = {v};
    for (const auto& c : mesh_->around(vertex)) {
        const int before = (c.corner + 2) % 3;
        for (const Point& w :
             {on_side(c.triangle, c.corner), on_side(c.triangle, before), inner(c.triangle)})
            out.push_back(v + part * (w - v));
    }
    return out;
}

}  // namespace mpm::triangular
