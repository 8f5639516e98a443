// CPU driver of the passes over a body's particles: loops, arenas, lanes and flush; no formula.
//
// One worker owns one block at a time. It expands the velocities that the block's particles can
// reach into an arena, walks the cells, and takes the particles of a cell a pack at a time: lanes
// share the cell's nodes, so what is gathered is broadcast and each lane adds to sums of its own
// that are added up once a cell. Particles that have left the cell they were sorted into go one by
// one through the same formulae with a scalar number type. Blocks of one colour share no node, so
// the order of additions, and with it every bit, is independent of the number of threads.
#pragma once

#include <memory>

#include "mpm/kernels/cpu/arena.hpp"
#include "mpm/kernels/cpu/phases.hpp"
#include "mpm/kernels/keep.hpp"

namespace mpm::cpu {

/// What one block's pass does: the whole step, or one half of the two-pass form, or the first
/// deposit.
enum class Stage { fused, gather, scatter, initial };

/// `keeps`: the particles store velocities (kernels/keep.hpp).
template <class Material, Smoothing S, class T, int D, Stage stage, bool keeps = false>
struct BlockPass {
    static_assert(!keeps || stage == Stage::fused);
    static constexpr int C = transfer_channels<D, S>;
    static constexpr int E = keeps ? C + D : C;  // of a deposit, without the mass
    static constexpr int R = state_reals<Material, D, S> + (keeps ? D : 0);
    static constexpr int W = lanes<T>;
    using V = Pack<T, W>;
    using P = Pass<Cpu, T, D>;
    using Numbers = StepNumbers<T, Material>;
    using A = std::conditional_t<keeps, KeepArena<T, D, C>, Arena<T, D, C>>;
    struct Nothing {};
    using Keep = std::conditional_t<keeps, KeepNumbers<T>, Nothing>;
    static constexpr bool reads = stage == Stage::fused || stage == Stage::gather;
    static constexpr bool adds = stage != Stage::gather;

    const P& pass;
    const Numbers& numbers;
    A& arena;
    const Keep keep{};

    template <class N>
    MPM_INLINE void load(std::uint32_t q, Vec<N, D>& xi, N (&state)[R]) const {
        MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = load_from<N>(pass.body.offset[a] + q);
        MPM_UNROLL for (int r = 0; r < R; ++r) state[r] = load_from<N>(pass.body.state[r] + q);
    }
    template <class N>
    MPM_INLINE static N load_from(const T* p) {
        if constexpr (std::is_same_v<N, T>)
            return *p;
        else
            return N::load(p);
    }

