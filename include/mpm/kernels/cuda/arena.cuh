// What the CUDA drivers keep in shared memory for one block of cells: the velocities that its
// particles can reach and the sums that they fill. Fixed point throughout: sums are integers.
#pragma once

#include "mpm/exec/cuda.cuh"
#include "mpm/kernels/body_common.hpp"

namespace mpm::cuda {

/// Node values for `gather`, one vector a node. The strides keep the lanes of a quarter warp, which
/// own neighbouring cells, in different banks.
template <class T, int D, int C>
struct VelocityArena {
    static_assert(C >= 2 && C <= 4);
    static constexpr int width = C == 2 ? 2 : 4;
    static constexpr int nodes = D == 2 ? 12 * 12 : 8 * 8 * 12;
    struct alignas(sizeof(T) * width < 16 ? sizeof(T) * width : 16) Node {
        T e[width];
    };
    Node at[nodes];

    MPM_INLINE static constexpr int stride(int axis) {
        return axis == D - 1 ? 1 : (axis == D - 2 ? 12 : 96);
    }
    template <int N>
    MPM_INLINE Vec<T, N> load(int node) const {
        const Node n = at[node];
        Vec<T, N> v;
        MPM_UNROLL for (int c = 0; c < N; ++c) v[c] = n.e[c];
        return v;
    }
};

/// Calls f(coordinates in the arena, neighbour, node there) for every node of an arena.
template <int D, class F>
__device__ __forceinline__ void for_each_node(const F& f) {
    for (int n = threadIdx.x; n < Block<D>::arena_nodes; n += blockDim.x) {
        int at[D], rest = n, neighbour, node;
        MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
            at[a] = rest % Block<D>::arena_edge;
            rest /= Block<D>::arena_edge;
        }
        arena_node<D>(at, neighbour, node);
        f(at, neighbour, node);
    }
}

template <int D>
__device__ __forceinline__ const std::int32_t* neighbours_of(const BlockTableView<D>& table,
                                                             std::int32_t slot) {
    return table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
}

template <class T, int D, int C>
__device__ __forceinline__ void fill(const Pass<Cuda, T, D>& pass, std::int32_t slot,
                                     VelocityArena<T, D, C>& arena) {
    const auto& g = pass.grid;
    const std::int32_t* neighbours = neighbours_of(g.table, slot);
    for_each_node<D>([&](const int(&at)[D], int neighbour, int node) {
        const T* from = g.velocity +
                        std::int64_t(neighbours[neighbour]) * g.velocity_channels * block_cells +
                        node;
        typename VelocityArena<T, D, C>::Node v{};
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            v.e[c] = from[(c < D ? c : pass.group.average) * block_cells];
        }
        int place = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) place += at[a] * arena.stride(a);
        arena.at[place] = v;
    });
}

__device__ __forceinline__ std::int32_t to_fixed(float x) { return __float2int_rn(x); }
__device__ __forceinline__ std::int64_t to_fixed(double x) { return __double2ll_rn(x); }
__device__ __forceinline__ void add_fixed(std::int32_t* to, std::int32_t x) { atomicAdd(to, x); }
__device__ __forceinline__ void add_fixed(std::int64_t* to, std::int64_t x) {
    atomicAdd(reinterpret_cast<unsigned long long*>(to), static_cast<unsigned long long>(x));
}

/// From units of one particle's mass to integers. One contribution may use a 32nd of the range, so
/// that the 27 cells which share a node cannot wrap its sum.
template <class T, int D>
struct Scales {
    T mass, momentum, group;
    static constexpr T limit = T(std::int64_t(1) << (Cuda::sum_bits<T> - 5));

    __device__ explicit Scales(const Pass<Cuda, T, D>& pass)
        : mass(T(pass.body.particle_mass * pass.clock->scale_write[max_mass])),
          momentum(T(pass.body.particle_mass * pass.clock->scale_write[max_momentum])),
          group(T(pass.body.particle_mass * pass.clock->scale_write[max_group])) {}
    /// Of a transfer channel; the one after the last is the mass.
    template <int C>
    MPM_INLINE T of(int channel) const {
        return channel < D ? momentum : (channel < C ? group : mass);
    }
};

/// Sums of a block's particles, channel by channel; lanes of a warp add in different banks.
template <int D, int C>
struct SumArena {
    static constexpr int nodes = D == 2 ? 12 * 40 : 8 * 68;
    std::int32_t at[(C + 1) * nodes];
    MPM_INLINE static constexpr int stride(int axis) {
        return axis == D - 1 ? 1 : (D == 2 ? 40 : (axis == 1 ? 8 : 68));
    }
};

/// Takes the deposit of one particle straight into a sum arena.
template <int D, int C>
struct SharedSums {
    using Arena = SumArena<D, C>;
    std::int32_t* at;  // lowest node of the stencil
    const Scales<float, D>& scales;
    bool fits = true;
    __device__ __forceinline__ void put(int node, int channel, float v) {
        const float x = v * scales.template of<C>(channel);
        fits = fits & (fabsf(x) <= scales.limit);
        atomicAdd(at + channel * Arena::nodes + stencil_place<Arena, D>(node), to_fixed(x));
    }
    __device__ __forceinline__ void add(int node, int channel, float v) { put(node, channel, v); }
    __device__ __forceinline__ void add_mass(int node, float v) { put(node, C, v); }
};

