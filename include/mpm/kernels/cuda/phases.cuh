// CUDA driver of the phased step: the material's part, a thread a particle. No formula here.
#pragma once

#include "mpm/kernels/cuda/arena.cuh"
#include "mpm/kernels/respond.hpp"

namespace mpm::cuda {

inline constexpr int phase_block = 128;

/// The largest deposits that the threads of a warp have found, to the clock.
template <class P, class G>
__device__ __forceinline__ void tell_largest(const P& pass, G momentum, G average) {
    Largest<G> largest;
    largest.momentum = as_bits(momentum);
    largest.group = as_bits(average);
    largest.listen(pass);
    largest.tell(pass);
}

template <class Material, Smoothing S, class X, class T, int D>
__global__ void __launch_bounds__(phase_block)
    respond_step(const __grid_constant__ Phase<X, T, D> phase,
                 const __grid_constant__ typename Material::template Constants<T> constants) {
    const auto& pass = phase.pass;
    if (pass.clock->halt != Halt::none) return;
    const auto numbers = phase_numbers<Material>(phase, constants);
    const bool due = phase.n.sweeps && pass.clock->step % phase.n.every == 0;
    const std::uint32_t q = blockIdx.x * phase_block + threadIdx.x;
    Responded<typename Pass<X, T, D>::Grid> found{true, false, 0, 0};
    if (q < pass.body.count) {
        found = respond_particle<Material, S>(phase, numbers, due, q);
        if (!found.sound) {
            Cuda::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
            found.momentum = found.average = 0;
        }
        if (found.far) call_for_sort(pass);
    }
    tell_largest(pass, found.momentum, found.average);
}

template <class Material, Smoothing S, class X, class T, int D>
__global__ void __launch_bounds__(phase_block)
    rest_step(const __grid_constant__ Phase<X, T, D> phase,
              const __grid_constant__ typename Material::template Constants<T> constants) {
    const auto numbers = phase_numbers<Material>(phase, constants);
    const std::uint32_t q = blockIdx.x * phase_block + threadIdx.x;
    Responded<typename Pass<X, T, D>::Grid> found{true, false, 0, 0};
    if (q < phase.pass.body.count) found = rest_particle<Material, S>(phase, numbers, q);
    tell_largest(phase.pass, found.momentum, found.average);
}

template <class Material, Smoothing S, class X, class T, int D>
__global__ void __launch_bounds__(phase_block)
    project_step(const __grid_constant__ Phase<X, T, D> phase,
                 const __grid_constant__ typename Material::template Constants<T> constants) {
    if (phase.pass.clock->halt != Halt::none) return;
    const auto numbers = phase_numbers<Material>(phase, constants);
    const std::uint32_t q = blockIdx.x * phase_block + threadIdx.x;
    typename Pass<X, T, D>::Grid size = 0;
    if (q < phase.pass.body.count)
        size = absolute(project_particle<Material, S>(phase, numbers, q));
    tell_largest(phase.pass, size * 0, size);
}

/// One block of threads a home block, in a fixed order, so that the bits never change.
template <class Material, Smoothing S, class X, class T, int D>
__global__ void __launch_bounds__(phase_block)
    sum_phase_energies(const __grid_constant__ Phase<X, T, D> phase, const std::int32_t* due,
                       double* partial) {
    constexpr int R = state_reals<Material, D, S>;
    if (!*due) return;
    const auto& pass = phase.pass;
    __shared__ double parts[3][phase_block];
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    std::int64_t corner[D];
    pass.grid.table.keys_of.block(pass.grid.table.keys[slot], corner);
    MPM_UNROLL for (int a = 0; a < D; ++a) corner[a] *= Block<D>::edge;
    double sum[3] = {};
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += phase_block) {
        int home[D];
        Block<D>::coordinates(pass.body.home_cell(q), home);
        Vec<T, D> xi;
        T state[R];
        load(pass.body, q, xi, state);
        add_energies_of<Material>(pass, corner, home, xi, speed_squared(phase, q), state, sum);
    }
    add_in_order(parts, sum, partial + 3 * std::int64_t(blockIdx.x));
}

template <class X, class T, int D>
std::int64_t phase_blocks(const Phase<X, T, D>& phase) {
    return (std::int64_t(phase.pass.body.count) + phase_block - 1) / phase_block;
}
template <class Material, Smoothing S, class X, class T, int D>
void run_respond(const Phase<X, T, D>& phase) {
    phase.pass.exec->launch(&respond_step<Material, S, X, T, D>, phase_blocks(phase), 1,
                            phase_block, phase,
                            Material::template constants<T>(phase.pass.parameters));
}
template <class Material, Smoothing S, class X, class T, int D>
void run_rest(const Phase<X, T, D>& phase) {
    phase.pass.exec->launch(&rest_step<Material, S, X, T, D>, phase_blocks(phase), 1, phase_block,
                            phase, Material::template constants<T>(phase.pass.parameters));
}
template <class Material, Smoothing S, class X, class T, int D>
void run_project(const Phase<X, T, D>& phase) {
    phase.pass.exec->launch(&project_step<Material, S, X, T, D>, phase_blocks(phase), 1,
                            phase_block, phase,
                            Material::template constants<T>(phase.pass.parameters));
}
template <class Material, Smoothing S, class X, class T, int D>
void run_phase_energies(const Phase<X, T, D>& phase, const std::int32_t* due, double* partial) {
    phase.pass.exec->launch(&sum_phase_energies<Material, S, X, T, D>, phase.pass.body.homes, 1,
                            phase_block, phase, due, partial);
}

/// The phased part of a material's instance.
template <class Material, Smoothing S, class X, class T, int D>
void add_phases(BodyOps<X, T, D>& ops) {
    ops.respond = &run_respond<Material, S, X, T, D>;
    ops.rest = &run_rest<Material, S, X, T, D>;
    // Only a second volume is averaged in a transfer of its own.
    if constexpr (S == Smoothing::two_volumes) ops.project = &run_project<Material, S, X, T, D>;
    ops.phase_energies = &run_phase_energies<Material, S, X, T, D>;
    describe_instance<Material, S>(ops);
}

}  // namespace mpm::cuda