    /// What a particle deposits, carried between the halves of the two-pass form: value and slopes
    /// by channel.
    template <class N>
    MPM_INLINE void load_deposit(std::uint32_t q, Affine<N, D, C>& u) const {
        const std::size_t n = pass.body.count;
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            u.value[c] = load_from<N>(pass.scratch + c * n + q);
            MPM_UNROLL for (int a = 0; a < D; ++a) u.slope[a][c] =
                load_from<N>(pass.scratch + (C + a * C + c) * n + q);
        }
    }
    MPM_INLINE void store_deposit(std::uint32_t q, const Affine<T, D, C>& u) const {
        const std::size_t n = pass.body.count;
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            pass.scratch[c * n + q] = u.value[c];
            MPM_UNROLL for (int a = 0; a < D; ++a) pass.scratch[(C + a * C + c) * n + q] =
                u.slope[a][c];
        }
    }

    /// The step of particles that stand in `cell`; xi is relative to that cell's centre.
    template <class N>
    MPM_INLINE Affine<N, D, E> advance(std::uint32_t q, const int (&cell)[D], Vec<N, D>& xi,
                                       N (&state)[R]) const {
        if constexpr (keeps) {
            const ArenaLines<T, D, C> lines{&arena.line[0][0][0][0]};
            const ArenaNodes<T, D> nodes{arena.node};
            return advance_keeping<Material, S, N, D>(
                lines, stencil_origin<ArenaLines<T, D, C>>(cell), nodes,
                stencil_origin<ArenaNodes<T, D>>(cell), xi, state, numbers, keep);
        } else if constexpr (reads) {
            const int origin = stencil_origin<ArenaLines<T, D, C>>(cell);
            const ArenaLines<T, D, C> lines{&arena.line[0][0][0][0]};
            return advance_particle<Material, S, N, D>(lines, origin, xi, state, numbers);
        } else if constexpr (stage == Stage::scatter) {
            Affine<N, D, C> u;
            load_deposit<N>(q, u);
            return u;
        } else {
            Vec<N, D> v;
            MPM_UNROLL for (int a = 0; a < D; ++a) v[a] =
                load_from<N>(pass.scratch + a * std::size_t(pass.body.count) + q);
            return resting_particle<Material, S, N, D>(v, state, numbers);
        }
    }

    MPM_INLINE void report(std::uint32_t q) const {
        Cpu::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
    }

    /// A particle that is, or comes to be, outside its home cell.
    MPM_INLINE void deposit_alone(const int (&home)[D], const Vec<T, D>& xi,
                                  const Affine<T, D, E>& u) const {
        int cell[D];
        Vec<T, D> local;
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const int shift = cell_shift(xi[a]);
            cell[a] = home[a] + shift;
            local[a] = xi[a] - T(shift);
        }
        ArenaSums<T, D, E> sums{arena.sums[stencil_origin<ArenaSums<T, D, E>>(cell)]};
        scatter<T, D, E, keeps>(sums, quadratic_weights<T, D>(local), T(1), u);
    }

    MPM_INLINE void step_alone(const int (&home)[D], std::uint32_t q) const {
        Vec<T, D> xi;
        T state[R];
        load<T>(q, xi, state);
        int cell[D], shift[D];
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            shift[a] = cell_shift(xi[a]);
            cell[a] = home[a] + shift[a];
            if constexpr (reads) xi[a] -= T(shift[a]);
        }
        const Affine<T, D, E> u = advance<T>(q, cell, xi, state);
        if constexpr (reads) {
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                xi[a] += T(shift[a]);
                pass.body.offset[a][q] = xi[a];
            }
            MPM_UNROLL for (int r = 0; r < R; ++r) pass.body.state[r][q] = state[r];
            if (!sound<Material>(xi, state)) return report(q);
            if constexpr (keeps) {
                if (strays_far(xi)) call_for_sort(pass.strays);
            }
        }
        if constexpr (stage == Stage::gather) store_deposit(q, u);
        if constexpr (adds) deposit_alone(home, xi, u);
    }

    /// One for all instruction sets: a copy in each was a quarter of what a law takes to compile
    /// (design/build.md). Where there are packs only particles that have left their cell come here.
    MPM_HOST_CALL void alone(const int (&home)[D], std::uint32_t q) const { step_alone(home, q); }

    MPM_INLINE static Affine<T, D, E> lane(const Affine<V, D, E>& u, int l) {
        Affine<T, D, E> out;
        MPM_UNROLL for (int c = 0; c < E; ++c) {
            out.value[c] = u.value[c][l];
            MPM_UNROLL for (int a = 0; a < D; ++a) out.slope[a][c] = u.slope[a][c][l];
        }
        return out;
    }

    MPM_INLINE void together(const int (&home)[D], std::uint32_t q, int count,
                             CellSums<V, D, E>& sums) const {
        using Mask = MaskOf<V>;
        Vec<V, D> xi;
        V state[R];
        load<V>(q, xi, state);
        const Mask present = Mask::first(count);
        const Mask before = present & in_cell(xi);
        // Lanes without a particle of this cell compute on harmless numbers and write nothing.
        MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = select(before, xi[a], V(T(0)));
        MPM_UNROLL for (int r = 0; r < R; ++r) state[r] = select(before, state[r], V(T(0)));
        Affine<V, D, E> u = advance<V>(q, home, xi, state);
        Mask inside = before;
        if constexpr (reads) {
            const bool whole = count == W && all(before);
            if (whole) {
                MPM_UNROLL for (int a = 0; a < D; ++a) xi[a].store(pass.body.offset[a] + q);
                MPM_UNROLL for (int r = 0; r < R; ++r) state[r].store(pass.body.state[r] + q);
            } else {
                for (int l = 0; l < count; ++l) {
                    if (!before[l]) continue;
                    MPM_UNROLL for (int a = 0; a < D; ++a) pass.body.offset[a][q + l] = xi[a][l];
                    MPM_UNROLL for (int r = 0; r < R; ++r) pass.body.state[r][q + l] = state[r][l];
                }
            }
            const Mask good = sound<Material>(xi, state);
            if (any(before & !good)) {
                for (int l = 0; l < count; ++l)
                    if (before[l] && !good[l]) report(q + l);
                inside = inside & good;
            }
            if constexpr (keeps) {
                if (any(inside & strays_far(xi))) call_for_sort(pass.strays);
            }
            const Mask still = in_cell(xi);
            if constexpr (adds) {
                if (any(inside & !still)) {
                    for (int l = 0; l < count; ++l) {
                        if (!inside[l] || still[l]) continue;
                        Vec<T, D> x;
                        MPM_UNROLL for (int a = 0; a < D; ++a) x[a] = xi[a][l];
                        deposit_alone(home, x, lane(u, l));
                    }
                }
            }
            if constexpr (stage == Stage::gather) {
                for (int l = 0; l < count; ++l)
                    if (before[l]) store_deposit(q + l, lane(u, l));
            }
            inside = inside & still;
        }
        if constexpr (adds) {
            V unit = V(T(1));
            if (!all(inside)) {
                unit = select(inside, unit, V(T(0)));
                MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = select(inside, xi[a], V(T(0)));
                MPM_UNROLL for (int c = 0; c < E; ++c) {
                    u.value[c] = select(inside, u.value[c], V(T(0)));
                    MPM_UNROLL for (int a = 0; a < D; ++a) u.slope[a][c] =
                        select(inside, u.slope[a][c], V(T(0)));
                }
            }
            scatter<V, D, E, keeps>(sums, quadratic_weights<V, D>(xi), unit, u);
        }
        if (any(present & !before)) {
            for (int l = 0; l < count; ++l)
                if (!before[l]) alone(home, q + l);
        }
    }

    /// `packs`: particles of a cell side by side, in the lanes of packs.
    template <bool packs>
    MPM_INLINE void cell(int number, std::uint32_t begin, std::uint32_t end) const {
        int home[D];
        Block<D>::coordinates(number, home);
        if constexpr (lane_wise<Material>)
            for (std::uint32_t q = begin; q < end; ++q) step_alone(home, q);
        else if constexpr (packs)
            side_by_side(home, begin, end);
        else
            for (std::uint32_t q = begin; q < end; ++q) alone(home, q);
    }

    MPM_INLINE void side_by_side(const int (&home)[D], std::uint32_t begin,
                                 std::uint32_t end) const {
        CellSums<V, D, E> sums;
        if constexpr (adds) {
            MPM_UNROLL for (int n = 0; n < stencil_nodes<D>; ++n) for (int c = 0; c <= E; ++c)
                sums.value[n][c] = V(T(0));
        }
        for (std::uint32_t q = begin; q < end; q += W)
            together(home, q, int(end - q < W ? end - q : W), sums);
        if constexpr (adds) {
            T* at = arena.sums[stencil_origin<ArenaSums<T, D, E>>(home)];
            constexpr int stride = A::stride, group = stride < W ? stride : W;
            const auto node = [&](int n) {
                T* to = at + ArenaSums<T, D, E>::place(n) * stride;
                MPM_UNROLL for (int first = 0; first <= E; first += group) {
                    V parts[W];
                    MPM_UNROLL for (int k = 0; k < W; ++k) {
                        parts[k] = k < group && first + k <= E
                                       ? sums.value[n][first + k <= E ? first + k : 0]
                                       : V(T(0));
                    }
                    const V total = sums_of_lanes(parts);
                    MPM_UNROLL for (int k = 0; k < group; ++k) to[first + k] += total[k];
                }
            };
            if constexpr (keeps) {
                MPM_NO_UNROLL for (int n = 0; n < stencil_nodes<D>; ++n) node(n);
            } else {
                MPM_UNROLL for (int n = 0; n < stencil_nodes<D>; ++n) node(n);
            }
        }
    }

    MPM_INLINE void fill(const std::int32_t* neighbours) const {
        constexpr int edge = Block<D>::arena_edge;
        const auto& g = pass.grid;
        T u[edge][C];
        for_each_run<D>(neighbours, [&](int at, std::int32_t slot, int node, int length) {
            const T* from = g.velocity + g.velocity_place(slot, node);
            for (int k = 0; k < length; ++k) {
                MPM_UNROLL for (int c = 0; c < C; ++c) {
                    u[at % edge + k][c] =
                        from[k * g.velocity_channels + (c < D ? c : pass.group.average)];
                }
                if constexpr (keeps) {
                    const T* of = from + k * g.velocity_channels;
                    for (int a = 0; a < D; ++a) arena.node[at + k][a] = of[keep.before + a];
                    arena.node[at + k][D] = keep.guarded ? of[keep.guard] : T(0);
                }
            }
            if (at % edge + length < edge) return;
            for (int k = 0; k < A::cells; ++k) {
                MPM_UNROLL for (int c = 0; c < C; ++c) {
                    T q[3];
                    expand_line(u[k][c], u[k + 1][c], u[k + 2][c], q);
                    MPM_UNROLL for (int e = 0; e < 3; ++e) arena.line[at / edge][k][e][c] = q[e];
                }
            }
        });
    }

    /// `several`: there may be staged slots among the destinations.
    template <bool several>
    MPM_INLINE void flush(const std::int32_t* destinations) const {
        const auto& g = pass.grid;
        const T whole = T(pass.body.particle_mass);
        for_each_run<D>(destinations, [&](int at, std::int32_t slot, int node, int length) {
            const T m = several && slot >= pass.staged ? T(1) : whole;
            T* to = g.sums + std::int64_t(slot) * g.sum_channels * block_cells + node;
            const auto add = [&](int channel, int from) {
                for (int k = 0; k < length; ++k)
                    to[channel * block_cells + k] += m * arena.sums[at + k][from];
            };
            add(0, E);
            MPM_UNROLL for (int c = 0; c < C; ++c) add(c < D ? 1 + c : pass.group.sum, c);
            if constexpr (keeps) {
                MPM_UNROLL for (int a = 0; a < D; ++a) add(keep.plain + a, C + a);
            }
            if (pass.group.weight >= 0) add(pass.group.weight, E);
        });
    }

    template <bool packs>
    MPM_INLINE void block(std::int32_t slot) const {
        const std::int32_t* neighbours =
            pass.grid.table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
        if constexpr (reads) fill(neighbours);
        if constexpr (adds) std::memset(arena.sums, 0, sizeof(arena.sums));
        const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
        for (int c = 0; c < block_cells; ++c)
            if (start[c] < start[c + 1]) cell<packs>(c, start[c], start[c + 1]);
        if constexpr (adds) {
            const std::int32_t* to = pass.destinations + std::int64_t(slot) * Block<D>::neighbours;
            if (pass.staged == none_staged)
                flush<false>(to);
            else
                flush<true>(to);
        }
    }

    template <bool packs>
    MPM_INLINE static void run(const P& pass, const Numbers& numbers, A& arena, const Keep& keep,
                               std::int32_t slot) {
        BlockPass{pass, numbers, arena, keep}.template block<packs>(slot);
    }
};

