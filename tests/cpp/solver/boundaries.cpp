// Boundaries where kernels see them, without an engine: their motion at a time, the blocks that
// they touch, and the planes across which nodes read each other.
#include "mpm/solver/boundaries.hpp"

#include <gtest/gtest.h>

#include "mpm/exec/cpu.hpp"
#include "mpm/kernels/sorting.hpp"
#include "support/scene.hpp"

namespace mpm {
namespace {

/// 40 x 24 cells: 5 x 3 blocks of 8.
Spec basin() {
    Spec s = test::empty_scene(2, false, {40, 24}, 0.5);
    s.gravity.time = {0, 2};
    s.gravity.value = {0, 0, 4, -8};
    return s;
}

void add_box(Spec& s, std::vector<int> lower, std::vector<int> upper) {
    BoundarySpec box;
    box.name = "box";
    box.is_box = true;
    box.lower = std::move(lower);
    box.upper = std::move(upper);
    box.present.assign(4, 1);
    box.law.assign(4, {Response::sticky, 0, 0});
    box.end = test::forever;
    s.boundaries.push_back(box);
}

/// Every block of the domain, linked as far as boundaries ask.
struct Whole {
    std::vector<std::uint64_t> keys;
    std::vector<std::int32_t> corners, neighbours;
    BlockTableView<2> table{};

