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
    UpliftRecord uplift{0, 500 * std::pow(cell, D)};
    double covered = above_bed * uplift.full;  // of a node on the bed that a body covers, kg

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
        s[0] += part * covered;
        s[solid_mass * block_cells] += part * covered;
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
        return all()(std::int32_t(x / edge * fields + fields - 1), number(x, y), uplift)[up] /
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

/// A bed that is a surface: its plane through the middle of the row of blocks.
struct LeaningFloor : Floor<2> {
    static constexpr int wide = 4;  // blocks of distances, along each axis
    std::vector<std::uint64_t> surface_keys;
    std::vector<std::int32_t> places;
    std::vector<float> distances;
    SurfaceRecord<2> surface{};
    double slope, lowest;  // of the plane; its height at x = 0, in cells

    LeaningFloor(double lowest, double slope) : slope(slope), lowest(lowest) {
        constexpr int side = DistanceField<2>::edge, n = side + 1;
        const double length = std::hypot(1.0, slope);
        for (int b = 0; b < wide * wide; ++b) {
            surface_keys.push_back(std::uint64_t(b));
            places.push_back(b);
            for (int i = 0; i < n; ++i)
                for (int j = 0; j < n; ++j)
                    distances.push_back(float(
                        (b % wide * side + j - lowest - slope * (b / wide * side + i)) / length));
        }
        surface.field = {surface_keys.data(), places.data(), distances.data(), wide * wide, {0, 0},
                         {wide, wide},        {0, 0},        1 / cell};
        surface.decay = Decay::constrained;
        surface.thickness = cell;
        surface.axis[2] = 1;
        surface.set(0);
        record.surface = 1;
        record.law[0].response = Response::separable;
    }
    NodeUplift<double, double, 2> all() {
        auto found = Floor<2>::all();
        found.node.boundaries.surfaces = &surface;
        return found;
    }
    double above(int x, int y) const { return y + 0.5 - lowest - slope * (x + 0.5); }
    /// The row of a base at x.
    int row(int x) const {
        int y = 0;
        while (above(x, y) <= lowest_foot) ++y;
        return y;
    }
    double* node(int x, int y) {
        const int in[2] = {x % edge, y};
        return sums.data() + x / edge * channels * block_cells + Block<2>::cell(in);
    }
    void solid(int x) {
        for (int y = 0; y < edge; ++y) {
            const double mass = uplift.full * part_above(above(x, y));
            node(x, y)[0] += mass;
            node(x, y)[solid_mass * block_cells] += mass;
        }
    }
    /// At rest, of so much on the bed, Pa: rows that it holds bear it, as their splines there are.
    void fluid(int x, double pressure) {
        const auto part = [&](int y) {
            const double far = std::abs(above(x, y));
            if (above(x, y) / std::hypot(1.0, slope) > 1) return 0.0;
            return far < 0.5 ? 0.75 - far * far : far < 1.5 ? 0.5 * (1.5 - far) * (1.5 - far) : 0.0;
        };
        double all = 0;
        for (int y = 0; y < edge; ++y) all += part(y);
        for (int y = 0; y < edge; ++y) {
            const double mass = water.full * part_above(above(x, y));
            if (!(mass > 0)) continue;
            double* const s = node(x, y);
            s[0] += mass;
            s[water_mass * block_cells] += mass;
            const double held = dt * pressure * part(y) / all * cell;
            s[block_cells] += slope * held;
            s[2 * block_cells] += dt * 10 * mass - held;
        }
    }
    Vec<double, 2> pressure(int x) {
        const int in[2] = {x % edge, row(x)};
        auto p = all()(x / edge, Block<2>::cell(in), uplift);
        for (int a = 0; a < 2; ++a) p[a] /= dt * cell;
        return p;
    }
};

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
    for (double d = -1.6; d < 1.7; d += 0.1) {
        double sum = 0;
        constexpr int steps = 20000;
        for (int k = 0; k < steps; ++k) {
            const double s = (k + 0.5) * 3.5 / steps, far = std::abs(s - d);
            sum += 3.5 / steps *
                   (far < 0.5   ? 0.75 - far * far
                    : far < 1.5 ? 0.5 * (1.5 - far) * (1.5 - far)
                                : 0);
        }
        EXPECT_NEAR(part_above(d), sum, 1e-6) << d;
    }
    EXPECT_DOUBLE_EQ(part_above(0.5), above_bed);
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
    const FindUplift<double, double, 2> find{all,         blocks.data(), feet.data(),
                                             mask.data(), before.data(), with.data()};
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
