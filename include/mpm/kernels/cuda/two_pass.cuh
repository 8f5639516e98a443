// CUDA driver of the two-pass step, of the first deposit and of energies: loops and flush; no
// formula.
//
// The first half runs a thread per particle and leaves what it deposits in scratch columns. The
// second half knows no material: a thread owns one channel of one cell, keeps its 3^D sums in
// registers and adds them to the grid as integers. What schemes deposit that store a velocity
// (two_pass_keep.cuh) goes the same way.
#pragma once

#include "mpm/kernels/cuda/arena.cuh"
#include "mpm/kernels/cuda/rank_walk.cuh"
#include "mpm/kernels/phase.hpp"

namespace mpm::cuda {

inline constexpr int pass_threads = 128;

/// Moves the particles of a home block, a thread each: `advance(home, xi, state)` returns what one
/// deposits, `put(q, u)` keeps it, and `see(xi, u, largest)` hears of those that are sound.
template <class Material, int R, class X, class T, int D, class Advance, class Put, class See>
__device__ __forceinline__ void gather_particles(const Pass<X, T, D>& pass, std::int32_t slot,
                                                 const Advance& advance, const Put& put,
                                                 const See& see) {
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    Largest<typename Pass<X, T, D>::Grid> largest;
    largest.listen(pass);
    int strays = 0;
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += pass_threads) {
        int home[D];
        Block<D>::coordinates(pass.body.home_cell(q), home);
        Vec<T, D> xi;
        T state[R];
        load(pass.body, q, xi, state);
        strays += !at_home(xi);
        const auto u = advance(home, xi, state);
        store(pass.body, q, xi, state);
        if (!sound<Material>(xi, state))
            Cuda::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
        else
            see(xi, u, largest);
        put(q, u);
    }
    strays = __reduce_add_sync(~0u, strays);
    if (threadIdx.x % 32 == 0 && strays > 0) count_strays(pass, strays);
    largest.tell(pass);
}
/// The transfer channels of a deposit, to scratch.
template <int C, class G, int D, int E>
__device__ __forceinline__ void put_affine(G* scratch, std::size_t n, std::uint32_t q,
                                           const Affine<G, D, E>& u) {
    const Scratch<D> column{C};
    MPM_UNROLL for (int c = 0; c < C; ++c) {
        scratch[column.value(c) * n + q] = u.value[c];
        MPM_UNROLL for (int a = 0; a < D; ++a) scratch[column.slope(a, c) * n + q] = u.slope[a][c];
    }
}

template <class Material, Smoothing S, class X, class T, int D>
__global__ void __launch_bounds__(pass_threads)
    gather_step(const __grid_constant__ Pass<X, T, D> pass,
                const __grid_constant__ typename Material::template Constants<T> constants) {
    using G = typename Pass<X, T, D>::Grid;
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    after_previous();
    if (pass.clock->halt != Halt::none) return;
    __shared__ LineArena<G, D, C> lines;
    const std::int32_t slot = pass.body.home[blockIdx.x];
    fill(pass, slot, lines);
    __syncthreads();
    const auto numbers =
        step_numbers<T, Material>(*pass.numbers, constants, pass.carry, pass.stress_only);
    gather_particles<Material, R>(
        pass, slot,
        [&](const int(&home)[D], Vec<T, D>& xi, T(&state)[R]) {
            return advance<Material, S, T, D>(lines, home, xi, state, numbers);
        },
        [&](std::uint32_t q, const auto& u) { put_affine<C>(pass.scratch, pass.body.count, q, u); },
        [](const auto&, const auto& u, auto& largest) { largest.template see<D, C>(u); });
}

/// One channel of a cell; the mass is the channel of a constant one.
template <class T, int D>
struct ChannelSums {
    T value[stencil_nodes<D>];
    __device__ __forceinline__ void add(int node, int, T v) { value[node] += v; }
    __device__ __forceinline__ void add_mass(int, T) {}
};

/// Takes one channel of one particle, or of a cell, to the grid.
template <class P>
struct ChannelToGrid {
    using T = typename P::Grid;
    const P& pass;
    const std::int32_t* neighbours;
    T scale;
    int sum;  // of a node, which the channel goes to; 0 for the mass
    int cell[P::dimension];

    __device__ __forceinline__ void add(int node, int, T v) {
        const typename P::Sum x = to_fixed(v * scale);
        if (x == 0) return;
        typename P::Sum* const to = sums_at(pass, stencil_node(neighbours, cell, node));
        add_fixed(to + sum * block_cells, x);
        if (sum == 0 && pass.group.weight >= 0) add_fixed(to + pass.group.weight * block_cells, x);
    }
    __device__ __forceinline__ void add_mass(int, T) {}
};

/// Blocks that the registers of a multiprocessor are to hold: fewer hide less of the reads.
template <class G>
inline constexpr int scatter_blocks = sizeof(G) == 4 ? 12 : 6;

