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

/// What the ranks that a body is shared among do together while cells sum it up.
struct CellPeers {
    /// Adds to the blocks that several ranks hold, with so many numbers a cell, what all have of
    /// them: then these are what one rank would have.
    virtual void complete(double* cells, std::size_t width) = 0;

protected:
    ~CellPeers() = default;
};
/// The same on CPUs, which have staged it, and wait for each other.
struct StagedPeers : CellPeers {
    /// Adds up what each rank has of its own particles.
    virtual void add_up(SmoothingTotals& totals) = 0;

protected:
    ~StagedPeers() = default;
};
/// Room for `cell_numbers` of every cell (cell_phases.hpp), and behind those of the table for the
/// cells of staged blocks (kernels/staging.hpp), of which the body's begin and end there.
struct CellRoom {
    double* cells;
    StagedPeers* peers = nullptr;  // null: one rank
    std::int32_t first_staged = 0, last_staged = 0;
};
/// What a body's step does between its parts, one entry where each belongs.
template <class X, class T, int D>
struct CellOps {
    using Run = void (*)(const Phase<X, T, D>&, const CellNumbers&, const CellRoom&);
    Run collected;                                                                          // rates
    SmoothingEnergy (*smooth)(const Phase<X, T, D>&, const CellNumbers&, const CellRoom&);  // state
    Run responded;  // deposits
};

/// For CPUs.
template <class X, class T, int D>
CellOps<X, T, D> cell_ops();

template <int D>
struct CellTask;
/// For devices: smooths the state, and leaves sums of the energy (cell_sums.hpp). `peers`: null
/// where this is the only rank.
template <class X, class T, int D>
using SmoothCells = void (*)(const Phase<X, T, D>&, const CellTask<D>&, CellPeers* peers);
template <class X, class T, int D>
SmoothCells<X, T, D> smooth_cells();

}  // namespace mpm
