// The warps of the fused step that add up what others of their block deposit
// (kernels/cuda/split.cuh).
#pragma once

#include "mpm/kernels/cuda/split_shared.cuh"

namespace mpm::cuda {

/// The scale of a sum; the one after the last is that of the mass.
template <class Sizes>
__device__ __forceinline__ float scale_of(const Scales<float, 3>& scales, int channel) {
    if (channel >= Sizes::C && channel < Sizes::sums) return scales.momentum;
    return scales.template of<Sizes::C>(channel);
}

/// What a warp that adds holds of its plane: N channels from `first` of those of the sums on, and
/// the mass.
template <int First, int N, bool Mass>
struct PlaneSums {
    static constexpr int first = First, channels = N;
    static constexpr bool mass = Mass;
    float value[9][N + mass];
    __device__ __forceinline__ void add(int node, int channel, float v) {
        value[node][channel] += v;
    }
    __device__ __forceinline__ void add_mass(int node, float v) {
        if constexpr (mass) value[node][N] += v;
    }
};

/// What a warp that adds does: `Sums` of a plane of the stencils of 32 cells.
template <class Sums, class Sizes>
__device__ __forceinline__ void add_rows(const Pass<Cuda, float, 3>& pass,
                                         SplitShared<Sizes>& shared, int plane) {
    using Shared = SplitShared<Sizes>;
    using Places = SplitPlaces<Sizes::H>;
    constexpr int N = Sums::channels, values = N + Sums::mass;
    const int lane = threadIdx.x % 32;
    // The weight of the plane, as `quadratic_weights` has it.
    const float side = float(plane - 1), p0 = plane == 1 ? 0.75f : 0.125f, p1 = 0.5f * side,
                p2 = plane == 1 ? -1.0f : 0.5f;
    std::uint32_t turn = 0;
#pragma unroll 1
    for (int group = 0; group < 2 * Sizes::H; ++group) {
        const CellPlaces& places = shared.places[group / 2];
        const int place = group % 2 * warp_cells + lane;
        const std::uint32_t count = places.count[place], most = __reduce_max_sync(~0u, count);
        Sums sums;
        MPM_UNROLL for (int n = 0; n < 9; ++n) MPM_UNROLL for (int c = 0; c < values; ++c)
            sums.value[n][c] = 0;
#pragma unroll 1
        for (std::uint32_t first = 0; first < most; first += chunk_ranks, ++turn) {
            await_full<Sizes::threads>(turn);
            const std::uint32_t own = of_chunk(count, first);
            const Piece* row = &shared.ring[turn % 2][0][lane];
#pragma unroll 1
            for (std::uint32_t r = 0; __any_sync(~0u, r < own); ++r, row += Shared::pitch) {
                if (r >= own) continue;
                Record<N> record;
                if constexpr (Sums::first == 0) {
                    record.get(row, warp_cells);
                } else {
                    record.get_place(row);
                    PlainPieces::get(row + Record<Sizes::C>::pieces * warp_cells, warp_cells,
                                     record.centre, record.slope);
                }
                const float x = record.local[0], share = record.tag * (p0 + x * (p1 + x * p2));
                MPM_UNROLL for (int c = 0; c < N; ++c) record.centre[c] =
                    record.centre[c] + side * record.slope[0][c];
                detail::spread<1, false, float, 3, N>(sums,
                                                      quadratic_weights<float, 3>(record.local),
                                                      share, record.centre, record.slope, 0);
            }
            arrive(shared.empty + turn % 2);
        }
        if (count == 0) continue;
        const Scales<float, 3> scales(pass);
        int cell[3];
        Block<3>::coordinates(places.cell_at[place], cell);
        cell[0] += group / 2 * Block<3>::edge;
        std::int32_t* to =
            shared.sums.at + stencil_origin<Places, 3>(cell) + plane * Places::stride(0);
        MPM_UNROLL for (int n = 0; n < 9; ++n) MPM_UNROLL for (int c = 0; c < values; ++c) {
            const int channel = c < N ? Sums::first + c : Sizes::sums;
            atomicAdd(to + channel * Places::nodes + n / 3 * Places::stride(1) + n % 3,
                      to_fixed(sums.value[n][c] * scale_of<Sizes>(scales, channel)));
        }
    }
}

/// The work of one of the warps that add.
template <class Sizes>
__device__ __forceinline__ void add_as(const Pass<Cuda, float, 3>& pass, SplitShared<Sizes>& shared,
                                       int adder) {
    if constexpr (!Sizes::keeps)
        add_rows<PlaneSums<0, Sizes::C, true>>(pass, shared, adder);
    else if (adder < 3)
        add_rows<PlaneSums<0, Sizes::C, false>>(pass, shared, adder);
    else
        add_rows<PlaneSums<Sizes::C, 3, true>>(pass, shared, adder - 3);
}

}  // namespace mpm::cuda
