// What the CUDA drivers keep in shared memory for one block of cells: the velocities that its
// particles can reach, by lines, and the sums that they fill. Fixed point throughout: sums are
// integers.
#pragma once

#include "mpm/exec/cuda.cuh"
#include "mpm/kernels/body_common.hpp"

namespace mpm::cuda {

/// The coefficients that a cell's three entries hold of N channels.
template <int N, class T, class Entry>
MPM_INLINE Line<T, N> line_from(const Entry* at) {
    Line<T, N> line;
    MPM_UNROLL for (int k = 0; k < 3; ++k) {
        const Entry q = at[k];
        MPM_UNROLL for (int c = 0; c < N; ++c) line.q[k][c] = q.e[c];
    }
    return line;
}
/// Three nodes along the last axis to the entries of the cell in their middle.
template <class T, int C, class Entry>
__device__ __forceinline__ void expand_into(Entry* at, const T (&below)[C], const T (&here)[C],
                                            const T (&above)[C]) {
    Entry out[3] = {};
    MPM_UNROLL for (int c = 0; c < C; ++c) {
        T q[3];
        expand_line(below[c], here[c], above[c], q);
        MPM_UNROLL for (int e = 0; e < 3; ++e) out[e].e[c] = q[e];
    }
    MPM_UNROLL for (int e = 0; e < 3; ++e) at[e] = out[e];
}

/// What `gather` reads: for every line of nodes along the last axis and every cell on it that
/// particles of the block may stand in, the coefficients of the quadratic. The strides keep the
/// lanes of a quarter warp, which own neighbouring cells, in different banks.
template <class T, int D, int C>
struct LineArena {
    static_assert(C >= 2 && C <= 4);
    using Number = T;
    static constexpr int width = C == 2 ? 2 : 4;
    static constexpr int cells = Block<D>::edge + 2;
    static constexpr int edge = Block<D>::arena_edge;
    static constexpr int lines = Block<D>::arena_nodes / edge;
    MPM_INLINE static constexpr int stride(int axis) {
        return axis == D - 1 ? 3 : (D == 2 ? 30 : (axis == 1 ? 20 : 160));
    }
    struct alignas(sizeof(T) * width < 16 ? sizeof(T) * width : 16) Entry {
        T e[width];
    };
    Entry at[edge * stride(0)];

