#include "mpm/exec/cuda.cuh"
#include "mpm/solver/make_domain.hpp"
#include "mpm/solver/merged.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cuda_engine(const Spec& spec) {
    if (spec.ranks.count != 1)
        throw SceneError("several ranks are not built for CUDA; take one device");
    return make_merged(spec, [](const Spec& s) {
        const Plan plan = make_plan(s, cuda_traits(s.precision));
        const auto executor = [&] { return Cuda(s.device, s.shared_device); };
        if (s.precision == Precision::mixed) {
            return make_domain<CudaMixed, double>(
                s, plan, [&] { return CudaMixed(s.device, s.shared_device); });
        }
        return s.precision == Precision::single ? make_domain<Cuda, float>(s, plan, executor)
                                                : make_domain<Cuda, double>(s, plan, executor);
    });
}

}  // namespace mpm
