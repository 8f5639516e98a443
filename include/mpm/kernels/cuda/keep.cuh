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
template <class T, int D>
struct KeptArena {
    static constexpr int edge = Block<D>::arena_edge;
    MPM_INLINE static constexpr int stride(int axis) {
        return axis == D - 1 ? 1 : (axis == D - 2 ? 12 : 96);
    }
    struct alignas(16) Node {
        T e[4];
    };
    Node at[edge * stride(0)];

    MPM_INLINE Node load(int place) const { return at[place]; }
};

/// Reads what `KeptArena` holds of a node; `T` is that of the scheme's numbers.
template <class P, class T>
struct NodeReader {
    static constexpr int D = P::dimension;
    using G = typename P::Grid;
    const KeepNumbers<T>& keep;
    bool in_one;  // they are one piece of four numbers

    __device__ __forceinline__ NodeReader(const P& pass, const KeepNumbers<T>& keep)
        : keep(keep),
          in_one(D == 3 && pass.grid.velocity_channels % 4 == 0 && keep.before % 4 == 0 &&
                 (!keep.guarded || keep.guard == keep.before + D)) {}

    __device__ __forceinline__ void operator()(const G* from, G (&u)[4]) const {
        if (in_one) {
            load_piece(from + keep.before, u);
        } else {
            MPM_UNROLL for (int a = 0; a < D; ++a) u[a] = from[keep.before + a];
            if (keep.guarded) u[D] = from[keep.guard];
        }
        if (!keep.guarded) u[D] = 0;
    }
};

/// Takes that from the nodes of a line: see `fill`.
template <class P, class T>
struct TakeNodes {
    static constexpr int D = P::dimension;
    using G = typename P::Grid;
    using Arena = KeptArena<G, D>;
    NodeReader<P, T> read;
    Arena& arena;

    __device__ __forceinline__ TakeNodes(const P& pass, const KeepNumbers<T>& keep, Arena& arena)
        : read(pass, keep), arena(arena) {}

    template <class From>
    __device__ __forceinline__ void operator()(const int (&line)[D], unsigned mine,
                                               const From& from) const {
        constexpr int edge = Arena::edge;
        int place = 0;
        MPM_UNROLL for (int a = 0; a < D - 1; ++a) place += line[a] * Arena::stride(a);
        G u[edge][4] = {};
        // All reads first: none waits for another.
        MPM_UNROLL for (int k = 0; k < edge; ++k) if (mine >> k & 1) read(from(k), u[k]);
        MPM_UNROLL for (int k = 0; k < edge; ++k) {
            if (!(mine >> k & 1)) continue;
            arena.at[place + k] = {{u[k][0], u[k][1], u[k][2], u[k][3]}};
        }
    }
};

/// Shared memory of a block. With this room for strays four blocks fit on a multiprocessor, as many
/// as their registers allow.
template <int D, int C>
struct KeepShared {
    LineArena<float, D, C> lines;
    KeptArena<float, D> nodes;
    SumArena<D, C + D> sums;
    StrayList<D, C + D, 52> strays;
    std::uint32_t surplus_begin[2], surplus_count[2];
};
static_assert(sizeof(KeepShared<3, 4>) <= 56 * 1024);

/// Where the sums of a node are: its transfer channels, then momentum without stress.
template <int C, int D>
__device__ __forceinline__ auto sum_channels_of(const Pass<Cuda, float, D>& pass,
                                                const KeepNumbers<float>& keep) {
    return [&](int c) { return c < C ? sum_channels_of(pass)(c) : keep.plain + c - C; };
}

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
template <int first, int N, class T, int D, int E>
__device__ __forceinline__ Affine<T, D, N> part_of(const Affine<T, D, E>& u) {
    Affine<T, D, N> out;
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

/// One particle's step up to its deposit; xi stays relative to the home cell, whose stencil begins
/// at `origin` in the lines and at `first` in the nodes.
template <class Material, Smoothing S, class T, int D, class Lines, class Nodes>
__device__ __forceinline__ auto advance_keeping_from(const Lines& lines, int origin,
                                                     const Nodes& nodes, int first, Vec<T, D>& xi,
                                                     T (&state)[state_reals<Material, D, S> + D],
                                                     const StepNumbers<T, Material>& numbers,
                                                     const KeepNumbers<T>& keep) {
    using G = typename Lines::Number;
    Vec<T, D> shift{}, local;
    if (!at_home(xi)) {
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const int cells = cell_shift(xi[a]);
            origin += cells * Lines::stride(a);
            first += cells * Nodes::stride(a);
            shift[a] = T(cells);
        }
    }
    MPM_UNROLL for (int a = 0; a < D; ++a) local[a] = xi[a] - shift[a];
    const auto u = advance_keeping<Material, S, T, D, G>(lines, origin, nodes, first, local, state,
                                                         numbers, keep);
    MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = local[a] + shift[a];
    return u;
}
/// The same with lines and nodes of `shared`.
template <class Material, Smoothing S, class T, int D, class Shared>
__device__ __forceinline__ auto advance_kept(const Shared& shared, const int (&home)[D],
                                             Vec<T, D>& xi,
                                             T (&state)[state_reals<Material, D, S> + D],
                                             const StepNumbers<T, Material>& numbers,
                                             const KeepNumbers<T>& keep) {
    return advance_keeping_from<Material, S, T, D>(
        shared.lines, stencil_origin<std::remove_cvref_t<decltype(shared.lines)>, D>(home),
        shared.nodes, stencil_origin<std::remove_cvref_t<decltype(shared.nodes)>, D>(home), xi,
        state, numbers, keep);
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
    fill<true>(pass, slot, shared.lines, TakeNodes(pass, keep, shared.nodes));
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
            const auto u =
                advance_kept<Material, S, float, D>(shared, home, xi, state, numbers, keep);
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
            u = advance_kept<Material, S, float, D>(shared, of, xi, state, numbers, keep);
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
    flush(pass, slot, shared.sums, sum_channels_of<C>(pass, keep));
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
