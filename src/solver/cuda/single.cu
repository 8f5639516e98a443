#include "make_on.cuh"

namespace mpm {

std::unique_ptr<Engine> make_cuda_single(const Spec& spec, const Plan& plan) {
    return make_on<Cuda, float>(spec, plan);
}

}  // namespace mpm
