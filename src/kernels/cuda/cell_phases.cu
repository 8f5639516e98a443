// Smoothing over cells within the phased step, on CUDA devices: a block of threads a block of
// cells, a thread a particle. What particles add to cells goes to the grid itself: those of a warp
// stand in different cells, side by side. What they add to nodes goes by an arena. No formula here.
#include "mpm/kernels/cell_sums.hpp"
#include "mpm/kernels/cuda/phases.cuh"
#include "mpm/kernels/phase_ops.hpp"

namespace mpm {

namespace cuda {

namespace {

inline constexpr int cell_threads = max_threads;

/// Calls f(home cell, particle) for this thread's particles of a home block.
template <class X, class T, int D, class F>
__device__ __forceinline__ void for_my_particles(const Phase<X, T, D>& phase, std::int32_t slot,
                                                 const F& f) {
    const auto& body = phase.pass.body;
    const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += cell_threads) {
        int home[D];
        Block<D>::coordinates(body.home_cell(q), home);
        f(home, q);
    }
}

template <int D>
__device__ __forceinline__ void add_at(const CellTask<D>& task, int column, std::int64_t c,
                                       std::int64_t x) {
    Cuda::add_integer(reinterpret_cast<std::int64_t*>(&task.cells.at(column, c)), x);
}

template <class X, class T, int D>
__global__ void __launch_bounds__(cell_threads)
    add_cells_step(const __grid_constant__ Phase<X, T, D> phase,
                   const __grid_constant__ CellTask<D> task) {
    if (idle(phase)) return;
    const std::int32_t slot = phase.pass.body.home[blockIdx.x];
    for_my_particles(phase, slot, [&](const int(&home)[D], std::uint32_t q) {
        add_to_cells(phase, task, slot, home, q, [&](int column, std::int64_t c, std::int64_t x) {
            add_at(task, column, c, x);
        });
    });
}

/// Sums of this many columns fit an arena; more go to the grid itself.
inline constexpr int node_columns = 4;

template <int W, class X, class T, int D>
__global__ void __launch_bounds__(cell_threads)
    add_nodes_step(const __grid_constant__ Phase<X, T, D> phase,
                   const __grid_constant__ CellTask<D> task) {
    using Arena = SumArena<D, 0>;
    if (idle(phase)) return;
    __shared__ std::int64_t arena[node_columns * Arena::nodes];
    const std::int32_t slot = phase.pass.body.home[blockIdx.x];
    const std::int32_t* neighbours = phase.pass.grid.table.neighbours;
    const int columns = 1 + task.cells.components;
    const bool in_arena = columns <= node_columns;
    if (in_arena) {
        for (int k = threadIdx.x; k < columns * Arena::nodes; k += cell_threads) arena[k] = 0;
        __syncthreads();
    }
    for_my_particles(phase, slot, [&](const int(&home)[D], std::uint32_t q) {
        const Reached<W, X, T, D> reached(phase, slot, home, q);
        if (in_arena && fits_arena<W>(reached.at.cell)) {
            add_to_nodes(phase, task, reached, places_in_arena<Arena, W>(reached.at.cell), q,
                         [&](int column, int place, std::int64_t x) {
                             Cuda::add_integer(arena + column * Arena::nodes + place, x);
                         });
        } else {
            add_to_nodes(phase, task, reached, places_in_grid<W>(reached.at.cell), q,
                         [&](int column, int place, std::int64_t x) {
                             add_at(task, column, cell_number<D>(neighbours, slot, place), x);
                         });
        }
    });
    if (!in_arena) return;
    __syncthreads();
    for (int k = threadIdx.x; k < Block<D>::arena_nodes; k += cell_threads) {
        int at[D], rest = k, place = 0, neighbour, node;
        MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
            at[a] = rest % Block<D>::arena_edge;
            rest /= Block<D>::arena_edge;
            place += at[a] * Arena::stride(a);
        }
        arena_node<D>(at, neighbour, node);
        const std::int64_t c = cell_number<D>(neighbours, slot, neighbour << 8 | node);
        for (int column = 0; column < columns; ++column) {
            const std::int64_t x = arena[column * Arena::nodes + place];
            if (x != 0) add_at(task, column, c, x);
        }
    }
}

/// The threads' sums of a home block, in a fixed order. All threads must come here.
template <class X, class T, int D>
__device__ __forceinline__ void put_energies(const CellTask<D>& task,
                                             double (&sum)[smoothing_sums]) {
    add_up<smoothing_sums>(sum);
    if (threadIdx.x != 0) return;
    double* to = task.energies + std::int64_t(blockIdx.x) * smoothing_sums;
    MPM_UNROLL for (int k = 0; k < smoothing_sums; ++k) to[k] = sum[k];
}

template <class X, class T, int D>
__global__ void __launch_bounds__(cell_threads)
    value_of_cells_step(const __grid_constant__ Phase<X, T, D> phase,
                        const __grid_constant__ CellTask<D> task) {
    if (idle(phase)) return;
    const std::int32_t slot = phase.pass.body.home[blockIdx.x];
    double sum[smoothing_sums] = {};
    for_my_particles(phase, slot, [&](const int(&home)[D], std::uint32_t q) {
        value_of_cells(phase, task, slot, home, q, sum);
    });
    put_energies<X, T, D>(task, sum);
}

template <int W, class X, class T, int D>
__global__ void __launch_bounds__(cell_threads)
    value_of_nodes_step(const __grid_constant__ Phase<X, T, D> phase,
                        const __grid_constant__ CellTask<D> task) {
    if (idle(phase)) return;
    const std::int32_t slot = phase.pass.body.home[blockIdx.x];
    double sum[smoothing_sums] = {};
    for_my_particles(phase, slot, [&](const int(&home)[D], std::uint32_t q) {
        const Reached<W, X, T, D> reached(phase, slot, home, q);
        value_of_nodes(phase, task, reached, slot, q, sum);
    });
    put_energies<X, T, D>(task, sum);
}

template <class X, class T, int D>
void smooth_body(const Phase<X, T, D>& phase, const CellTask<D>& task, CellPeers* peers) {
    const bool narrow = kernel_width(phase.n.kernel.kernel) == 3;
    const auto launch = [&](auto* kernel) {
        phase.pass.exec->launch(kernel, phase.pass.body.homes, 1, cell_threads, phase, task);
    };
    smooth_with_sums(
        phase, task, peers,
        [&] {
            launch(!task.nodal() ? &add_cells_step<X, T, D>
                   : narrow      ? &add_nodes_step<3, X, T, D>
                                 : &add_nodes_step<5, X, T, D>);
        },
        [&] {
            launch(!task.nodal() ? &value_of_cells_step<X, T, D>
                   : narrow      ? &value_of_nodes_step<3, X, T, D>
                                 : &value_of_nodes_step<5, X, T, D>);
        });
}

}  // namespace

}  // namespace cuda

template <>
SmoothCells<Cuda, float, 2> smooth_cells<Cuda, float, 2>() {
    return &cuda::smooth_body<Cuda, float, 2>;
}
template <>
SmoothCells<Cuda, float, 3> smooth_cells<Cuda, float, 3>() {
    return &cuda::smooth_body<Cuda, float, 3>;
}
template <>
SmoothCells<Cuda, double, 2> smooth_cells<Cuda, double, 2>() {
    return &cuda::smooth_body<Cuda, double, 2>;
}
template <>
SmoothCells<Cuda, double, 3> smooth_cells<Cuda, double, 3>() {
    return &cuda::smooth_body<Cuda, double, 3>;
}
template <>
SmoothCells<CudaMixed, double, 2> smooth_cells<CudaMixed, double, 2>() {
    return &cuda::smooth_body<CudaMixed, double, 2>;
}
template <>
SmoothCells<CudaMixed, double, 3> smooth_cells<CudaMixed, double, 3>() {
    return &cuda::smooth_body<CudaMixed, double, 3>;
}

}  // namespace mpm
