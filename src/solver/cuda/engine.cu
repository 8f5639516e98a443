// The CUDA engine: picks number type and dimension, and the material's compiled passes.
#include "mpm/exec/cuda.cuh"
#include "mpm/kernels/model_headers.inc"
#include "mpm/solver/domain.hpp"

namespace mpm {

namespace {

template <class T, int D>
std::unique_ptr<Engine> make(const Spec& spec, const Plan& plan) {
    const auto find = [](const std::string& name, Smoothing s) {
#define MPM_MODEL(Model) \
    if (name == Model::name) return body_ops<Cuda, T, D, Model>(s);
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
        throw SceneError("material '" + name + "' has no CUDA form");
    };
    return std::make_unique<Domain<Cuda, T, D>>(spec, plan, Cuda(spec.device), find);
}

}  // namespace

std::unique_ptr<Engine> make_cuda_engine(const Spec& spec) {
    const Plan plan = make_plan(spec, cuda_traits(spec.single));
    if (spec.dimension == 2) {
        return spec.single ? make<float, 2>(spec, plan) : make<double, 2>(spec, plan);
    }
    return spec.single ? make<float, 3>(spec, plan) : make<double, 3>(spec, plan);
}

}  // namespace mpm
