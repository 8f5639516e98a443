// Products of B-splines on a rectangle; on a line where one degree is 0.
#include "mpm/triangular/tensor_spline.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "properties.hpp"

namespace mpm::triangular {
namespace {

const BSpline uneven({-1, -1, -1, -0.6, 0, 0, 0.5, 1.5, 1.5, 1.5}, 2);

TEST(TensorSpline, sums_gradients_and_positions) {
    for (int across = 1; across <= BSpline::highest; ++across) {
        for (int up : {1, 2, 5}) {
            const TensorSpline basis(BSpline::open(0, 2, 5, across), BSpline::open(1, 1.9, 3, up));
            EXPECT_EQ(basis.functions(), (5 + across) * (3 + up));
            EXPECT_EQ(basis.cells(), 15);
            EXPECT_EQ(basis.degree(), across + up);
            const Worst w = worst_of(basis, unsigned(across));
            EXPECT_LT(w.sum, 1e-14);
            EXPECT_LT(w.gradient_sum, 1e-13);
            EXPECT_LT(w.precision, 1e-13);
            EXPECT_LT(w.difference, 1e-8);
            EXPECT_LT(w.area, 1e-13);
            EXPECT_GE(w.lowest, 0);
            EXPECT_FALSE(w.lost);
        }
    }
    const TensorSpline basis(uneven, uneven);
    const Worst w = worst_of(basis, 9);
    EXPECT_LT(std::max({w.sum, w.gradient_sum, w.precision, w.area}), 1e-13);
    EXPECT_GE(w.lowest, 0);
    EXPECT_FALSE(w.lost);
    EXPECT_NEAR(basis.spacing(), 0.4, 1e-15);
    EXPECT_LE(
        int(TensorSpline(BSpline::open(0, 1, 1, 5), BSpline::open(0, 1, 1, 5)).on_cell(0).size()),
        int(Basis::most));
}

TEST(TensorSpline, products) {
    const BSpline line = BSpline::open(0, 3, 4, 3);
    const TensorSpline basis(uneven, line);
    test::Random random(2);
    for (int n = 0; n < 200; ++n) {
        const Point x(random.between(-1, 1.5), random.between(0, 3));
        const int cell = basis.locate(x, n);
        const Vector all = Alive(basis, cell, x).all(basis.functions());
        double left[6], right[6], unused[6];
        const int i = uneven.span(x[0]), j = line.span(x[1]);
        EXPECT_EQ(cell, j * uneven.spans() + i);
        uneven.evaluate(i, x[0], left, unused);
        line.evaluate(j, x[1], right, unused);
        for (int b = 0; b <= 3; ++b)
            for (int a = 0; a <= 2; ++a)
                EXPECT_EQ(all[(line.first(j) + b) * uneven.count() + uneven.first(i) + a],
                          left[a] * right[b]);
    }
}

TEST(TensorSpline, location) {
    const TensorSpline basis(BSpline::open(0, 2, 4, 2), BSpline::open(0, 1, 2, 1));
    EXPECT_EQ(basis.locate(Point(0, 0), -1), 0);
    EXPECT_EQ(basis.locate(Point(2, 1), 0), 7);
    EXPECT_EQ(basis.locate(Point(2 + 1e-12, -1e-13), 0), 3);
    EXPECT_EQ(basis.locate(Point(2.001, 0.5), 0), -1);
    EXPECT_EQ(basis.locate(Point(1, -0.001), 0), -1);
    EXPECT_EQ(basis.locate(Point(std::numeric_limits<double>::quiet_NaN(), 0), 0), -1);
    EXPECT_EQ(basis.lower(), Point(0, 0));
    EXPECT_EQ(basis.upper(), Point(2, 1));
    EXPECT_EQ(basis.centre(6), Point(1.25, 0.75));
}

TEST(TensorSpline, outline) {
    const TensorSpline basis(uneven, BSpline::open(0, 2, 3, 1));
    Point sum = Point::Zero();
    double length = 0, twice = 0;
    for (const OuterEdge& e : basis.outline()) {
        const Point along = e.end - e.start;
        length += along.norm();
        sum += along.norm() * e.normal;
        twice += cross(e.start, e.end);
        EXPECT_NEAR(cross(e.normal, along), along.norm(), 1e-15) << "the domain lies on the left";
        EXPECT_EQ(basis.locate((e.start + e.end) / 2 + 1e-6 * e.normal, -1), -1);
    }
    EXPECT_EQ(basis.outline().size(), 2u * 4 + 2u * 3);
    EXPECT_NEAR(length, 9, 1e-14);
    EXPECT_NEAR(sum.norm(), 0, 1e-14);
    EXPECT_NEAR(twice / 2, 5, 1e-14);
}

TEST(TensorSpline, sides) {
    for (int across : {0, 1, 2, 4}) {
        for (int up : {0, 1, 3}) {
            const TensorSpline basis(BSpline::open(0, 2, 5, across), BSpline::open(1, 2, 3, up));
            for (int axis = 0; axis < 2; ++axis) {
                for (double sign : {-1.0, 1.0}) {
                    const Side side(basis, sign * Point::Unit(axis));
                    // Functions of a sum of degrees 0 know no distances.
                    EXPECT_LT(across > 0 && up > 0 ? side.constant : 0, 1e-13);
                    EXPECT_EQ(side.slopes, 0);
                    EXPECT_LT(side.left_over(3), 1e-13);
                    EXPECT_TRUE(side.exact());
                    EXPECT_EQ(Side::rank(side.given), axis == 0 ? 3 + up : 5 + across);
                }
            }
        }
    }
}

/// One span of degree 0 in y: the B-splines of x, on whose ends one coefficient each sits.
TEST(TensorSpline, line) {
    const TensorSpline basis(uneven, BSpline({0, 0.1}, 0));
    EXPECT_EQ(basis.functions(), uneven.count());
    EXPECT_EQ(basis.cells(), uneven.spans());
    for (int i = 0; i < basis.cells(); ++i) {
        const Alive here(basis, i, basis.centre(i));
        double value[3], slope[3];
        uneven.evaluate(i, basis.centre(i)[0], value, slope);
        for (std::size_t a = 0; a < 3; ++a) {
            EXPECT_EQ(here.value[a], value[a]);
            EXPECT_EQ(here.gradient[a], Point(slope[a], 0));
        }
    }
    int free_of_ends = 0;
    for (std::size_t e = 0; e < basis.outline().size(); ++e) {
        const auto given = basis.along(int(e));
        if (basis.outline()[e].normal[0] != 0) {
            ASSERT_EQ(given.size(), 1u);
            const bool right = basis.outline()[e].normal[0] > 0;
            EXPECT_EQ(given[0].function, std::vector<int>{right ? uneven.count() - 1 : 0});
        } else {
            EXPECT_EQ(given.size(), 3u) << "the constant of y is not 0 on a side";
            ++free_of_ends;
        }
    }
    EXPECT_EQ(free_of_ends, 2 * uneven.spans());
}

TEST(TensorSpline, projection) {
    const auto f = [](const Point& x) { return std::sin(M_PI * x[0]) * std::sin(M_PI * x[1]); };
    for (int degree = 1; degree <= 3; ++degree) {
        const auto error = [&](int spans) {
            const BSpline line = BSpline::open(0, 1, spans, degree);
            return project(TensorSpline(line, line), f).error;
        };
        EXPECT_NEAR(std::log2(error(8) / error(16)), degree + 1, 0.25) << degree;
        const BSpline line = BSpline::open(0, 1, 3, degree);
        const auto powers = [=](const Point& x) {
            return std::pow(x[0], degree) * std::pow(x[1], degree) - x[0];
        };
        EXPECT_LT(project(TensorSpline(line, line), powers).error, 1e-14);
    }
}

}  // namespace
}  // namespace mpm::triangular