    template <int N>
    MPM_INLINE Line<T, N> load(int place) const {
        return line_from<N, T>(at + place);
    }
};

template <int D>
__device__ __forceinline__ const std::int32_t* neighbours_of(const BlockTableView<D>& table,
                                                             std::int32_t slot) {
    return table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
}

/// True if what a particle reads of a node is one piece of four numbers.
template <int C, class P>
__device__ __forceinline__ bool in_one_piece(const P& pass) {
    return C == 4 && pass.grid.velocity_channels == 4 && pass.group.average == 3;
}
template <class T>
__device__ __forceinline__ void load_piece(const T* from, T (&u)[4]) {
    struct alignas(16) Four {
        T e[4];
    };
    const Four v = *reinterpret_cast<const Four*>(from);
    MPM_UNROLL for (int c = 0; c < 4; ++c) u[c] = v.e[c];
}

/// Velocities, and where there are C > D channels the group's average, of one node. `wide`: nodes
/// have more channels behind these.
template <int C, class P, class T, bool wide = false>
__device__ __forceinline__ void load_node(const P& pass, const T* from, T (&u)[C]) {
    if constexpr (C == 4) {
        if (wide ? pass.grid.velocity_channels % 4 == 0 && pass.group.average == 3
                 : in_one_piece<C>(pass)) {
            load_piece(from, u);
            return;
        }
    }
    MPM_UNROLL for (int c = 0; c < C; ++c) u[c] = from[c < P::dimension ? c : pass.group.average];
}

/// Bits part, part + parts, part + 2 parts, ... of the first 16.
__device__ __forceinline__ unsigned every(int parts, int part) {
    unsigned mine = 0;
    for (int k = part; k < 16; k += parts) mine |= 1u << k;
    return mine;
}

struct NothingElse {
    template <class... A>
    __device__ __forceinline__ void operator()(const A&...) const {}
};

/// Threads share the lines, and where there are more threads than lines also the cells of a line.
/// `also(line, mine, from)` may read more of the nodes of a thread's line, whose place is line[0 ..
/// D - 2]: node k, of which it is to take those in the bits `mine`, begins at from(k).
template <bool wide = false, class P, class T, int D, int C, class Also = NothingElse>
__device__ __forceinline__ void fill(const P& pass, std::int32_t slot, LineArena<T, D, C>& arena,
                                     const Also& also = {}) {
    using Arena = LineArena<T, D, C>;
    constexpr int edge = Block<D>::edge, margin = Block<D>::margin;
    const auto& g = pass.grid;
    const std::int32_t* neighbours = neighbours_of(g.table, slot);
    const int parts = blockDim.x / Arena::lines, part = threadIdx.x / Arena::lines;
    if (part >= parts) return;
    int rest = threadIdx.x % Arena::lines, neighbour = 0, first_node = 0, place = 0, side_step = 1,
        node_step = edge;
    int line[D] = {};
    MPM_UNROLL for (int a = D - 2; a >= 0; --a) {
        const int at = rest % Arena::edge, n = at - margin + edge;
        line[a] = at;
        rest /= Arena::edge;
        side_step *= 3;
        neighbour += n / edge * side_step;
        first_node += n % edge * node_step;
        node_step *= edge;
        place += at * Arena::stride(a);
    }
    const T* side[3];
    MPM_UNROLL for (int k = 0; k < 3; ++k) {
        side[k] = g.velocity + g.velocity_place(neighbours[neighbour + k], first_node);
    }
    const auto from = [&](int k) {
        const int n = k - margin + edge;
        return side[n / edge] + n % edge * g.velocity_channels;
    };
    T u[Arena::edge][C];
    MPM_UNROLL for (int k = 0; k < Arena::edge; ++k) load_node<C, P, T, wide>(pass, from(k), u[k]);
    const unsigned mine = every(parts, part);
    also(line, mine, from);
    MPM_UNROLL for (int k = 0; k < Arena::cells; ++k) {
        if (!(mine >> k & 1)) continue;
        expand_into(arena.at + place + k * 3, u[k], u[k + 1], u[k + 2]);
    }
}

__device__ __forceinline__ std::int32_t to_fixed(float x) { return __float2int_rn(x); }
__device__ __forceinline__ std::int64_t to_fixed(double x) { return __double2ll_rn(x); }
__device__ __forceinline__ void add_fixed(std::int32_t* to, std::int32_t x) { atomicAdd(to, x); }
__device__ __forceinline__ void add_fixed(std::int64_t* to, std::int64_t x) {
    atomicAdd(reinterpret_cast<unsigned long long*>(to), static_cast<unsigned long long>(x));
}

/// From units of one particle's mass to integers.
template <class T, int D>
struct Scales {
    T mass, momentum, group;

