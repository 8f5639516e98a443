#include "mpm/triangular/tensor_spline.hpp"

#include <algorithm>
#include <limits>

namespace mpm::triangular {

static_assert((BSpline::highest + 1) * (BSpline::highest + 1) <= Basis::most);

TensorSpline::TensorSpline(BSpline x, BSpline y) : x_(std::move(x)), y_(std::move(y)) {
    const int columns = x_.spans(), rows = y_.spans();
    for (int j = 0; j < rows; ++j) {
        for (int i = 0; i < columns; ++i) {
            std::vector<int> here;
            for (int b = y_.first(j); b <= y_.first(j) + y_.degree(); ++b)
                for (int a = x_.first(i); a <= x_.first(i) + x_.degree(); ++a)
                    here.push_back(b * x_.count() + a);
            on_cell_.push_back(std::move(here));
        }
    }
    // Open knots: of the functions of one direction only the first is not 0 at the lower end, and
    // only the last at the upper end.
    const auto add = [&](int cell, int axis, bool upper) {
        const auto [low, high] = box(cell);
        const int along = 1 - axis;
        OuterEdge e{low, high, Point::Zero()};
        e.start[axis] = e.end[axis] = upper ? high[axis] : low[axis];
        // The domain lies on the left of the way from start to end.
        if (upper == (axis == 1)) std::swap(e.start[along], e.end[along]);
        e.normal[axis] = upper ? 1 : -1;
        outline_.push_back(e);
        const int there = upper ? (axis == 0 ? x_ : y_).count() - 1 : 0;
        std::vector<int> alive;
        for (int f : on_cell_[std::size_t(cell)])
            if ((axis == 0 ? f % x_.count() : f / x_.count()) == there) alive.push_back(f);
        along_.push_back(std::move(alive));
    };
    for (bool upper : {false, true})
        for (int i = 0; i < columns; ++i) add((upper ? rows - 1 : 0) * columns + i, 1, upper);
    for (bool upper : {false, true})
        for (int j = 0; j < rows; ++j) add(j * columns + (upper ? columns - 1 : 0), 0, upper);
}

std::array<Point, 2> TensorSpline::box(int cell) const {
    const auto i = std::size_t(cell % x_.spans()), j = std::size_t(cell / x_.spans());
    return {Point(x_.breaks()[i], y_.breaks()[j]), Point(x_.breaks()[i + 1], y_.breaks()[j + 1])};
}

void TensorSpline::evaluate(int cell, const Point& x, double* value, Point* gradient) const {
    constexpr int top = BSpline::highest + 1;
    double across[top], steep_across[top], up[top], steep_up[top];
    x_.evaluate(cell % x_.spans(), x[0], across, steep_across);
    y_.evaluate(cell / x_.spans(), x[1], up, steep_up);
    int f = 0;
    for (int b = 0; b <= y_.degree(); ++b) {
        for (int a = 0; a <= x_.degree(); ++a, ++f) {
            value[f] = across[a] * up[b];
            gradient[f] = Point(steep_across[a] * up[b], across[a] * steep_up[b]);
        }
    }
}

int TensorSpline::locate(const Point& x, int) const {
    const int i = x_.span(x[0]), j = y_.span(x[1]);
    return i < 0 || j < 0 ? -1 : j * x_.spans() + i;
}

std::vector<std::array<Point, 3>> TensorSpline::pieces(int cell) const {
    const auto [low, high] = box(cell);
    return {{low, Point(high[0], low[1]), high}, {low, high, Point(low[0], high[1])}};
}

double TensorSpline::area(int cell) const {
    const auto [low, high] = box(cell);
    return (high - low).prod();
}

Point TensorSpline::centre(int cell) const {
    const auto [low, high] = box(cell);
    return (low + high) / 2;
}

std::vector<Point> TensorSpline::control_points() const {
    std::vector<Point> out;
    const auto across = x_.greville();
    for (double b : y_.greville())
        for (double a : across) out.emplace_back(a, b);
    return out;
}

std::vector<Functional> TensorSpline::along(int edge) const {
    std::vector<Functional> out;
    for (int f : along_[std::size_t(edge)]) out.push_back({{f}, {1.0}});
    return out;
}

double TensorSpline::spacing() const {
    double out = std::numeric_limits<double>::infinity();
    for (const BSpline* line : {&x_, &y_})
        for (std::size_t k = 1; k < line->breaks().size(); ++k)
            out = std::min(out, line->breaks()[k] - line->breaks()[k - 1]);
    return out;
}

}  // namespace mpm::triangular
