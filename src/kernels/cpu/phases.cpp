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

/// Kernels whose functions particles find side by side: parallelepipeds and the dual domain are
/// found one by one, as are functions that a deposit modifies.
template <class S>
inline constexpr bool has_lanes = false;
template <class T, int D, int W>
inline constexpr bool has_lanes<Stencil<T, D, W>> = true;

/// Without packs wider instructions change little, and a third level gains a fifth over the second
/// for as much again to compile.
template <class S, bool modified = false>
inline constexpr Levels levels_of = has_lanes<S> && !modified ? Levels::up_to_v3 : Levels::base;

/// The cell's particles may share packs unless its functions are clamped.
template <class T, int D>
MPM_INLINE bool shares_packs(const Phase<Cpu, T, D>& phase, std::int32_t slot,
                             const int (&home)[D]) {
    const std::int32_t* corner = phase.pass.grid.table.corners + std::int64_t(slot) * D;
    bool ends = false;
    MPM_UNROLL for (int a = 0; a < D; ++a) ends =
        ends || phase.n.kernel.near_end(std::int64_t(corner[a]) + home[a], a);
    return !ends;
}

/// Of a cell's particles begin to end: together(row, stencil) for those that stand in it, a pack at
/// a time, alone(q) for the others.
template <int W, class T, int D, class Together, class Alone>
MPM_INLINE void for_each_pack(const Phase<Cpu, T, D>& phase, std::uint32_t begin, std::uint32_t end,
                              const Together& together, const Alone& alone) {
    using Row = PackOfParticles<T, D>;
    using V = typename Row::Number;
    const std::int64_t anywhere[D] = {};
    for (std::uint32_t q = begin; q < end; q += V::lanes) {
        const int count = int(end - q < V::lanes ? end - q : V::lanes);
        const auto present = Row::Mask::first(count);
        Vec<V, D> xi;
        MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = V::load(phase.pass.body.offset[a] + q);
        const auto inside = present & in_cell(xi);
        if (any(inside)) {
            const Row row{phase.pass, q, inside, all(inside)};
            // Lanes without a particle compute on harmless numbers.
            MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = select(inside, xi[a], V(T(0)));
            const auto half =
                half_edges<D>(phase.n, [&](int r) MPM_INLINE_LAMBDA { return row.state(r); });
            auto kernel = phase.n.kernel;
            kernel.clamped = false;
            Stencil<V, D, W> s = stencil_within<W>(kernel, xi, half, anywhere);
            // and weigh nothing.
            if (!row.whole) {
                MPM_UNROLL for (int k = 0; k < W; ++k) {
                    s.weight[0][k] = select(inside, s.weight[0][k], V(T(0)));
                    s.slope[0][k] = select(inside, s.slope[0][k], V(T(0)));
                }
            }
            together(row, s);
        }
        if (any(present & !inside)) {
            for (int l = 0; l < count; ++l)
                if (!inside[l]) alone(q + std::uint32_t(l));
        }
    }
}

/// Calls cell(home, begin, end) for the cells of a block that have particles.
template <class T, int D, class F>
MPM_INLINE void for_each_cell(const BodyView<T, D>& body, std::int32_t slot, const F& cell) {
    const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
    for (int c = 0; c < block_cells; ++c) {
        if (start[c] == start[c + 1]) continue;
        int home[D];
        Block<D>::coordinates(c, home);
        cell(home, start[c], start[c + 1]);
    }
}

template <class S, class T, int D>
struct CollectBlock {
    static constexpr int W = S::width;
    using P = Phase<Cpu, T, D>;

