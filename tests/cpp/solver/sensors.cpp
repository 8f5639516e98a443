// Sensors without an engine: rings that drain in order and once, a state that goes on where it was,
// the blocks that load cells measure and points read.
#include "mpm/solver/sensors.hpp"

#include <gtest/gtest.h>

#include "mpm/exec/cpu.hpp"
#include "support/scene.hpp"

namespace mpm {
namespace {

/// 40 x 24 cells, 5 x 3 blocks of 8, with an energy sensor and a load cell at the wall x+.
Spec basin() {
    Spec s = test::empty_scene(2, false, {40, 24}, 0.5);
    test::add_walls(s, Response::separable);
    test::add_energy(s, 0.1);
    SensorSpec load;
    load.name = "load";
    load.kind = SensorKind::load_cell;
    load.boundary = 0;
    load.faces = 1 << 1;  // x+
    load.interval = 0.25;
    load.reference = {0, 0};
    s.sensors.push_back(load);
    return s;
}

/// What a pass writes of a sensor that is due.
void fill_row(SensorRecord& r, double time) {
    double* row = open_row(r, time);
    for (int c = 0; c < r.columns; ++c) row[c] = 100 * time + c;
}

TEST(Sensors, DrainTheirRingsInOrderAndOnce) {
    Cpu exec(1);
    Sensors<Cpu, 2> sensors(exec, basin(), Plan{});
    ASSERT_EQ(sensors.count(), 2);
    std::vector<double> times;
    for (int k = 0; k < 5; ++k) {
        times.push_back(0.1 * k);
        fill_row(sensors.records()[0], times.back());
        if (k % 2 == 0) sensors.collect();  // rows wait, in order, while the ring goes on
    }
    const auto rows = sensors.drain();
    ASSERT_EQ(rows.size(), 2u);
    EXPECT_EQ(rows[0].time, times);
    ASSERT_EQ(rows[0].values.shape, (std::vector<std::size_t>{5, 4}));
    for (std::size_t k = 0; k < 5; ++k)
        for (std::size_t c = 0; c < 4; ++c)
            EXPECT_EQ(rows[0].values.data[4 * k + c], 100 * times[k] + double(c));
    EXPECT_TRUE(rows[1].time.empty());
    EXPECT_EQ(rows[1].values.shape, (std::vector<std::size_t>{0, ring_columns(basin(), 1)}));

    const auto again = sensors.drain();
    EXPECT_TRUE(again[0].time.empty());
    EXPECT_EQ(again[0].values.shape, (std::vector<std::size_t>{0, 4}));
}

TEST(Sensors, GoOnWhereASavedStateWas) {
    Cpu exec(1);
    const Spec s = basin();
    Sensors<Cpu, 2> before(exec, s, Plan{});
    Clock clock{};
    before.restore({}, {}, {}, {}, clock);
    before.records()[0].next = 7;
    before.records()[1].last_time = 0.625;
    const auto take = before.take_load(&clock);
    const Int128 sum[3] = {exact(3, take.scale[0]), exact(-4, take.scale[1]),
                           exact(1.0 / 3, take.scale[2])};
    take(0, sum);
    State state;
    before.save(state);

    Spec more = s;
    test::add_energy(more, 0.2);
    Sensors<Cpu, 2> after(exec, more, Plan{});
    clock.time = 1.05;
    after.load(state, clock);
    EXPECT_EQ(after.records()[0].next, 7);
    EXPECT_EQ(after.records()[1].last_time, 0.625);
    EXPECT_EQ(after.records()[2].next, 5);  // begins now
    EXPECT_EQ(after.records()[2].last_time, 1.05);
    State again;
    after.save(again);
    EXPECT_EQ(again["load_impulse"].bytes, state["load_impulse"].bytes);
    // Earlier versions saved one number for each sum.
    State earlier = state;
    earlier["load_impulse"] = detail::to_blob(std::vector<double>{3, -4, 1.0 / 3});
    Sensors<Cpu, 2> before_exact(exec, more, Plan{});
    before_exact.load(earlier, clock);
    State same;
    before_exact.save(same);
    EXPECT_EQ(same["load_impulse"].bytes, state["load_impulse"].bytes);
    // A scene that has fewer sensors is another one.
    Spec fewer = s;
    fewer.sensors.pop_back();
    Sensors<Cpu, 2> other(exec, fewer, Plan{});
    EXPECT_THROW(other.load(state, clock), SceneError);
}

TEST(Sensors, OfWallsMeasureTheNodesOfTheirBlocks) {
    Cpu exec(1);
    const Spec s = basin();
    Boundaries<Cpu, 2> boundaries(exec, s, Plan{});
    Sensors<Cpu, 2> sensors(exec, s, Plan{});
    // Two blocks at the wall, two that are not.
    BlockTableView<2> table{};
    table.keys_of.counts[0] = 9;
    table.keys_of.counts[1] = 7;
    const std::vector<std::uint64_t> keys = {table.keys_of.key({1, 1}), table.keys_of.key({3, 1}),
                                             table.keys_of.key({4, 0}), table.keys_of.key({4, 1})};
    table.keys = keys.data();
    table.slots = 4;
    sensors.measure(table, boundaries, nullptr);
    ASSERT_EQ(sensors.measured().count, 1);
    EXPECT_EQ(sensors.measured().set[0].count, 2 * block_cells);
    EXPECT_EQ(sensors.measured_slots()[0], 2);
    EXPECT_EQ(sensors.measured_slots()[1], 3);
    // Each node counts once among ranks.
    const std::vector<std::uint8_t> counted = {1, 1, 0, 1};
    sensors.measure(table, boundaries, counted.data());
    EXPECT_EQ(sensors.measured().set[0].count, block_cells);
    EXPECT_EQ(sensors.measured_slots()[0], 3);
}

TEST(Sensors, ReadTheBlocksAroundTheirPoints) {
    Cpu exec(1);
    Spec s = test::empty_scene(2, false, {40, 24}, 0.5);
    SensorSpec probe;
    probe.kind = SensorKind::velocity_probe;
    probe.position = {8.0, 6.0};  // node 16, 12: between blocks 1 and 2 along x, inside 1 along y
    s.sensors.push_back(probe);
    Sensors<Cpu, 2> sensors(exec, s, Plan{});
    BlockKeys<2> keys_of{};
    keys_of.counts[0] = 9;
    keys_of.counts[1] = 7;
    EXPECT_EQ(sensors.blocks_of_points(keys_of),
              (std::vector<std::uint64_t>{keys_of.key({1, 1}), keys_of.key({2, 1})}));
    EXPECT_TRUE(sensors.blocks_of_due_points(keys_of).empty());
    sensors.records()[0].due = 1;
    EXPECT_EQ(sensors.blocks_of_due_points(keys_of), sensors.blocks_of_points(keys_of));
}

TEST(Sensors, RefuseIdsThatTheirBodyHasNot) {
    Cpu exec(1);
    Spec s = test::empty_scene(2, false, {40, 24}, 0.5);
    BodySpec water;
    water.name = "water";
    water.material = "TaitFluid";
    water.parameters = test::fluid();
    water.count = 10;
    water.first_id = 5;
    s.bodies.push_back(water);
    SensorSpec track;
    track.name = "track";
    track.kind = SensorKind::tracker;
    track.body = 0;
    track.ids = {14, 5};
    s.sensors.push_back(track);
    Sensors<Cpu, 2> sensors(exec, s, Plan{});
    // By id, ascending; where each goes among the columns.
    EXPECT_EQ(sensors.at(0).ids.host(), (std::vector<std::uint32_t>{0, 9}));
    EXPECT_EQ(sensors.at(0).columns.host(), (std::vector<std::int32_t>{1, 0}));
    s.sensors[0].ids = {15};
    EXPECT_THROW((Sensors<Cpu, 2>(exec, s, Plan{})), SceneError);
}

}  // namespace
}  // namespace mpm
