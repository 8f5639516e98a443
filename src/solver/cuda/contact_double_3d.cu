#include "grid_passes.cuh"

namespace mpm {

MPM_CONTACT_PASSES_IN(, double, 3)

}  // namespace mpm
