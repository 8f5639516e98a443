#include "mpm/kernels/cuda/tally_laws.cuh"

namespace mpm {

MPM_TALLIES(, Cuda, double)
MPM_TALLIES(, CudaMixed, double)

}  // namespace mpm
