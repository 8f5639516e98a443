// CUDA driver of the fused step for blocks that hold few particles: spray, and the rim of a flow.
// An arena would cost more than they do, so a thread takes one particle, reads the grid itself, and
// the warp adds what its particles deposit one after another, a lane a node; neighbours in one cell
// go to the grid together. No formula here.
#pragma once

#include "mpm/kernels/cuda/arena.cuh"
#include "mpm/kernels/order.hpp"

namespace mpm::cuda {

/// Where the nodes around a cell are kept: they lie in at most two blocks along each axis.
template <int D>
struct Surroundings {
    std::int32_t block[1 << D];  // slots, the last axis fastest
    int low[D];                  // the lowest node, counted in its block

    __device__ __forceinline__ void find(const std::int32_t* neighbours, const int (&cell)[D]) {
        int side[D];
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const int at = cell[a] - 1 + Block<D>::edge;
            side[a] = at / Block<D>::edge;
            low[a] = at % Block<D>::edge;
        }
        MPM_UNROLL for (int b = 0; b < 1 << D; ++b) {
            int neighbour = 0;
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                neighbour = neighbour * 3 + side[a] + (b >> (D - 1 - a) & 1);
            }
            block[b] = neighbours[neighbour];
        }
    }
    /// What node k along an axis adds: to the number in its block, and 256-fold to that of `block`.
    __device__ __forceinline__ int part(int axis, int k) const {
        int step = 1;
        MPM_UNROLL for (int a = D - 1; a > axis; --a) step *= Block<D>::edge;
        const int at = low[axis] + k, beyond = at >= Block<D>::edge;
        return (at - beyond * Block<D>::edge) * step + (beyond << (8 + D - 1 - axis));
    }
};

/// Lines for `gather` from the grid, for the stencil of one cell: line 3 i + j of them (2D: i).
template <int D, int C, bool in_pieces>
struct GridLines {
    const Pass<Cuda, float, D>& pass;
    const Surroundings<D>& around;
    int part[D][3];

    __device__ __forceinline__ GridLines(const Pass<Cuda, float, D>& pass,
                                         const Surroundings<D>& around)
        : pass(pass), around(around) {
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            MPM_UNROLL for (int k = 0; k < 3; ++k) part[a][k] = around.part(a, k);
        }
    }
    MPM_INLINE static constexpr int stride(int axis) { return D - axis == 3 ? 3 : 1; }

    template <int N>
    __device__ __forceinline__ Line<float, N> load(int line) const {
        const auto& g = pass.grid;
        const int first = D == 2 ? part[0][line] : part[0][line / 3] + part[1][line % 3];
        float u[3][C];
        MPM_UNROLL for (int k = 0; k < 3; ++k) {
            const int at = first + part[D - 1][k];
            const float* from = g.velocity + g.velocity_place(around.block[at >> 8], at & 255);
            if constexpr (in_pieces)
                load_piece(from, u[k]);
            else
                load_node(pass, from, u[k]);
        }
        Line<float, N> out;
        MPM_UNROLL for (int c = 0; c < N; ++c) {
            float q[3];
            expand_line(u[0][c], u[1][c], u[2][c], q);
            MPM_UNROLL for (int k = 0; k < 3; ++k) out.q[k][c] = q[k];
        }
        return out;
    }
};

/// A deposit on its way from the thread that moved its particle to the lanes that add it, on the
/// scale of the sums.
template <int D, int C>
struct alignas(16) Parcel {
    Deposit<float, D, C> deposit;
    Surroundings<D> around;
    bool filled;
};

/// The lanes of a warp add what its threads have moved, a node each. Particles of one cell that
/// follow each other go to the grid together.
template <int D, int C>
__device__ __forceinline__ void add_parcels(const Pass<Cuda, float, D>& pass,
                                            const Parcel<D, C>* parcels) {
    const int lane = threadIdx.x % 32;
    const Parcel<D, C>& mine = parcels[lane];
    bool same = __shfl_down_sync(~0u, mine.filled, 1);
    same &= mine.around.block[0] == __shfl_down_sync(~0u, mine.around.block[0], 1);
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        same &= mine.around.low[a] == __shfl_down_sync(~0u, mine.around.low[a], 1);
    }
    const unsigned filled = __ballot_sync(~0u, mine.filled);
    const unsigned last = __ballot_sync(~0u, !same || lane == 31);
    int k_of[D], node = lane;
    MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
        k_of[a] = node % 3;
        node /= 3;
    }
    if (lane >= stencil_nodes<D>) return;
    std::int32_t sum[C + 1] = {};
    const auto to_grid = [&](const Surroundings<D>& around) {
        int at = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) at += around.part(a, k_of[a]);
        std::int32_t* to = sums_at(pass, NodePlace{around.block[at >> 8], at & 255});
        add_fixed(to, sum[C]);
        if (pass.group.weight >= 0) add_fixed(to + pass.group.weight * block_cells, sum[C]);
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            // Drops that fall freely are often not compressed at all.
            if (sum[c] != 0) add_fixed(to + (c < D ? 1 + c : pass.group.sum) * block_cells, sum[c]);
        }
        MPM_UNROLL for (int c = 0; c <= C; ++c) sum[c] = 0;
    };
    // Two at a time, so that one's reads hide behind the other's arithmetic.
    constexpr int pair = 2;