    template <bool packs>
    MPM_INLINE static void run(const P& phase, std::int32_t slot) {
        const auto& g = phase.pass.grid;
        const std::int32_t* neighbours =
            g.table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
        const auto read = [&](int place) MPM_INLINE_LAMBDA {
            return g.velocity + g.velocity_place(neighbours[place >> 8], place & 255);
        };
        const TransferNumbers t = TransferNumbers::of(phase);
        for_each_cell<T, D>(
            phase.pass.body, slot,
            [&](const int(&home)[D], std::uint32_t begin, std::uint32_t end) MPM_INLINE_LAMBDA {
                const auto alone = [&](std::uint32_t q) MPM_INLINE_LAMBDA {
                    Reached<W, Cpu, T, D, S> reached(phase, slot, home, q);
                    const Places<D, W> places = places_in_grid<W>(reached.at.cell);
                    if (phase.part == Part::step)
                        find_gradients(phase, neighbours, places, reached.stencil);
                    collect_particle(phase, reached, places, q, read);
                };
                if constexpr (packs && has_lanes<S>) {
                    if (shares_packs(phase, slot, home)) {
                        const Places<D, W> places = places_in_grid<W>(home);
                        for_each_pack<W>(
                            phase, begin, end,
                            [&](const auto& row, const auto& stencil) MPM_INLINE_LAMBDA {
                                using V = typename PackOfParticles<T, D>::Number;
                                collect_by<V>(phase.n, t, stencil, places, read,
                                              [&](int c, V x)
                                                  MPM_INLINE_LAMBDA { row.set_scratch(c, x); });
                            },
                            alone);
                        return;
                    }
                }
                for (std::uint32_t q = begin; q < end; ++q) alone(q);
            });
    }
};

template <class S, bool modified, class T, int D>
struct SpreadBlock {
    static constexpr int W = S::width;
    using P = Phase<Cpu, T, D>;
    using A = SpreadArena<T, D, W>;

    template <bool packs>
    MPM_INLINE static void run(const P& phase, A& arena, std::int32_t slot) {
        const auto& pass = phase.pass;
        const SpreadTargets<D> to(phase.n, phase.part, pass.group);
        const TransferNumbers t = TransferNumbers::of(phase);
        const T m = T(pass.body.particle_mass);
        const std::int64_t row = std::int64_t(slot) * Block<D>::neighbours;
        std::memset(arena.sums, 0, sizeof arena.sums);
        for_each_cell<T, D>(
            pass.body, slot,
            [&](const int(&home)[D], std::uint32_t begin, std::uint32_t end) MPM_INLINE_LAMBDA {
                const auto alone = [&](std::uint32_t q) MPM_INLINE_LAMBDA {
                    Reached<W, Cpu, T, D, S> reached(phase, slot, home, q);
                    if constexpr (modified) modify_for_deposit(reached.stencil, reached.at.xi);
                    if (phase.part == Part::stresses)
                        find_gradients(phase, pass.grid.table.neighbours + row,
                                       places_in_grid<W>(reached.at.cell), reached.stencil);
                    spread_particle(
                        phase, reached, places_in_arena<A, W, D, A::margin>(reached.at.cell), q,
                        [&](int channel, int place, T amount)
                            MPM_INLINE_LAMBDA { arena.sums[place][channel] += m * amount; });
                };
                if constexpr (packs && has_lanes<S> && !modified) {
                    if (shares_packs(phase, slot, home)) {
                        using Sums = SpreadSums<T, D, W>;
                        using V = typename Sums::V;
                        Sums sums;
                        sums.clear(to.channels);
                        const Places<D, W> nodes = Sums::places();
                        for_each_pack<W>(
                            phase, begin, end,
                            [&](const auto& particles, const auto& stencil) MPM_INLINE_LAMBDA {
                                spread_by<V>(
                                    phase.n, t, stencil, nodes,
                                    [&](int c) MPM_INLINE_LAMBDA { return particles.scratch(c); },
                                    [&](int channel, int node, V amount)
                                        MPM_INLINE_LAMBDA { sums.value[node][channel] += amount; });
                            },
                            alone);
                        sums.bring(arena, places_in_arena<A, W, D, A::margin>(home), m,
                                   to.channels);
                        return;
                    }
                }
                for (std::uint32_t q = begin; q < end; ++q) alone(q);
            });
        flush_arena<W>(phase, to, arena, slot);
    }
};

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
        const auto run =
            runner<CollectBlock<S, T, D>, levels_of<S>, const Phase<Cpu, T, D>&, std::int32_t>();
#pragma omp parallel for schedule(dynamic, 4) \
    num_threads(phase_threads(*pass.exec, pass.body.count))
        for (std::int32_t h = 0; h < pass.body.homes; ++h) run(phase, pass.body.home[h]);
    });
}

template <class S, bool modified, class T, int D>
void spread_by_colours(const Phase<Cpu, T, D>& phase) {
    using A = SpreadArena<T, D, S::width>;
    const auto run = runner<SpreadBlock<S, modified, T, D>, levels_of<S, modified>,
                            const Phase<Cpu, T, D>&, A&, std::int32_t>();
    for_each_colour<A>(phase, [&](A& arena, std::int32_t slot) { run(phase, arena, slot); });
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
