#include "grid_passes.cuh"

namespace mpm {

MPM_GRID_PASSES(, double)

}  // namespace mpm
