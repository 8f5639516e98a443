#include "mpm/triangular/bspline.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "mpm/core/error.hpp"

namespace mpm::triangular {

namespace {

/// A place this far outside, as a part of the width, is still inside.
constexpr double rounding = 1e-12;

std::string text(double x) {
    char out[32];
    std::snprintf(out, sizeof out, "%g", x);
    return out;
}

void check_degree(int degree) {
    if (degree < 0 || degree > BSpline::highest) {
        throw SceneError("B-spline: degree " + std::to_string(degree) + "; expected 0 to " +
                         std::to_string(BSpline::highest));
    }
}

}  // namespace

BSpline::BSpline(std::vector<double> knots, int degree)
    : knots_(std::move(knots)), degree_(degree) {
    check_degree(degree);
    const auto ends = std::size_t(degree + 1);
    const std::string of_degree = " of degree " + std::to_string(degree);
    if (knots_.size() < 2 * ends) {
        throw SceneError("B-spline" + of_degree + ": there are " + std::to_string(knots_.size()) +
                         " knots; expected at least " + std::to_string(2 * ends) +
                         ", each end repeated " + std::to_string(ends) + " times");
    }
    for (std::size_t k = 0; k < knots_.size(); ++k) {
        if (!std::isfinite(knots_[k])) {
            throw SceneError("B-spline: knot " + std::to_string(k) +
                             " is not finite; expected a number in m");
        }
        if (k > 0 && knots_[k] < knots_[k - 1]) {
            throw SceneError("B-spline: knot " + std::to_string(k) + " = " + text(knots_[k]) +
                             " is below the one before, " + text(knots_[k - 1]) +
                             "; expected knots that do not fall");
        }
    }
    if (knots_.front() == knots_.back()) {
        throw SceneError("B-spline: all knots are " + text(knots_.front()) +
                         "; expected a first and a last one that differ");
    }
    // An inner knot repeated more than `degree` times lets a function jump, which only the
    // constants of degree 0 may.
    const auto inner = std::size_t(std::max(degree, 1));
    for (std::size_t k = 0; k < knots_.size();) {
        std::size_t next = k;
        while (next < knots_.size() && knots_[next] == knots_[k]) ++next;
        const bool end = k == 0 || next == knots_.size();
        const std::size_t times = next - k;
        if (end ? times != ends : times > inner) {
            throw SceneError("B-spline" + of_degree + ": the " + (end ? "end" : "inner") +
                             " knot " + text(knots_[k]) + " is there " + std::to_string(times) +
                             " times; expected " + (end ? "" : "at most ") +
                             std::to_string(end ? ends : inner));
        }
        breaks_.push_back(knots_[k]);
        if (next < knots_.size()) first_.push_back(int(next) - 1 - degree);
        k = next;
    }
}

BSpline BSpline::open(double lower, double upper, int spans, int degree) {
    check_degree(degree);
    if (spans < 1) {
        throw SceneError("B-spline: there are " + std::to_string(spans) +
                         " spans; expected at least 1");
    }
    if (!(lower < upper && std::isfinite(upper - lower))) {
        throw SceneError("B-spline: from " + text(lower) + " to " + text(upper) +
                         "; expected the lower end below the upper one");
    }
    const auto ends = std::size_t(degree + 1);
    std::vector<double> knots(ends, lower);
    for (int k = 1; k < spans; ++k) knots.push_back(lower + (upper - lower) * k / spans);
    knots.insert(knots.end(), ends, upper);
    return BSpline(std::move(knots), degree);
}

int BSpline::span(double x) const {
    const double near = rounding * (upper() - lower());
    if (!(x >= lower() - near && x <= upper() + near)) return -1;
    const auto after = std::upper_bound(breaks_.begin(), breaks_.end(), x);
    return std::clamp(int(after - breaks_.begin()) - 1, 0, spans() - 1);
}

void BSpline::evaluate(int span, double x, double* value, double* derivative) const {
    // Degree by degree, Cox and de Boor's recursion for those of the functions that live here.
    // Each divisor is the length of a support that holds this span, so there is no 0/0.
    const double* right = knots_.data() + first(span) + degree_ + 1;
    const double* left = right - 1;
    value[0] = 1;
    derivative[0] = 0;
    for (int d = 1; d <= degree_; ++d) {
        double carried = 0, steep = 0;
        for (int r = 0; r < d; ++r) {
            const double from = left[r + 1 - d], to = right[r];
            const double part = value[r] / (to - from);
            value[r] = carried + (to - x) * part;
            carried = (x - from) * part;
            derivative[r] = steep - d * part;
            steep = d * part;
        }
        value[d] = carried;
        derivative[d] = steep;
    }
}

std::vector<double> BSpline::greville() const {
    std::vector<double> out;
    for (int i = 0; i < count(); ++i) {
        double sum = 0;
        const int from = degree_ == 0 ? i : i + 1, to = degree_ == 0 ? i + 1 : i + degree_;
        for (int k = from; k <= to; ++k) sum += knots_[std::size_t(k)];
        out.push_back(sum / (to - from + 1));
    }
    return out;
}

}  // namespace mpm::triangular
