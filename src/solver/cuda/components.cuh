// Components without a precision are compiled in components*.cu.
#pragma once

#include "mpm/exec/cuda.cuh"
#include "mpm/solver/components.hpp"

namespace mpm {

MPM_COMPONENTS_OF_ALL(extern, Cuda)
MPM_COMPONENTS(extern, Cuda, 2)
MPM_COMPONENTS(extern, Cuda, 3)

}  // namespace mpm
