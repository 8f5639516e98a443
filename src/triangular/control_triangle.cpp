#include "mpm/triangular/control_triangle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "mpm/core/error.hpp"

namespace mpm::triangular {

namespace {

/// Parts of the points' extent: what lies on a line, which lines are parallel, what is inside.
constexpr double collinear = 1e-10, parallel = 1e-9, outside = 1e-9;

/// Counter-clockwise convex hull without points on its sides (monotone chain).
std::vector<Point> convex_hull(std::vector<Point> points, double size) {
    std::sort(points.begin(), points.end(), [](const Point& a, const Point& b) {
        return a[0] < b[0] || (a[0] == b[0] && a[1] < b[1]);
    });
    const auto half = [&](auto first, auto last) {
        std::vector<Point> chain;
        for (auto p = first; p != last; ++p) {
            if (!chain.empty() && (*p - chain.back()).norm() <= collinear * size) continue;
            while (chain.size() > 1 &&
                   twice_area(chain[chain.size() - 2], chain.back(), *p) <= collinear * size * size)
                chain.pop_back();
            chain.push_back(*p);
        }
        chain.pop_back();
        return chain;
    };
    std::vector<Point> hull = half(points.begin(), points.end());
    const std::vector<Point> upper = half(points.rbegin(), points.rend());
    hull.insert(hull.end(), upper.begin(), upper.end());
    return hull;
}

/// Keeps the smallest triangle offered that holds all points.
class Smallest {
public:
    Smallest(const std::vector<Point>& points, double size) : points_(points), size_(size) {}

    void offer(ControlTriangle t) {
        double area = 0.5 * twice_area(t[0], t[1], t[2]);
        if (area < 0) {
            std::swap(t[1], t[2]);
            area = -area;
        }
        if (!(area > 1e-12 * size_ * size_) || area >= area_ * (1 - 1e-9)) return;
        for (const Point& p : points_) {
            const auto b = barycentric(t, p);
            if (std::min({b[0], b[1], b[2]}) < -outside) return;
        }
        best_ = t;
        area_ = area;
    }
    const std::optional<ControlTriangle>& best() const { return best_; }

private:
    const std::vector<Point>& points_;
    double size_;
    std::optional<ControlTriangle> best_;
    double area_ = std::numeric_limits<double>::infinity();
};

}  // namespace

ControlTriangle control_triangle(const std::vector<Point>& points) {
    Point low = points.at(0), high = low;
    for (const Point& p : points) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    const double size = (high - low).maxCoeff();
    const std::vector<Point> hull = convex_hull(points, size);
    const std::size_t n = hull.size();
    std::vector<Point> side(n);
    for (std::size_t i = 0; i < n; ++i) side[i] = (hull[(i + 1) % n] - hull[i]).normalized();
    const auto meet = [&](std::size_t i, std::size_t j) -> std::optional<Point> {
        const double d = cross(side[i], side[j]);
        if (std::abs(d) < parallel) return std::nullopt;
        return hull[i] + side[i] * (cross(hull[j] - hull[i], side[j]) / d);
    };

    Smallest smallest(points, size);
    for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t j = i + 1; j < n; ++j) {
            const auto apex = meet(i, j);
            for (std::size_t k = j + 1; apex && k < n; ++k) {
                const auto second = meet(j, k), third = meet(k, i);
                if (second && third) smallest.offer({*apex, *second, *third});
            }
            if (!apex) continue;
            // Two sides along the hull; the third across the bisector through the farthest point.
            const Point in_i(-side[i][1], side[i][0]), in_j(-side[j][1], side[j][0]);
            const Point to_i = side[i].dot(in_j) > 0 ? side[i] : Point(-side[i]);
            const Point to_j = side[j].dot(in_i) > 0 ? side[j] : Point(-side[j]);
            const Point bisector = (to_i + to_j).normalized();
            double reach = 0;
            for (const Point& p : points) reach = std::max(reach, (p - *apex).dot(bisector));
            smallest.offer({*apex, *apex + to_i * (reach / to_i.dot(bisector)),
                            *apex + to_j * (reach / to_j.dot(bisector))});
        }
    }
    if (!smallest.best())
        throw SceneError(
            "Powell-Sabin: no control triangle holds the points of a vertex; the "
            "triangles around it are too flat");
    return *smallest.best();
}

std::array<Triplet, 3> triplets(const ControlTriangle& corners, const Point& vertex) {
    const auto value = barycentric(corners, vertex);
    const auto gradient = barycentric_gradients(corners);
    return {Triplet{value[0], gradient[0]}, {value[1], gradient[1]}, {value[2], gradient[2]}};
}

}  // namespace mpm::triangular
