#include "mpm/kernels/cuda/tally_laws.cuh"

namespace mpm {

int law_number(const std::string& name) {
    int number = 0, found = -1;
#define MPM_MODEL(Model)                     \
    if (name == Model::name) found = number; \
    ++number;
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
    return found;
}

MPM_TALLIES(, Cuda, float)

}  // namespace mpm
