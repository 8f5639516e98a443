// A material that asks to be taken one particle at a time gives what the packs give, to rounding.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "mpm/kernels/cpu/body_pass.hpp"
#include "mpm/physics/material/tait_fluid.hpp"
#include "mpm/solver/added_materials.hpp"
#include "support/scene.hpp"

namespace mpm {
namespace {

struct BranchingFluid : TaitFluid {
    static constexpr const char* name = "BranchingFluid";
    static constexpr bool lane_wise = true;
};
static_assert(lane_wise<BranchingFluid> && !lane_wise<TaitFluid>);

/// What the puddle's step calls, and no other instance of the law.
BodyOps<Cpu, double, 2> branching_ops(Smoothing s) {
    EXPECT_EQ(s, Smoothing::one_volume);
    constexpr Smoothing one = Smoothing::one_volume;
    BodyOps<Cpu, double, 2> ops{};
    ops.fused = &cpu::run_body<BranchingFluid, one, double, 2, cpu::Stage::fused>;
    ops.initial = &cpu::run_body<BranchingFluid, one, double, 2, cpu::Stage::initial>;
    cpu::add_phases<BranchingFluid, one, double, 2>(ops);
    return ops;
}

Spec puddle(const char* material) {
    Spec s;
    s.dimension = 2;
    s.precision = Precision::double_;
    s.threads = 1;
    s.cell_size = 0.1;
    s.cells = {12, 12};
    s.gravity = {{0.0}, {0.0, -9.81}, TableEnd::hold};
    BodySpec b;
    b.name = "water";
    b.material = material;
    b.parameters = {1000, 1e6, 7, 0.001};
    std::vector<double> position;
    for (int i = 0; i < 14; ++i)
        for (int j = 0; j < 10; ++j) {
            position.push_back(0.05 * (i + 0.5));
            position.push_back(0.05 * (j + 0.5));
        }
    b.count = position.size() / 2;
    b.position = rows_of(position, 2);
    b.bounds = {0, 0, 0.7, 0.5};
    b.particle_mass = 1000 * 0.05 * 0.05;
    b.velocity = {0.5, 0.0};
    b.smoothing = SmoothingForm::one_volume_gradient;
    b.smoothing_time = 0.1;
    s.bodies = {b};
    BoundarySpec walls;
    walls.name = "walls";
    walls.present.assign(4, 1);
    walls.law.assign(4, SurfaceLaw{});
    walls.end = 1e300;
    s.boundaries = {walls};
    return s;
}

std::vector<double> run(const Spec& spec) {
    const auto engine = make_cpu_engine(spec);
    EXPECT_EQ(engine->run(400, 1e300, 1e300).reason, "steps");
    const Attributes a = engine->attributes(0, {"position"});
    std::vector<double> by_id(a.values.at("position").data.size());
    for (std::size_t k = 0; k < a.id.size(); ++k)
        for (int c = 0; c < 2; ++c)
            by_id[2 * a.id[k] + c] = a.values.at("position").data[2 * k + c];
    return by_id;
}

TEST(LaneWise, AgreesWithThePacks) {
    add_material(describe_material<BranchingFluid>());
    added_ops<Cpu, double, 2>()[BranchingFluid::name] = branching_ops;
    const Spec s = puddle(TaitFluid::name);
    const auto packs = run(s), alone = run(puddle(BranchingFluid::name));
    double apart = 0, moved = 0;
    const auto start = test::positions(s.bodies[0], 2);
    for (std::size_t k = 0; k < packs.size(); ++k) {
        apart = std::max(apart, std::abs(packs[k] - alone[k]));
        moved = std::max(moved, std::abs(packs[k] - start[k]));
    }
    EXPECT_GT(moved, 0.05);
    EXPECT_LT(apart, 1e-10);
}

}  // namespace
}  // namespace mpm
