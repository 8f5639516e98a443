// What the CPU drivers keep in cache for one block of cells: the velocities that its particles can
// reach, by lines, and the sums that they fill.
#pragma once

#include "mpm/exec/cpu.hpp"
#include "mpm/kernels/body_common.hpp"

namespace mpm::cpu {

template <class T>
inline constexpr int lanes = 32 / int(sizeof(T));

/// Which particles stand in the cell that their offsets are from.
template <class V, int D>
MPM_INLINE MaskOf<V> in_cell(const Vec<V, D>& xi) {
    const V half = V(ScalarOf<V>(0.5));
    MaskOf<V> m = absolute(xi[0]) <= half;
    MPM_UNROLL for (int a = 1; a < D; ++a) m = m & (absolute(xi[a]) <= half);
    return m;
}

/// With C channels to read and E to add to.
template <class T, int D, int C, int E = C>
struct Arena {
    static constexpr int nodes = Block<D>::arena_nodes;
    static constexpr int cells = Block<D>::edge + 2;  // of a line: home cells and one beside
    static constexpr int lines = nodes / Block<D>::arena_edge;
    alignas(64) T line[lines][cells][3][C];
    static constexpr int stride = E + 1 <= 4 ? 4 : 8;  // of one node's sums
    alignas(64) T sums[nodes][stride];  // channels, then mass; in units of one particle's mass
};

/// Beside it, of schemes that store velocities: what is read of a node without slopes.
template <class T, int D, int C>
struct KeepArena : Arena<T, D, C, C + D> {
    static constexpr int width = 4;  // D velocities, then the guard
    alignas(64) T node[Block<D>::arena_nodes][width];
};
template <class T, int D>
struct ArenaNodes {
    const T (*at)[4];
    static constexpr int stride(int axis) { return Block<D>::arena_stride(axis); }
    struct Node {
        T e[4];
    };
    MPM_INLINE Node load(int place) const {
        return {{at[place][0], at[place][1], at[place][2], at[place][3]}};
    }
};

/// Lines for `gather`: the same for all lanes.
template <class T, int D, int C>
struct ArenaLines {
    const T* at;
    static constexpr int stride(int axis) {
        int s = 3 * C;
        if (axis < D - 1) s *= Block<D>::edge + 2;
        if (axis < D - 2) s *= Block<D>::arena_edge;
        return s;
    }
    template <int N>
    MPM_INLINE Line<T, N> load(int place) const {
        Line<T, N> line;
        MPM_UNROLL for (int k = 0; k < 3; ++k) {
            MPM_UNROLL for (int c = 0; c < N; ++c) line.q[k][c] = at[place + k * C + c];
        }
        return line;
    }
};

/// Sums of one cell, a pack a node and channel.
template <class V, int D, int C>
struct CellSums {
    V value[stencil_nodes<D>][C + 1];
    MPM_INLINE void add(int node, int channel, V v) { value[node][channel] += v; }
    MPM_INLINE void add_mass(int node, V v) { value[node][C] += v; }
};

/// Sums of a lone particle, straight into the arena.
template <class T, int D, int C>
struct ArenaSums {
    T* at;  // first node of the stencil, channel 0
    static constexpr int stride(int axis) { return Block<D>::arena_stride(axis); }
    MPM_INLINE static int place(int node) { return stencil_place<ArenaSums, D>(node); }
    MPM_INLINE void add(int node, int channel, T v) {
        at[place(node) * Arena<T, D, C>::stride + channel] += v;
    }
    MPM_INLINE void add_mass(int node, T v) { at[place(node) * Arena<T, D, C>::stride + C] += v; }
};

/// Calls f(arena position, slot, node, length) for each run of nodes that is contiguous on both
/// sides, of an arena that holds `margin` nodes around a block.
template <int D, int margin = Block<D>::margin, class F>
MPM_INLINE void for_each_run(const std::int32_t* neighbours, const F& f) {
    constexpr int edge = Block<D>::edge, arena = edge + 2 * margin,
                  rows = D == 2 ? arena : arena * arena;
    for (int row = 0; row < rows; ++row) {
        int at[D], rest = row;
        for (int a = D - 2; a >= 0; --a) {
            at[a] = rest % arena;
            rest /= arena;
        }
        const int starts[4] = {0, margin, margin + edge, arena};
        MPM_UNROLL for (int part = 0; part < 3; ++part) {
            at[D - 1] = starts[part];
            int neighbour, node;
            arena_node<D, margin>(at, neighbour, node);
            f(row * arena + starts[part], neighbours[neighbour], node,
              starts[part + 1] - starts[part]);
        }
    }
}

}  // namespace mpm::cpu
