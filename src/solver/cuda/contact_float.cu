#include "grid_passes.cuh"

namespace mpm {

MPM_CONTACT_PASSES(, float)

}  // namespace mpm
