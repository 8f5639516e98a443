// The simulations on the CPU, a unit for each precision and dimension: they take long to compile.
#pragma once

#include <memory>

#include "mpm/exec/rank_threads.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

/// With particles in T and D dimensions: one rank, one of several processes, or all of `ranks` as
/// threads of this one. Instances: those of mpm/solver/cpu_domains.inc.
template <class T, int D>
std::unique_ptr<Engine> make_on_cpu(const Spec& spec, const Plan& plan,
                                    std::unique_ptr<RankThreads>& ranks);

}  // namespace mpm
