#include "mpm/triangular/mesh.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "mpm/core/error.hpp"

namespace mpm::triangular {

namespace {

/// A point this far outside, in barycentric coordinates, is still inside: rounding on a side.
constexpr double on_side = 1e-12;
/// Smallest height of a triangle, as a part of its longest side, that counts as one.
constexpr double flat = 1e-9;

std::string name_of(int t, const std::array<int, 3>& v) {
    return "mesh: triangle " + std::to_string(t) + " (vertices " + std::to_string(v[0]) + ", " +
           std::to_string(v[1]) + ", " + std::to_string(v[2]) + ")";
}

}  // namespace

std::array<double, 3> barycentric(const std::array<Point, 3>& c, const Point& x) {
    const double d = twice_area(c[0], c[1], c[2]);
    const double second = twice_area(c[0], x, c[2]) / d, third = twice_area(c[0], c[1], x) / d;
    return {1 - second - third, second, third};
}

std::array<Point, 3> barycentric_gradients(const std::array<Point, 3>& c) {
    const double d = twice_area(c[0], c[1], c[2]);
    std::array<Point, 3> out;
    for (std::size_t k = 0; k < 3; ++k) {
        const Point along = c[(k + 2) % 3] - c[(k + 1) % 3];
        out[k] = Point(-along[1], along[0]) / d;
    }
    return out;
}

Mesh::Mesh(std::vector<Point> vertices, std::vector<std::array<int, 3>> triangles)
    : vertices_(std::move(vertices)), triangles_(std::move(triangles)) {
    if (triangles_.empty()) throw SceneError("mesh: there is no triangle; give at least one");
    for (std::size_t v = 0; v < vertices_.size(); ++v) {
        if (!vertices_[v].allFinite()) {
            throw SceneError("mesh: vertex " + std::to_string(v) +
                             " is not finite; expected two numbers in m");
        }
    }
    const int count = int(vertices_.size());
    around_.resize(vertices_.size());
    for (int t = 0; t < int(triangles_.size()); ++t) {
        auto& v = triangles_[std::size_t(t)];
        for (int k : v) {
            if (k < 0 || k >= count) {
                throw SceneError(name_of(t, v) + ": there is no vertex " + std::to_string(k) +
                                 "; expected 0 to " + std::to_string(count - 1));
            }
        }
        const auto c = corners(t);
        const double twice = twice_area(c[0], c[1], c[2]);
        double longest = 0;
        for (std::size_t k = 0; k < 3; ++k)
            longest = std::max(longest, (c[(k + 1) % 3] - c[k]).norm());
        if (!(std::abs(twice) > flat * longest * longest)) {
            throw SceneError(name_of(t, v) + " has no area; remove it or move a vertex");
        }
        if (twice < 0) std::swap(v[1], v[2]);
        for (int k = 0; k < 3; ++k) around_[std::size_t(v[std::size_t(k)])].push_back({t, k});
    }
    for (int v = 0; v < count; ++v) {
        if (around_[std::size_t(v)].empty()) {
            throw SceneError("mesh: no triangle uses vertex " + std::to_string(v) +
                             "; leave it out");
        }
    }
    connect();
    fill_bins();
}

std::array<Point, 3> Mesh::corners(int t) const {
    const auto& v = triangles_[std::size_t(t)];
    return {vertices_[std::size_t(v[0])], vertices_[std::size_t(v[1])],
            vertices_[std::size_t(v[2])]};
}

double Mesh::area(int t) const {
    const auto c = corners(t);
    return 0.5 * twice_area(c[0], c[1], c[2]);
}

void Mesh::connect() {
    std::map<std::array<int, 2>, int> number;
    edge_of_.resize(triangles_.size());
    for (int t = 0; t < int(triangles_.size()); ++t) {
        const auto& v = triangles_[std::size_t(t)];
        for (int k = 0; k < 3; ++k) {
            std::array<int, 2> ends = {v[std::size_t(k)], v[std::size_t((k + 1) % 3)]};
            if (ends[0] > ends[1]) std::swap(ends[0], ends[1]);
            const auto [place, fresh] = number.try_emplace(ends, int(edges_.size()));
            if (fresh) {
                edges_.push_back({ends, {Side{t, k}, Side{-1, -1}}});
            } else if (Edge& e = edges_[std::size_t(place->second)]; e.outer()) {
                e.sides[1] = {t, k};
            } else {
                throw SceneError(name_of(t, v) + ": its side from vertex " +
                                 std::to_string(ends[0]) + " to " + std::to_string(ends[1]) +
                                 " already has two triangles; expected at most two");
            }
            edge_of_[std::size_t(t)][std::size_t(k)] = place->second;
        }
    }
    shortest_ = std::numeric_limits<double>::infinity();
    for (const Edge& e : edges_) {
        const Point along =
            vertices_[std::size_t(e.vertex[1])] - vertices_[std::size_t(e.vertex[0])];
        shortest_ = std::min(shortest_, along.norm());
    }
}

void Mesh::fill_bins() {
    lower_ = upper_ = vertices_[0];
    for (const Point& p : vertices_) {
        lower_ = lower_.cwiseMin(p);
        upper_ = upper_.cwiseMax(p);
    }
    const Point size = upper_ - lower_;
    // About one triangle a bin.
    const double edge = std::sqrt(size[0] * size[1] / double(triangles_.size()));
    for (std::size_t a = 0; a < 2; ++a)
        bins_[a] = std::clamp(int(size[Eigen::Index(a)] / edge), 1, 4096);
    bin_size_ = Point(size[0] / bins_[0], size[1] / bins_[1]);
    const auto range = [&](int t, std::array<int, 2>& low, std::array<int, 2>& high) {
        const auto c = corners(t);
        for (std::size_t a = 0; a < 2; ++a) {
            const auto i = Eigen::Index(a);
            const double from = std::min({c[0][i], c[1][i], c[2][i]}) - lower_[i];
            const double to = std::max({c[0][i], c[1][i], c[2][i]}) - lower_[i];
            low[a] = std::clamp(int(from / bin_size_[i] - 1e-9), 0, bins_[a] - 1);
            high[a] = std::clamp(int(to / bin_size_[i] + 1e-9), 0, bins_[a] - 1);
        }
    };
    std::array<int, 2> low, high;
    bin_start_.assign(std::size_t(bins_[0]) * std::size_t(bins_[1]) + 1, 0);
    for (int pass = 0; pass < 2; ++pass) {
        std::vector<int> next(bin_start_.begin(), bin_start_.end() - 1);
        for (int t = 0; t < int(triangles_.size()); ++t) {
            range(t, low, high);
            for (int j = low[1]; j <= high[1]; ++j)
                for (int i = low[0]; i <= high[0]; ++i) {
                    const auto bin = std::size_t(j * bins_[0] + i);
                    if (pass == 0)
                        ++bin_start_[bin + 1];
                    else
                        bin_triangles_[std::size_t(next[bin]++)] = t;
                }
        }
        if (pass == 0) {
            for (std::size_t b = 1; b < bin_start_.size(); ++b) bin_start_[b] += bin_start_[b - 1];
            bin_triangles_.resize(std::size_t(bin_start_.back()));
        }
    }
}

int Mesh::search(const Point& x) const {
    std::array<int, 2> at;
    for (std::size_t a = 0; a < 2; ++a) {
        const auto i = Eigen::Index(a);
        const double place = (x[i] - lower_[i]) / bin_size_[i];
        if (!(place > -1 && place < bins_[a] + 1)) return -1;
        at[a] = std::clamp(int(place), 0, bins_[a] - 1);
    }
    const auto bin = std::size_t(at[1] * bins_[0] + at[0]);
    for (int k = bin_start_[bin]; k < bin_start_[bin + 1]; ++k) {
        const int t = bin_triangles_[std::size_t(k)];
        const auto b = barycentric(corners(t), x);
        if (std::min({b[0], b[1], b[2]}) >= -on_side) return t;
    }
    return -1;
}

int Mesh::locate(const Point& x, int guess) const {
    int t = guess;
    if (t < 0 || t >= int(triangles_.size())) return search(x);
    // Particles move by less than a triangle a step; a long way is quicker by the bins.
    for (int step = 0; step < 8; ++step) {
        const auto b = barycentric(corners(t), x);
        const auto k = std::size_t(std::min_element(b.begin(), b.end()) - b.begin());
        if (b[k] >= -on_side) return t;
        const Edge& e = edges_[std::size_t(edge_of(t, int(k + 1) % 3))];
        if (e.outer()) break;  // perhaps around a corner that sticks in
        t = e.sides[e.sides[0].triangle == t ? 1 : 0].triangle;
    }
    return search(x);
}

}  // namespace mpm::triangular
