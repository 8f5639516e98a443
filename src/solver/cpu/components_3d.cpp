#include "components.hpp"

namespace mpm {

MPM_COMPONENTS(, Cpu, 3)

}  // namespace mpm