#pragma unroll 1
    for (int first = 0; first < 32; first += pair) {
        if (!(filled >> first & 3)) continue;
        std::int32_t share[pair][C + 1];
        MPM_UNROLL for (int k = 0; k < pair; ++k) {
            float value[C];
            const float part = deposit_at(parcels[first + k].deposit, lane, value);
            share[k][C] = to_fixed(part);
            MPM_UNROLL for (int c = 0; c < C; ++c) share[k][c] = to_fixed(part * value[c]);
        }
        MPM_UNROLL for (int k = 0; k < pair; ++k) {
            if (!(filled >> (first + k) & 1)) continue;
            MPM_UNROLL for (int c = 0; c <= C; ++c) sum[c] += share[k][c];
            if (last >> (first + k) & 1) to_grid(parcels[first + k].around);
        }
    }
}

template <class Material, Smoothing S, int D>
__global__ void __launch_bounds__(lone_threads)
    lone_step(const __grid_constant__ Pass<Cuda, float, D> pass,
              const __grid_constant__ typename Material::template Constants<float> constants) {
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    after_previous();
    if (pass.clock->halt != Halt::none) return;
    __shared__ Parcel<D, C> parcels[lone_threads];
    const Scales<float, D> scales(pass);
    Largest<float> largest;
    bool stray = false;
    const std::uint32_t number = blockIdx.x * lone_threads + threadIdx.x;
    Parcel<D, C>& mine = parcels[threadIdx.x];
    mine.filled = false;
    if (number < pass.body.lone_count) {
        const auto numbers =
            step_numbers<float, Material>(*pass.numbers, constants, pass.carry, pass.stress_only);
        const std::uint32_t q = pass.body.lone[number];
        const std::int32_t* neighbours =
            neighbours_of(pass.grid.table, pass.body.lone_slot[number]);
        int home[D], cell[D], moved[D];
        Block<D>::coordinates(pass.body.home_cell(q), home);
        Vec<float, D> xi, local;
        float state[R];
        load(pass.body, q, xi, state);
        stray = !at_home(xi);
        settle<float, D>(home, xi, cell, local);
        mine.around.find(neighbours, cell);
        Affine<float, D, C> u;
        const auto advance_by = [&]<bool in_pieces>() {
            const GridLines<D, C, in_pieces> lines(pass, mine.around);
            u = advance_particle<Material, S, float, D>(lines, 0, local, state, numbers);
        };
        if (C == 4 && in_one_piece<C>(pass))
            advance_by.template operator()<C == 4>();
        else
            advance_by.template operator()<false>();
        MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = local[a] + float(cell[a] - home[a]);
        store(pass.body, q, xi, state);
        if (sound<Material>(xi, state)) {
            largest.template see<D, C>(u);
            settle<float, D>(home, xi, moved, local);
            bool stays = true;
            MPM_UNROLL for (int a = 0; a < D; ++a) stays = stays & (moved[a] == cell[a]);
            if (!stays) mine.around.find(neighbours, moved);
            mine.deposit = deposit_of(quadratic_weights<float, D>(local), to_mass_scale(u, scales));
            MPM_UNROLL for (int k = 0; k < 3; ++k) mine.deposit.weight[0][k] *= scales.mass;
            mine.filled = true;
        } else {
            Cuda::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
        }
    }
    largest.listen(pass);
    __syncwarp();
    add_parcels<D, C>(pass, parcels + threadIdx.x / 32 * 32);
    __syncwarp();
    const unsigned strays = __popc(__ballot_sync(~0u, stray));
    if (threadIdx.x % 32 == 0 && strays > 0) count_strays(pass, int(strays));
    largest.tell(pass);
    end_pass(pass);
}

template <class Material, Smoothing S, int D>
void run_lone(const Pass<Cuda, float, D>& pass) {
    pass.exec->launch_next(&lone_step<Material, S, D>, lone_blocks(pass.body.lone_count), 1,
                           lone_threads, pass,
                           Material::template constants<float>(pass.parameters));
}

}  // namespace mpm::cuda