    template <class P>
    __device__ explicit Scales(const P& pass)
        : mass(T(pass.body.particle_mass * pass.clock->scale_write[mass_sum])),
          momentum(T(pass.body.particle_mass * pass.clock->scale_write[momentum_sum])),
          group(T(pass.body.particle_mass * pass.clock->scale_write[group_sum])) {}
    /// Of a transfer channel; the one after the last is the mass.
    template <int C>
    MPM_INLINE T of(int channel) const {
        return channel < D ? momentum : (channel < C ? group : mass);
    }
};

/// Scales a deposit by a power of two. The products are rounded as such: fused with the additions
/// that follow, in another way at each of the places that deposit one particle alone, they made its
/// bits depend on whether it found room in the list of its block.
template <int D, int C>
__device__ __forceinline__ void scale_channel(Affine<float, D, C>& u, int channel, float by) {
    u.value[channel] = __fmul_rn(u.value[channel], by);
    MPM_UNROLL for (int a = 0; a < D; ++a) u.slope[a][channel] = __fmul_rn(u.slope[a][channel], by);
}

/// A deposit whose sums stand to that of the mass as their scales do: by powers of two, so exactly.
template <int D, int C>
__device__ __forceinline__ Affine<float, D, C> to_mass_scale(Affine<float, D, C> u,
                                                             const Scales<float, D>& scales) {
    MPM_UNROLL for (int c = 0; c < C; ++c)
        scale_channel(u, c, scales.template of<C>(c) / scales.mass);
    return u;
}

template <class P>
__device__ __forceinline__ void count_strays(const P& pass, int count) {
    atomicAdd(reinterpret_cast<unsigned long long*>(pass.strays),
              static_cast<unsigned long long>(count));
}

/// Sorting is due, whatever strays have cost: beyond any limit, and with room for what others
/// count.
template <class P>
__device__ __forceinline__ void call_for_sort(const P& pass) {
    atomicMax(reinterpret_cast<unsigned long long*>(pass.strays), 1ull << 63);
}

/// The clock turns when the last worker of a step's passes is done; all threads must come here.
template <class P>
__device__ __forceinline__ void end_pass(const P& pass) {
    last_of(pass.workers, pass.arrivals, pass.turn);
}

__device__ __forceinline__ unsigned as_bits(float x) { return __float_as_uint(x); }
__device__ __forceinline__ unsigned long long as_bits(double x) {
    return static_cast<unsigned long long>(__double_as_longlong(x));
}
__device__ __forceinline__ double as_number(unsigned x) { return double(__uint_as_float(x)); }
__device__ __forceinline__ double as_number(unsigned long long x) {
    return __longlong_as_double(static_cast<long long>(x));
}

/// The largest deposits that a thread has seen, and their way to the clock. They are not negative,
/// so their bits are in the order of the numbers, and not-a-number is the largest of all.
template <class T>
struct Largest {
    using Bits = decltype(as_bits(T(0)));
    Bits momentum = 0, group = 0;

    template <int D, int C>
    __device__ __forceinline__ void see(const Affine<T, D, C>& u) {
        momentum = max(momentum, as_bits(deposit_size<0, D>(u)));
        if constexpr (C > D) group = max(group, as_bits(deposit_size<D, C>(u)));
    }
    __device__ __forceinline__ void see_momentum(T size) {
        momentum = max(momentum, as_bits(size));
    }
    template <class P>
    __device__ __forceinline__ void tell(const P& pass) const {
        tell(pass.deposited + momentum_sum, momentum, known_momentum);
        tell(pass.deposited + group_sum, group, known_group);
    }

    /// Asks what others have told: most then need not tell any more. What a cache holds will do, as
    /// it only grows.
    template <class P>
    __device__ __forceinline__ void listen(const P& pass) {
        const auto told = [&](int quantity) {
            return as_bits(T(__ldca(pass.deposited + quantity)));
        };
        known_momentum = told(momentum_sum);
        known_group = told(group_sum);
    }

private:
    Bits known_momentum = 0, known_group = 0;

