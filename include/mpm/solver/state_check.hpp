// Whether a saved state can be this scene's: asked before any of it is adopted, so that a state
// that is refused leaves the engine as it was.
#pragma once

#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

/// Raises `SceneError`, by the name of the entry, unless every index, size and number of the state
/// can be run with: of the clock, the table of blocks, the particles in it, their sums, inlets and
/// sensors. `plan`: of the engine, whose spec may be that of one rank of several.
void check_state(const State& state, const Spec& spec, const Plan& plan);

}  // namespace mpm
