#include "components.hpp"

namespace mpm {

MPM_COMPONENTS_OF_ALL(, Cpu)
MPM_COMPONENTS(, Cpu, 2)

}  // namespace mpm
