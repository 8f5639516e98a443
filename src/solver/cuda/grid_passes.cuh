// Passes over the grid, the largest kernels there are: the units of the precisions that keep their
// grid in T share one instance each, compiled in grid_<T>.cu.
#pragma once

#include "mpm/exec/cuda.cuh"
#include "mpm/exec/cuda_meeting.cuh"
#include "mpm/solver/domain.hpp"

#define MPM_GRID_PASS(prefix, D, ...)                                             \
    prefix template void Cuda::max_each<maxima_count, __VA_ARGS__, AfterGrid<D>>( \
        std::int64_t, const __VA_ARGS__&, const AfterGrid<D>&);

#define MPM_WALL_PASS(prefix, T, D, pass)                                              \
    prefix template void Cuda::for_each_next<MoveWallNodes<T, Cuda::Sum<T>, D, pass>>( \
        std::int64_t, const MoveWallNodes<T, Cuda::Sum<T>, D, pass>&);

#define MPM_GRID_PASSES_IN(prefix, T, D)                                                        \
    MPM_GRID_PASS(prefix, D, UpdateGrid<T, Cuda::Sum<T>, D, false, false>)                      \
    MPM_GRID_PASS(prefix, D, UpdateGrid<T, Cuda::Sum<T>, D, true, false>)                       \
    MPM_GRID_PASS(prefix, D, UpdateGrid<T, Cuda::Sum<T>, D, false, true>)                       \
    MPM_GRID_PASS(prefix, D, UpdateGrid<T, Cuda::Sum<T>, D, true, true>)                        \
    prefix template void Cuda::for_each_next<SeatWallNodes<T, Cuda::Sum<T>, D>>(                \
        std::int64_t, const SeatWallNodes<T, Cuda::Sum<T>, D>&);                                \
    MPM_WALL_PASS(prefix, T, D, WallPass::lines)                                                \
    MPM_WALL_PASS(prefix, T, D, WallPass::held)                                                 \
    MPM_WALL_PASS(prefix, T, D, WallPass::all)                                                  \
    MPM_GRID_PASS(prefix, D, FinishSweep<T, Cuda::Sum<T>, D>)                                   \
    prefix template void Cuda::sum_each<load_columns<D>, MeasureLoads<T, Cuda::Sum<T>, D>,      \
                                        TakeLoad<D>, Int128, SamplePoints<T, Cuda::Sum<T>, D>>( \
        const SumSets&, const MeasureLoads<T, Cuda::Sum<T>, D>&, const TakeLoad<D>&, Int128*,   \
        std::int64_t, const SamplePoints<T, Cuda::Sum<T>, D>&);                                 \
    prefix template void Cuda::for_each_large<SamplePoints<T, Cuda::Sum<T>, D>>(                \
        std::int64_t, const SamplePoints<T, Cuda::Sum<T>, D>&);

// Beside the first ones in units of their own, contact_*.cu: a scene without contacts never
// launches them, and together they were more than a unit may take (design/build.md).
#define MPM_CONTACT_PASSES_IN(prefix, T, D)                                                      \
    prefix template void Cuda::max_each<maxima_count, ContactPass<Cuda, T, Cuda::Sum<T>, D>,     \
                                        AfterContact<AfterGrid<D>>>(                             \
        std::int64_t, const ContactPass<Cuda, T, Cuda::Sum<T>, D>&,                              \
        const AfterContact<AfterGrid<D>>&);                                                      \
    prefix template void Cuda::sum_each<load_columns<D>, MeasureLoads<T, Cuda::Sum<T>, D, true>, \
                                        TakeLoad<D>, Int128, Nothing>(                           \
        const SumSets&, const MeasureLoads<T, Cuda::Sum<T>, D, true>&, const TakeLoad<D>&,       \
        Int128*, std::int64_t, const Nothing&);                                                  \
    prefix template void Cuda::sum_each<contact_columns<D>, MeasureContacts<T, Cuda::Sum<T>, D>, \
                                        TakeContact<D>, Int128, Nothing>(                        \
        const SumSets&, const MeasureContacts<T, Cuda::Sum<T>, D>&, const TakeContact<D>&,       \
        Int128*, std::int64_t, const Nothing&);
#define MPM_CONTACT_PASSES(prefix, T)   \
    MPM_CONTACT_PASSES_IN(prefix, T, 2) \
    MPM_CONTACT_PASSES_IN(prefix, T, 3)

// In a unit of their own too: few scenes have water in the gap below what stands on a bed.
#define MPM_UPLIFT_PASSES_IN(prefix, T, D)                                                      \
    prefix template void Cuda::for_each<FindUplift<T, Cuda::Sum<T>, D>>(                        \
        std::int64_t, const FindUplift<T, Cuda::Sum<T>, D>&);                                   \
    prefix template void Cuda::sum_each<load_columns<D>, MeasureUplift<T, Cuda::Sum<T>, D>,     \
                                        AddToLoad<D>, Int128, Nothing>(                         \
        const SumSets&, const MeasureUplift<T, Cuda::Sum<T>, D>&, const AddToLoad<D>&, Int128*, \
        std::int64_t, const Nothing&);
#define MPM_UPLIFT_PASSES(prefix)                                                       \
    MPM_UPLIFT_PASSES_IN(prefix, float, 2)                                              \
    MPM_UPLIFT_PASSES_IN(prefix, float, 3)                                              \
    MPM_UPLIFT_PASSES_IN(prefix, double, 2)                                             \
    MPM_UPLIFT_PASSES_IN(prefix, double, 3)                                             \
    prefix template void Cuda::for_each<MarkFeet<2>>(std::int64_t, const MarkFeet<2>&); \
    prefix template void Cuda::for_each<MarkFeet<3>>(std::int64_t, const MarkFeet<3>&);

#define MPM_GRID_PASSES(prefix, T)   \
    MPM_GRID_PASSES_IN(prefix, T, 2) \
    MPM_GRID_PASSES_IN(prefix, T, 3)

// What a step does once, whatever the grid is kept in.
#define MPM_TURNS_IN(prefix, D)                                           \
    prefix template void Cuda::single<BeginStep<D>>(const BeginStep<D>&); \
    prefix template void Cuda::single<TurnStep<D>>(const TurnStep<D>&);   \
    prefix template void Cuda::single<DecideByVotes<D>>(const DecideByVotes<D>&);
#define MPM_TURNS(prefix)   \
    MPM_TURNS_IN(prefix, 2) \
    MPM_TURNS_IN(prefix, 3)

namespace mpm {

MPM_GRID_PASSES(extern, float)
MPM_GRID_PASSES(extern, double)
MPM_CONTACT_PASSES(extern, float)
MPM_CONTACT_PASSES(extern, double)
MPM_UPLIFT_PASSES(extern)
MPM_TURNS(extern)

}  // namespace mpm
