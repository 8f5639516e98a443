// The parts of the phased step that know no material.
#include "mpm/kernels/cpu/spreading.hpp"
#include "mpm/kernels/phase_ops.hpp"

namespace mpm {

namespace cpu {

namespace {

/// Gradients of the dual domain ask which nodes have mass.
template <class T, int D, class S>
void find_gradients(const Phase<Cpu, T, D>&, const std::int32_t*, const Places<D, S::width>&, S&) {}
template <class T, int D>
void find_gradients(const Phase<Cpu, T, D>& phase, const std::int32_t* neighbours,
                    const Places<D, 5>& places, DualStencil<T, D>& stencil) {
    const std::int64_t numbers = std::int64_t(phase.pass.grid.sum_channels) * block_cells;
    stencil.find_gradients([&](const DualNode<D>& node) {
        int place = 0;
        for (int a = 0; a < D; ++a) place += places.part[a][node[a]];
        return phase.masses[neighbours[place >> 8] * numbers + (place & 255)] > T(0);
    });
}

template <class S, class T, int D>
void collect_block(const Phase<Cpu, T, D>& phase, std::int32_t slot) {
    constexpr int W = S::width;
    const auto& g = phase.pass.grid;
    const std::int32_t* neighbours = g.table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
    for_each_of_block<T, D>(phase.pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
        Reached<W, Cpu, T, D, S> reached(phase, slot, home, q);
        const Places<D, W> places = places_in_grid<W>(reached.at.cell);
        if (phase.part == Part::step) find_gradients(phase, neighbours, places, reached.stencil);
        collect_particle(phase, reached, places, q, [&](int place) {
            return g.velocity + g.velocity_place(neighbours[place >> 8], place & 255);
        });
    });
}

template <class S, bool modified, class T, int D>
void spread_block(const Phase<Cpu, T, D>& phase, SpreadArena<T, D, S::width>& arena,
                  std::int32_t slot) {
    constexpr int W = S::width;
    using A = SpreadArena<T, D, W>;
    const auto& pass = phase.pass;
    const auto& g = pass.grid;
    const SpreadTargets<D> to(phase.n, phase.part, pass.group);
    const T m = T(pass.body.particle_mass);
    const std::int64_t row = std::int64_t(slot) * Block<D>::neighbours;
    std::memset(arena.sums, 0, sizeof arena.sums);
    for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
        Reached<W, Cpu, T, D, S> reached(phase, slot, home, q);
        if constexpr (modified) modify_for_deposit(reached.stencil, reached.at.xi);
        if (phase.part == Part::stresses)
            find_gradients(phase, g.table.neighbours + row, places_in_grid<W>(reached.at.cell),
                           reached.stencil);
        spread_particle(
            phase, reached, places_in_arena<A, W, D, A::margin>(reached.at.cell), q,
            [&](int channel, int place, T amount) { arena.sums[place][channel] += m * amount; });
    });
    flush_arena<W>(phase, to, arena, slot);
}

/// Calls f with a stencil of the kernel's kind.
template <class T, int D, class F>
void with_stencil(Kernel kernel, const F& f) {
    if (kernel == Kernel::cpdi)
        f(CornerStencil<T, D>{});
    else if (kernel == Kernel::ddmp)
        f(DualStencil<T, D>{});
    else if (kernel_width(kernel) == 3)
        f(Stencil<T, D, 3>{});
    else
        f(Stencil<T, D, 5>{});
}

template <class T, int D>
void collect_body(const Phase<Cpu, T, D>& phase) {
    if (idle(phase)) return;
    const auto& pass = phase.pass;
    with_stencil<T, D>(phase.n.kernel.kernel, [&](auto stencil) {
        using S = decltype(stencil);
#pragma omp parallel for schedule(dynamic, 4) \
    num_threads(phase_threads(*pass.exec, pass.body.count))
        for (std::int32_t h = 0; h < pass.body.homes; ++h)
            collect_block<S>(phase, pass.body.home[h]);
    });
}

template <class S, bool modified, class T, int D>
void spread_by_colours(const Phase<Cpu, T, D>& phase) {
    for_each_colour<SpreadArena<T, D, S::width>>(phase, [&](auto& arena, std::int32_t slot) {
        spread_block<S, modified>(phase, arena, slot);
    });
}

template <class T, int D>
void spread_body(const Phase<Cpu, T, D>& phase) {
    if (idle(phase)) return;
    if (phase.n.kernel.modified) return spread_by_colours<Stencil<T, D, 3>, true>(phase);
    with_stencil<T, D>(phase.n.kernel.kernel,
                       [&](auto stencil) { spread_by_colours<decltype(stencil), false>(phase); });
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
