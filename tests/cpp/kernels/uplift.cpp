// Water in the gap below a base, on nodal sums written by hand.
#include "mpm/kernels/uplift.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

namespace mpm {
namespace {

constexpr double stiffness = 1e5, exponent = 7, density = 1000, cell = 0.1, dt = 1e-3;

/// A floor of blocks in a row along the first axis, of solids of 500 kg/m³ and water, which have
/// velocities of their own where there are two `fields`.
template <int D, int fields = 1>
struct Floor {
    static constexpr int edge = Block<D>::edge, count = 3, channels = 4 + D, cells = edge * count;
    static constexpr int up = D - 1;
    enum { solid_mass = 1 + D, volumes = 2 + D, water_mass = 3 + D };
    BlockKeys<D> keys_of{};
    static constexpr int slots = count * fields;
    std::uint64_t keys[slots];
    std::int32_t corners[slots * D] = {}, of_solids[fields] = {};
    std::vector<double> sums = std::vector<double>(slots * channels * block_cells);
    std::uint32_t touched[slots] = {};
    bool lined = false;
    std::vector<std::uint32_t> lines = std::vector<std::uint32_t>(slots * block_cells * D, 1),
                               listed = std::vector<std::uint32_t>(slots);
    std::vector<WallAsks> asks = std::vector<WallAsks>(slots * block_cells, WallNode::on_lines);
    BoundaryRecord<D> record{};
    Clock clock{};
    GroupPressure water{volumes, water_mass, stiffness, exponent, density* std::pow(cell, D)};
    UpliftRecord uplift{0, above_bed * 500 * std::pow(cell, D)};

    Floor() {
        std::fill(keys_of.counts, keys_of.counts + D, 8);
        keys_of.counts[0] = count + 4;
        keys_of.fields = fields;
        of_solids[fields - 1] = fields > 1;
        for (int k = 0; k < slots; ++k) {
            std::int64_t block[D] = {};
            block[0] = k / fields;
            keys[k] = keys_of.key(block, k % fields);
            corners[k * D] = k / fields * edge;
            touched[k] = listed[k] = std::uint32_t(k + 1);
        }
        clock.dt = dt;
        clock.gravity[up] = -10;
        clock.halt = Halt::none;
        record.active = true;
        record.share = std::uint64_t(1) << solid_mass;
        for (int a = 0; a < D; ++a) record.upper[a] = a == 0 ? cells : edge;
        record.present[2 * up] = 1;
        record.law[2 * up].response = Response::separable;
    }
    int number(std::int64_t x, std::int64_t y) const {
        int in[D] = {};
        in[0] = int(x % edge);
        if (D == 3) in[1] = int(y);
        return Block<D>::cell(in);
    }
    double* at(std::int64_t x, std::int64_t y = 0, int field = 0) {
        return sums.data() + (x / edge * fields + field) * channels * block_cells + number(x, y);
    }
    void solid(std::int64_t x, std::int64_t y = 0, double part = 1) {
        double* const s = at(x, y, fields - 1);
        s[0] += part * uplift.full;
        s[solid_mass * block_cells] += part * uplift.full;
    }
    /// Which the bed bears with so much, Pa, at a node that it holds.
    void fluid(std::int64_t x, double pressure, std::int64_t y = 0) {
        const double mass = above_bed * water.full;
        double* const s = at(x, y);
        s[0] += mass;
        s[water_mass * block_cells] += mass;
        s[(1 + up) * block_cells] += dt * (10 * mass - pressure * std::pow(cell, D - 1));
    }
    /// Water at rest of so many cells between lines, by quadratic splines, for the plane.
    void column(std::int64_t x, double depth) {
        constexpr int steps = 4000;
        for (int row = 0; row < edge; ++row) {
            const int in[2] = {int(x % edge), row};
            double* const s =
                sums.data() + x / edge * fields * channels * block_cells + Block<2>::cell(in);
            for (int k = 0; k < steps; ++k) {
                const double y = (k + 0.5) * depth / steps, far = std::abs(y - row - 0.5);
                const double weight = far < 0.5   ? 0.75 - far * far
                                      : far < 1.5 ? 0.5 * (1.5 - far) * (1.5 - far)
                                                  : 0;
                const double mass = weight * water.full * depth / steps;
                const double j = -std::expm1(
                    -std::log1p(density * 10 * cell * (depth - y) / stiffness) / exponent);
                s[0] += mass;
                s[water_mass * block_cells] += mass;
                s[volumes * block_cells] += mass * j;
            }
        }
    }
    NodeUplift<double, double, D> all() {
        NodeUpdate<double, double, D> node{};
        node.grid.table = {keys_of, slots, keys, corners, nullptr};
        node.grid.sums = sums.data();
        node.grid.sum_channels = channels;
        node.clock = &clock;
        node.boundaries = {&record, 1, nullptr, cell, 1};
        node.touched = touched;
        NodeUplift<double, double, D> found{
            node,
            lined ? KnownNodes<D>{lines.data(), nullptr, listed.data(), asks.data()}
                  : KnownNodes<D>{},
            {&uplift, 1, &water, 1, fields > 1 ? of_solids : nullptr, {}},
            up,
            1};
        for (int a = 0; a < D; ++a) found.uplift.cells[a] = a == 0 ? cells : edge;
        return found;
    }
    /// On the base, Pa, at a node that it covers whole.
    double pressure(std::int64_t x, std::int64_t y = 0) {
        return all()(std::int32_t(x / edge * fields + fields - 1), number(x, y), uplift) /
               (dt * std::pow(cell, D - 1));
    }
};

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

TEST(Uplift, StandsOnTheLowestRowAlone) {
    Floor<2> f;
    const auto all = f.all();
    for (std::int64_t y = -2; y < 4; ++y) {
        const std::int64_t at[2] = {3, y};
        EXPECT_EQ((on_bed_of<2>(all.node.boundaries, 0, at, 1, 1)), y < 0    ? OnBed::inside
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
    std::vector<double> before(feet.size()), with(feet.size());
    const FindUplift<double, double, 2> find{all,         blocks.data(), feet.data(),
                                             mask.data(), before.data(), with.data()};
    std::uint32_t lifted = 0;
    const auto set = [&](const std::vector<double>& from) {
        const SetFeet<double, double, 2> put{all.node.grid, blocks.data(), feet.data(),
                                             from.data(),   &lifted,       1};
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
