// Passes over the grid, compiled apart (grid_passes.cpp) from the simulations that call them.
#pragma once

#include "mpm/exec/cpu.hpp"
#include "mpm/kernels/wall_nodes.hpp"

#define MPM_GRID_PASSES_WITH(prefix, T, D, keeps, mirrors, lines)              \
    prefix template void                                                       \
    Cpu::largest_of<maxima_count, UpdateGrid<T, T, D, keeps, mirrors, lines>>( \
        std::int64_t, const UpdateGrid<T, T, D, keeps, mirrors, lines>&, double(&)[maxima_count]);

#define MPM_WALL_PASS(prefix, T, D, pass)                             \
    prefix template void Cpu::for_each<MoveWallNodes<T, T, D, pass>>( \
        std::int64_t, const MoveWallNodes<T, T, D, pass>&);

#define MPM_GRID_PASSES_IN(prefix, T, D)                                                       \
    MPM_GRID_PASSES_WITH(prefix, T, D, false, false, false)                                    \
    MPM_GRID_PASSES_WITH(prefix, T, D, true, false, false)                                     \
    MPM_GRID_PASSES_WITH(prefix, T, D, false, false, true)                                     \
    MPM_GRID_PASSES_WITH(prefix, T, D, true, false, true)                                      \
    MPM_GRID_PASSES_WITH(prefix, T, D, false, true, false)                                     \
    MPM_GRID_PASSES_WITH(prefix, T, D, true, true, false)                                      \
    prefix template void Cpu::for_each<SeatWallNodes<T, T, D>>(std::int64_t,                   \
                                                               const SeatWallNodes<T, T, D>&); \
    MPM_WALL_PASS(prefix, T, D, WallPass::held)                                                \
    MPM_WALL_PASS(prefix, T, D, WallPass::all)

#define MPM_GRID_PASSES(prefix)           \
    MPM_GRID_PASSES_IN(prefix, float, 2)  \
    MPM_GRID_PASSES_IN(prefix, float, 3)  \
    MPM_GRID_PASSES_IN(prefix, double, 2) \
    MPM_GRID_PASSES_IN(prefix, double, 3)

namespace mpm {

MPM_GRID_PASSES(extern)

}  // namespace mpm
