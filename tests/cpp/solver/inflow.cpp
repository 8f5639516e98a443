// Inlets and outlets without an engine: layers that are due come once and in order, a refused sort
// leaves the counters alone, and who leaves is listed once, by the way it took.
#include "mpm/solver/inflow.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "mpm/exec/cpu.hpp"
#include "mpm/solver/outflow.hpp"
#include "support/scene.hpp"

namespace mpm {
namespace {

constexpr double spacing = 0.25;

/// Water of 10 particles, fed by three a layer through the face x-.
Spec fed() {
    Spec s = test::empty_scene(2, false, {40, 24}, 0.5);
    BodySpec water;
    water.name = "water";
    water.material = "TaitFluid";
    water.parameters = test::fluid();
    water.count = 10;
    water.id_count = 19;
    water.particle_mass = 62.5;
    s.bodies.push_back(water);
    InletSpec inlet;
    inlet.name = "inlet";
    inlet.body = 0;
    inlet.face = 0;
    inlet.spacing = spacing;
    inlet.points = {0.125, 1.0, 0.125, 1.25, 0.125, 4.5};
    inlet.velocity.time = {0, 1};
    inlet.velocity.value = {0, 2};
    s.inlets.push_back(inlet);
    return s;
}
Plan plan_of(const Spec& s) {
    Plan plan;
    plan.bodies.resize(s.bodies.size());
    plan.time_step = 0.01;
    return plan;
}

TEST(Inflow, LayersComeOnceInOrderAsFarInAsTheirWater) {
    Cpu exec(1);
    const Spec s = fed();
    Inflow<Cpu, 2> inflow(exec, s, plan_of(s));
    Clock clock{};
    clock.time = 0.5;
    clock.step = 42;
    inflow.begin(clock);
    EXPECT_FALSE(inflow.arrives());  // nothing has moved
    inflow.records()[0].moved = 2 * spacing + 0.1;
    inflow.begin(clock);
    ASSERT_EQ(inflow.arrivals().size(), 1u);
    EXPECT_EQ(inflow.arriving(0), 6u);
    const BodySpec& rows = inflow.arrivals()[0].rows;
    EXPECT_EQ(rows.ids, (std::vector<std::uint32_t>{10, 11, 12, 13, 14, 15}));
    const auto x = test::positions(rows, 2);
    for (std::size_t k = 0; k < 6; ++k) {
        EXPECT_NEAR(x[2 * k], 0.125 + (k < 3 ? spacing : 0) + 0.1, 1e-14);  // the older one further
        EXPECT_EQ(x[2 * k + 1], s.inlets[0].points[2 * (k % 3) + 1]);
    }
    EXPECT_DOUBLE_EQ(rows.velocity[0], 1.0);  // of its table, half way up

    // A sort that is refused is asked again, and finds the same.
    inflow.end();
    EXPECT_FALSE(inflow.arrives());
    inflow.begin(clock);
    EXPECT_EQ(inflow.arrivals()[0].rows.ids.front(), 10u);
    const auto flows = inflow.take();
    inflow.end();
    ASSERT_EQ(flows.size(), 1u);
    EXPECT_TRUE(flows[0].inlet);
    EXPECT_EQ(flows[0].step, 42);
    EXPECT_EQ(flows[0].particles, 6u);
    EXPECT_DOUBLE_EQ(flows[0].mass, 6 * 62.5);
    EXPECT_DOUBLE_EQ(flows[0].volume, 6 * 62.5 / 1000);
    EXPECT_DOUBLE_EQ(inflow.records()[0].due, 3 * spacing);
    inflow.begin(clock);
    EXPECT_FALSE(inflow.arrives());

    // The body has room for nine more than its own ten, of which six are there.
    inflow.records()[0].moved = 4 * spacing;
    EXPECT_THROW(inflow.begin(clock), CapacityError);
}

TEST(Inflow, GoesOnWhereASavedStateWas) {
    Cpu exec(1);
    const Spec s = fed();
    Inflow<Cpu, 2> before(exec, s, plan_of(s)), after(exec, s, plan_of(s));
    const Clock clock{};
    before.records()[0].moved = spacing + 0.07;
    before.begin(clock);
    before.take();
    State state;
    before.save(state);
    after.load(state);
    EXPECT_EQ(after.records()[0].moved, before.records()[0].moved);
    EXPECT_EQ(after.records()[0].due, before.records()[0].due);
    after.records()[0].moved = 2 * spacing;
    after.begin(clock);
    EXPECT_EQ(after.arrivals().at(0).rows.ids, (std::vector<std::uint32_t>{13, 14, 15}));
}

TEST(Inflow, CountsTheStepsBeforeTheNextLayer) {
    Cpu exec(1);
    const Spec s = fed();
    Inflow<Cpu, 2> inflow(exec, s, plan_of(s));
    EXPECT_EQ(inflow.steps_to_next(64), 65);
    inflow.records()[0].last = spacing / 10;
    EXPECT_EQ(inflow.steps_to_next(64), 11);
}

TEST(Inflow, MarksTheBlocksOfWhoComes) {
    Cpu exec(1);
    const Spec s = fed();
    Inflow<Cpu, 2> inflow(exec, s, plan_of(s));
    BlockTableView<2> table{};
    table.keys_of.counts[0] = 9;
    table.keys_of.counts[1] = 7;
    const std::vector<std::uint64_t> keys = {table.keys_of.key({0, 0})};  // lacks that of 4.5 m
    table.keys = keys.data();
    table.slots = 1;
    inflow.records()[0].moved = spacing;
    inflow.begin(Clock{});
    Buffer<Cpu, std::uint32_t> occupied(exec), found(exec);
    Buffer<Cpu, std::uint64_t> coming(exec);
    occupied.assign({0});
    found.assign({0});
    inflow.mark(table, occupied, found.data(), coming);
    EXPECT_EQ(occupied.host()[0], 1u);
    EXPECT_EQ(found.host()[0], 1u);
    EXPECT_EQ(coming.host(),
              (std::vector<std::uint64_t>{table.keys_of.key({0, 0}), table.keys_of.key({0, 1})}));
}

Leaver<2> leaver(std::uint32_t place, int x, int y) {
    Leaver<2> who{};
    who.place = place;
    who.id = 100 + place;
    who.cell[0] = x;
    who.cell[1] = y;
    who.position[0] = 0.5 * x;
    who.position[1] = 0.5 * y;
    return who;
}

TEST(Outflow, ListsEachOnceByTheWayItTook) {
    Spec s = test::empty_scene(2, false, {40, 24}, 0.5);
    s.leaving = Leaving::freeze;
    s.outlets = {{"out", 1}, {"top", 3}};  // x+, y+
    Outflow<2> outflow(s);
    EXPECT_FALSE(outflow.stops());
    // Through x+; through both, which counts for the first; elsewhere; through y+.
    const auto ways = outflow.ways(
        1, 1000, 7, {leaver(2, 40, 3), leaver(4, 40, 24), leaver(5, -1, 2), leaver(9, 8, 24)});
    ASSERT_EQ(ways.size(), 3u);
    EXPECT_EQ(ways[0].place, (std::vector<std::uint32_t>{2, 4}));
    EXPECT_EQ(ways[1].place, (std::vector<std::uint32_t>{9}));
    EXPECT_EQ(ways[2].place, (std::vector<std::uint32_t>{5}));
    EXPECT_FALSE(outflow.freezes(ways[0]));
    EXPECT_TRUE(outflow.freezes(ways[2]));
    EXPECT_TRUE(outflow.removed().empty());  // nothing has changed yet

    const auto flows = outflow.take(ways, 0.5, 7, {{1, 1}, {2, 0.5}});
    ASSERT_EQ(flows.size(), 2u);
    EXPECT_EQ(flows[0].particles, 2u);
    EXPECT_DOUBLE_EQ(flows[0].mass, 4);
    EXPECT_DOUBLE_EQ(flows[0].volume, 1);
    EXPECT_EQ(flows[1].number, 1);
    const auto removed = outflow.removed();
    ASSERT_EQ(removed.size(), 3u);
    EXPECT_EQ(removed[0].policy, "outflow:out");
    EXPECT_EQ(removed[2].policy, "freeze");
    EXPECT_EQ(removed[2].ids, (std::vector<std::uint64_t>{1105}));
    EXPECT_EQ(removed[2].position.shape, (std::vector<std::size_t>{1, 2}));
    EXPECT_EQ(removed[2].position.data, (std::vector<double>{-0.5, 1}));
    EXPECT_TRUE(outflow.removed().empty());
}

}  // namespace
}  // namespace mpm