/// The instructions that a pass is compiled for besides those of every processor. The first deposit
/// runs once, and the two-pass form is there on the CPU to be compared with the fused one: these
/// are not worth more than one level. Solids that store velocities get two: the third would cost as
/// much to compile as both.
template <class Material, Stage stage, bool keeps = false>
constexpr Levels levels() {
    if (stage == Stage::initial || stage == Stage::gather) return Levels::base;
    return keeps && !Material::volumetric ? Levels::up_to_v3 : Levels::all;
}
template <class B, Levels to>
auto block_runner() {
    return runner<B, to, const typename B::P&, const typename B::Numbers&, typename B::A&,
                  const typename B::Keep&, std::int32_t>();
}

/// Calls block(arena, slot) for the home blocks of a body, colour after colour.
template <class A, class T, int D, class F>
void for_each_block(const Pass<Cpu, T, D>& pass, const F& block) {
    // Below some thousand particles waking the other threads costs more than they save.
    const int threads = pass.body.count > 4096 ? pass.exec->threads() : 1;
#pragma omp parallel num_threads(threads)
    {
        const auto arena = std::make_unique<A>();
        for (int colour = 0; colour < pass.colours; ++colour) {
#pragma omp for schedule(dynamic, 1)
            for (std::int32_t k = pass.colour_start[colour]; k < pass.colour_start[colour + 1]; ++k)
                block(*arena, pass.coloured[k]);
        }
    }
}