    explicit Whole(const Spec& s) {
        for (int a = 0; a < 2; ++a)
            table.keys_of.counts[a] = s.cells[std::size_t(a)] / Block<2>::edge + 4;
        for (std::int64_t x = 0; x < s.cells[0] / Block<2>::edge; ++x)
            for (std::int64_t y = 0; y < s.cells[1] / Block<2>::edge; ++y)
                keys.push_back(table.keys_of.key({x, y}));
        corners.resize(2 * keys.size());
        neighbours.resize(keys.size() * Block<2>::neighbours);
        table.keys = keys.data();
        table.corners = corners.data();
        table.neighbours = neighbours.data();
        table.slots = std::int32_t(keys.size());
        const LinkBlocks<2> link{table, neighbours.data(), corners.data()};
        for (std::size_t i = 0; i < neighbours.size(); ++i) link(std::int64_t(i));
    }
    std::size_t slot(std::int64_t x, std::int64_t y) const {
        return std::size_t(find_key(keys.data(), table.slots, table.keys_of.key({x, y})));
    }
};

TEST(SurfaceBlocks, a_table_of_all_says_what_a_search_does) {
    SurfaceSpec spec;
    spec.keys = {1, 4, -1, 3, 0, 2, 0, 5};  // blocks (1, 4), (-1, 3), (0, 2), (0, 5)
    spec.place = {0, 2, DistanceField<2>::deep, 1};
    const SurfaceBlocks<2> blocks(spec);
    ASSERT_EQ(blocks.entries(), 12u);
    std::vector<std::uint64_t> keys;
    std::vector<std::int32_t> place;
    blocks.list(spec, keys, place);
    const std::vector<std::int32_t> all = blocks.all(keys, place);
    DistanceField<2> field{keys.data(), place.data(), nullptr, 4, {-1, 2}, {3, 4}, {0.1, 0.2}, 8};
    field.all = all.data();
    for (int k = 0; k < 4; ++k) {
        double centre[2], local[2];
        for (int a = 0; a < 2; ++a)
            centre[a] = field.origin[a] + double(spec.keys[std::size_t(2 * k + a)]) + 0.5;
        EXPECT_EQ(field.find(centre, local), spec.place[std::size_t(k)]) << k;
    }
    int found[3] = {};  // outside, deep, with values
    for (double x = -2.5; x < 3; x += 0.25)
        for (double y = 0.5; y < 7; y += 0.25) {
            const double at[2] = {x, y};
            double local[2][2];
            field.all = nullptr;
            const std::int32_t searched = field.find(at, local[0]);
            field.all = all.data();
            EXPECT_EQ(field.find(at, local[1]), searched) << x << ' ' << y;
            EXPECT_EQ(local[0][0], local[1][0]);
            ++found[searched < 0 ? searched + 2 : 2];
        }
    for (const int n : found) EXPECT_GT(n, 0);
    spec.keys.insert(spec.keys.end(), {600, 600});
    spec.place.push_back(3);
    EXPECT_EQ(SurfaceBlocks<2>(spec).entries(), 0u);
    EXPECT_TRUE(SurfaceBlocks<2>(spec).all(keys, place).empty());
}

TEST(Boundaries, MoveByTheirTablesWhileTheyAct) {
    Cpu exec(1);
    Spec s = basin();
    add_box(s, {16, 8}, {24, 16});
    BoundarySpec& box = s.boundaries.back();
    box.start = 1;
    box.end = 3;
    box.moves = true;
    box.motion.time = {0, 4};
    box.motion.value = {0, 0, 2, -6};
    Boundaries<Cpu, 2> boundaries(exec, s, Plan{});
    Clock clock{};
    for (const double time : {0.5, 1.0, 2.0, 3.0}) {
        clock.time = time;
        exec.single(boundaries.begin_step(&clock));
        const BoundaryRecord<2>& r = boundaries.view().records[0];
        EXPECT_EQ(r.active != 0, time >= 1 && time < 3) << time;
        EXPECT_DOUBLE_EQ(r.velocity[0], 2 * time / 4);
        EXPECT_DOUBLE_EQ(r.velocity[1], -6 * time / 4);
        EXPECT_DOUBLE_EQ(clock.gravity[0], 4 * std::min(time, 2.0) / 2);
        EXPECT_DOUBLE_EQ(clock.gravity[1], -8 * std::min(time, 2.0) / 2);
    }
}

TEST(Boundaries, AreLeftAloneByAClockThatHalts) {
    Cpu exec(1);
    Spec s = basin();
    add_box(s, {16, 8}, {24, 16});
    s.boundaries.back().start = 1;
    Boundaries<Cpu, 2> boundaries(exec, s, Plan{});
    Clock clock{};
    clock.halt = Halt::sort;
    clock.time = 1;
    exec.single(boundaries.begin_step(&clock));
    EXPECT_EQ(clock.gravity[1], 0);
    EXPECT_EQ(boundaries.view().records[0].active, 0);
}

TEST(Boundaries, TouchTheBlocksWhoseNodesTheyMayHold) {
    Cpu exec(1);
    Spec s = basin();
    // Inside of one block, so far from its edge that no other has a node beside it.
    add_box(s, {19, 11}, {21, 13});
    Boundaries<Cpu, 2> boundaries(exec, s, Plan{});
    const Whole all(s);
    boundaries.touch(all.table);
    const auto touched = boundaries.touched().host();
    ASSERT_EQ(touched.size(), all.keys.size());
    for (std::size_t k = 0; k < touched.size(); ++k)
        EXPECT_EQ(touched[k], k == all.slot(2, 1) ? 1u : 0u) << k;
}

TEST(Boundaries, OfALoadCellAreItsFacesAlone) {
    Cpu exec(1);
    Spec s = basin();
    test::add_walls(s, Response::separable);
    SensorSpec load;
    load.kind = SensorKind::load_cell;
    load.boundary = 0;
    load.faces = 1 << 1;  // x+
    s.sensors.push_back(load);
    Boundaries<Cpu, 2> boundaries(exec, s, Plan{});
    const Whole all(s);
    std::vector<std::uint32_t> flag(all.keys.size(), 7);
    boundaries.touch_measured(0, all.table, flag.data());
    boundaries.touch(all.table);
    const auto touched = boundaries.touched().host();
    for (std::int64_t x = 0; x < 5; ++x) {
        for (std::int64_t y = 0; y < 3; ++y) {
            EXPECT_EQ(flag[all.slot(x, y)], x == 4 ? 1u : 0u) << x << " " << y;
            EXPECT_EQ(touched[all.slot(x, y)], x % 4 == 0 || y % 2 == 0 ? 1u : 0u);
        }
    }
}

TEST(Boundaries, MirrorBetweenTheBlocksOnBothSidesOfAWall) {
    Cpu exec(1);
    Spec s = basin();
    test::add_walls(s, Response::slip);
    const BlockKeys<2> keys_of{{5 + 4, 3 + 4}};
    EXPECT_TRUE((Boundaries<Cpu, 2>(exec, s, Plan{}).blocks_together(keys_of).empty()));
    s.boundaries[0].law[0].response = Response::mirror;
    Boundaries<Cpu, 2> boundaries(exec, s, Plan{});
    EXPECT_TRUE(boundaries.has_mirrors());
    EXPECT_FALSE(boundaries.lists());
    EXPECT_TRUE(boundaries.view().mirrors);
    const auto planes = boundaries.blocks_together(keys_of).planes;
    ASSERT_EQ(planes.size(), 1u);
    EXPECT_EQ(planes[0].axis, 0);
    EXPECT_EQ(planes[0].low, -1);
    EXPECT_EQ(planes[0].high, 0);
    s.boundaries[0].within = {0, 0, 1, 1};
    EXPECT_THROW((Boundaries<Cpu, 2>(exec, s, Plan{})), SceneError);
}

TEST(Boundaries, ListNodesByWhatTheyAskForWhereThatStays) {
    Cpu exec(1);
    Spec s = basin();
    test::add_walls(s, Response::slip);
    for (SurfaceLaw& law : s.boundaries[0].law) law.linear = true;
    add_box(s, {16, 8}, {24, 16});  // holds its nodes, and one layer before each face
    const Whole all(s);
    Boundaries<Cpu, 2> boundaries(exec, s, Plan{});
    ASSERT_TRUE(boundaries.lists());
    boundaries.touch(all.table);
    const auto touched = boundaries.touched().host();
    const auto blocks = boundaries.blocks().host();
    const auto asks = boundaries.asks().host();
    const auto lines = boundaries.lines().host();
    ASSERT_EQ(asks.size(), blocks.size() * block_cells);
    std::size_t on_lines = 0, only_held = 0, all_asked = 0;
    for (std::size_t k = 0; k < blocks.size(); ++k) {
        const std::size_t slot = std::size_t(blocks[k]);
        EXPECT_EQ(touched[slot], k + 1);
        for (int n = 0; n < block_cells; ++n) {
            int at[2];
            Block<2>::coordinates(n, at);
            bool line = false;
            int off_box = 0, outside = 0;  // cells from it, and axes on which it is off
            for (int a = 0; a < 2; ++a) {
                const int cell = all.corners[2 * slot + std::size_t(a)] + at[a];
                const int end = int(s.cells[std::size_t(a)]);
                const bool here = cell < 2 || cell >= end - 2;
                const std::size_t i = (k * block_cells + std::size_t(n)) * 2 + std::size_t(a);
                EXPECT_EQ(lines[i] != 0, here) << cell;
                if (here) {
                    const WallLine found = WallLine::unpacked(lines[i]);
                    EXPECT_EQ(found.form, WallLine::linear);
                    EXPECT_EQ(found.sign, cell < 2 ? 1 : -1);
                    EXPECT_EQ(found.place, cell < 2 ? cell : end - 1 - cell);
                    EXPECT_EQ(found.packed(), lines[i]);
                }
                line = line || here;
                const int lower = a == 0 ? 16 : 8, off = std::max(lower - cell, cell - lower - 7);
                outside += off > 0;
                off_box = std::max(off_box, off);
            }
            const bool held = off_box <= 0 || (off_box == 1 && outside == 1);
            const WallAsks wanted = WallAsks((line ? WallNode::on_lines : WallNode::free) |
                                             (held ? WallNode::held : WallNode::free));
            EXPECT_EQ(int(asks[k * block_cells + std::size_t(n)]), int(wanted));
            on_lines += wanted == WallNode::on_lines;
            only_held += wanted == WallNode::held;
            all_asked += wanted == (WallNode::on_lines | WallNode::held);
        }
    }
    const auto lined = boundaries.lined().host();
    ASSERT_EQ(lined.size(), on_lines);
    std::size_t others = 0, beyond = 0;
    for (const LinedNode<2>& piece : lined) {
        const std::size_t slot = std::size_t(piece.slot());
        const std::size_t listed = touched[slot] - 1;
        const std::size_t i = listed * block_cells + std::size_t(piece.number());
        ASSERT_LT(listed, blocks.size());
        EXPECT_EQ(asks[i], WallNode::on_lines);
        int at[2];
        Block<2>::coordinates(piece.number(), at);
        std::int64_t cell[2];
        for (std::size_t a = 0; a < 2; ++a) cell[a] = all.corners[2 * slot + a] + at[a];
        for (int a = 0; a < 2; ++a) {
            EXPECT_EQ(piece.lines[a], lines[i * 2 + std::size_t(a)]);
            const WallLine line = WallLine::unpacked(piece.lines[a]);
            if (line.form == WallLine::none) continue;
            for (int place = -1; place < 2; ++place) {
                const int by = (place - line.place) * line.sign;
                int number = 0, found = 0;
                const std::int32_t of =
                    node_beside<2>(all.table, piece.slot(), cell, a, by, number);
                EXPECT_EQ(piece.beside_along(a, by, found), of);
                EXPECT_EQ(found, number);
                others += place != line.place;
                beyond += of != piece.slot();
            }
        }
    }
    EXPECT_GT(others, beyond);
    EXPECT_GT(beyond, 0u);
    EXPECT_EQ(boundaries.nodes_of(WallPass::held).size(), only_held);
    EXPECT_EQ(boundaries.nodes_of(WallPass::all).size(), all_asked);
    EXPECT_GT(only_held, 0u);

    s.boundaries[1].end = 2;  // one that comes and goes
    Boundaries<Cpu, 2> changing(exec, s, Plan{});
    changing.touch(all.table);
    EXPECT_TRUE(changing.lists());
    EXPECT_EQ(changing.blocks().size(), blocks.size());
    const auto then = changing.asks().host();
    ASSERT_EQ(then.size(), asks.size());
    std::size_t unknown = 0;
    for (std::size_t k = 0; k < then.size(); ++k) {
        int at[2];
        Block<2>::coordinates(int(k % block_cells), at);
        bool near = true;  // 12 cells, beyond what a line looks at
        for (int a = 0; a < 2; ++a) {
            const int cell =
                all.corners[2 * std::size_t(blocks[k / block_cells]) + std::size_t(a)] + at[a];
            near = near && cell >= (a == 0 ? 4 : -4) && cell < (a == 0 ? 36 : 28);
        }
        EXPECT_EQ(then[k] == WallNode::unknown, near);
        if (!near) {
            EXPECT_EQ(int(then[k]), int(asks[k]));
        }
        unknown += near;
    }
    EXPECT_GT(unknown, 0u);
    EXPECT_LT(unknown, then.size());

    s.boundaries[1].law[0].response = Response::mirror;
    EXPECT_THROW((Boundaries<Cpu, 2>(exec, s, Plan{})), SceneError);  // beside linear cells
}

}  // namespace
}  // namespace mpm
