// Components without a precision are compiled in components*.cpp.
#pragma once

#include "mpm/exec/cpu.hpp"
#include "mpm/solver/components.hpp"

namespace mpm {

MPM_COMPONENTS_OF_ALL(extern, Cpu)
MPM_COMPONENTS(extern, Cpu, 2)
MPM_COMPONENTS(extern, Cpu, 3)

}  // namespace mpm