template <class Material, class T, int D>
StepNumbers<T, Material> numbers_of(const Pass<Cpu, T, D>& pass) {
    return step_numbers<T, Material>(*pass.numbers,
                                     Material::template constants<T>(pass.parameters), pass.carry,
                                     pass.stress_only);
}

template <class Material, Smoothing S, class T, int D, Stage stage>
void run_body(const Pass<Cpu, T, D>& pass) {
    if (pass.clock->halt != Halt::none) return;
    const auto numbers = numbers_of<Material>(pass);
    using A = Arena<T, D, transfer_channels<D, S>>;
    using B = BlockPass<Material, S, T, D, stage>;
    const auto run = block_runner<B, levels<Material, stage>()>();
    for_each_block<A>(pass,
                      [&](A& arena, std::int32_t slot) { run(pass, numbers, arena, {}, slot); });
}

/// The fused step of schemes that store velocities.
template <class Material, Smoothing S, class T, int D>
void run_keeping(const Phase<Cpu, T, D>& phase) {
    const Pass<Cpu, T, D>& pass = phase.pass;
    if (pass.clock->halt != Halt::none) return;
    const auto numbers = numbers_of<Material>(pass);
    const auto keep = keep_numbers<T>(phase.n);
    using A = KeepArena<T, D, transfer_channels<D, S>>;
    using B = BlockPass<Material, S, T, D, Stage::fused, true>;
    const auto run = block_runner<B, levels<Material, Stage::fused, true>()>();
    for_each_block<A>(pass,
                      [&](A& arena, std::int32_t slot) { run(pass, numbers, arena, keep, slot); });
}

