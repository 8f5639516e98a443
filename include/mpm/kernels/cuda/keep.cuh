// CUDA driver of the fused step of schemes that store velocities (kernels/keep.hpp), in single
// precision: loops, lists and flush; no formula. As fused.cuh, with two additions in shared memory.
//
// The registers of a thread hold the 3^D x (C + 1) sums of its cell and no more. Momentum without
// stress therefore goes to shared memory particle by particle, as integers: lanes of a warp own
// different cells, so they add in different places, and nothing waits for the result. The
// velocities before forces, of which a particle needs no slopes, are kept by nodes.
#pragma once

#include "mpm/kernels/cuda/fused.cuh"
#include "mpm/kernels/keep.hpp"

namespace mpm::cuda {

/// D velocities of each node and its guard. The strides keep the lanes of a quarter warp, which own
/// neighbouring cells, in different banks.
template <int D>
struct NodeArena {
    static constexpr int edge = Block<D>::arena_edge;
    MPM_INLINE static constexpr int stride(int axis) {
        return axis == D - 1 ? 1 : (axis == D - 2 ? 12 : 96);
    }
    struct alignas(16) Node {
        float e[4];
    };
    Node at[edge * stride(0)];

    MPM_INLINE Node load(int place) const { return at[place]; }
};

/// Takes from the nodes of a line what `NodeArena` holds: see `fill`.
template <int D>
struct TakeNodes {
    const KeepNumbers<float>& keep;
    NodeArena<D>& arena;
    bool in_one;  // they are one piece of four numbers

    __device__ __forceinline__ TakeNodes(const Pass<Cuda, float, D>& pass,
                                         const KeepNumbers<float>& keep, NodeArena<D>& arena)
        : keep(keep),
          arena(arena),
          in_one(D == 3 && pass.grid.velocity_channels % 4 == 0 && keep.before % 4 == 0 &&
                 (!keep.guarded || keep.guard == keep.before + D)) {}

    template <class From>
    __device__ __forceinline__ void operator()(const int (&line)[D], unsigned mine,
                                               const From& from) const {
        constexpr int edge = NodeArena<D>::edge;
        int place = 0;
        MPM_UNROLL for (int a = 0; a < D - 1; ++a) place += line[a] * NodeArena<D>::stride(a);
        float u[edge][4] = {};
        // All reads first: none waits for another.
        MPM_UNROLL for (int k = 0; k < edge; ++k) {
            if (!(mine >> k & 1)) continue;
            if (in_one) {
                load_piece(from(k) + keep.before, u[k]);
            } else {
                MPM_UNROLL for (int a = 0; a < D; ++a) u[k][a] = from(k)[keep.before + a];
                if (keep.guarded) u[k][D] = from(k)[keep.guard];
            }
        }
        MPM_UNROLL for (int k = 0; k < edge; ++k) {
            if (!(mine >> k & 1)) continue;
            if (!keep.guarded) u[k][D] = 0;
            arena.at[place + k] = {{u[k][0], u[k][1], u[k][2], u[k][3]}};
        }
    }
};

/// Shared memory of a block. With this room for strays four blocks fit on a multiprocessor, as many
/// as their registers allow.
template <int D, int C>
struct KeepShared {
    LineArena<float, D, C> lines;
    NodeArena<D> nodes;
    SumArena<D, C + D> sums;
    StrayList<D, C + D, 52> strays;
    std::uint32_t surplus_begin[2], surplus_count[2];
};
static_assert(sizeof(KeepShared<3, 4>) <= 56 * 1024);

/// Momentum without stress of one particle, straight into a sum arena.
template <int D, int E>
struct PlainSums {
    std::int32_t* at;  // lowest node of the stencil, first channel of them
    __device__ __forceinline__ void add(int node, int channel, float v) {
        atomicAdd(at + channel * SumArena<D, E>::nodes + stencil_place<SumArena<D, E>, D>(node),
                  to_fixed(v));
    }
    __device__ __forceinline__ void add_mass(int, float) {}
};

/// N channels of a deposit from `first` on.
template <int first, int N, int D, int E>
__device__ __forceinline__ Affine<float, D, N> part_of(const Affine<float, D, E>& u) {
    Affine<float, D, N> out;
    MPM_UNROLL for (int c = 0; c < N; ++c) {
        out.value[c] = u.value[first + c];
        MPM_UNROLL for (int a = 0; a < D; ++a) out.slope[a][c] = u.slope[a][first + c];
    }
    return out;
}

/// The deposit of a particle that goes alone. `C`: transfer channels.
template <int C, int D>
__device__ __forceinline__ void deposit_kept(SumArena<D, C + D>& arena,
                                             const Scales<float, D>& scales, const int (&cell)[D],
                                             const Vec<float, D>& local,
                                             Affine<float, D, C + D> u) {
    using Sums = SumArena<D, C + D>;
    MPM_UNROLL for (int c = 0; c < C + D; ++c)
        scale_channel(u, c, (c < D || c >= C ? scales.momentum : scales.group) / scales.mass);
    SharedSums<D, C + D> sums{arena.at + stencil_origin<Sums, D>(cell)};
    scatter<float, D, C + D, true>(sums, quadratic_weights<float, D>(local), scales.mass, u);
}

/// One particle's step up to its deposit; xi stays relative to the home cell.
template <class Material, Smoothing S, int D, int C>
__device__ __forceinline__ Affine<float, D, C + D> advance_kept(
    const KeepShared<D, C>& shared, const int (&home)[D], Vec<float, D>& xi,
    float (&state)[state_reals<Material, D, S> + D], const StepNumbers<float, Material>& numbers,
    const KeepNumbers<float>& keep) {
    using Lines = LineArena<float, D, C>;
    using Nodes = NodeArena<D>;
    int origin = stencil_origin<Lines, D>(home), first = stencil_origin<Nodes, D>(home);
    Vec<float, D> shift{}, local;
    if (!at_home(xi)) {
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const int cells = cell_shift(xi[a]);
            origin += cells * Lines::stride(a);
            first += cells * Nodes::stride(a);
            shift[a] = float(cells);
        }
    }
    MPM_UNROLL for (int a = 0; a < D; ++a) local[a] = xi[a] - shift[a];
    const auto u = advance_keeping<Material, S, float, D>(shared.lines, origin, shared.nodes, first,
                                                          local, state, numbers, keep);
    MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = local[a] + shift[a];
    return u;
}

