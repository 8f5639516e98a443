// CUDA passes over a body's particles, as the solver knows them.
#pragma once

#include "mpm/kernels/cuda/fused.cuh"
#include "mpm/kernels/cuda/keep.cuh"
#include "mpm/kernels/cuda/lone.cuh"
#include "mpm/kernels/cuda/phases.cuh"
#include "mpm/kernels/cuda/split.cuh"
#include "mpm/kernels/cuda/two_pass_keep.cuh"

namespace mpm::cuda {

template <class Material, Smoothing S, class X, class T, int D>
BodyOps<X, T, D> instance() {
    constexpr int C = transfer_channels<D, S>;
    BodyOps<X, T, D> ops{};
    // In double precision the sums of a cell do not fit the registers of one thread.
    if constexpr (std::is_same_v<T, float>) {
        // Devices before compute capability 8 have no barriers in shared memory: there alone the
        // other form runs in three dimensions.
        if constexpr (D == 3) {
            ops.split = &run_split<Material, S>;
            if constexpr (fuses_memory<Material>) ops.split_keep = &run_split_keeping<Material, S>;
            ops.pairs = pairs_fit<Material, S, NothingKept> &&
                        (!fuses_memory<Material> || pairs_fit<Material, S, KeepNumbers<float>>);
        }
        if constexpr (D == 3 && built_from(800))
            ops.fused = ops.split;
        else
            ops.fused = &run_fused<Material, S, D>;
        ops.lone = &run_lone<Material, S, D>;
        if constexpr (D == 3 && built_from(800))
            ops.keep = ops.split_keep;
        else if constexpr (fuses_memory<Material>)
            ops.keep = &run_keeping<Material, S, D>;
    } else if constexpr (fuses_memory<Material>) {
        ops.keep = &run_two_pass_keeping<Material, S, X, T, D>;
    }
    ops.gather = &run_gather<Material, S, X, T, D>;
    ops.scatter = &run_scatter<X, T, D, C>;
    ops.initial = &run_initial<Material, S, X, T, D>;
    ops.energies = &run_energies<Material, S, X, T, D>;
    add_phases<Material, S, X, T, D>(ops);
    return ops;
}

}  // namespace mpm::cuda

namespace mpm {

template <class X, class T, int D, class Material>
BodyOps<X, T, D> cuda_body_ops(Smoothing s) {
    const auto make = [&]<Smoothing S>() {
        if constexpr (has_fused_form<Material>) {
            return cuda::instance<Material, S, X, T, D>();
        } else {
            BodyOps<X, T, D> ops{};
            cuda::add_phases<Material, S, X, T, D>(ops);
            return ops;
        }
    };
    if constexpr (smoothable<Material, D>) {
        if (s == Smoothing::one_volume) return make.template operator()<Smoothing::one_volume>();
        if (s == Smoothing::two_volumes) return make.template operator()<Smoothing::two_volumes>();
    }
    return make.template operator()<Smoothing::none>();
}

}  // namespace mpm
