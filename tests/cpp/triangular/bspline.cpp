// B-splines on a line against the recursion as printed, and the numbers of VAL-4 of the digest.
#include "mpm/triangular/bspline.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "properties.hpp"

namespace mpm::triangular {
namespace {

/// De Koster (2018), equations 3.13 and 3.14, with 0/0 = 0.
double by_recursion(const std::vector<double>& knots, int i, int degree, double x, int at) {
    if (degree == 0) return i == at ? 1 : 0;  // `at`: the knot that begins the span of x
    const auto k = [&](int n) { return knots[std::size_t(n)]; };
    const double one = k(i + degree) - k(i), two = k(i + degree + 1) - k(i + 1);
    double out = 0;
    if (one > 0) out += (x - k(i)) / one * by_recursion(knots, i, degree - 1, x, at);
    if (two > 0)
        out += (k(i + degree + 1) - x) / two * by_recursion(knots, i + 1, degree - 1, x, at);
    return out;
}

struct Values {
    Vector value, derivative;
    Values(const BSpline& b, int span, double x)
        : value(Vector::Zero(b.count())), derivative(Vector::Zero(b.count())) {
        double v[BSpline::highest + 1], d[BSpline::highest + 1];
        b.evaluate(span, x, v, d);
        for (int r = 0; r <= b.degree(); ++r) {
            value[b.first(span) + r] = v[r];
            derivative[b.first(span) + r] = d[r];
        }
    }
};

const std::vector<std::pair<std::vector<double>, int>> examples = {
    {{0, 0, 0, 1, 2, 3, 4, 5, 5, 5}, 2},
    {{0, 0, 0, 1, 2, 3, 4, 4, 5, 5, 5}, 2},
    {{0, 0, 1, 2, 3, 4, 5, 5}, 1},
    {{0, 0, 0, 0, 1, 2, 3, 4, 5, 5, 5, 5}, 3},
    {{-2, -2, -2, -2, -2, -0.3, 0.1, 0.1, 0.1, 0.1, 4, 7.5, 7.5, 7.5, 7.5, 7.5}, 4},
    {{0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1}, 5},
};

TEST(BSpline, functions) {
    for (const auto& [knots, degree] : examples) {
        const BSpline b(knots, degree);
        const auto greville = b.greville();
        const Vector points = Eigen::Map<const Vector>(greville.data(), b.count());
        for (int n = 0; n <= 1000; ++n) {
            const double x = b.lower() + (b.upper() - b.lower()) * n / 1000;
            const int span = b.span(x);
            ASSERT_GE(span, 0);
            const Values here(b, span, x);
            EXPECT_NEAR(here.value.sum(), 1, 1e-14);
            EXPECT_GE(here.value.minCoeff(), 0);
            EXPECT_NEAR(here.derivative.sum(), 0, 1e-12);
            EXPECT_NEAR(points.dot(here.value), x, 1e-13);
            EXPECT_NEAR(points.dot(here.derivative), 1, 1e-12);
            for (int i = 0; i < b.count(); ++i)
                EXPECT_NEAR(here.value[i],
                            by_recursion(knots, i, degree, x, b.first(span) + degree), 1e-14);
            const double step = 1e-6, left = b.breaks()[std::size_t(span)];
            const double middle =
                std::clamp(x, left + step, b.breaks()[std::size_t(span) + 1] - step);
            const Vector difference =
                Values(b, span, middle + step).value - Values(b, span, middle - step).value;
            EXPECT_LT((difference / (2 * step) - Values(b, span, middle).derivative)
                          .lpNorm<Eigen::Infinity>(),
                      1e-8);
        }
    }
}

TEST(BSpline, numbers_of_the_thesis) {
    const BSpline smooth(examples[0].first, 2), kinked(examples[1].first, 2);
    EXPECT_EQ(smooth.count(), 7);
    EXPECT_EQ(kinked.count(), 8);
    const auto jump = [](const BSpline& b) {
        const Values left(b, b.span(3.5), 4), right(b, b.span(4), 4);
        EXPECT_LT((left.value - right.value).lpNorm<Eigen::Infinity>(), 1e-15);
        return (left.derivative - right.derivative).lpNorm<Eigen::Infinity>();
    };
    EXPECT_NEAR(jump(smooth), 0, 1e-14);
    EXPECT_NEAR(jump(kinked), 4, 1e-14);
}

/// Coefficients of the polynomials of a span in x - at.
Matrix polynomials(const BSpline& b, int span, double at) {
    const int n = b.degree() + 1;
    Matrix powers(n, n), values(n, b.count());
    const double from = b.breaks()[std::size_t(span)];
    const double width = b.breaks()[std::size_t(span) + 1] - from;
    for (int r = 0; r < n; ++r) {
        const double x = from + width * (r + 0.5) / n;
        values.row(r) = Values(b, span, x).value;
        for (int c = 0; c < n; ++c) powers(r, c) = std::pow(x - at, c);
    }
    return powers.fullPivLu().solve(values);
}

/// At a knot that is there r times, degree - r derivatives are continuous and the next is not.
TEST(BSpline, multiplicity) {
    for (int degree = 1; degree <= BSpline::highest; ++degree) {
        for (int times = 1; times <= degree; ++times) {
            std::vector<double> knots(std::size_t(degree + 1), 0.0);
            knots.insert(knots.end(), std::size_t(times), 1.0);
            knots.insert(knots.end(), {1.7});
            knots.insert(knots.end(), std::size_t(degree + 1), 3.0);
            const BSpline b(knots, degree);
            const Matrix jump = polynomials(b, 1, 1) - polynomials(b, 0, 1);
            for (int order = 0; order <= degree; ++order) {
                const double most = jump.row(order).lpNorm<Eigen::Infinity>();
                if (order <= degree - times) {
                    EXPECT_LT(most, 1e-9) << degree << " " << times << " " << order;
                } else if (order == degree - times + 1) {
                    EXPECT_GT(most, 1e-2) << degree << " " << times;
                }
            }
        }
    }
}

TEST(BSpline, spans) {
    const BSpline b({0, 0, 0, 1, 1, 3, 3, 3}, 2);
    EXPECT_EQ(b.spans(), 2);
    EXPECT_EQ(b.span(0), 0);
    EXPECT_EQ(b.span(1 - 1e-9), 0);
    EXPECT_EQ(b.span(1), 1);
    EXPECT_EQ(b.span(3), 1) << "the last span is closed";
    EXPECT_EQ(b.span(3 + 1e-12), 1) << "rounding";
    EXPECT_EQ(b.span(-1e-12), 0);
    EXPECT_EQ(b.span(3 + 1e-11), -1);
    EXPECT_EQ(b.span(-1e-11), -1);
    EXPECT_EQ(b.span(std::numeric_limits<double>::quiet_NaN()), -1);
    EXPECT_EQ(Values(b, 1, 3).value[b.count() - 1], 1);
    EXPECT_EQ(Values(b, 0, 0).value[0], 1);
}

TEST(BSpline, constants) {
    const BSpline one({-1, 2}, 0), steps = BSpline::open(0, 1, 4, 0);
    EXPECT_EQ(one.count(), 1);
    EXPECT_EQ(Values(one, one.span(0.3), 0.3).value[0], 1);
    EXPECT_EQ(Values(one, 0, 0.3).derivative[0], 0);
    EXPECT_EQ(one.greville(), std::vector<double>{0.5});
    EXPECT_EQ(steps.count(), 4);
    const Vector third = Values(steps, steps.span(0.6), 0.6).value;
    EXPECT_EQ(third, Vector(Vector::Unit(4, 2)));
}

TEST(BSpline, open_knots) {
    const BSpline b = BSpline::open(1, 3, 4, 2);
    EXPECT_EQ(b.knots(), (std::vector<double>{1, 1, 1, 1.5, 2, 2.5, 3, 3, 3}));
    EXPECT_EQ(b.count(), 6);
    EXPECT_EQ(b.spans(), 4);
}

TEST(BSpline, errors) {
    const auto error = [](std::vector<double> knots, int degree) {
        return error_of([&] { BSpline(knots, degree); });
    };
    const double nan = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(error({0, 1}, -1), "B-spline: degree -1; expected 0 to 5");
    EXPECT_EQ(error(std::vector<double>(14, 0.0), 6), "B-spline: degree 6; expected 0 to 5");
    EXPECT_EQ(error({0, 0, 1}, 1),
              "B-spline of degree 1: there are 3 knots; expected at least 4, each end repeated 2 "
              "times");
    EXPECT_EQ(error({0, 0, nan, 1, 1}, 1),
              "B-spline: knot 2 is not finite; expected a number in m");
    EXPECT_EQ(error({0, 0, 0.5, 0.25, 1, 1}, 1),
              "B-spline: knot 3 = 0.25 is below the one before, 0.5; expected knots that do not "
              "fall");
    EXPECT_EQ(error({2, 2, 2, 2}, 1),
              "B-spline: all knots are 2; expected a first and a last one that differ");
    EXPECT_EQ(error({0, 0, 0.5, 1, 1, 1}, 2),
              "B-spline of degree 2: the end knot 0 is there 2 times; expected 3");
    EXPECT_EQ(error({0, 0, 0, 1, 1, 1, 1}, 2),
              "B-spline of degree 2: the end knot 1 is there 4 times; expected 3");
    EXPECT_EQ(error({0, 0, 0, 0.5, 0.5, 0.5, 1, 1, 1}, 2),
              "B-spline of degree 2: the inner knot 0.5 is there 3 times; expected at most 2");
    EXPECT_EQ(error({0, 0.5, 0.5, 1}, 0),
              "B-spline of degree 0: the inner knot 0.5 is there 2 times; expected at most 1");
    EXPECT_EQ(error({0, 0.5, 1}, 0), "");
    EXPECT_EQ(error_of([] { BSpline::open(0, 1, 0, 2); }),
              "B-spline: there are 0 spans; expected at least 1");
    EXPECT_EQ(error_of([] { BSpline::open(1, 1, 3, 2); }),
              "B-spline: from 1 to 1; expected the lower end below the upper one");
}

}  // namespace
}  // namespace mpm::triangular
