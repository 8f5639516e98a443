#include "grid_passes.hpp"

namespace mpm {

MPM_GRID_PASSES()

}  // namespace mpm
