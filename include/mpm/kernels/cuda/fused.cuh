// CUDA driver of the fused step in single precision: loops, lists and flush; no formula.
//
// A block of 64 threads owns a block of 64 cells, a thread one cell. A thread takes the particles
// of its cell one after another and keeps the 3^D x (C + 1) sums of the cell in registers; at the
// end they go to shared memory as integers, and from there to the grid. Two kinds of particles are
// done afterwards, one thread each: strays, no longer in the cell they were sorted into, and the
// surplus of cells that hold more than the others, which would hold up their warp.
#pragma once

#include "mpm/kernels/cuda/arena.cuh"

namespace mpm::cuda {

template <int D, int C>
struct RegisterSums {
    float value[stencil_nodes<D>][C + 1];
    __device__ __forceinline__ void add_terms(int node, int channel, float x, float y) {
        value[node][channel] += x;
        value[node][channel] += y;
    }
    __device__ __forceinline__ void add_mass(int node, float v) { value[node][C] += v; }
};

/// What strays deposit, from the thread that moved them to the one that adds it.
template <int D, int C>
struct StrayList {
    static constexpr int room = 128;
    static constexpr int reals = D + C * (1 + D);
    float value[reals][room];
    int cell[room];
    int count;

    __device__ __forceinline__ void put(int k, const int (&at)[D], const Vec<float, D>& local,
                                        const Affine<float, D, C>& u) {
        int code = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            code = code * 16 + at[a] + 1;
            value[a][k] = local[a];
        }
        cell[k] = code;
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            value[D + c][k] = u.value[c];
            MPM_UNROLL for (int a = 0; a < D; ++a) value[D + C + a * C + c][k] = u.slope[a][c];
        }
    }
    __device__ __forceinline__ void get(int k, int (&at)[D], Vec<float, D>& local,
                                        Affine<float, D, C>& u) const {
        int code = cell[k];
        MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
            at[a] = code % 16 - 1;
            code /= 16;
            local[a] = value[a][k];
        }
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            u.value[c] = value[D + c][k];
            MPM_UNROLL for (int a = 0; a < D; ++a) u.slope[a][c] = value[D + C + a * C + c][k];
        }
    }
};

/// start[t] = sum of `mine` over the threads before t, for 64 threads and t in [0, 64].
__device__ __forceinline__ void scan_over_block(int mine, int (&start)[block_cells + 1]) {
    __shared__ int first_warp;
    const int lane = threadIdx.x % 32;
    int sum = mine;
    MPM_UNROLL for (int by = 1; by < 32; by *= 2) {
        const int other = __shfl_up_sync(~0u, sum, by);
        if (lane >= by) sum += other;
    }
    if (threadIdx.x == 31) first_warp = sum;
    __syncthreads();
    if (threadIdx.x >= 32) sum += first_warp;
    start[threadIdx.x + 1] = sum;
    if (threadIdx.x == 0) start[0] = 0;
}

