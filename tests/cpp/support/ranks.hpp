// What tests of several ranks compare with one, and a scene with something of everything.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "mpm/kernels/tally.hpp"
#include "mpm/solver/engine.hpp"
#include "support/scene.hpp"

namespace mpm::test {

/// Axis -1: bricks.
inline Spec with_ranks(Spec s, int ranks, int axis = -1, double rebalance_above = 1.05) {
    s.threads = ranks;
    s.ranks.count = ranks;
    s.ranks.axis = axis;
    s.ranks.rebalance_above = rebalance_above;
    return s;
}

/// Each rank on the one device that there is (support/slow_device.hpp).
inline Spec on_devices(Spec s, int ranks, int axis = -1, double rebalance_above = 1.05) {
    s = with_ranks(std::move(s), ranks, axis, rebalance_above);
    s.ranks.devices.assign(std::size_t(ranks), 0);
    return s;
}

inline RunResult go(Engine& e, std::int64_t steps) { return e.run(steps, forever, forever); }

/// Water with F-bar that runs under two solid blocks that fall, fast enough to cross the cuts.
inline Spec gauged_scene(int dimension, bool single) {
    Spec s = test::busy_scene(dimension, single);
    s.bodies[0].velocity[0] = 5;
    const bool flat = s.dimension == 2;
    SensorSpec gauge;
    gauge.name = "gauge";
    gauge.kind = SensorKind::wave_gauge;
    gauge.interval = 0.004;
    gauge.axis = s.dimension - 1;
    gauge.position = flat ? std::vector<double>{2.43, 0} : std::vector<double>{0.63, 0.7, 0};
    gauge.body = 0;
    s.sensors.push_back(gauge);
    SensorSpec probe = gauge;
    probe.name = "probe";
    probe.kind = SensorKind::velocity_probe;
    probe.position[std::size_t(s.dimension - 1)] = 0.31;
    s.sensors.push_back(probe);
    SensorSpec sums;
    sums.name = "sums";
    sums.kind = SensorKind::tally;
    sums.interval = 0.003;
    const std::vector<double> none(std::size_t(s.dimension), 0.0);
    for (const auto& [body, of] :
         {std::pair(0, TallyOf::von_mises), std::pair(0, TallyOf::velocity),
          std::pair(1, TallyOf::motion), std::pair(1, TallyOf::spin)}) {
        TallySpec t;
        t.body = body;
        t.first = s.bodies[std::size_t(body)].first_id;
        t.count = s.bodies[std::size_t(body)].count;
        t.of = int(of);
        t.origin = t.up = t.reference = none;
        sums.tallies.push_back(t);
    }
    s.sensors.push_back(sums);
    return s;
}

/// Everything that can be read of the particles, by id; and no id twice.
inline void expect_same_particles(Engine& many, Engine& one, int bodies) {
    EXPECT_EQ(many.step(), one.step());
    EXPECT_EQ(many.time(), one.time());
    EXPECT_EQ(many.time_step(), one.time_step());
    for (int b = 0; b < bodies; ++b) {
        const auto x = test::table(many, b), y = test::table(one, b);
        ASSERT_EQ(many.attributes(b, {"mass"}).id.size(), x.size()) << "an id is there twice";
        ASSERT_EQ(many.particle_count(b), one.particle_count(b));
        EXPECT_TRUE(x == y) << "body " << b;
    }
}

/// What all particles store, by id.
inline std::map<std::uint64_t, std::vector<double>> stored_by_id(Engine& e, int body) {
    const Attributes a = e.attributes(body, {"state"});
    const std::vector<double>& all = a.values.at("state").data;
    const std::size_t width = all.size() / a.id.size();
    std::map<std::uint64_t, std::vector<double>> out;
    for (std::size_t k = 0; k < a.id.size(); ++k)
        out[a.id[k]].assign(all.begin() + std::ptrdiff_t(k * width),
                            all.begin() + std::ptrdiff_t((k + 1) * width));
    return out;
}
inline void expect_same_states(Engine& many, Engine& one, int bodies) {
    expect_same_particles(many, one, bodies);
    for (int b = 0; b < bodies; ++b)
        EXPECT_TRUE(stored_by_id(many, b) == stored_by_id(one, b)) << b;
}

/// What smoothing over cells has done, to rounding: energies are sums of ranks.
inline void expect_same_smoothing(Engine& many, Engine& one, int bodies, double share) {
    for (int b = 0; b < bodies; ++b) {
        const SmoothingHistory x = many.smoothing(b), y = one.smoothing(b);
        ASSERT_EQ(x.rows.size(), y.rows.size()) << b;
        for (std::size_t k = 0; k < x.rows.size(); ++k) {
            EXPECT_EQ(x.rows[k].time, y.rows[k].time);
            EXPECT_NEAR(x.rows[k].before, y.rows[k].before, share * y.rows[k].before);
            EXPECT_NEAR(x.rows[k].change, y.rows[k].change, share * y.rows[k].before);
        }
    }
}

/// To the bit, but for energies: sums over ranks to `rounding` of the largest.
inline void expect_same_samples(std::vector<Samples> many, std::vector<Samples> one,
                                const Spec& scene, double rounding = 1e-11) {
    ASSERT_EQ(many.size(), one.size());
    for (std::size_t k = 0; k < one.size(); ++k) {
        EXPECT_EQ(many[k].time, one[k].time);
        ASSERT_EQ(many[k].values.data.size(), one[k].values.data.size());
        const bool exact = scene.sensors[k].kind != SensorKind::energy;
        double size = 0;
        for (double v : one[k].values.data) size = std::max(size, std::abs(v));
        for (std::size_t i = 0; i < one[k].values.data.size(); ++i)
            ASSERT_NEAR(many[k].values.data[i], one[k].values.data[i], exact ? 0 : rounding * size)
                << scene.sensors[k].name << " value " << i;
    }
}

}  // namespace mpm::test
