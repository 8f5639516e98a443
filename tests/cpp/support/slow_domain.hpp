// How a simulation on the device that is none is made: for the units that compile one, a dimension
// each. Tests take support/slow_engine.hpp.
#pragma once

#include <utility>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/physics/material/fixed_corotated.hpp"
#include "mpm/physics/material/linear_elastic.hpp"
#include "mpm/physics/material/tait_fluid.hpp"
#include "mpm/physics/material/von_mises.hpp"
#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_scene.hpp"
#include "mpm/solver/ranks.hpp"
#include "support/slow_device.hpp"
#include "support/slow_elements.hpp"
#include "support/slow_engine.hpp"

namespace mpm::test {

template <int D>
BodyOps<SlowDevice, float, D> slow_ops_of(const std::string& name, Smoothing s) {
    if (name == FixedCorotated::name) return slow_ops<FixedCorotated, Smoothing::none, D>();
    if (name == LinearElastic::name) return slow_ops<LinearElastic, Smoothing::none, D>();
    if (name != TaitFluid::name) throw Error("the slow device has no " + name);
    if (s == Smoothing::two_volumes) return slow_ops<TaitFluid, Smoothing::two_volumes, D>();
    return s == Smoothing::none ? slow_ops<TaitFluid, Smoothing::none, D>()
                                : slow_ops<TaitFluid, Smoothing::one_volume, D>();
}

template <int D>
std::unique_ptr<Engine> make_slow(const Spec& s, bool reaches) {
    using Slow = Domain<SlowDevice, float, D>;
    BackendTraits traits;
    traits.device = true;
    traits.name = "slow";
    traits.precision = Precision::single;
    const Plan plan = make_plan(s, traits);
    if (s.ranks.count == 1) return std::make_unique<Slow>(s, plan, SlowDevice(), slow_ops_of<D>);
    check_ranks(s);
    check_devices(s);
    auto threads = std::make_unique<RankThreads>(s.ranks.count);
    std::vector<std::unique_ptr<Engine>> engines(std::size_t(s.ranks.count));
    const RankScenes<D> scenes(s);
    threads->together([&](int r) {
        const RankLink<D> link{&threads->of(r), scenes.partition, s.ranks.rebalance_above};
        engines[std::size_t(r)] = std::make_unique<Slow>(scenes.spec[std::size_t(r)], plan,
                                                         SlowDevice(reaches), slow_ops_of<D>, link);
    });
    return join_ranks(s, std::move(threads), std::move(engines));
}

extern template std::unique_ptr<Engine> make_slow<2>(const Spec&, bool);
extern template std::unique_ptr<Engine> make_slow<3>(const Spec&, bool);

}  // namespace mpm::test
