// From a spec and a plan to a simulation on the executor X, with the material's compiled passes.
// The one place where the list of materials meets the solver.
#pragma once

#include "mpm/kernels/model_headers.inc"
#include "mpm/solver/added_materials.hpp"
#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_scene.hpp"
#include "mpm/solver/ranks.hpp"

namespace mpm {

template <class X, class T, int D>
BodyOps<X, T, D> find_body_ops(const std::string& name, Smoothing s) {
#define MPM_MODEL(Model) \
    if (name == Model::name) return body_ops<X, T, D, Model>(s);
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
    const auto& added = added_ops<X, T, D>();
    if (const auto found = added.find(name); found != added.end()) return found->second(s);
    throw SceneError("material '" + name + "' has no form for this backend");
}

/// With particles in T and D dimensions. `make_executor()` is called once, for the simulation that
/// it will own.
template <class X, class T, int D, class MakeExecutor>
std::unique_ptr<Engine> make_domain(const Spec& spec, const Plan& plan,
                                    const MakeExecutor& make_executor) {
    return std::make_unique<Domain<X, T, D>>(spec, plan, make_executor(), find_body_ops<X, T, D>);
}

/// As many simulations as the scene has ranks, seen as one. `make_executor(rank)` is called once
/// for each, on its thread.
template <class X, class T, int D, class MakeExecutor>
std::unique_ptr<Engine> make_ranks(const Spec& scene, const Plan& plan,
                                   std::unique_ptr<RankThreads> ranks,
                                   const MakeExecutor& make_executor) {
    std::vector<std::unique_ptr<Engine>> engines(std::size_t(ranks->ranks()));
    RankScenes<D> scenes(scene);
    ranks->together([&](int r) {
        const RankLink<D> link{&ranks->of(r), scenes.partition, scene.ranks.rebalance_above};
        engines[std::size_t(r)] = std::make_unique<Domain<X, T, D>>(
            scenes.spec[std::size_t(r)], plan, make_executor(r), find_body_ops<X, T, D>, link);
    });
    return join_ranks(scene, std::move(ranks), std::move(engines));
}

/// The part of the scene that this process has, seen as all of it. `make_executor()` is called
/// once.
template <class X, class T, int D, class MakeExecutor>
std::unique_ptr<Engine> make_rank(const Spec& scene, const Plan& plan,
                                  std::shared_ptr<Communicator> processes,
                                  const MakeExecutor& make_executor) {
    return join_processes(scene, processes, [&]() -> std::unique_ptr<Engine> {
        const int rank = processes->rank();
        RankScenes<D> scenes(scene, rank);
        const RankLink<D> link{processes.get(), scenes.partition, scene.ranks.rebalance_above};
        return std::make_unique<Domain<X, T, D>>(scenes.spec[std::size_t(rank)], plan,
                                                 make_executor(), find_body_ops<X, T, D>, link);
    });
}

}  // namespace mpm
