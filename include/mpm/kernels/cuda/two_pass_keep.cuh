// CUDA driver of the two-pass step of schemes that store a velocity (kernels/keep.hpp), in double
// and mixed precision, where the sums of a cell do not fit the registers of one thread: loops; no
// formula. As two_pass.cuh, with the momentum without stress in scratch behind what that has.
#pragma once

#include "mpm/kernels/cuda/keep.cuh"
#include "mpm/kernels/cuda/two_pass.cuh"

namespace mpm::cuda {

template <class G, int D, int C>
struct GatherShared {
    LineArena<G, D, C> lines;
    KeptArena<G, D> nodes;
};

template <class Material, Smoothing S, class X, class T, int D>
__global__ void __launch_bounds__(pass_threads)
    gather_keeping(const __grid_constant__ Pass<X, T, D> pass,
                   const __grid_constant__ typename Material::template Constants<T> constants,
                   const __grid_constant__ KeepNumbers<T> keep) {
    using G = typename Pass<X, T, D>::Grid;
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S> + D;
    extern __shared__ __align__(16) unsigned char memory[];
    auto& shared = *reinterpret_cast<GatherShared<G, D, C>*>(memory);
    after_previous();
    if (pass.clock->halt != Halt::none) return;
    const std::int32_t slot = pass.body.home[blockIdx.x];
    fill<true>(pass, slot, shared.lines, TakeNodes(pass, keep, shared.nodes));
    __syncthreads();
    const auto numbers =
        step_numbers<T, Material>(*pass.numbers, constants, pass.carry, pass.stress_only);
    gather_particles<Material, R>(
        pass, slot,
        [&](const int(&home)[D], Vec<T, D>& xi, T(&state)[R]) {
            return advance_kept<Material, S, T, D>(shared, home, xi, state, numbers, keep);
        },
        [&](std::uint32_t q, const auto& u) {
            const std::size_t n = pass.body.count;
            put_affine<C>(pass.scratch, n, q, u);
            MPM_UNROLL for (int c = 0; c < D; ++c) MPM_UNROLL for (int a = 0; a < D; ++a)
                pass.scratch[Scratch<D>{C}.stress(a, c) * n + q] = u.slope[a][C + c];
        },
        [&](const Vec<T, D>& xi, const auto& u, auto& largest) {
            if (strays_far(xi)) call_for_sort(pass);
            largest.template see<D, C>(part_of<0, C>(u));
            largest.template see<D, D>(part_of<C, D>(u));
        });
}

/// Both halves.
template <class Material, Smoothing S, class X, class T, int D>
void run_two_pass_keeping(const Phase<X, T, D>& phase) {
    constexpr int C = transfer_channels<D, S>;
    const Pass<X, T, D>& pass = phase.pass;
    pass.exec->launch_large(int(sizeof(GatherShared<typename Pass<X, T, D>::Grid, D, C>)),
                            &gather_keeping<Material, S, X, T, D>, pass.body.homes, pass_threads,
                            pass, Material::template constants<T>(pass.parameters),
                            keep_numbers<T>(phase.n));
    scatter_body<X, T, D>(pass, C, phase.n.plain);
}

}  // namespace mpm::cuda
