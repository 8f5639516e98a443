// CPU: sums of one block's particles on their way to the grid in the phased step, and the order in
// which blocks bring theirs.
#pragma once

#include <cstring>
#include <memory>

#include "mpm/kernels/cpu/arena.hpp"
#include "mpm/kernels/cpu/phases.hpp"
#include "mpm/kernels/transfers.hpp"

namespace mpm::cpu {

/// The nodes, or cells, of a block and `margin` around it.
template <int D, int margin>
struct AroundBlock {
    static constexpr int edge = Block<D>::edge + 2 * margin,
                         nodes = D == 2 ? edge * edge : edge * edge * edge;
    static constexpr int stride(int axis) {
        int s = 1;
        for (int a = D - 1; a > axis; --a) s *= edge;
        return s;
    }
};

/// Sums of one block's particles, of all nodes that they can reach from the cells beside their own,
/// with the particles' mass. Together they go to the grid, so that a block of nodes gets one number
/// of each block of particles: which rank has added these is nothing that bits could tell.
template <class T, int D, int W>
struct SpreadArena : AroundBlock<D, W / 2 + 1> {
    static constexpr int margin = W / 2 + 1, width = SpreadTargets<D>::most;  // channels
    T sums[AroundBlock<D, margin>::nodes][width];
};

/// Sums of one cell's particles on their way to the arena, a pack a node and channel. A place is
/// the number of a node of the stencil.
template <class T, int D, int W>
struct SpreadSums {
    using V = Pack<T, lanes<T>>;
    static constexpr int nodes = D == 2 ? W * W : W * W * W, width = SpreadTargets<D>::most;
    V value[nodes][width];

    static Places<D, W> places() {
        Places<D, W> p;
        int step = 1;
        MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
            MPM_UNROLL for (int k = 0; k < W; ++k) p.part[a][k] = k * step;
            step *= W;
        }
        return p;
    }
    MPM_INLINE void clear(int channels) {
        for (int n = 0; n < nodes; ++n)
            for (int c = 0; c < channels; ++c) value[n][c] = V(T(0));
    }
    /// Adds m times the sums to the nodes around a cell, `at` their places in the arena.
    MPM_INLINE void bring(SpreadArena<T, D, W>& arena, const Places<D, W>& at, T m,
                          int channels) const {
        constexpr int L = V::lanes;
        MPM_NO_UNROLL for (int n = 0; n < nodes; ++n) {
            int place = 0, rest = n;
            MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
                place += at.part[a][rest % W];
                rest /= W;
            }
            MPM_UNROLL for (int first = 0; first < width; first += L) {
                if (first >= channels) break;
                V parts[L];
                MPM_UNROLL for (int k = 0; k < L; ++k) parts[k] =
                    first + k < width && first + k < channels ? value[n][first + k] : V(T(0));
                const V total = sums_of_lanes(parts);
                MPM_UNROLL for (int k = 0; k < L; ++k) {
                    if (first + k < width && first + k < channels)
                        arena.sums[place][first + k] += m * total[k];
                }
            }
        }
    }
};

/// What an arena holds of the particles of a home block, into the grid.
template <int W, class T, int D>
MPM_INLINE void flush_arena(const Phase<Cpu, T, D>& phase, const SpreadTargets<D>& to,
                            const SpreadArena<T, D, W>& arena, std::int32_t slot) {
    const auto& pass = phase.pass;
    const auto& g = pass.grid;
    const bool weighs = phase.part == Part::step && pass.group.weight >= 0;
    for_each_run<D, SpreadArena<T, D, W>::margin>(
        pass.destinations + std::int64_t(slot) * Block<D>::neighbours,
        [&](int at, std::int32_t target, int node, int length) {
            T* sums = g.sums + std::int64_t(target) * g.sum_channels * block_cells + node;
            const auto add = [&](int sum, int channel) {
                for (int k = 0; k < length; ++k)
                    sums[sum * block_cells + k] += arena.sums[at + k][channel];
            };
            for (int c = 0; c < to.channels; ++c) add(to.sum[c], c);
            if (weighs) add(pass.group.weight, to.channels - 1);
        });
}

/// Calls block(arena, slot) for the home blocks of a body, colour after colour; arenas, one a
/// thread, are made of `given`.
template <class A, class T, int D, class F, class... Given>
void for_each_colour(const Phase<Cpu, T, D>& phase, const F& block, const Given&... given) {
    const auto& pass = phase.pass;
#pragma omp parallel num_threads(phase_threads(*pass.exec, pass.body.count))
    {
        const auto arena = std::make_unique<A>(given...);
        for (int colour = 0; colour < pass.colours; ++colour) {
#pragma omp for schedule(dynamic, 1)
            for (std::int32_t k = pass.colour_start[colour]; k < pass.colour_start[colour + 1]; ++k)
                block(*arena, pass.coloured[k]);
        }
    }
}

}  // namespace mpm::cpu
