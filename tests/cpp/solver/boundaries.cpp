// Boundaries where kernels see them, without an engine: their motion at a time, the blocks that
// they touch, and the planes across which nodes read each other.
#include "mpm/solver/boundaries.hpp"

#include <gtest/gtest.h>

#include "mpm/exec/cpu.hpp"
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
    BlockTableView<2> table{};

    explicit Whole(const Spec& s) {
        for (int a = 0; a < 2; ++a)
            table.keys_of.counts[a] = s.cells[std::size_t(a)] / Block<2>::edge + 4;
        for (std::int64_t x = 0; x < s.cells[0] / Block<2>::edge; ++x)
            for (std::int64_t y = 0; y < s.cells[1] / Block<2>::edge; ++y)
                keys.push_back(table.keys_of.key({x, y}));
        table.keys = keys.data();
        table.slots = std::int32_t(keys.size());
    }
    std::size_t slot(std::int64_t x, std::int64_t y) const {
        return std::size_t(find_key(keys.data(), table.slots, table.keys_of.key({x, y})));
    }
};

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
    EXPECT_TRUE((Boundaries<Cpu, 2>(exec, s, Plan{}).mirror_planes().empty()));
    s.boundaries[0].law[0].response = Response::mirror;
    Boundaries<Cpu, 2> boundaries(exec, s, Plan{});
    EXPECT_TRUE(boundaries.special());
    EXPECT_TRUE(boundaries.view().mirrors);
    const auto planes = boundaries.mirror_planes();
    ASSERT_EQ(planes.size(), 1u);
    EXPECT_EQ(planes[0].axis, 0);
    EXPECT_EQ(planes[0].low, -1);
    EXPECT_EQ(planes[0].high, 0);
    s.boundaries[0].within = {0, 0, 1, 1};
    EXPECT_THROW((Boundaries<Cpu, 2>(exec, s, Plan{})), SceneError);
}

}  // namespace
}  // namespace mpm
