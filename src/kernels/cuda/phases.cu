// The parts of the phased step that know no material, on CUDA devices: a block of threads a block
// of cells, a thread a particle, nodes in shared memory. A particle that has drifted so far that it
// reaches beyond the arena goes to the grid itself.
#include "mpm/kernels/cuda/spreading.cuh"
#include "mpm/kernels/phase_ops.hpp"

namespace mpm {

namespace cuda {

namespace {

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

template <int W, bool Splines, class X, class T, int D>
__global__ void __launch_bounds__(most_home_threads, home_blocks<Splines>)
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
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += blockDim.x) {
        int home[D];
        Block<D>::coordinates(pass.body.home_cell(q), home);
        const auto reached = reach<W, Splines>(phase, slot, home, q);
        if (in_arena && fits_arena<W>(reached.at.cell)) {
            collect_particle<NodesOf<Splines>>(
                phase, reached, places_in_arena<NodeArena<D>, W>(reached.at.cell), q,
                [&](int place) { return ArenaNode<G, D>{arena + place}; });
        } else {
            collect_particle(phase, reached, places_in_grid<W>(reached.at.cell), q, [&](int place) {
                return g.velocity + g.velocity_place(neighbours[place >> 8], place & 255);
            });
        }
    }
}

template <class X, class T, int D>
void collect_body(const Phase<X, T, D>& phase) {
    const KernelChoice& choice = phase.n.kernel;
    auto* kernel = kernel_width(choice.kernel) == 3 ? &collect_step<3, false, X, T, D>
                                                    : &collect_step<5, false, X, T, D>;
    if constexpr (may_unroll<typename Pass<X, T, D>::Grid>) {
        if (of_splines(choice)) kernel = &collect_step<3, true, X, T, D>;
    }
    const auto& pass = phase.pass;
    pass.exec->launch(kernel, pass.body.homes, 1, home_threads(pass), phase);
}
template <class X, class T, int D>
void spread_body(const Phase<X, T, D>& phase) {
    spread_with(phase, Particles{});
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
