// A boundary that lets go acts on a solid that has contact once the gap between them is closed, and
// not from as far off as its nodes reach.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "mpm/kernels/grid.hpp"

namespace mpm {
namespace {

constexpr double cell = 0.1, dt = 1e-3, density = 500;

/// One block on a bed, of a field of water and one of a solid whose face is so many cells above the
/// bed, with a part of the nodes' width: less than all beside its edges.
struct Bed {
    static constexpr int edge = Block<2>::edge, channels = 3, water = 0, solid = 1;
    BlockKeys<2> keys_of{};
    std::uint64_t keys[2];
    std::int32_t corners[4] = {};
    std::vector<std::int32_t> beside = std::vector<std::int32_t>(2 * Block<2>::neighbours, -1);
    std::vector<double> sums = std::vector<double>(2 * channels * block_cells);
    std::uint32_t touched[2] = {1, 2};
    std::int32_t of_solids[2] = {0, closes_gaps};
    BoundaryRecord<2> record{};
    Clock clock{};
    NodeUpdate<double, double, 2> node{};

    Bed(double gap, double width = 1) {
        keys_of.counts[0] = keys_of.counts[1] = 8;
        keys_of.fields = 2;
        const std::int64_t block[2] = {};
        for (int f = 0; f < 2; ++f) {
            keys[f] = keys_of.key(block, f);
            beside[std::size_t(f * Block<2>::neighbours + Block<2>::neighbours / 2)] = f;
        }
        clock.dt = dt;
        clock.halt = Halt::none;
        record.active = true;
        record.upper[0] = record.upper[1] = edge;
        record.present[2] = 1;
        record.law[2].response = Response::separable;
        for (int x = 0; x < edge; ++x)
            for (int y = 0; y < edge; ++y)
                sum(solid, x, y) = width * density * cell * cell * filled_at(y + 0.5 - gap);
        node.grid.table = {keys_of, 2, keys, corners, beside.data()};
        node.grid.sums = sums.data();
        node.grid.sum_channels = channels;
        node.clock = &clock;
        node.boundaries = {&record, 1, nullptr, cell, 1};
        node.boundaries.solid_fields = of_solids;
        node.touched = touched;
    }
    Bed(const Bed&) = delete;
    double& sum(int field, int x, int y, int channel = 0) {
        const int in[2] = {x, y};
        return sums[std::size_t((field * channels + channel) * block_cells + Block<2>::cell(in))];
    }
    /// Of a row above the bed.
    double closes(int field, int row) {
        const int in[2] = {1, row};
        const double level[2] = {};
        return node.share(field, Block<2>::cell(in)).closing_speed(1, 1, row + 0.5, level);
    }
    /// The solid is a corner of 90 degrees in place of a face, its tip at x and so many cells above
    /// the bed.
    void corner(double x, double gap, double degrees) {
        constexpr int steps = 200;
        const double lean = std::tan(degrees * 3.14159265358979 / 180), part = 5.0 / steps;
        const auto weight = [](double s) {
            const double far = std::abs(s);
            return far < 0.5 ? 0.75 - far * far : far < 1.5 ? 0.5 * (1.5 - far) * (1.5 - far) : 0.0;
        };
        for (int column = 0; column < edge; ++column)
            for (int row = 0; row < edge; ++row) {
                double inside = 0;
                for (int i = 0; i < steps; ++i)
                    for (int j = 0; j < steps; ++j) {
                        const double along = (i + 0.5) * part - 0.5, up = (j + 0.5) * part;
                        const bool in =
                            up - gap > lean * (along - x) && (up - gap) * lean > -(along - x);
                        inside += in * part * part * weight(along - column - 0.5) *
                                  weight(up - row - 0.5);
                    }
                sum(solid, column, row) = density * cell * cell * inside;
            }
    }
    /// The smallest of all columns, cells.
    double closes_first() {
        double least = 2;
        for (int x = 0; x < edge; ++x) {
            const int in[2] = {x, 0};
            const double level[2] = {},
                         gap = node.closing_speed(solid, Block<2>::cell(in), 1, 1, 0.5, level) *
                               dt / cell;
            if (sum(solid, x, 0) > 1e-3 * density * cell * cell) least = std::min(least, gap);
        }
        return least;
    }
    /// What the bed leaves of a velocity of the solid in the row above it.
    Vec<double, 2> left_of(double along, double down) {
        const int in[2] = {1, 0};
        const double mass = sum(solid, 1, 0);
        sum(solid, 1, 0, 1) = mass * along;
        sum(solid, 1, 0, 2) = -mass * down;
        const int n = Block<2>::cell(in);
        return node.held_velocity(solid, n, mass, node.momentum(solid, n), NothingSeen{});
    }
};

TEST(ClosingGaps, AreThoseOfTheFaceBesideItsEdgesToo) {
    for (const double width : {1.0, 0.5, 0.05})
        for (double gap = 0; gap < 1.45; gap += 0.1) {
            Bed bed(gap, width);
            EXPECT_NEAR(bed.closes(Bed::solid, 0), gap * cell / dt, 0.03 * cell / dt) << gap;
            EXPECT_NEAR(bed.closes(Bed::solid, 1), gap * cell / dt, 0.03 * cell / dt) << gap;
        }
}

/// A face that lies along a slope is no corner.
TEST(ClosingGaps, OfSlopesAreThoseOfTheFaceAlongThem) {
    for (const double slope : {0.1, 0.3})
        for (const double gap : {0.2, 0.5, 0.8}) {
            Bed bed(0);
            for (int x = 0; x < Bed::edge; ++x)
                for (int y = 0; y < Bed::edge; ++y)
                    bed.sum(Bed::solid, x, y) =
                        density * cell * cell * filled_at(y + 0.5 - slope * (x - 1) - gap);
            const int in[2] = {1, 0};
            const double leans[2] = {-slope, 1};
            EXPECT_NEAR(bed.node.closing_speed(Bed::solid, Block<2>::cell(in), 1, 1, 0.5, leans),
                        gap * cell / dt, 0.08 * cell / dt)
                << slope << ' ' << gap;
        }
}

/// From the lower row alone they would be up to half a cell more.
TEST(ClosingGaps, OfCornersAreNoMoreThanTheyAre) {
    for (const double degrees : {5.0, 20.0, 45.0})
        for (const double x : {1.6, 2.0, 2.3})
            for (const double gap : {0.0, 0.3, 0.6}) {
                Bed bed(0);
                bed.corner(x, gap, degrees);
                EXPECT_LT(bed.closes_first(), gap + 0.05) << degrees << ' ' << x << ' ' << gap;
                EXPECT_GT(bed.closes_first(), gap - 0.5) << degrees << ' ' << x << ' ' << gap;
            }
}

TEST(ClosingGaps, AreNoneOfWhatIsPressedIntoABed) {
    for (double gap = -0.5; gap < 0; gap += 0.1)
        EXPECT_EQ(Bed(gap).closes(Bed::solid, 0), 0) << gap;
}

TEST(ClosingGaps, AreOfSolidsOfParticlesBesideContacts) {
    Bed bed(0.5);
    for (int y = 0; y < Bed::edge; ++y) bed.sum(Bed::water, 1, y) = bed.sum(Bed::solid, 1, y);
    EXPECT_GT(bed.closes(Bed::solid, 0), 0);
    EXPECT_EQ(bed.closes(Bed::water, 0), 0);
    bed.of_solids[Bed::solid] = held_by_nodes;  // rigid, or of elements
    EXPECT_EQ(bed.closes(Bed::solid, 0), 0);
    bed.node.boundaries.solid_fields = nullptr;
    EXPECT_EQ(bed.closes(Bed::solid, 0), 0);
}

TEST(ClosingGaps, AreClosedAndNoMore) {
    Bed bed(0.3);
    const double speed = bed.closes(Bed::solid, 0);
    const auto slow = bed.left_of(1, 0.9 * speed);
    EXPECT_EQ(slow[0], 1);
    EXPECT_DOUBLE_EQ(slow[1], -0.9 * speed);
    const auto fast = bed.left_of(1, 1.5 * speed);
    EXPECT_EQ(fast[0], 1);
    EXPECT_NEAR(fast[1], -speed, 1e-12 * speed);
}

TEST(ClosingGaps, RubWithWhatPressesOnceTheyAreClosed) {
    Bed bed(0.3);
    auto& law = bed.record.law[2];
    law.static_friction = law.dynamic_friction = 0.4;
    const double speed = bed.closes(Bed::solid, 0);
    EXPECT_DOUBLE_EQ(bed.left_of(10, 0.9 * speed)[0], 10);
    EXPECT_NEAR(bed.left_of(10, speed + 2)[0], 10 - 0.4 * 2, 1e-9);
    EXPECT_DOUBLE_EQ(Bed(0).left_of(10, 2)[0], 10);  // a bed without friction
}

TEST(ClosingGaps, AreNotAskedOfWallsThatHold) {
    Bed bed(0.5);
    bed.record.law[2].response = Response::slip;
    EXPECT_EQ(bed.left_of(1, 0.1)[1], 0);
}

}  // namespace
}  // namespace mpm
