// What faults say, without an engine.
#include "mpm/solver/faults.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "support/scene.hpp"

namespace mpm {
namespace {

struct Failed {
    Spec spec = test::empty_scene(2, false, {40, 24}, 0.5);
    Plan plan;
    Clock clock{};
    FailedParticle particle{1007, {0.25, -0.5}, {0.01}};
    int asked = 0;

    Failed() {
        BodySpec water;
        water.name = "water";
        water.material = "TaitFluid";
        spec.bodies = {water, water};
        plan.bodies.resize(2);
        plan.bodies[1].name = "sea";
        clock.step = 12;
        clock.fault = FaultKind::particle;
        clock.fault_particle = (std::uint64_t(1) << 40) + 7;
    }
    Fault said() {
        asked = 0;
        return describe_fault<2>(spec, plan, clock, [&](std::size_t body, std::size_t place) {
            ++asked;
            EXPECT_EQ(body, 1u);
            EXPECT_EQ(place, 7u);
            return particle;
        });
    }
};

TEST(Faults, NameTheParticleTheStepThatHurtItAndWhatItIs) {
    Failed f;
    Fault said = f.said();
    EXPECT_EQ(said.body, "sea");
    EXPECT_EQ(said.ids, (std::vector<std::uint64_t>{1007}));
    EXPECT_EQ(said.step, 11);  // found by the step after
    EXPECT_EQ(said.code, "compressed");
    EXPECT_EQ(said.value, 0.01);
    f.particle.offset[1] = -2;
    said = f.said();
    EXPECT_EQ(said.code, "outran-cell");
    EXPECT_EQ(said.value, 2);
    // Whatever else it did: a number that is none comes first.
    f.particle.state[0] = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(f.said().code, "non-finite");
    EXPECT_EQ(f.asked, 1);
}

TEST(Faults, OfNodesAndOtherRanksAskForNoParticle) {
    Failed f;
    f.clock.fault_particle = fault_elsewhere;
    EXPECT_TRUE(f.said().body.empty());
    EXPECT_EQ(f.asked, 0);
    f.clock.fault = FaultKind::outran;
    f.clock.fault_value = 30;
    EXPECT_EQ(f.said().code, "outran-cell");
    EXPECT_EQ(f.said().step, 12);
    f.clock.fault_value = std::numeric_limits<double>::infinity();
    EXPECT_EQ(f.said().code, "non-finite");
    f.clock.fault = FaultKind::crowded;
    EXPECT_EQ(f.said().code, "crowded-node");
    EXPECT_EQ(f.asked, 0);
}

TEST(Faults, GrowthBeginsAfterTheLastStepThatWasSlow) {
    Clock clock{};
    const double speeds[] = {1, 50, 2, 40, 90};
    for (int k = 0; k < 5; ++k) {
        clock.log_step[k] = 10 * k;
        clock.log_speed[k] = speeds[k];
    }
    clock.log_count = 5;
    clock.speed = 100;
    EXPECT_EQ(growth_start(clock), 20);
    clock.speed = 5;
    EXPECT_EQ(growth_start(clock), 0);
}

}  // namespace
}  // namespace mpm
