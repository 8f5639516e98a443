#include "mpm/kernels/cuda/elements_for.cuh"

namespace mpm {

MPM_ELEMENTS_ON(Cuda, double, 2)
MPM_ELEMENTS_ON(Cuda, double, 3)
MPM_ELEMENTS_ON(CudaMixed, double, 2)
MPM_ELEMENTS_ON(CudaMixed, double, 3)

}  // namespace mpm
