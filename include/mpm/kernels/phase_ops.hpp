// The parts of the phased step that know no material, as the solver calls them: compiled once for
// each backend, precision and dimension.
#pragma once

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

}  // namespace mpm