template <class X, class T, int D>
__global__ void __launch_bounds__(block_cells, scatter_blocks<typename Pass<X, T, D>::Grid>)
    scatter_step(const __grid_constant__ Pass<X, T, D> pass, int channels, int plain) {
    using G = typename Pass<X, T, D>::Grid;
    using ToGrid = ChannelToGrid<Pass<X, T, D>>;
    after_previous();
    if (pass.clock->halt != Halt::none) return;
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    const int number = threadIdx.x;
    const RankWalk walk(start[number / warp_cells * warp_cells], start[number + 1] - start[number]);
    // The transfer channels, the mass, then momentum without stress.
    const int channel = blockIdx.y, axis = channel - channels - 1;
    const bool is_mass = channel == channels, is_plain = axis >= 0;
    const Scales<G, D> scales(pass);
    int home[D];
    Block<D>::coordinates(number, home);
    ToGrid grid{pass, neighbours_of(pass.grid.table, slot),
                is_mass ? scales.mass : (channel < D || is_plain ? scales.momentum : scales.group),
                is_mass ? 0 : (is_plain ? plain + axis : sum_channels_of(pass)(channel))};
    ChannelSums<G, D> sums{};
    const std::size_t n = pass.body.count;
    const Scratch<D> column{channels};
    for_each_of_cell(walk, [&](std::uint32_t q) {
        Vec<T, D> xi;
        MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = pass.body.offset[a][q];
        Affine<G, D, 1> u;
        u.value[0] = is_mass ? G(1) : pass.scratch[column.value(is_plain ? axis : channel) * n + q];
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const int slope = is_plain ? column.stress(a, axis) : column.slope(a, channel);
            u.slope[a][0] = is_mass ? G(0) : pass.scratch[slope * n + q];
        }
        if (at_home(xi)) {
            scatter<G, D, 1>(sums, quadratic_weights<G, D>(as<G>(xi)), G(1), u);
        } else {
            Vec<T, D> local;
            settle<T, D>(home, xi, grid.cell, local);
            scatter<G, D, 1, true>(grid, quadratic_weights<G, D>(as<G>(local)), G(1), u);
        }
    });
    if (walk.count > 0) {
        MPM_UNROLL for (int a = 0; a < D; ++a) grid.cell[a] = home[a];
        MPM_UNROLL for (int k = 0; k < stencil_nodes<D>; ++k) grid.add(k, 0, sums.value[k]);
    }
    end_pass(pass);
}

/// Particles at rest before the first step, one thread each, straight to the grid.
template <class Material, Smoothing S, class X, class T, int D>
__global__ void __launch_bounds__(pass_threads)
    first_deposit(const __grid_constant__ Pass<X, T, D> pass,
                  const __grid_constant__ typename Material::template Constants<T> constants) {
    using G = typename Pass<X, T, D>::Grid;
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    if (pass.clock->halt != Halt::none) return;
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    const auto numbers =
        step_numbers<T, Material>(*pass.numbers, constants, pass.carry, pass.stress_only);
    const Scales<G, D> scales(pass);
    Largest<G> largest;
    largest.listen(pass);
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += pass_threads) {
        Vec<T, D> xi;
        Vec<G, D> velocity;
        T state[R];
        load(pass.body, q, xi, state);
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            velocity[a] = pass.scratch[a * std::size_t(pass.body.count) + q];
        }
        const auto u = resting_particle<Material, S, T, D, G>(velocity, state, numbers);
        GridSums<Pass<X, T, D>, C> sums{pass, neighbours_of(pass.grid.table, slot), scales};
        int home[D];
        Block<D>::coordinates(pass.body.home_cell(q), home);
        Vec<T, D> local;
        settle<T, D>(home, xi, sums.cell, local);
        largest.template see<D, C>(u);
        scatter<G, D, C, true>(sums, quadratic_weights<G, D>(as<G>(local)), G(1), u);
    }
    largest.tell(pass);
}

/// One block of threads a home block, in a fixed order, so that the bits never change.
template <class Material, Smoothing S, class X, class T, int D>
__global__ void __launch_bounds__(pass_threads)
    sum_energies(const __grid_constant__ Pass<X, T, D> pass, const std::int32_t* due,
                 double* partial) {
    using G = typename Pass<X, T, D>::Grid;
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    if (!*due) return;
    __shared__ LineArena<G, D, C> lines;
    __shared__ double parts[3][pass_threads];
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    fill(pass, slot, lines);
    __syncthreads();
    std::int64_t corner[D];
    pass.grid.table.keys_of.block(pass.grid.table.keys[slot], corner);
    MPM_UNROLL for (int a = 0; a < D; ++a) corner[a] *= Block<D>::edge;
    double sum[3] = {};
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += pass_threads) {
        int home[D];
        Block<D>::coordinates(pass.body.home_cell(q), home);
        Vec<T, D> xi;
        T state[R];
        load(pass.body, q, xi, state);
        add_energies<Material, T, D, C>(pass, lines, corner, home, xi, state, sum);
    }
    add_in_order(parts, sum, partial + 3 * std::int64_t(blockIdx.x));
}

template <class Material, Smoothing S, class X, class T, int D>
void run_gather(const Pass<X, T, D>& pass) {
    pass.exec->launch_next(&gather_step<Material, S, X, T, D>, pass.body.homes, 1, pass_threads,
                           pass, Material::template constants<T>(pass.parameters));
}
template <class Material, Smoothing S, class X, class T, int D>
void run_initial(const Pass<X, T, D>& pass) {
    pass.exec->launch(&first_deposit<Material, S, X, T, D>, pass.body.homes, 1, pass_threads, pass,
                      Material::template constants<T>(pass.parameters));
}
template <class Material, Smoothing S, class X, class T, int D>
void run_energies(const Pass<X, T, D>& pass, const std::int32_t* due, double* partial) {
    pass.exec->launch(&sum_energies<Material, S, X, T, D>, pass.body.homes, 1, pass_threads, pass,
                      due, partial);
}

/// Compiled once, in src/kernels/cuda/scatter.cu; `plain`: the first sum of momentum without
/// stress, or -1.
template <class X, class T, int D>
void scatter_body(const Pass<X, T, D>& pass, int channels, int plain);
template <class X, class T, int D, int C>
void run_scatter(const Pass<X, T, D>& pass) {
    scatter_body<X, T, D>(pass, C, -1);
}

}  // namespace mpm::cuda
