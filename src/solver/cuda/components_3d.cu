#include "components.cuh"

namespace mpm {

MPM_COMPONENTS(, Cuda, 3)

}  // namespace mpm
