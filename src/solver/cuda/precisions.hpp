// The simulations on CUDA devices, a unit for each precision: they take the longest to compile.
#pragma once

#include <memory>

#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cuda_single(const Spec& spec, const Plan& plan);
std::unique_ptr<Engine> make_cuda_mixed(const Spec& spec, const Plan& plan);
std::unique_ptr<Engine> make_cuda_double(const Spec& spec, const Plan& plan);

}  // namespace mpm
