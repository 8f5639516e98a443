// Ranks of one process, each a thread with an engine of its own, seen from outside as one engine.
#pragma once

#include <memory>
#include <vector>

#include "mpm/exec/rank_threads.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

/// Refuses what is not built for several ranks.
void check_ranks(const Spec& spec, const Plan& plan);
/// The same for ranks on devices, of which each needs one.
void check_devices(const Spec& spec);

/// One engine of many. `engines`: of each rank, made on `ranks` together.
std::unique_ptr<Engine> join_ranks(const Spec& spec, std::unique_ptr<RankThreads> ranks,
                                   std::vector<std::unique_ptr<Engine>> engines);

/// As make_cpu_engine, with ranks that speak to each other through these threads.
std::unique_ptr<Engine> make_cpu_engine(const Spec& spec, std::unique_ptr<RankThreads> ranks);

}  // namespace mpm
