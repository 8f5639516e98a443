// CUDA driver of the fused step in single precision: loops, lists and flush; no formula.
//
// A block of threads owns a block of 64 cells, a lane one cell of the 32 that its warp owns. It
// takes the particles of its cell one after another and keeps the 3^D x (C + 1) sums of the cell in
// registers; at the end they go to shared memory as integers, and from there to the grid. Two kinds
// of particles are done afterwards, one thread each: strays, no longer in the cell they were sorted
// into, and the surplus of cells that hold more than the others, which would hold up their warp.
//
// Where there are too few blocks to fill a device, two or four threads share a cell.
#pragma once

#include "mpm/kernels/cuda/arena.cuh"
#include "mpm/kernels/cuda/rank_walk.cuh"

namespace mpm::cuda {

template <int D, int C>
struct RegisterSums {
    float value[stencil_nodes<D>][C + 1];
    __device__ __forceinline__ void add(int node, int channel, float v) {
        value[node][channel] += v;
    }
    __device__ __forceinline__ void add_mass(int node, float v) { value[node][C] += v; }
};

/// What strays deposit, from the thread that moved them to the one that adds it.
template <int D, int C, int Room = 128>
struct StrayList {
    static constexpr int room = Room;
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

template <int D, int C>
__device__ __forceinline__ void deposit(SumArena<D, C>& arena, const Scales<float, D>& scales,
                                        const int (&cell)[D], const Vec<float, D>& local,
                                        const Affine<float, D, C>& u) {
    using Sums = SumArena<D, C>;
    SharedSums<D, C> sums{arena.at + stencil_origin<Sums, D>(cell)};
    scatter<float, D, C, true>(sums, quadratic_weights<float, D>(local), scales.mass,
                               to_mass_scale(u, scales));
}

/// Threads of a block when four share a cell. All the registers that a thread may have, as the sums
/// of a cell take 135: with 200, and a fifth block on a multiprocessor, what is spilled costs a
/// tenth of the speed (docs/performance.md).
inline constexpr int fused_threads = 4 * block_cells;

template <class Material, Smoothing S, int D>
__global__ void __launch_bounds__(fused_threads, 1)
    fused_step(const __grid_constant__ Pass<Cuda, float, D> pass,
               const __grid_constant__ typename Material::template Constants<float> constants) {
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    using Sums = SumArena<D, C>;

    __shared__ LineArena<float, D, C> lines;
    __shared__ Sums arena;
    __shared__ StrayList<D, C> strays;
    __shared__ std::uint32_t surplus_begin[2], surplus_count[2];

    after_previous();
    const bool halted = pass.clock->halt != Halt::none;
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const int number = threadIdx.x % block_cells, part = threadIdx.x / block_cells,
              parts = blockDim.x / block_cells, half = number / warp_cells;
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    RankWalk walk(start[half * warp_cells], start[number + 1] - start[number]);
    fill(pass, slot, lines);
    clear(arena);
    if (threadIdx.x == 0) strays.count = 0;
    const auto numbers =
        step_numbers<float, Material>(*pass.numbers, constants, pass.carry, pass.stress_only);
    const Scales<float, D> scales(pass);
    if (halted) return;
    __syncthreads();

    const auto report = [&](std::uint32_t q) {
        Cuda::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
    };
    Largest<float> largest;
    largest.listen(pass);
    int home[D];
    Block<D>::coordinates(number, home);
    {
        RegisterSums<D, C> sums;
        MPM_UNROLL for (int n = 0; n < stencil_nodes<D>; ++n) {
            MPM_UNROLL for (int c = 0; c <= C; ++c) sums.value[n][c] = 0;
        }
        // F-bar on a solid takes the registers in which its next particle would wait.
        constexpr bool ahead = Material::volumetric || S == Smoothing::none;
        Vec<float, D> next_xi{};
        float next_state[R] = {};
        walk.skip(part);
        bool next_mine = walk.rank < walk.own;
        std::uint32_t next_q = walk.take();
        if (ahead && next_mine) load(pass.body, next_q, next_xi, next_state);
#pragma unroll 1
        for (std::uint32_t rank = part; rank < walk.most; rank += parts) {
            const bool mine = next_mine;
            const std::uint32_t q = next_q;
            Vec<float, D> xi = next_xi;
            float state[R];
            MPM_UNROLL for (int r = 0; r < R; ++r) state[r] = next_state[r];
            if (parts > 1) walk.skip(parts - 1);
            next_mine = walk.rank < walk.own;
            next_q = walk.take();
            if (ahead && next_mine) load(pass.body, next_q, next_xi, next_state);
            if (!mine) continue;
            if constexpr (!ahead) load(pass.body, q, xi, state);
            const auto u = advance<Material, S, float, D>(lines, home, xi, state, numbers);
            store(pass.body, q, xi, state);
            if (!sound<Material>(xi, state)) {
                report(q);
                continue;
            }
            largest.template see<D, C>(u);
            if (at_home(xi)) {
                scatter<float, D, C>(sums, quadratic_weights<float, D>(xi), 1.0f, u);
            } else {
                int cell[D];
                Vec<float, D> local;
                settle<float, D>(home, xi, cell, local);
                const int k = atomicAdd(&strays.count, 1);
                if (k < strays.room)
                    strays.put(k, cell, local, u);
                else
                    deposit<D, C>(arena, scales, cell, local, u);
            }
        }
        __syncwarp();
        // What is left of the walk is the surplus.
        while (walk.rank < walk.most) walk.skip(1);
        if (threadIdx.x < block_cells && threadIdx.x % warp_cells == 0) {
            surplus_begin[half] = walk.next;
            surplus_count[half] = walk.surplus;
        }
        if (part < int(walk.own)) {
            std::int32_t* at = arena.at + stencil_origin<Sums, D>(home);
            MPM_UNROLL for (int n = 0; n < stencil_nodes<D>; ++n) {
                MPM_UNROLL for (int c = 0; c <= C; ++c) {
                    atomicAdd(at + c * Sums::nodes + stencil_place<Sums, D>(n),
                              to_fixed(sums.value[n][c] * scales.template of<C>(c)));
                }
            }
        }
    }
    __syncthreads();

    if (threadIdx.x == 0 && strays.count > 0) count_strays(pass, strays.count);
    const int surplus = int(surplus_count[0] + surplus_count[1]);
    const int listed = strays.count < strays.room ? strays.count : strays.room;
#pragma unroll 1
    for (int t = threadIdx.x; t < surplus + listed; t += blockDim.x) {
        int cell[D];
        Vec<float, D> local;
        Affine<float, D, C> u;
        if (t < surplus) {
            const bool first = t < int(surplus_count[0]);
            const std::uint32_t q =
                first ? surplus_begin[0] + t : surplus_begin[1] + (t - surplus_count[0]);
            int of[D];
            Block<D>::coordinates(pass.body.home_cell(q), of);
            Vec<float, D> xi;
            float state[R];
            load(pass.body, q, xi, state);
            u = advance<Material, S, float, D>(lines, of, xi, state, numbers);
            store(pass.body, q, xi, state);
            if (!sound<Material>(xi, state)) {
                report(q);
                continue;
            }
            largest.template see<D, C>(u);
            settle<float, D>(of, xi, cell, local);
        } else {
            strays.get(t - surplus, cell, local, u);
        }
        deposit<D, C>(arena, scales, cell, local, u);
    }
    __syncwarp();
    largest.tell(pass);
    __syncthreads();
    flush(pass, slot, arena);
    end_pass(pass);
}

/// Threads that share a cell, which splits its sum and with it the bits, so `homes` are those of
/// all ranks: enough for a few warps on every scheduler, of which other simulations on the same
/// device bring their own.
inline int threads_a_cell(std::int32_t homes, int multiprocessors, bool shared) {
    if (shared) return 1;
    return homes < multiprocessors * 3 / 2 ? 4 : (homes < multiprocessors * 4 ? 2 : 1);
}

template <class Material, Smoothing S, int D>
void run_fused(const Pass<Cuda, float, D>& pass) {
    const int threads = block_cells * threads_a_cell(pass.full_homes, pass.exec->multiprocessors(),
                                                     pass.exec->shared());
    pass.exec->launch_next(&fused_step<Material, S, D>, pass.body.full_homes, 1, threads, pass,
                           Material::template constants<float>(pass.parameters));
}

}  // namespace mpm::cuda