template <class Material, Smoothing S, int D>
__global__ void __launch_bounds__(fused_threads, 1)
    fused_keeping(const __grid_constant__ Pass<Cuda, float, D> pass,
                  const __grid_constant__ typename Material::template Constants<float> constants,
                  const __grid_constant__ KeepNumbers<float> keep) {
    constexpr int C = transfer_channels<D, S>, E = C + D, R = state_reals<Material, D, S> + D;
    using Sums = SumArena<D, E>;

    extern __shared__ __align__(16) unsigned char memory[];
    KeepShared<D, C>& shared = *reinterpret_cast<KeepShared<D, C>*>(memory);
    auto& strays = shared.strays;

    after_previous();
    const bool halted = pass.clock->halt != Halt::none;
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const int number = threadIdx.x % block_cells, part = threadIdx.x / block_cells,
              parts = blockDim.x / block_cells, half = number / warp_cells;
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    RankWalk walk(start[half * warp_cells], start[number + 1] - start[number]);
    fill<true>(pass, slot, shared.lines, TakeNodes<D>(pass, keep, shared.nodes));
    clear(shared.sums);
    if (threadIdx.x == 0) strays.count = 0;
    const auto numbers =
        step_numbers<float, Material>(*pass.numbers, constants, pass.carry, pass.stress_only);
    const Scales<float, D> scales(pass);
    if (halted) return;
    __syncthreads();

    Largest<float> largest;
    largest.listen(pass);
    /// What becomes of every particle that has moved; false for one that deposits nothing.
    const auto passes = [&](std::uint32_t q, const Vec<float, D>& xi, const float(&state)[R],
                            const Affine<float, D, E>& u) {
        if (!sound<Material>(xi, state)) {
            Cuda::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
            return false;
        }
        if (strays_far(xi)) call_for_sort(pass);
        largest.template see<D, C>(part_of<0, C>(u));
        largest.template see<D, D>(part_of<C, D>(u));
        return true;
    };
    int home[D];
    Block<D>::coordinates(number, home);
    {
        std::int32_t* const own = shared.sums.at + stencil_origin<Sums, D>(home);
        RegisterSums<D, C> sums;
        MPM_UNROLL for (int n = 0; n < stencil_nodes<D>; ++n) {
            MPM_UNROLL for (int c = 0; c <= C; ++c) sums.value[n][c] = 0;
        }
        Vec<float, D> next_xi{};
        float next_state[R] = {};
        walk.skip(part);
        bool next_mine = walk.rank < walk.own;
        std::uint32_t next_q = walk.take();
        if (next_mine) load(pass.body, next_q, next_xi, next_state);
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
            if (next_mine) load(pass.body, next_q, next_xi, next_state);
            if (!mine) continue;
            const auto u = advance_kept<Material, S, D, C>(shared, home, xi, state, numbers, keep);
            store(pass.body, q, xi, state);
            if (!passes(q, xi, state, u)) continue;
            if (at_home(xi)) {
                const auto w = quadratic_weights<float, D>(xi);
                PlainSums<D, E> plain{own + C * Sums::nodes};
                scatter<float, D, D>(plain, w, scales.momentum, part_of<C, D>(u));
                scatter<float, D, C>(sums, w, 1.0f, part_of<0, C>(u));
            } else {
                int cell[D];
                Vec<float, D> local;
                settle<float, D>(home, xi, cell, local);
                const int k = atomicAdd(&strays.count, 1);
                if (k < strays.room)
                    strays.put(k, cell, local, u);
                else
                    deposit_kept<C, D>(shared.sums, scales, cell, local, u);
            }
        }
        __syncwarp();
        // What is left of the walk is the surplus.
        while (walk.rank < walk.most) walk.skip(1);
        if (threadIdx.x < block_cells && threadIdx.x % warp_cells == 0) {
            shared.surplus_begin[half] = walk.next;
            shared.surplus_count[half] = walk.surplus;
        }
        if (part < int(walk.own)) {
            MPM_UNROLL for (int n = 0; n < stencil_nodes<D>; ++n) {
                MPM_UNROLL for (int c = 0; c <= C; ++c) {
                    atomicAdd(own + (c < C ? c : E) * Sums::nodes + stencil_place<Sums, D>(n),
                              to_fixed(sums.value[n][c] * scales.template of<C>(c)));
                }
            }
        }
    }
    __syncthreads();

    if (threadIdx.x == 0 && strays.count > 0) count_strays(pass, strays.count);
    const int surplus = int(shared.surplus_count[0] + shared.surplus_count[1]);
    const int listed = strays.count < strays.room ? strays.count : strays.room;
