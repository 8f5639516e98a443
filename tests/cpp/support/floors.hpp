// Beds for tests of water in the gap below a base: nodal sums that are written by hand.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "mpm/kernels/uplift_passes.hpp"

namespace mpm::test {

inline constexpr double stiffness = 1e5, exponent = 7, density = 1000, cell = 0.1, dt = 1e-3;

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
            {&uplift, 1, &water, 1, fields > 1 ? of_solids : nullptr, 0.7, {}},
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
    /// A body that is so many cells off the bed.
    void solid(int x, double off = 0) {
        for (int y = 0; y < edge; ++y) {
            const double mass = uplift.full * filled_at(above(x, y) - off);
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
            const double mass = water.full * filled_at(above(x, y));
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

}  // namespace mpm::test
