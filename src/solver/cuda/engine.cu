#include "mpm/exec/cuda.cuh"
#include "mpm/solver/make_domain.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cuda_engine(const Spec& spec) {
    return make_domain<Cuda>(spec, make_plan(spec, cuda_traits(spec.single)),
                             [&] { return Cuda(spec.device); });
}

}  // namespace mpm
