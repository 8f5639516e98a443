// CUDA: what particles, or vertices of elements, have in scratch goes to the grid. A block of
// threads a block of cells, a thread a particle, sums in shared memory; a particle that has drifted
// so far that it reaches beyond the arena goes to the grid itself.
#pragma once

#include "mpm/kernels/cuda/phases.cuh"
#include "mpm/kernels/transfers.hpp"

namespace mpm::cuda {

/// Strides that keep the lanes of a warp, which hold particles of neighbouring cells, in different
/// banks; channel by channel.
template <int D>
using NodeArena = SumArena<D, 0>;

/// Threads that share a home block: more where its particles are many and homes too few to fill the
/// device.
inline constexpr int most_home_threads = 2 * phase_block;
/// Resident blocks that are asked for: three of 256 threads leave 80 registers to a thread, of
/// which it would take 115 where nodes need no loop.
template <bool Splines>
inline constexpr int home_blocks = Splines ? 3 : 1;
template <class P>
int home_threads(const P& pass) {
    const std::int64_t homes = std::max(pass.body.homes, 1), each = pass.body.count / homes,
                       resident = 1024 * std::int64_t(pass.exec->multiprocessors());
    const bool few = homes * most_home_threads <= resident;
    return few && each > phase_block ? most_home_threads : phase_block;
}

/// Calls f(place in the arena, block among the neighbours, node) for this thread's nodes.
template <int D, class F>
__device__ __forceinline__ void for_my_arena_nodes(const F& f) {
    for (int k = threadIdx.x; k < Block<D>::arena_nodes; k += blockDim.x) {
        int at[D], rest = k, place = 0, neighbour, node;
        MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
            at[a] = rest % Block<D>::arena_edge;
            rest /= Block<D>::arena_edge;
            place += at[a] * NodeArena<D>::stride(a);
        }
        arena_node<D>(at, neighbour, node);
        f(place, neighbour, node);
    }
}

/// In double precision registers do not hold what nodes without a loop need.
template <class G>
inline constexpr bool may_unroll = sizeof(G) == 4;

/// Particles: what they deposit is all in scratch, and told by `respond`.
struct Particles {
    static constexpr bool tell = false;
    /// Deposits are velocities, then the mass, and short enough to stand at every node unrolled.
    static constexpr bool velocities_then_mass = false;
    template <class P, class L>
    __device__ __forceinline__ Particles at(const P&, std::uint32_t, L&) const {
        return {};
    }
    template <class Nodes, class P, class R, class N, class Add>
    __device__ __forceinline__ void spread(const P& phase, const R& reached, const N& places,
                                           std::uint32_t q, const Add& add) const {
        spread_particle(phase, reached, places, q, add);
    }
};

/// Sums are integers: in which order they are added to the arena, and from there to the grid,
/// changes nothing.
template <int W, bool Splines, class X, class T, int D, class Carriers>
__global__ void __launch_bounds__(most_home_threads, home_blocks<Splines>)
    spread_step(const __grid_constant__ Phase<X, T, D> phase,
                const __grid_constant__ Carriers carriers) {
    using G = typename Pass<X, T, D>::Grid;
    using Sum = typename Pass<X, T, D>::Sum;
    constexpr int most = SpreadTargets<D>::most;
    const auto& pass = phase.pass;
    const auto& g = pass.grid;
    if (idle(phase)) return;
    __shared__ alignas(16) Sum arena[most * NodeArena<D>::nodes];
    const SpreadTargets<D> to(phase.n, phase.part, pass.group);
    const int pieces = to.channels * NodeArena<D>::nodes * int(sizeof(Sum)) / int(sizeof(int4));
    static_assert(NodeArena<D>::nodes * sizeof(Sum) % sizeof(int4) == 0);
    for (int k = threadIdx.x; k < pieces; k += blockDim.x)
        reinterpret_cast<int4*>(arena)[k] = int4{};
    const Scales<G, D> scales(pass);
    G scale[most];
    MPM_UNROLL for (int c = 0; c < most; ++c) {
        const auto kind = spread_channel<D>(phase.n, phase.part, c).kind;
        scale[c] = phase.part == Part::vectors
                       ? G(pass.body.particle_mass * pass.clock->sweep_scale)
                   : kind == SpreadChannel::mass    ? scales.mass
                   : kind == SpreadChannel::average ? scales.group
                                                    : scales.momentum;
    }
    const auto fixed = [&](int channel, G amount) {
        if constexpr (Carriers::velocities_then_mass)  // no list to look scales up in
            return to_fixed(amount * (channel == to.channels - 1 ? scales.mass : scales.momentum));
        else
            return to_fixed(amount * scale[channel]);
    };
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const std::int32_t* neighbours = neighbours_of(g.table, slot);
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    const auto to_grid = [&](int channel, int block, int node, Sum x) {
        if (x == 0) return;
        Sum* at = g.sums + std::int64_t(neighbours[block]) * g.sum_channels * block_cells + node;
        add_fixed(at + to.sum[channel] * block_cells, x);
        if (phase.part == Part::step && channel == to.channels - 1 && pass.group.weight >= 0)
            add_fixed(at + pass.group.weight * block_cells, x);
    };
    Largest<G> largest;
    __syncthreads();
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += blockDim.x) {
        int home[D];
        Block<D>::coordinates(pass.body.home_cell(q), home);
        const auto reached = reach<W, Splines>(phase, slot, home, q);
        const auto carrier = carriers.at(phase, q, largest);
        if (fits_arena<W>(reached.at.cell)) {
            carrier.template spread<NodesOf<Splines>>(
                phase, reached, places_in_arena<NodeArena<D>, W>(reached.at.cell), q,
                [&](int channel, int place, G amount) {
                    add_fixed(arena + channel * NodeArena<D>::nodes + place,
                              fixed(channel, amount));
                });
        } else {
            carrier.template spread<ByPlanes>(phase, reached, places_in_grid<W>(reached.at.cell), q,
                                              [&](int channel, int place, G amount) {
                                                  to_grid(channel, place >> 8, place & 255,
                                                          fixed(channel, amount));
                                              });
        }
    }
    if constexpr (Carriers::tell) {
        largest.listen(pass);
        largest.tell(pass);
    }
    __syncthreads();
    for_my_arena_nodes<D>([&](int place, int neighbour, int node) {
        for (int c = 0; c < to.channels; ++c)
            to_grid(c, neighbour, node, arena[c * NodeArena<D>::nodes + place]);
    });
    if (phase.part == Part::step && phase.turns) end_pass(pass);
}

template <class X, class T, int D, class Carriers>
void spread_with(const Phase<X, T, D>& phase, const Carriers& carriers) {
    const KernelChoice& choice = phase.n.kernel;
    auto* kernel = kernel_width(choice.kernel) == 3 ? &spread_step<3, false, X, T, D, Carriers>
                                                    : &spread_step<5, false, X, T, D, Carriers>;
    if constexpr (Carriers::velocities_then_mass && may_unroll<typename Pass<X, T, D>::Grid>) {
        if (of_splines(choice)) kernel = &spread_step<3, true, X, T, D, Carriers>;
    }
    const auto& pass = phase.pass;
    pass.exec->launch(kernel, pass.body.homes, 1, home_threads(pass), phase, carriers);
}

}  // namespace mpm::cuda
