// What a step does between its parts, for one particle or cell.
#include "mpm/kernels/cell_phases.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace mpm {
namespace {

TEST(CellPhases, a_turn_by_moved_nodes_does_not_strain) {
    // The velocity at the end of a step turns about the centre where the nodes have come to.
    const double a = 0.03;  // dt omega
    const Mat<double, 2> turn{{{0, -a}, {a, 0}}};
    const double d = 1 + a * a;  // (I - W)^-1 = (I + W) / d in two dimensions
    const Mat<double, 2> seen = product(turn, Mat<double, 2>{{{1 / d, -a / d}, {a / d, 1 / d}}});
    EXPECT_NEAR(trace(seen), -2 * a * a / d, 1e-15);  // what the nodes of before make of it
    const Mat<double, 2> moved = by_moved_nodes(seen);
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j) EXPECT_NEAR(moved.e[i][j], turn.e[i][j], 1e-15);
    const Mat<double, 3> h{{{0.1, 0.02, -0.03}, {0.05, -0.2, 0.01}, {0.04, 0.06, 0.07}}};
    const Mat<double, 3> out = by_moved_nodes(h);  // out (I + h) = h
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            double sum = out.e[i][j];
            for (int k = 0; k < 3; ++k) sum += out.e[i][k] * h.e[k][j];
            EXPECT_NEAR(sum, h.e[i][j], 1e-15);
        }
}

TEST(CellPhases, modified_functions_add_up_and_do_not_jump) {
    KernelChoice k;
    k.kernel = Kernel::linear;
    k.gradient = GradientForm::shapes;
    const std::int64_t cell[] = {5, 5};
    for (double x = -0.5; x <= 0.5; x += 0.0078125) {
        const Vec<double, 2> xi{{x, 0.3}};
        auto s = stencil_of<3>(k, xi, Vec<double, 2>{}, cell);
        modify_for_deposit(s, xi);
        for (int a = 0; a < 2; ++a) {
            double weight = 0, slope = 0;
            for (int n = 0; n < 3; ++n) {
                weight += s.weight[a][n];
                slope += s.slope[a][n];
                EXPECT_TRUE(s.weight[a][n] == 0 || s.weight[a][n] >= 0.001);
            }
            EXPECT_NEAR(weight, 1, 1e-15);
            EXPECT_NEAR(slope, 0, 1e-15);
        }
        const double away = std::abs(x);  // from the node, which is a face of the spans
        EXPECT_NEAR(std::abs(s.slope[0][1]), std::min(2 * away / 0.01, 1.0), 1e-12);
        EXPECT_NEAR(s.weight[0][1], std::min(1 - away, 0.999), 1e-12);
    }
}

TEST(CellPhases, spans_are_around_nodes_or_between_them) {
    std::vector<double> x = {0.4, -0.4, 0.9}, y = {-0.1, 0.2, -1.2};
    BodyView<double, 2> body{};
    body.offset[0] = x.data();
    body.offset[1] = y.data();
    const int home[] = {0, 7};
    const int middle = 256 * 4;  // the home block among its neighbours
    const auto around = span_of<double, 2>(body, home, 0, false);
    EXPECT_EQ(around.place, middle + 7);
    EXPECT_NEAR(around.x[0], 0.4, 1e-15);
    const auto between = span_of<double, 2>(body, home, 0, true);
    EXPECT_EQ(between.place, middle + 6);  // y below its node
    EXPECT_NEAR(between.x[0], -0.1, 1e-15);
    EXPECT_NEAR(between.x[1], 0.4, 1e-15);
    const auto beyond = span_of<double, 2>(body, home, 1, true);  // x below the block's first node
    EXPECT_EQ(beyond.place, 256 * 1 + 7 * 8 + 7);
    const auto stray = span_of<double, 2>(body, home, 2, false);
    EXPECT_EQ(stray.place, middle + 8 + 6);
    EXPECT_NEAR(stray.x[0], -0.1, 1e-15);
    EXPECT_NEAR(stray.x[1], -0.2, 1e-15);
}

TEST(CellPhases, cells_beside_a_cell_lie_in_its_block_or_the_next) {
    // Two blocks, one behind the other along x, and none elsewhere.
    std::vector<std::int32_t> neighbours(18, -1);
    neighbours[4] = 0;
    neighbours[7] = 1;  // beyond x+ of block 0
    neighbours[9 + 4] = 1;
    neighbours[9 + 1] = 0;
    const NextInBlocks<2> next{neighbours.data()};
    EXPECT_EQ(next(9, 0, 1), 17);
    EXPECT_EQ(next(9, 1, 0), 8);
    EXPECT_EQ(next(8, 1, 0), -1);
    EXPECT_EQ(next(63, 0, 1), 64 + 7);
    EXPECT_EQ(next(64 + 7, 0, 0), 63);
    EXPECT_EQ(next(64 + 63, 0, 1), -1);
}

TEST(CellPhases, means_replace_parts_of_tensors) {
    const Mat<double, 3> m{{{1, 2, 3}, {4, 5, 6}, {7, 8, 12}}};
    const double mean[] = {3};
    Mat<double, 3> v = m;
    const AssumedTensor<3> volume{TensorPart::volumetric}, deviator{TensorPart::deviatoric};
    volume.replace(v, mean);
    EXPECT_NEAR(trace(v), 3, 1e-15);
    EXPECT_NEAR(v.e[0][0] - v.e[1][1], -4, 1e-15);
    EXPECT_EQ(v.e[0][1], 2);
    // Its own components put back leave every tensor as it is.
    for (TensorPart part : {TensorPart::volumetric, TensorPart::deviatoric, TensorPart::full}) {
        const AssumedTensor<3> t{part};
        double own[9];
        for (int k = 0; k < t.components(); ++k) own[k] = t.component(m, k);
        Mat<double, 3> same = m;
        t.replace(same, own);
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) EXPECT_NEAR(same.e[i][j], m.e[i][j], 1e-14);
    }
    Mat<double, 3> d = m;
    const double none[9] = {};
    deviator.replace(d, none);
    EXPECT_NEAR(trace(d), 18, 1e-14);
    EXPECT_EQ(d.e[0][1], -1);  // the spin of m
    EXPECT_EQ(d.e[1][0], 1);
}

}  // namespace
}  // namespace mpm
