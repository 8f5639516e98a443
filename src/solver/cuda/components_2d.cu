#include "components.cuh"

namespace mpm {

MPM_COMPONENTS_OF_ALL(, Cuda)
MPM_COMPONENTS(, Cuda, 2)

}  // namespace mpm
