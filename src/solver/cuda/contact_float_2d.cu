#include "grid_passes.cuh"

namespace mpm {

MPM_CONTACT_PASSES_IN(, float, 2)

}  // namespace mpm
