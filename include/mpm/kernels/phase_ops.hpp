// The parts of the phased step that know no material, as the solver calls them: compiled once for
// each backend, precision and dimension.
#pragma once

#include "mpm/kernels/cell_smoothing.hpp"
#include "mpm/kernels/phase.hpp"

namespace mpm {

template <class X, class T, int D>
struct PhaseOps {
    using Run = void (*)(const Phase<X, T, D>&);
    Run collect;
    Run spread;
};

template <class X, class T, int D>
PhaseOps<X, T, D> phase_ops();

/// What a body's step does between its parts, one entry where each belongs. `cells` is room for
/// `cell_numbers` of every cell (cell_phases.hpp).
template <class X, class T, int D>
struct CellOps {
    using Run = void (*)(const Phase<X, T, D>&, const CellNumbers&, double* cells);
    Run collected;                                                                        // rates
    SmoothingEnergy (*smooth)(const Phase<X, T, D>&, const CellNumbers&, double* cells);  // state
    Run responded;  // deposits
};

/// For CPUs.
template <class X, class T, int D>
CellOps<X, T, D> cell_ops();

template <int D>
struct CellTask;
/// For devices: smooths the state, and leaves sums of the energy (cell_sums.hpp).
template <class X, class T, int D>
using SmoothCells = void (*)(const Phase<X, T, D>&, const CellTask<D>&);
template <class X, class T, int D>
SmoothCells<X, T, D> smooth_cells();

}  // namespace mpm