    __device__ __forceinline__ static void tell(double* to, Bits x, Bits known) {
        for (int by = 16; by > 0; by /= 2) x = max(x, __shfl_xor_sync(~0u, x, by));
        if (threadIdx.x % 32 == 0 && x > known) {
            atomicMax(reinterpret_cast<unsigned long long*>(to), as_bits(as_number(x)));
        }
    }
};

/// Sums of a block's particles, channel by channel; lanes of a warp add in different banks.
template <int D, int C>
struct SumArena {
    static constexpr int nodes = D == 2 ? 12 * 40 : 8 * 68;
    alignas(16) std::int32_t at[(C + 1) * nodes];
    MPM_INLINE static constexpr int stride(int axis) {
        return axis == D - 1 ? 1 : (D == 2 ? 40 : (axis == 1 ? 8 : 68));
    }
};

/// Takes the deposit of one particle, already on the scale of the sums, straight into a sum arena.
template <int D, int C>
struct SharedSums {
    using Arena = SumArena<D, C>;
    std::int32_t* at;  // lowest node of the stencil
    __device__ __forceinline__ void put(int node, int channel, float v) {
        atomicAdd(at + channel * Arena::nodes + stencil_place<Arena, D>(node), to_fixed(v));
    }
    __device__ __forceinline__ void add(int node, int channel, float v) { put(node, channel, v); }
    __device__ __forceinline__ void add_mass(int node, float v) { put(node, C, v); }
};

template <int D, int C>
__device__ __forceinline__ void clear(SumArena<D, C>& arena) {
    constexpr int pieces = (C + 1) * SumArena<D, C>::nodes / 4;
    static_assert((C + 1) * SumArena<D, C>::nodes % 4 == 0);
    int4* at = reinterpret_cast<int4*>(arena.at);
    for (int k = threadIdx.x; k < pieces; k += blockDim.x) at[k] = int4{};
}

/// The sums of one node to the grid; `nodes` lie between those of its channels.
template <int C, class P, class ChannelOf>
__device__ __forceinline__ void flush_node(const P& pass, const std::int32_t* from, int nodes,
                                           std::int32_t* to, const ChannelOf& channel_of) {
    const std::int32_t mass = from[C * nodes];
    if (mass == 0) return;
    add_fixed(to, mass);
    if (pass.group.weight >= 0) add_fixed(to + pass.group.weight * block_cells, mass);
    MPM_UNROLL for (int c = 0; c < C; ++c)
        add_fixed(to + channel_of(c) * block_cells, from[c * nodes]);
}
/// Where the transfer channels of a node's sums are.
template <class P>
__device__ __forceinline__ auto sum_channels_of(const P& pass) {
    return [&pass](int c) { return c < P::dimension ? 1 + c : pass.group.sum; };
}

/// The sums of a block to the grid, channel c to that of number channel_of(c). A thread takes a row
/// of nodes along the axis before the last, so that neighbouring threads add to neighbouring
/// numbers; more threads share the rows.
template <int D, int C, class ChannelOf>
__device__ __forceinline__ void flush(const Pass<Cuda, float, D>& pass, std::int32_t slot,
                                      const SumArena<D, C>& arena, const ChannelOf& channel_of) {
    using Arena = SumArena<D, C>;
    constexpr int edge = Block<D>::edge, margin = Block<D>::margin,
                  long_edge = Block<D>::arena_edge;
    constexpr int rows = Block<D>::arena_nodes / long_edge, axis = D - 2;
    const int parts = blockDim.x / rows, part = threadIdx.x / rows;
    if (part >= parts) return;
    const std::int32_t* neighbours = neighbours_of(pass.grid.table, slot);
    int rest = threadIdx.x % rows, neighbour = 0, first_node = 0, place = 0;
    MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
        if (a == axis) continue;
        const int at = rest % long_edge, n = at - margin + edge;
        rest /= long_edge;
        int side_step = 1, node_step = 1;
        MPM_UNROLL for (int b = D - 1; b > a; --b) {
            side_step *= 3;
            node_step *= edge;
        }
        neighbour += n / edge * side_step;
        first_node += n % edge * node_step;
        place += at * Arena::stride(a);
    }
    const std::int64_t stride = std::int64_t(pass.grid.sum_channels) * block_cells;
    const unsigned mine = every(parts, part);
    std::int32_t* side[3];
    MPM_UNROLL for (int k = 0; k < 3; ++k) {
        side[k] =
            pass.grid.sums + std::int64_t(neighbours[neighbour + 3 * k]) * stride + first_node;
    }
    MPM_UNROLL for (int k = 0; k < long_edge; ++k) {
        if (!(mine >> k & 1)) continue;
        const int n = k - margin + edge;
        const std::int32_t* from = arena.at + place + k * Arena::stride(axis);
        std::int32_t* to = side[n / edge] + n % edge * edge;
        flush_node<C>(pass, from, Arena::nodes, to, channel_of);
    }
}
template <int D, int C>
__device__ __forceinline__ void flush(const Pass<Cuda, float, D>& pass, std::int32_t slot,
                                      const SumArena<D, C>& arena) {
    flush(pass, slot, arena, sum_channels_of(pass));
}

