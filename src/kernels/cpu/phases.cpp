// The parts of the phased step that know no material.
#include "mpm/kernels/cpu/phases.hpp"
#include "mpm/kernels/phase_ops.hpp"
#include "mpm/kernels/transfers.hpp"

namespace mpm {

namespace cpu {

namespace {

template <int W, class T, int D>
void collect_block(const Phase<Cpu, T, D>& phase, std::int32_t slot) {
    const auto& g = phase.pass.grid;
    const std::int32_t* neighbours = g.table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
    for_each_of_block<T, D>(phase.pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
        const Reached<W, Cpu, T, D> reached(phase, slot, home, q);
        collect_particle(phase, reached, places_in_grid<W>(reached.at.cell), q, [&](int place) {
            return g.velocity + g.velocity_place(neighbours[place >> 8], place & 255);
        });
    });
}

/// Sums of one block's particles go straight to the grid.
template <int W, bool modified, class T, int D>
void spread_block(const Phase<Cpu, T, D>& phase, std::int32_t slot) {
    const auto& pass = phase.pass;
    const auto& g = pass.grid;
    const SpreadTargets<D> to(phase.n, phase.part, pass.group);
    const bool weighs = phase.part == Part::step && pass.group.weight >= 0;
    const T m = T(pass.body.particle_mass);
    const std::int32_t* neighbours = g.table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
    for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
        Reached<W, Cpu, T, D> reached(phase, slot, home, q);
        if constexpr (modified) modify_for_deposit(reached.stencil, reached.at.xi);
        const auto add = [&](int channel, int place, T amount) {
            T* sums = g.sums + std::int64_t(neighbours[place >> 8]) * g.sum_channels * block_cells +
                      (place & 255);
            sums[to.sum[channel] * block_cells] += m * amount;
            if (weighs && channel == to.channels - 1)
                sums[pass.group.weight * block_cells] += m * amount;
        };
        spread_particle(phase, reached, places_in_grid<W>(reached.at.cell), q, add);
    });
}

template <class T, int D>
void collect_body(const Phase<Cpu, T, D>& phase) {
    if (idle(phase)) return;
    const auto& pass = phase.pass;
    const bool narrow = kernel_width(phase.n.kernel.kernel) == 3;
#pragma omp parallel for schedule(dynamic, 4) \
    num_threads(phase_threads(*pass.exec, pass.body.count))
    for (std::int32_t h = 0; h < pass.body.homes; ++h) {
        if (narrow)
            collect_block<3>(phase, pass.body.home[h]);
        else
            collect_block<5>(phase, pass.body.home[h]);
    }
}

template <class T, int D>
void spread_body(const Phase<Cpu, T, D>& phase) {
    const auto& pass = phase.pass;
    if (idle(phase)) return;
    const int threads = phase_threads(*pass.exec, pass.body.count);
    const bool narrow = kernel_width(phase.n.kernel.kernel) == 3;
    for (int colour = 0; colour < pass.colours; ++colour) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads)
        for (std::int32_t k = pass.colour_start[colour]; k < pass.colour_start[colour + 1]; ++k) {
            if (phase.n.kernel.modified)
                spread_block<3, true>(phase, pass.coloured[k]);
            else if (narrow)
                spread_block<3, false>(phase, pass.coloured[k]);
            else
                spread_block<5, false>(phase, pass.coloured[k]);
        }
    }
}

}  // namespace

}  // namespace cpu

template <class T, int D>
PhaseOps<Cpu, T, D> cpu_phase_ops() {
    return {&cpu::collect_body<T, D>, &cpu::spread_body<T, D>};
}
template <>
PhaseOps<Cpu, float, 2> phase_ops<Cpu, float, 2>() {
    return cpu_phase_ops<float, 2>();
}
template <>
PhaseOps<Cpu, float, 3> phase_ops<Cpu, float, 3>() {
    return cpu_phase_ops<float, 3>();
}
template <>
PhaseOps<Cpu, double, 2> phase_ops<Cpu, double, 2>() {
    return cpu_phase_ops<double, 2>();
}
template <>
PhaseOps<Cpu, double, 3> phase_ops<Cpu, double, 3>() {
    return cpu_phase_ops<double, 3>();
}

}  // namespace mpm
