#include "make_on.cuh"

namespace mpm {

std::unique_ptr<Engine> make_cuda_mixed(const Spec& spec, const Plan& plan) {
    return make_on<CudaMixed, double>(spec, plan);
}

}  // namespace mpm