/// A node as the grid stores it.
struct NodePlace {
    std::int32_t slot;
    int number;
};
/// Node 0 .. 3^D - 1 of a cell's stencil; the cell is one of the block, or beside it.
template <int D>
__device__ __forceinline__ NodePlace stencil_node(const std::int32_t* neighbours,
                                                  const int (&cell)[D], int node) {
    int at[D], neighbour, number;
    MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
        at[a] = cell[a] + node % 3 - 1 + Block<D>::margin;
        node /= 3;
    }
    arena_node<D>(at, neighbour, number);
    return {neighbours[neighbour], number};
}
/// The sums of a node.
template <class P>
__device__ __forceinline__ typename P::Sum* sums_at(const P& pass, const NodePlace& node) {
    const std::int64_t stride = std::int64_t(pass.grid.sum_channels) * block_cells;
    return pass.grid.sums + node.slot * stride + node.number;
}
/// Adds to a transfer channel of a node; the one after the last is the mass.
template <int C, class P>
__device__ __forceinline__ void add_to_node(const P& pass, const NodePlace& node, int channel,
                                            typename P::Sum x) {
    if (x == 0) return;
    typename P::Sum* to = sums_at(pass, node);
    if (channel == C) {
        add_fixed(to, x);
        if (pass.group.weight >= 0) add_fixed(to + pass.group.weight * block_cells, x);
    } else {
        add_fixed(to + (channel < P::dimension ? 1 + channel : pass.group.sum) * block_cells, x);
    }
}

/// Takes the deposit of one particle straight to the grid.
template <class P, int C>
struct GridSums {
    using T = typename P::Grid;
    const P& pass;
    const std::int32_t* neighbours;
    const Scales<T, P::dimension>& scales;
    int cell[P::dimension];

    __device__ __forceinline__ void add(int node, int channel, T v) {
        const NodePlace place = stencil_node(neighbours, cell, node);
        add_to_node<C>(pass, place, channel, to_fixed(v * scales.template of<C>(channel)));
    }
    __device__ __forceinline__ void add_mass(int node, T v) { add(node, C, v); }
};

/// True if a particle stands in its home cell.
template <class T, int D>
__device__ __forceinline__ bool at_home(const Vec<T, D>& xi) {
    bool home = true;
    MPM_UNROLL for (int a = 0; a < D; ++a) home = home & (absolute(xi[a]) <= T(0.5));
    return home;
}

/// Cell in which a particle stands, and its offset from that cell's centre.
template <class T, int D>
__device__ __forceinline__ void settle(const int (&home)[D], const Vec<T, D>& xi, int (&cell)[D],
                                       Vec<T, D>& local) {
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        const int shift = cell_shift(xi[a]);
        cell[a] = home[a] + shift;
        local[a] = xi[a] - T(shift);
    }
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

/// One particle's step up to its deposit; xi stays relative to the home cell, whose stencil begins
/// at `origin`.
template <class Material, Smoothing S, class T, int D, class Lines>
__device__ __forceinline__ auto advance_from(const Lines& lines, int origin, Vec<T, D>& xi,
                                             T (&state)[state_reals<Material, D, S>],
                                             const StepNumbers<T, Material>& numbers) {
    using G = typename Lines::Number;
    Vec<T, D> shift{};
    if (!at_home(xi)) {
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const int cells = cell_shift(xi[a]);
            origin += cells * Lines::stride(a);
            shift[a] = T(cells);
        }
    }
    Vec<T, D> local;
    MPM_UNROLL for (int a = 0; a < D; ++a) local[a] = xi[a] - shift[a];
    const auto u = advance_particle<Material, S, T, D, G>(lines, origin, local, state, numbers);
    MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = local[a] + shift[a];
    return u;
}

template <class Material, Smoothing S, class T, int D, class Lines>
__device__ __forceinline__ auto advance(const Lines& lines, const int (&home)[D], Vec<T, D>& xi,
                                        T (&state)[state_reals<Material, D, S>],
                                        const StepNumbers<T, Material>& numbers) {
    return advance_from<Material, S>(lines, stencil_origin<Lines, D>(home), xi, state, numbers);
}

/// What the threads of a block hold, added in a fixed order through `parts`.
template <int threads>
__device__ __forceinline__ void add_in_order(double (&parts)[3][threads], const double (&sum)[3],
                                             double* to) {
    for (int e = 0; e < 3; ++e) parts[e][threadIdx.x] = sum[e];
    for (int by = threads / 2; by > 0; by /= 2) {
        __syncthreads();
        if (threadIdx.x < by) {
            for (int e = 0; e < 3; ++e) parts[e][threadIdx.x] += parts[e][threadIdx.x + by];
        }
    }
    __syncthreads();
    if (threadIdx.x < 3) to[threadIdx.x] = parts[threadIdx.x][0];
}

}  // namespace mpm::cuda
