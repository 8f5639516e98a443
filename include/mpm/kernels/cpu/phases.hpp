// CPU driver of the phased step: loops and flush; no formula. Collecting and responding are
// independent particle by particle; spreading goes by colours of blocks that share no node, so that
// no number of threads changes a bit.
#pragma once

#include "mpm/exec/cpu.hpp"
#include "mpm/kernels/respond.hpp"

namespace mpm::cpu {

inline int phase_threads(const Cpu& exec, std::uint32_t particles) {
    return particles > 2048 ? exec.threads() : 1;
}

/// Sorting is due, whatever the drift.
inline void call_for_sort(std::uint64_t* strays) {
    __atomic_store_n(strays, ~std::uint64_t(0), __ATOMIC_RELAXED);
}

/// One by one. Side by side, with fused multiply-add, a particle's last bit came to depend on where
/// its rank stores it (design/number-types.md); the packs of a cell are the same on any rank.
template <class Material, Smoothing S, class T, int D>
void respond_body(const Phase<Cpu, T, D>& phase) {
    const auto& pass = phase.pass;
    if (pass.clock->halt != Halt::none) return;
    const auto numbers =
        phase_numbers<Material>(phase, Material::template constants<T>(phase.pass.parameters));
    const bool due = phase.n.sweeps && pass.clock->step % phase.n.every == 0;
#pragma omp parallel for schedule(static) num_threads(phase_threads(*pass.exec, pass.body.count))
    for (std::uint32_t q = 0; q < pass.body.count; ++q) {
        const auto found = respond_particle<Material, S>(phase, numbers, due, q);
        if (!found.sound)
            Cpu::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
        if (found.far) call_for_sort(pass.strays);
    }
}
template <class Material, Smoothing S, class T, int D>
void rest_body(const Phase<Cpu, T, D>& phase) {
    const auto numbers =
        phase_numbers<Material>(phase, Material::template constants<T>(phase.pass.parameters));
    for (std::uint32_t q = 0; q < phase.pass.body.count; ++q)
        rest_particle<Material, S>(phase, numbers, q);
}
template <class Material, Smoothing S, class T, int D>
void project_body(const Phase<Cpu, T, D>& phase) {
    if (phase.pass.clock->halt != Halt::none) return;
    const auto numbers =
        phase_numbers<Material>(phase, Material::template constants<T>(phase.pass.parameters));
    const std::uint32_t count = phase.pass.body.count;
#pragma omp parallel for schedule(static) num_threads(phase_threads(*phase.pass.exec, count))
    for (std::uint32_t q = 0; q < count; ++q) project_particle<Material, S>(phase, numbers, q);
}

/// Per home block: kinetic, elastic and potential energy.
template <class Material, Smoothing S, class T, int D>
void phase_energies(const Phase<Cpu, T, D>& phase, const std::int32_t* due, double* partial) {
    if (!*due) return;
    const auto& pass = phase.pass;
#pragma omp parallel for schedule(dynamic, 8) num_threads(pass.exec->threads())
    for (std::int32_t h = 0; h < pass.body.homes; ++h) {
        const std::int32_t slot = pass.body.home[h];
        std::int64_t corner[D];
        pass.grid.table.keys_of.block(pass.grid.table.keys[slot], corner);
        for (int a = 0; a < D; ++a) corner[a] *= Block<D>::edge;
        double sum[3] = {};
        for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
            constexpr int R = state_reals<Material, D, S>;
            Vec<T, D> xi;
            T state[R];
            for (int a = 0; a < D; ++a) xi[a] = pass.body.offset[a][q];
            for (int r = 0; r < R; ++r) state[r] = pass.body.state[r][q];
            add_energies_of<Material>(pass, corner, home, xi, speed_squared(phase, q), state, sum);
        });
        for (int e = 0; e < 3; ++e) partial[3 * h + e] = sum[e];
    }
}

/// The phased part of a material's instance.
template <class Material, Smoothing S, class T, int D>
void add_phases(BodyOps<Cpu, T, D>& ops) {
    ops.respond = &respond_body<Material, S, T, D>;
    ops.rest = &rest_body<Material, S, T, D>;
    // Only a second volume is averaged in a transfer of its own.
    if constexpr (S == Smoothing::two_volumes) ops.project = &project_body<Material, S, T, D>;
    ops.phase_energies = &phase_energies<Material, S, T, D>;
    describe_instance<Material, S>(ops);
}

}  // namespace mpm::cpu
