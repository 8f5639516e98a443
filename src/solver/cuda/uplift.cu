#include "grid_passes.cuh"

namespace mpm {

MPM_UPLIFT_PASSES()

}  // namespace mpm