template <class Material, Smoothing S, int D>
__global__ void __launch_bounds__(block_cells, 4)
    fused_step(const __grid_constant__ Pass<Cuda, float, D> pass,
               const __grid_constant__ typename Material::template Constants<float> constants) {
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    using Sums = SumArena<D, C>;
    if (pass.clock->halt != Halt::none) return;

    __shared__ VelocityArena<float, D, C> nodes;
    __shared__ Sums arena;
    __shared__ StrayList<D, C> strays;
    __shared__ int surplus_start[block_cells + 1];

    const int thread = threadIdx.x;
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    const std::uint32_t begin = start[thread], end = start[thread + 1];
    const std::uint32_t most = (start[block_cells] - start[0] + block_cells - 1) / block_cells + 2;
    const std::uint32_t own_end = end - begin > most ? begin + most : end;
    fill(pass, slot, nodes);
    for (int k = thread; k < (C + 1) * Sums::nodes; k += block_cells) arena.at[k] = 0;
    if (thread == 0) strays.count = 0;
    scan_over_block(int(end - own_end), surplus_start);
    __syncthreads();

    const auto numbers =
        step_numbers<float, Material>(*pass.numbers, constants, pass.carry, pass.stress_only);
    const Scales<float, D> scales(pass);
    const auto deposit = [&](const int(&cell)[D], const Vec<float, D>& local,
                             const Affine<float, D, C>& u) {
        SharedSums<D, C> sums{arena.at + stencil_origin<Sums, D>(cell), scales};
        scatter<float, D, C>(sums, quadratic_weights<float, D>(local), 1.0f, u);
        return sums.fits;
    };
    const auto report = [&](std::uint32_t q) {
        Cuda::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
    };
    bool fits = true;
    int home[D];
    Block<D>::coordinates(thread, home);

    if (begin < own_end) {
        RegisterSums<D, C> sums;
        MPM_UNROLL for (int n = 0; n < stencil_nodes<D>; ++n) {
            MPM_UNROLL for (int c = 0; c <= C; ++c) sums.value[n][c] = 0;
        }
        Vec<float, D> next_xi;
        float next_state[R];
        load(pass.body, begin, next_xi, next_state);
#pragma unroll 1
        for (std::uint32_t q = begin; q < own_end; ++q) {
            Vec<float, D> xi = next_xi;
            float state[R];
            MPM_UNROLL for (int r = 0; r < R; ++r) state[r] = next_state[r];
            if (q + 1 < own_end) load(pass.body, q + 1, next_xi, next_state);
            const auto u = advance<Material, S, float, D, C>(nodes, home, xi, state, numbers);
            store(pass.body, q, xi, state);
            if (!sound<Material>(xi, state)) {
                report(q);
                continue;
            }
            int cell[D];
            Vec<float, D> local;
            if (settle<float, D>(home, xi, cell, local)) {
                scatter<float, D, C>(sums, quadratic_weights<float, D>(xi), 1.0f, u);
            } else {
                const int k = atomicAdd(&strays.count, 1);
                if (k < strays.room)
                    strays.put(k, cell, local, u);
                else
                    fits = deposit(cell, local, u) & fits;
            }
        }
        std::int32_t* at = arena.at + stencil_origin<Sums, D>(home);
        MPM_UNROLL for (int n = 0; n < stencil_nodes<D>; ++n) {
            MPM_UNROLL for (int c = 0; c <= C; ++c) {
                const float x = sums.value[n][c] * scales.template of<C>(c);
                fits = fits & (fabsf(x) <= scales.limit);
                atomicAdd(at + c * Sums::nodes + stencil_place<Sums, D>(n), to_fixed(x));
            }
        }
    }
    __syncthreads();

    const int surplus = surplus_start[block_cells];
    const int listed = strays.count < strays.room ? strays.count : strays.room;
#pragma unroll 1
    for (int t = thread; t < surplus + listed; t += block_cells) {
        int cell[D];
        Vec<float, D> local;
        Affine<float, D, C> u;
        if (t < surplus) {
            const int number = cell_holding(surplus_start, t);
            const std::uint32_t q = start[number] + most + std::uint32_t(t - surplus_start[number]);
            int of[D];
            Block<D>::coordinates(number, of);
            Vec<float, D> xi;
            float state[R];
            load(pass.body, q, xi, state);
            u = advance<Material, S, float, D, C>(nodes, of, xi, state, numbers);
            store(pass.body, q, xi, state);
            if (!sound<Material>(xi, state)) {
                report(q);
                continue;
            }
            settle<float, D>(of, xi, cell, local);
        } else {
            strays.get(t - surplus, cell, local, u);
        }
        fits = deposit(cell, local, u) & fits;
    }
    __syncthreads();

    const std::int32_t* neighbours = neighbours_of(pass.grid.table, slot);
    for_each_node<D>([&](const int(&at)[D], int neighbour, int node) {
        int place = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) place += at[a] * Sums::stride(a);
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            add_to_grid<float, D>(pass, neighbours, neighbour, node, c,
                                  arena.at[c * Sums::nodes + place]);
        }
        add_mass_to_grid<float, D>(pass, neighbours, neighbour, node,
                                   arena.at[C * Sums::nodes + place]);
    });
    if (!fits) Cuda::raise(pass.overflow);
}

template <class Material, Smoothing S, int D>
void run_fused(const Pass<Cuda, float, D>& pass) {
    pass.exec->launch(&fused_step<Material, S, D>, pass.body.homes, 1, block_cells, pass,
                      Material::template constants<float>(pass.parameters));
}

}  // namespace mpm::cuda
