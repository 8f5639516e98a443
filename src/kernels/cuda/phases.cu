// The parts of the phased step that know no material, on CUDA devices: a block of threads a block
// of cells, a thread a particle, nodes in shared memory. A particle that has drifted so far that it
// reaches beyond the arena goes to the grid itself.
#include "mpm/kernels/cuda/phases.cuh"
#include "mpm/kernels/phase_ops.hpp"
#include "mpm/kernels/transfers.hpp"

namespace mpm {

namespace cuda {

namespace {

/// Strides that keep the lanes of a warp, which hold particles of neighbouring cells, in different
/// banks; channel by channel.
template <int D>
using NodeArena = SumArena<D, 0>;

/// Calls f(place in the arena, block among the neighbours, node) for this thread's nodes.
template <int D, class F>
__device__ __forceinline__ void for_my_arena_nodes(const F& f) {
    for (int k = threadIdx.x; k < Block<D>::arena_nodes; k += phase_block) {
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

/// A node's velocities in an arena.
template <class G, int D>
struct ArenaNode {
    const G* at;
    __device__ __forceinline__ G operator[](int channel) const {
        return at[channel * NodeArena<D>::nodes];
    }
};

/// Channels of velocities that an arena has room for; scenes with more read the grid.
inline constexpr int arena_channels = 8;

template <int W, class X, class T, int D>
__global__ void __launch_bounds__(phase_block)
    collect_step(const __grid_constant__ Phase<X, T, D> phase) {
    using G = typename Pass<X, T, D>::Grid;
    const auto& pass = phase.pass;
    if (idle(phase)) return;
    const auto& g = pass.grid;
    __shared__ G arena[arena_channels * NodeArena<D>::nodes];
    const bool in_arena = g.velocity_channels <= arena_channels;
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const std::int32_t* neighbours = neighbours_of(g.table, slot);
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    if (in_arena) {
        for_my_arena_nodes<D>([&](int place, int neighbour, int node) {
            const G* from = g.velocity + g.velocity_place(neighbours[neighbour], node);
            for (int c = 0; c < g.velocity_channels; ++c)
                arena[c * NodeArena<D>::nodes + place] = from[c];
        });
        __syncthreads();
    }
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += phase_block) {
        int home[D];
        Block<D>::coordinates(pass.body.cell[q], home);
        const Reached<W, X, T, D> reached(phase, slot, home, q);
        if (in_arena && fits_arena<W>(reached.at.cell)) {
            collect_particle(phase, reached, places_in_arena<NodeArena<D>, W>(reached.at.cell), q,
                             [&](int place) { return ArenaNode<G, D>{arena + place}; });
        } else {
            collect_particle(phase, reached, places_in_grid<W>(reached.at.cell), q, [&](int place) {
                return g.velocity + g.velocity_place(neighbours[place >> 8], place & 255);
            });
        }
    }
}

/// Sums are integers: in which order they are added to the arena, and from there to the grid,
/// changes nothing.
template <int W, class X, class T, int D>
__global__ void __launch_bounds__(phase_block)
    spread_step(const __grid_constant__ Phase<X, T, D> phase) {
    using G = typename Pass<X, T, D>::Grid;
    using Sum = typename Pass<X, T, D>::Sum;
    constexpr int most = SpreadTargets<D>::most;
    const auto& pass = phase.pass;
    const auto& g = pass.grid;
    if (idle(phase)) return;
    __shared__ Sum arena[most * NodeArena<D>::nodes];
    const SpreadTargets<D> to(phase.n, phase.part, pass.group);
    for (int k = threadIdx.x; k < to.channels * NodeArena<D>::nodes; k += phase_block) arena[k] = 0;
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
    __syncthreads();
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += phase_block) {
        int home[D];
        Block<D>::coordinates(pass.body.cell[q], home);
        const Reached<W, X, T, D> reached(phase, slot, home, q);
        if (fits_arena<W>(reached.at.cell)) {
            spread_particle(phase, reached, places_in_arena<NodeArena<D>, W>(reached.at.cell), q,
                            [&](int channel, int place, G amount) {
                                add_fixed(arena + channel * NodeArena<D>::nodes + place,
                                          to_fixed(amount * scale[channel]));
                            });
        } else {
            spread_particle(phase, reached, places_in_grid<W>(reached.at.cell), q,
                            [&](int channel, int place, G amount) {
                                to_grid(channel, place >> 8, place & 255,
                                        to_fixed(amount * scale[channel]));
                            });
        }
    }
    __syncthreads();
    for_my_arena_nodes<D>([&](int place, int neighbour, int node) {
        for (int c = 0; c < to.channels; ++c)
            to_grid(c, neighbour, node, arena[c * NodeArena<D>::nodes + place]);
    });
    if (phase.part == Part::step && phase.turns) end_pass(pass);
}

template <class X, class T, int D>
void collect_body(const Phase<X, T, D>& phase) {
    auto* const kernel = kernel_width(phase.n.kernel.kernel) == 3 ? &collect_step<3, X, T, D>
                                                                  : &collect_step<5, X, T, D>;
    phase.pass.exec->launch(kernel, phase.pass.body.homes, 1, phase_block, phase);
}
template <class X, class T, int D>
void spread_body(const Phase<X, T, D>& phase) {
    auto* const kernel = kernel_width(phase.n.kernel.kernel) == 3 ? &spread_step<3, X, T, D>
                                                                  : &spread_step<5, X, T, D>;
    phase.pass.exec->launch(kernel, phase.pass.body.homes, 1, phase_block, phase);
}

}  // namespace

}  // namespace cuda

template <class X, class T, int D>
PhaseOps<X, T, D> cuda_phase_ops() {
    return {&cuda::collect_body<X, T, D>, &cuda::spread_body<X, T, D>};
}
template <>
PhaseOps<Cuda, float, 2> phase_ops<Cuda, float, 2>() {
    return cuda_phase_ops<Cuda, float, 2>();
}
template <>
PhaseOps<Cuda, float, 3> phase_ops<Cuda, float, 3>() {
    return cuda_phase_ops<Cuda, float, 3>();
}
template <>
PhaseOps<Cuda, double, 2> phase_ops<Cuda, double, 2>() {
    return cuda_phase_ops<Cuda, double, 2>();
}
template <>
PhaseOps<Cuda, double, 3> phase_ops<Cuda, double, 3>() {
    return cuda_phase_ops<Cuda, double, 3>();
}
template <>
PhaseOps<CudaMixed, double, 2> phase_ops<CudaMixed, double, 2>() {
    return cuda_phase_ops<CudaMixed, double, 2>();
}
template <>
PhaseOps<CudaMixed, double, 3> phase_ops<CudaMixed, double, 3>() {
    return cuda_phase_ops<CudaMixed, double, 3>();
}

}  // namespace mpm