/// Adds an integer to a node seen from a block's arena.
template <class T, int D>
__device__ __forceinline__ void add_to_grid(const Pass<Cuda, T, D>& pass,
                                            const std::int32_t* neighbours, int neighbour, int node,
                                            int channel, Cuda::Sum<T> x) {
    if (x == 0) return;
    Cuda::Sum<T>* to = pass.grid.sums +
                       std::int64_t(neighbours[neighbour]) * pass.grid.sum_channels * block_cells +
                       node;
    const int place = channel < D ? 1 + channel : pass.group.sum;
    add_fixed(to + place * block_cells, x);
}
template <class T, int D>
__device__ __forceinline__ void add_mass_to_grid(const Pass<Cuda, T, D>& pass,
                                                 const std::int32_t* neighbours, int neighbour,
                                                 int node, Cuda::Sum<T> x) {
    if (x == 0) return;
    Cuda::Sum<T>* to = pass.grid.sums +
                       std::int64_t(neighbours[neighbour]) * pass.grid.sum_channels * block_cells +
                       node;
    add_fixed(to, x);
    if (pass.group.weight >= 0) add_fixed(to + pass.group.weight * block_cells, x);
}

/// Takes the deposit of one particle, or the sums of one cell, straight to the grid.
template <class T, int D, int C>
struct GridSums {
    const Pass<Cuda, T, D>& pass;
    const std::int32_t* neighbours;
    const Scales<T, D>& scales;
    int cell[D];  // of the block, or one beside it
    bool fits = true;

    __device__ __forceinline__ void put(int node, int channel, T v) {
        const T x = v * scales.template of<C>(channel);
        fits = fits & (fabs(x) <= scales.limit);
        int at[D], rest = node, neighbour, number;
        MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
            at[a] = cell[a] + rest % 3 - 1 + Block<D>::margin;
            rest /= 3;
        }
        arena_node<D>(at, neighbour, number);
        if (channel < C)
            add_to_grid<T, D>(pass, neighbours, neighbour, number, channel, to_fixed(x));
        else
            add_mass_to_grid<T, D>(pass, neighbours, neighbour, number, to_fixed(x));
    }
    __device__ __forceinline__ void add(int node, int channel, T v) { put(node, channel, v); }
    __device__ __forceinline__ void add_mass(int node, T v) { put(node, C, v); }
};

/// The cell of an ascending list of 65 starts that holds entry i.
template <class I>
__device__ __forceinline__ int cell_holding(const I* start, I i) {
    int low = 0, high = block_cells;
    MPM_UNROLL for (int k = 0; k < 6; ++k) {
        const int middle = (low + high) / 2;
        if (start[middle] <= i)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/// Cell in which a particle stands, and its offset from that cell's centre; true if it is at home.
template <class T, int D>
__device__ __forceinline__ bool settle(const int (&home)[D], const Vec<T, D>& xi, int (&cell)[D],
                                       Vec<T, D>& local) {
    bool at_home = true;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        const int shift = cell_shift(xi[a]);
        cell[a] = home[a] + shift;
        local[a] = xi[a] - T(shift);
        at_home = at_home & (shift == 0);
    }
    return at_home;
}

template <class T, int D, int R>
__device__ __forceinline__ void load(const BodyView<T, D>& body, std::uint32_t q, Vec<T, D>& xi,
                                     T (&state)[R]) {
    MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = body.offset[a][q];
    MPM_UNROLL for (int r = 0; r < R; ++r) state[r] = body.state[r][q];
}
template <class T, int D, int R>
__device__ __forceinline__ void store(const BodyView<T, D>& body, std::uint32_t q,
                                      const Vec<T, D>& xi, const T (&state)[R]) {
    MPM_UNROLL for (int a = 0; a < D; ++a) body.offset[a][q] = xi[a];
    MPM_UNROLL for (int r = 0; r < R; ++r) body.state[r][q] = state[r];
}

/// One particle's step up to its deposit; xi stays relative to the home cell.
template <class Material, Smoothing S, class T, int D, int C>
__device__ __forceinline__ Affine<T, D, C> advance(const VelocityArena<T, D, C>& nodes,
                                                   const int (&home)[D], Vec<T, D>& xi,
                                                   T (&state)[state_reals<Material, D, S>],
                                                   const StepNumbers<T, Material>& numbers) {
    using Arena = VelocityArena<T, D, C>;
    int cell[D];
    Vec<T, D> local;
    settle<T, D>(home, xi, cell, local);
    const auto u = advance_particle<Material, S, T, D>(nodes, stencil_origin<Arena, D>(cell), local,
                                                       state, numbers);
    MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = local[a] + T(cell[a] - home[a]);
    return u;
}

}  // namespace mpm::cuda
