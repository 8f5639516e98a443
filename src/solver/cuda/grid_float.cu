#include "grid_passes.cuh"

namespace mpm {

MPM_GRID_PASSES(, float)
MPM_TURNS()

}  // namespace mpm