/// Per home block: kinetic, elastic and potential energy.
template <class Material, Smoothing S, class T, int D>
void energies(const Pass<Cpu, T, D>& pass, const std::int32_t* due, double* partial) {
    if (!*due) return;
    const auto numbers = numbers_of<Material>(pass);
    constexpr int C = transfer_channels<D, S>;
#pragma omp parallel num_threads(pass.exec->threads())
    {
        const auto arena = std::make_unique<Arena<T, D, C>>();
#pragma omp for schedule(dynamic, 8)
        for (std::int32_t h = 0; h < pass.body.homes; ++h) {
            const std::int32_t slot = pass.body.home[h];
            const BlockPass<Material, S, T, D, Stage::gather> block{pass, numbers, *arena};
            block.fill(pass.grid.table.neighbours + std::int64_t(slot) * Block<D>::neighbours);
            std::int64_t corner[D];
            pass.grid.table.keys_of.block(pass.grid.table.keys[slot], corner);
            for (int a = 0; a < D; ++a) corner[a] *= Block<D>::edge;
            double sum[3] = {};
            for (int c = 0; c < block_cells; ++c) {
                int home[D];
                Block<D>::coordinates(c, home);
                for (std::uint32_t q = pass.body.cell_start[slot * block_cells + c];
                     q < pass.body.cell_start[slot * block_cells + c + 1]; ++q) {
                    Vec<T, D> xi;
                    T state[state_reals<Material, D, S>];
                    block.template load<T>(q, xi, state);
                    const ArenaLines<T, D, C> lines{&arena->line[0][0][0][0]};
                    add_energies<Material, T, D, C>(pass, lines, corner, home, xi, state, sum);
                }
            }
            for (int e = 0; e < 3; ++e) partial[3 * h + e] = sum[e];
        }
    }
}

/// The second half of the two-pass form, compiled once (src/kernels/cpu/scatter.cpp).
template <class T, int D, Smoothing S>
void scatter_body(const Pass<Cpu, T, D>& pass);

template <class Material, Smoothing S, class T, int D>
BodyOps<Cpu, T, D> instance() {
    BodyOps<Cpu, T, D> ops{};
    ops.fused = &run_body<Material, S, T, D, Stage::fused>;
    ops.gather = &run_body<Material, S, T, D, Stage::gather>;
    ops.scatter = &scatter_body < T, D,
    S == Smoothing::none ? Smoothing::none : Smoothing::one_volume > ;
    ops.initial = &run_body<Material, S, T, D, Stage::initial>;
    ops.energies = &energies<Material, S, T, D>;
    if constexpr (fuses_memory<Material>) ops.keep = &run_keeping<Material, S, T, D>;
    add_phases<Material, S, T, D>(ops);
    return ops;
}

}  // namespace mpm::cpu

namespace mpm {

template <class T, int D, class Material>
BodyOps<Cpu, T, D> cpu_body_ops(Smoothing s) {
    const auto make = [&]<Smoothing S>() {
        // F-bar on solids and rare materials: in the phased step alone.
        constexpr bool all =
            has_fused_form<Material> && (Material::volumetric || S == Smoothing::none);
        if constexpr (all) {
            return cpu::instance<Material, S, T, D>();
        } else {
            BodyOps<Cpu, T, D> ops{};
            cpu::add_phases<Material, S, T, D>(ops);
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
