// The simulations on the CPU, a unit for each precision: they take long to compile.
#pragma once

#include <memory>

#include "mpm/exec/rank_threads.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

/// One rank, one of several processes, or all of `ranks` as threads of this one.
std::unique_ptr<Engine> make_cpu_single(const Spec& spec, const Plan& plan,
                                        std::unique_ptr<RankThreads>& ranks);
std::unique_ptr<Engine> make_cpu_double(const Spec& spec, const Plan& plan,
                                        std::unique_ptr<RankThreads>& ranks);

}  // namespace mpm
