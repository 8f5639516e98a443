#include "mpm/exec/cuda.cuh"
#include "mpm/solver/make_domain.hpp"
#include "mpm/solver/merged.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cuda_engine(const Spec& spec) {
    return make_merged(spec, [](const Spec& s) {
        return make_domain<Cuda>(s, make_plan(s, cuda_traits(s.single)),
                                 [&] { return Cuda(s.device); });
    });
}

}  // namespace mpm
