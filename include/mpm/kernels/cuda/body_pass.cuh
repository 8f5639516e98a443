// CUDA passes over a body's particles, as the solver knows them.
#pragma once

#include "mpm/kernels/cuda/fused.cuh"
#include "mpm/kernels/cuda/lone.cuh"
#include "mpm/kernels/cuda/two_pass.cuh"

namespace mpm::cuda {

template <class Material, Smoothing S, class X, class T, int D>
BodyOps<X, T, D> instance() {
    constexpr int C = transfer_channels<D, S>;
    BodyOps<X, T, D> ops{};
    // In double precision the sums of a cell do not fit the registers of one thread.
    if constexpr (std::is_same_v<T, float>) {
        ops.fused = &run_fused<Material, S, D>;
        ops.lone = &run_lone<Material, S, D>;
    }
    ops.gather = &run_gather<Material, S, X, T, D>;
    ops.scatter = &run_scatter<X, T, D, C>;
    ops.initial = &run_initial<Material, S, X, T, D>;
    ops.energies = &run_energies<Material, S, X, T, D>;
    ops.state_columns = state_reals<Material, D, S>;
    ops.channels = C;
    ops.observe = &Material::template observe<D>;
    return ops;
}

}  // namespace mpm::cuda

namespace mpm {

template <class X, class T, int D, class Material>
BodyOps<X, T, D> cuda_body_ops(Smoothing s) {
    if constexpr (Material::volumetric) {
        if (s == Smoothing::one_volume)
            return cuda::instance<Material, Smoothing::one_volume, X, T, D>();
        if (s == Smoothing::two_volumes)
            return cuda::instance<Material, Smoothing::two_volumes, X, T, D>();
    }
    return cuda::instance<Material, Smoothing::none, X, T, D>();
}

}  // namespace mpm