#pragma unroll 1
    for (int t = threadIdx.x; t < surplus + listed; t += blockDim.x) {
        int cell[D];
        Vec<float, D> local;
        Affine<float, D, E> u;
        if (t < surplus) {
            const bool first = t < int(shared.surplus_count[0]);
            const std::uint32_t q = first ? shared.surplus_begin[0] + t
                                          : shared.surplus_begin[1] + (t - shared.surplus_count[0]);
            int of[D];
            Block<D>::coordinates(pass.body.home_cell(q), of);
            Vec<float, D> xi;
            float state[R];
            load(pass.body, q, xi, state);
            u = advance_kept<Material, S, D, C>(shared, of, xi, state, numbers, keep);
            store(pass.body, q, xi, state);
            if (!passes(q, xi, state, u)) continue;
            settle<float, D>(of, xi, cell, local);
        } else {
            strays.get(t - surplus, cell, local, u);
        }
        deposit_kept<C, D>(shared.sums, scales, cell, local, u);
    }
    __syncwarp();
    largest.tell(pass);
    __syncthreads();
    flush(pass, slot, shared.sums,
          [&](int c) { return c < D ? 1 + c : (c < C ? pass.group.sum : keep.plain + c - C); });
    end_pass(pass);
}

template <class Material, Smoothing S, int D>
void run_keeping(const Phase<Cuda, float, D>& phase) {
    const Pass<Cuda, float, D>& pass = phase.pass;
    const int threads = block_cells * threads_a_cell(pass.full_homes, pass.exec->multiprocessors(),
                                                     pass.exec->shared());
    pass.exec->launch_large(int(sizeof(KeepShared<D, transfer_channels<D, S>>)),
                            &fused_keeping<Material, S, D>, pass.body.full_homes, threads, pass,
                            Material::template constants<float>(pass.parameters),
                            keep_numbers<float>(phase.n));
}

}  // namespace mpm::cuda
