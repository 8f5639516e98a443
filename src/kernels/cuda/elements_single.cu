#include "mpm/kernels/cuda/elements_for.cuh"

namespace mpm {

MPM_ELEMENTS_ON(Cuda, float, 2)
MPM_ELEMENTS_ON(Cuda, float, 3)

}  // namespace mpm
