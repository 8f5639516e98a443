// CUDA driver of the fused step for blocks that hold few particles: spray, and the rim of a flow.
// An arena would cost more than they do, so a thread takes one particle, reads the grid itself, and
// the warp adds what its particles deposit one after another, a lane a node. No formula here.
#pragma once

#include "mpm/kernels/cuda/arena.cuh"
#include "mpm/kernels/order.hpp"

namespace mpm::cuda {

/// Lines for `gather` from the grid. A place is the lowest line's nodes seen from the block's
/// arena, a hexadecimal digit an axis.
template <int D, int C>
struct GridLines {
    const Pass<Cuda, float, D>& pass;
    const std::int32_t* neighbours;
    MPM_INLINE static constexpr int stride(int axis) { return 1 << 4 * (D - 1 - axis); }

    template <int N>
    __device__ __forceinline__ Line<float, N> load(int place) const {
        const auto& g = pass.grid;
        float u[3][C];
        MPM_UNROLL for (int n = 0; n < 3; ++n) {
            int at[D], neighbour, node;
            MPM_UNROLL for (int a = 0; a < D; ++a) at[a] = place >> 4 * (D - 1 - a) & 15;
            at[D - 1] += n;
            arena_node<D>(at, neighbour, node);
            load_node(pass, g.velocity + g.velocity_place(neighbours[neighbour], node), u[n]);
        }
        Line<float, N> line;
        MPM_UNROLL for (int c = 0; c < N; ++c) {
            float q[3];
            expand_line(u[0][c], u[1][c], u[2][c], q);
            MPM_UNROLL for (int k = 0; k < 3; ++k) line.q[k][c] = q[k];
        }
        return line;
    }
};

/// A deposit on its way from the thread that moved its particle to the lanes that add it.
template <int D, int C>
struct Parcel {
    Affine<float, D, C> u;
    Vec<float, D> local;
    int cell[D];
    std::int32_t slot;  // negative: nothing to add
};

template <class Material, Smoothing S, int D>
__global__ void __launch_bounds__(lone_threads)
    lone_step(const __grid_constant__ Pass<Cuda, float, D> pass,
              const __grid_constant__ typename Material::template Constants<float> constants) {
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    if (pass.clock->halt != Halt::none) return;
    __shared__ Parcel<D, C> parcels[lone_threads];
    const auto numbers =
        step_numbers<float, Material>(*pass.numbers, constants, pass.carry, pass.stress_only);
    const Scales<float, D> scales(pass);
    Largest<float> largest(pass);
    int strays = 0;
    const std::uint32_t number = blockIdx.x * lone_threads + threadIdx.x;
    Parcel<D, C>& mine = parcels[threadIdx.x];
    mine.slot = -1;
    if (number < pass.body.lone_count) {
        const std::uint32_t q = pass.body.lone[number];
        const std::int32_t slot = pass.body.lone_slot[number];
        const GridLines<D, C> lines{pass, neighbours_of(pass.grid.table, slot)};
        int home[D], cell[D];
        Block<D>::coordinates(pass.body.cell[q], home);
        Vec<float, D> xi, local;
        float state[R];
        load(pass.body, q, xi, state);
        strays = !at_home(xi);
        settle<float, D>(home, xi, cell, local);
        mine.u = advance_particle<Material, S, float, D>(
            lines, stencil_origin<GridLines<D, C>, D>(cell), local, state, numbers);
        MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = local[a] + float(cell[a] - home[a]);
        store(pass.body, q, xi, state);
        if (sound<Material>(xi, state)) {
            largest.template see<D, C>(mine.u);
            settle<float, D>(home, xi, mine.cell, mine.local);
            mine.slot = slot;
        } else {
            Cuda::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
        }
    }
    __syncwarp();
    const int lane = threadIdx.x % 32, first = threadIdx.x - lane;
#pragma unroll 1
    for (int k = 0; k < 32; ++k) {
        const Parcel<D, C>& p = parcels[first + k];
        if (p.slot < 0 || lane >= stencil_nodes<D>) continue;
        float value[C];
        const float share =
            deposit_at<float, D, C>(quadratic_weights<float, D>(p.local), lane, p.u, value);
        GridSums<float, D, C> sums{pass, neighbours_of(pass.grid.table, p.slot), scales};
        MPM_UNROLL for (int a = 0; a < D; ++a) sums.cell[a] = p.cell[a];
        sums.add_mass(lane, share);
        MPM_UNROLL for (int c = 0; c < C; ++c) sums.add(lane, c, share * value[c]);
    }
    strays = __reduce_add_sync(~0u, strays);
    if (lane == 0 && strays > 0) count_strays(pass, strays);
    largest.tell(pass);
    end_pass(pass);
}

template <class Material, Smoothing S, int D>
void run_lone(const Pass<Cuda, float, D>& pass) {
    pass.exec->launch(&lone_step<Material, S, D>, lone_blocks(pass.body.lone_count), 1,
                      lone_threads, pass, Material::template constants<float>(pass.parameters));
}

}  // namespace mpm::cuda
