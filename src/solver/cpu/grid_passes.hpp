// Passes over the grid, compiled apart (grid_passes.cpp) from the simulations that call them.
#pragma once

#include "mpm/exec/cpu.hpp"
#include "mpm/kernels/grid.hpp"

#define MPM_GRID_PASSES_WITH(prefix, T, D, keeps, special)                                   \
    prefix template void Cpu::largest_of<maxima_count, UpdateGrid<T, T, D, keeps, special>>( \
        std::int64_t, const UpdateGrid<T, T, D, keeps, special>&, double(&)[maxima_count]);

#define MPM_GRID_PASSES_IN(prefix, T, D)             \
    MPM_GRID_PASSES_WITH(prefix, T, D, false, false) \
    MPM_GRID_PASSES_WITH(prefix, T, D, true, false)  \
    MPM_GRID_PASSES_WITH(prefix, T, D, false, true)  \
    MPM_GRID_PASSES_WITH(prefix, T, D, true, true)

#define MPM_GRID_PASSES(prefix)           \
    MPM_GRID_PASSES_IN(prefix, float, 2)  \
    MPM_GRID_PASSES_IN(prefix, float, 3)  \
    MPM_GRID_PASSES_IN(prefix, double, 2) \
    MPM_GRID_PASSES_IN(prefix, double, 3)

namespace mpm {

MPM_GRID_PASSES(extern)

}  // namespace mpm
