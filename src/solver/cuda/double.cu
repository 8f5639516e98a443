#include "make_on.cuh"

namespace mpm {

std::unique_ptr<Engine> make_cuda_double(const Spec& spec, const Plan& plan) {
    return make_on<Cuda, double>(spec, plan);
}

}  // namespace mpm
