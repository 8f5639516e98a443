// Ranks, each with an engine of its own, seen from outside as one engine: as threads of one
// process, or one of several processes.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "mpm/exec/rank_threads.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

/// Refuses what is not built for several ranks, on devices or on the CPU.
void check_ranks(const Spec& spec);
/// Where ranks are processes there are as many.
void check_processes(const Spec& spec);
/// Refuses what is not built for ranks on devices, of which each needs one.
void check_devices(const Spec& spec);

/// One engine of many. `engines`: of each rank, made on `ranks` together.
std::unique_ptr<Engine> join_ranks(const Spec& spec, std::unique_ptr<RankThreads> ranks,
                                   std::vector<std::unique_ptr<Engine>> engines);

/// The engine of this process, one of several that all make the same calls. `make`: its own part.
/// Particles, their number and nodes are those of this rank; everything else is of all ranks, and
/// the same on all, but for `save`: the whole state on rank 0, nothing on the others. What is
/// thrown on one rank stops all.
std::unique_ptr<Engine> join_processes(const Spec& spec, std::shared_ptr<Communicator> processes,
                                       const std::function<std::unique_ptr<Engine>()>& make);

/// As make_cpu_engine, with ranks that speak to each other through these threads.
std::unique_ptr<Engine> make_cpu_engine(const Spec& spec, std::unique_ptr<RankThreads> ranks);

}  // namespace mpm
