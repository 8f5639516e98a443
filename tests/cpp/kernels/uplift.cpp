// Water in the gap below a base, on nodal sums written by hand.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "support/floors.hpp"

namespace mpm {
namespace {

using namespace test;

template <class Floor>
void expect_linear_between_edges() {
    Floor f;
    for (int x = 0; x < 5; ++x) f.fluid(x, 3000);
    for (int x = 5; x < 19; ++x) f.solid(x);
    for (int x = 19; x < f.cells; ++x) f.fluid(x, 1000);
    for (int x = 5; x < 19; ++x)
        EXPECT_NEAR(f.pressure(x), 3000 - 2000 * (x - 4.5) / 14, 1e-6) << x;
}

TEST(Uplift, IsLinearBetweenTheEdgesOfABase) { expect_linear_between_edges<Floor<2>>(); }

TEST(Uplift, IsTheSameOfSolidsWithVelocitiesOfTheirOwn) {
    expect_linear_between_edges<Floor<2, 2>>();
}

TEST(Uplift, FallsToNothingAtADryEdge) {
    Floor<2> f;
    for (int x = 0; x < 5; ++x) f.fluid(x, 3000);
    for (int x = 5; x < 19; ++x) f.solid(x);
    for (int x = 5; x < 19; ++x) EXPECT_NEAR(f.pressure(x), 3000 * (18.5 - x) / 14, 1e-6) << x;
}

TEST(Uplift, FallsToNothingWhereTheBedEnds) {
    Floor<2> f;
    for (int x = 0; x < 5; ++x) f.fluid(x, 3000);
    for (int x = 5; x < 19; ++x) f.solid(x);
    f.record.is_box = true;  // its top the same plane
    f.record.lower[0] = -4;
    f.record.upper[0] = 19;
    f.record.lower[1] = -6;
    f.record.upper[1] = 0;
    f.record.present[3] = 1;
    f.record.law[3].response = Response::separable;
    for (int x = 5; x < 19; ++x) EXPECT_NEAR(f.pressure(x), 3000 * (18.5 - x) / 14, 1e-6) << x;
}

TEST(Uplift, IsThatOfTheOneEdgeThatNoWallCloses) {
    Floor<2> f;
    for (int x = 0; x < 5; ++x) f.fluid(x, 3000);
    for (int x = 5; x < f.cells; ++x) f.solid(x);
    for (int x = 5; x < f.cells; ++x) EXPECT_NEAR(f.pressure(x), 3000, 1e-6) << x;
}

TEST(Uplift, IsThatOfTheOpenEdgeWhereABoxStandsAtTheOther) {
    Floor<2> f;
    for (int x = 0; x < 5; ++x) f.fluid(x, 3000);
    for (int x = 5; x < 14; ++x) f.solid(x);
    for (int x = 20; x < f.cells; ++x) f.fluid(x, 1000);
    BoundaryRecord<2> both[2] = {f.record, {}};
    BoundaryRecord<2>& box = both[1];
    box.active = box.is_box = true;
    box.lower[0] = 14;
    box.upper[0] = 20;
    box.upper[1] = f.edge;
    for (auto& law : box.law) law.response = Response::slip;
    auto all = f.all();
    const auto at = [&](int x) {
        return all(std::int32_t(x / f.edge), f.number(x, 0), f.uplift)[1] / (dt * cell);
    };
    for (int x = 5; x < 14; ++x) EXPECT_NEAR(at(x), 3000 * (13.5 - x) / 9, 1e-6) << x;
    all.node.boundaries.records = both;
    all.node.boundaries.count = 2;
    for (int x = 5; x < 14; ++x) EXPECT_NEAR(at(x), 3000, 1e-6) << x;
}

TEST(Uplift, IsTheWeightOfTheWaterBesideOnLines) {
    for (const double depth : {0.5, 1.0, 1.5, 1.6, 2.0, 2.4, 3.0, 3.6, 5.0}) {
        Floor<2> f;
        f.lined = true;
        for (int x = 0; x < f.cells; ++x)
            if (x < 8 || x > 14)
                f.column(x, depth);
            else
                f.solid(x);
        const double of_depth = density * 10 * cell * depth;
        EXPECT_NEAR(f.pressure(11), of_depth, 0.04 * of_depth) << depth;
    }
}

TEST(Uplift, IsNothingOnADryBed) {
    Floor<2> f;
    for (int x = 5; x < 19; ++x) f.solid(x);
    for (int x = 5; x < 19; ++x) EXPECT_EQ(f.pressure(x), 0) << x;
}

TEST(Uplift, IsTheWatersOwnBelowABaseInWater) {
    Floor<3> f;
    for (int x = 0; x < f.cells; ++x)
        for (int y = 0; y < f.edge; ++y) {
            if (x > 2 && x < 10 && y > 0 && y < 3)
                f.solid(x, y);
            else
                f.fluid(x, 2500, y);
        }
    for (int x = 3; x < 10; ++x)
        for (int y = 1; y < 3; ++y) EXPECT_NEAR(f.pressure(x, y), 2500, 1e-6) << x << ' ' << y;
}

TEST(Uplift, PressesByThePartOfANodeThatIsCovered) {
    for (const double part : {0.3, 0.6, 0.9}) {
        Floor<2> f;
        for (int x = 0; x < f.cells; ++x)
            if (x < 5 || x > 10)
                f.fluid(x, 2000);
            else
                f.solid(x, 0, part);
        EXPECT_NEAR(f.pressure(7), 2000 * part, 1e-6);
    }
}

TEST(Uplift, IsNothingWhereItsBoundaryDoesNotAct) {
    Floor<2> f;
    for (int x = 0; x < f.cells; ++x)
        if (x < 5 || x > 10)
            f.fluid(x, 2000);
        else
            f.solid(x);
    EXPECT_GT(f.pressure(7), 1999);
    f.record.active = false;
    EXPECT_EQ(f.pressure(7), 0);
}

TEST(Uplift, IsTheSameWhereverASurfaceIsInItsCell) {
    for (double lowest = 1.0; lowest < 2.0; lowest += 0.0625) {
        LeaningFloor f(lowest, 0);
        for (int x = 0; x < 5; ++x) f.fluid(x, 3000);
        for (int x = 5; x < 9; ++x) f.solid(x);
        for (int x = 9; x < f.cells; ++x) f.fluid(x, 3000);
        for (int x = 5; x < 9; ++x) {
            EXPECT_NEAR(f.pressure(x)[1], 3000, 1e-2) << lowest << ' ' << x;
            EXPECT_EQ(f.pressure(x)[0], 0);
        }
    }
}

TEST(Uplift, AsksForTheBedBelowWhatItIsLimitedTo) {
    for (const double lowest : {1.1, 1.4, 1.55, 1.7, 1.9}) {
        LeaningFloor f(lowest, 0);
        for (int x = 0; x < 5; ++x) f.fluid(x, 3000);
        for (int x = 5; x < 9; ++x) f.solid(x);
        for (int x = 9; x < f.cells; ++x) f.fluid(x, 3000);
        f.record.limited = true;  // from the plane up, and up to x = 7
        f.record.within_lower[0] = 0;
        f.record.within_lower[1] = lowest * cell;
        f.record.within_upper[0] = 7 * cell;
        f.record.within_upper[1] = 1;
        for (int x = 5; x < 9; ++x) EXPECT_NEAR(f.pressure(x)[1], 3000, 1e-2) << lowest << ' ' << x;
        const auto all = f.all();
        for (int x = 5; x < 9; ++x) {
            const std::int64_t at[2] = {x, f.row(x)};
            EXPECT_EQ((acts_across<2>(f.record, cell, at, 1)), x < 7);
            EXPECT_EQ((on_bed_of<2>(all.node.boundaries, 0, at, 1, 1).is), OnBed::foot);
        }
    }
}

TEST(Uplift, AsksNothingOfTheUndersideOfADeck) {
    // A deck of three cells with water below: what it holds down is not borne.
    LeaningFloor f(2.5, 0);
    for (std::size_t k = 0; k < f.distances.size(); ++k) {
        float& d = f.distances[k];
        if (d < -1.5f) d = -3 - d;
    }
    for (int x = 0; x < 5; ++x) f.fluid(x, 3000);
    for (int x = 5; x < 9; ++x) f.solid(x);
    for (int x = 9; x < f.cells; ++x) f.fluid(x, 3000);
    const double above = f.pressure(7)[1];
    EXPECT_NEAR(above, 3000, 1e-2);
    for (int x = 0; x < f.cells; ++x) f.node(x, 0)[2 * block_cells] += dt * 2000 * cell;
    EXPECT_NEAR(f.pressure(7)[1], above, 1e-2);
}

TEST(Uplift, PressesUprightBesideTheEdgeOfALevelBed) {
    LeaningFloor f(1.5, 0);
    constexpr int side = DistanceField<2>::edge, n = side + 1;
    for (std::size_t k = 0; k < f.distances.size(); ++k) {
        // The bed ends at 8 cells: beyond, its corner is the nearest.
        const int block = int(k) / (n * n), i = int(k) / n % n;
        const double over = block / LeaningFloor::wide * side + i - 8.0;
        if (over > 0)
            f.distances[k] =
                float(f.distances[k] > 0 ? std::hypot(over, double(f.distances[k])) : over);
        else if (f.distances[k] < 0)
            f.distances[k] = float(std::max(double(f.distances[k]), over));
    }
    for (int x = 0; x < 5; ++x) f.fluid(x, 3000);
    for (int x = 5; x < 9; ++x) f.solid(x);
    for (int x = 5; x < 8; ++x) {
        const auto p = f.pressure(x);
        EXPECT_GT(p[1], 100) << x;
        EXPECT_EQ(p[0], 0) << x;
    }
}

TEST(Uplift, FollowsABedThatLeansAndPressesAcrossIt) {
    for (const double slope : {0.05, 0.1, 0.2, -0.1}) {
        LeaningFloor f(slope < 0 ? 3.3 : 0.6, slope);
        for (int x = 0; x < 4; ++x) f.fluid(x, 3000);
        for (int x = 4; x < 9; ++x) f.solid(x);
        for (int x = 9; x < f.cells; ++x) f.fluid(x, 1000);
        for (int x = 4; x < 9; ++x) {
            const auto p = f.pressure(x);
            const double between = 3000 - 2000 * (x - 3.5) / 5;
            EXPECT_NEAR(p[1], between, 0.01 * between) << slope << ' ' << x;
            EXPECT_NEAR(p[0], -slope * p[1], 1e-3 * p[1]) << slope << ' ' << x;
        }
    }
}

TEST(Uplift, StandsOnOneRowOfASurface) {
    for (double lowest = 1.0; lowest < 2.0; lowest += 0.0625) {
        LeaningFloor f(lowest, 0.07);
        const auto all = f.all();
        for (int x = 0; x < 10; ++x) {
            int feet = 0;
            for (int y = 0; y < f.edge; ++y) {
                const std::int64_t at[2] = {x, y};
                const auto bed = on_bed_of<2>(all.node.boundaries, 0, at, 1, 1);
                if (bed.is != OnBed::foot) continue;
                ++feet;
                EXPECT_EQ(y, f.row(x));
                EXPECT_NEAR(bed.height, f.above(x, y), 1e-5);
                EXPECT_TRUE((holds_up<2>(all.node.boundaries, 0, at, 1, 1)));
            }
            EXPECT_EQ(feet, 1) << lowest << ' ' << x;
        }
    }
}

TEST(Uplift, StandsOnOneRowWhereRoundingDecides) {
    for (const double off : {-1e-6, -1e-7, 0.0, 1e-7, 1e-6})
        for (const double upper : {-1e-6, -1e-7, 0.0, 1e-7, 1e-6}) {
            // Rows at -1/4 and 3/4 of a cell, each with an error of its own.
            LeaningFloor f(1.75, 0);
            for (std::size_t k = 0; k < f.distances.size(); ++k)
                f.distances[k] += float(k % 9 < 2 ? off : upper);
            const auto all = f.all();
            int feet = 0;
            for (int y = 0; y < f.edge; ++y) {
                const std::int64_t at[2] = {3, y};
                feet += on_bed_of<2>(all.node.boundaries, 0, at, 1, 1).is == OnBed::foot;
            }
            EXPECT_EQ(feet, 1) << off << ' ' << upper;
        }
}

TEST(Uplift, CountsThePartOfANodeAboveABed) {
    EXPECT_DOUBLE_EQ(filled_at(0.5), above_bed);
    EXPECT_NEAR(depth_of(above_bed), 0.5, 1e-12);
}

/// A base of one part of all nodes from 5 to 10 that is so many cells off the bed, and water beside
/// it and, by `wet`, below.
Floor<2> lifted_base(double off, double part = 1, double wet = 0) {
    Floor<2> f;
    for (int x = 0; x < f.cells; ++x) {
        if (x < 5 || x > 10) {
            f.fluid(x, 3000);
            continue;
        }
        for (int row = 0; row < 2; ++row) {
            const int in[2] = {x % f.edge, row};
            double* const s =
                f.sums.data() + x / f.edge * f.channels * block_cells + Block<2>::cell(in);
            const double mass = part * f.uplift.full * filled_at(row + 0.5 - off);
            s[0] += mass;
            s[f.solid_mass * block_cells] += mass;
            const double film =
                row > 0 ? 0 : wet * part * f.water.full * (above_bed - filled_at(0.5 - off));
            s[0] += film;
            s[f.water_mass * block_cells] += film;
        }
    }
    return f;
}

TEST(Uplift, IsThatAtTheHeightOfABaseThatHasComeOff) {
    for (const double part : {1.0, 0.7})
        for (const double off : {0.05, 0.1, 0.2, 0.4, 0.6}) {
            Floor<2> f = lifted_base(off, part);
            const double at_base = 3000 - density * 10 * cell * off;
            EXPECT_NEAR(f.pressure(7), part * at_base, 0.005 * 3000) << off;
        }
    // What is left at the foot is pushed by twice its part at most: it has little mass.
    for (const double off : {0.8, 1.0, 1.2, 1.4}) {
        Floor<2> f = lifted_base(off);
        const double own = filled_at(0.5 - off) / above_bed;
        EXPECT_LE(f.pressure(7), 2 * own * 3000) << off;
        EXPECT_GT(f.pressure(7), own * (3000 - density * 10 * cell * off)) << off;
    }
}

TEST(Uplift, IsNothingWhereWaterHasFilledTheGap) {
    for (const double off : {0.5, 0.6, 0.8}) {
        const double dry = lifted_base(off).pressure(7);
        EXPECT_NEAR(lifted_base(off, 1, 0.5).pressure(7), 0.5 * dry, 0.1 * dry) << off;
        EXPECT_NEAR(lifted_base(off, 1, 1).pressure(7), 0, 0.1 * dry) << off;
    }
}

TEST(Uplift, IsThatAtTheHeightOfABaseOffASurfaceToo) {
    for (double lowest = 1.0; lowest < 2.0; lowest += 0.125)
        for (const double off : {0.1, 0.3, 0.5}) {
            LeaningFloor f(lowest, 0);
            for (int x = 0; x < 5; ++x) f.fluid(x, 3000);
            for (int x = 5; x < 9; ++x) f.solid(x, off);
            for (int x = 9; x < f.cells; ++x) f.fluid(x, 3000);
            const double at_base = 3000 - density * 10 * cell * off,
                         own = filled_at(f.above(7, f.row(7)) - off) /
                               filled_at(f.above(7, f.row(7)));
            EXPECT_NEAR(f.pressure(7)[1], std::min(1.0, 2 * own) * at_base, 0.01 * 3000)
                << lowest << ' ' << off;
        }
}

/// What `FindUplift` leaves for what rubs, 1 more than it is, at all nodes on the bed.
std::vector<double> rubbing_parts(Floor<2>& f, std::vector<double>& part) {
    const auto all = f.all();
    const std::vector<std::int32_t> blocks = {0, 1, 2};
    std::vector<std::int32_t> feet;
    for (int x = 0; x < f.cells; ++x) feet.push_back(x / f.edge * block_cells + f.number(x, 0));
    const std::vector<std::uint32_t> mask(3 * block_cells, 1);
    std::vector<double> before(2 * feet.size()), with(2 * feet.size()), found;
    const FindUplift<double, double, 2> find{all,         blocks.data(),  feet.data(),
                                             mask.data(), before.data(),  with.data(),
                                             part.data(), 3 * block_cells};
    for (std::size_t k = 0; k < feet.size(); ++k) find(std::int64_t(k));
    for (const std::int32_t foot : feet) found.push_back(part[std::size_t(foot)]);
    return found;
}
std::vector<double> rubbing_parts(Floor<2>& f) {
    std::vector<double> part(3 * block_cells);
    return rubbing_parts(f, part);
}

TEST(Uplift, LetsSolidsRubWithoutTheWaterBesideThem) {
    // Of 5000 Pa on the base and 3000 of the water: at its edges both press on the same nodes.
    for (const double edge : {0.1, 0.5, 0.9}) {
        Floor<2> f;
        const auto weigh = [&](int x, double part) {
            f.solid(x, 0, part);
            f.at(x)[2 * block_cells] += dt * (10 * part * f.covered - part * 5000 * cell);
        };
        for (int x = 0; x < f.cells; ++x) {
            const double covered = x > 5 && x < 10 ? 1 : x == 5 || x == 10 ? edge : 0;
            if (covered > 0) weigh(x, covered);
            if (covered == 1) continue;
            const double mass = (1 - covered) * above_bed * f.water.full;
            f.at(x)[0] += mass;
            f.at(x)[f.water_mass * block_cells] += mass;
            f.at(x)[2 * block_cells] += dt * (10 * mass - (1 - covered) * 3000 * cell);
        }
        std::vector<double> table(3 * block_cells);
        const auto part = rubbing_parts(f, table);
        for (int x = 5; x < 11; ++x) {
            const double covered = x == 5 || x == 10 ? edge : 1;
            const double solid = covered * (5000 - 3000), water = (1 - covered) * 3000;
            EXPECT_NEAR(part[std::size_t(x)], 1 + solid / (solid + water), 1e-6)
                << x << ' ' << edge;
        }
        EXPECT_EQ(part[3], 0);  // no base is there
        // Where it has gone nothing is left of it.
        for (double& number : f.sums) number = 0;
        for (int x = 0; x < f.cells; ++x) f.fluid(x, 3000);
        for (const double one : rubbing_parts(f, table)) EXPECT_EQ(one, 0);
    }
}

TEST(Uplift, LetsNothingRubOnWaterBelowABase) {
    for (const double off : {0.6, 0.8, 1.0, 1.3}) {
        Floor<2> f = lifted_base(off, 1, 1);
        for (int x = 5; x < 11; ++x)  // all that presses is the water in the gap
            f.at(x)[2 * block_cells] = dt * (10 * f.at(x)[0] - 3000 * cell);
        EXPECT_NEAR(rubbing_parts(f)[7], 1, 0.1) << off;
    }
}

TEST(Uplift, StandsOnTheLowestRowAlone) {
    Floor<2> f;
    const auto all = f.all();
    for (std::int64_t y = -2; y < 4; ++y) {
        const std::int64_t at[2] = {3, y};
        EXPECT_EQ((on_bed_of<2>(all.node.boundaries, 0, at, 1, 1).is), y < 0    ? OnBed::inside
                                                                       : y == 0 ? OnBed::foot
                                                                                : OnBed::none)
            << y;
    }
}

TEST(Uplift, IsTakenAwayAgainToTheLastBit) {
    Floor<2> f;
    for (int x = 0; x < f.cells; ++x)
        if (x < 5 || x > 10)
            f.fluid(x, 2345.6);
        else
            f.solid(x);
    for (int x = 0; x < f.cells; ++x) f.at(x)[2 * block_cells] -= 0.1 / (x + 1);
    const auto kept = f.sums;
    const auto all = f.all();
    std::vector<std::int32_t> blocks = {0, 1, 2}, feet;
    std::vector<std::uint32_t> mask(3 * block_cells, 1);
    for (int i = 0; i < 3 * block_cells; ++i) feet.push_back(i);
    std::vector<double> before(2 * feet.size()), with(2 * feet.size());
    const FindUplift<double, double, 2> find{all,           blocks.data(), feet.data(), mask.data(),
                                             before.data(), with.data(),   nullptr,     0};
    std::uint32_t lifted = 0;
    const auto set = [&](const std::vector<double>& from) {
        const SetFeet<double, double, 2> put{all.node.grid, blocks.data(), feet.data(), from.data(),
                                             &lifted};
        for (std::size_t k = 0; k < feet.size(); ++k) put(std::int64_t(k));
    };
    for (std::size_t k = 0; k < feet.size(); ++k) find(std::int64_t(k));
    EXPECT_EQ(f.sums, kept);
    MayLift{&f.clock, &lifted}();
    set(with);
    EXPECT_NE(f.sums, kept);
    f.clock.halt = Halt::sort;  // what a step decides in between
    set(before);
    EXPECT_EQ(f.sums, kept);
    NotLifted{&lifted}();
    MayLift{&f.clock, &lifted}();
    set(with);
    EXPECT_EQ(f.sums, kept);
}

}  // namespace
}  // namespace mpm
