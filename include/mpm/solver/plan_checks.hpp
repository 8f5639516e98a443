// What a scene may not ask for together, refused when it is planned.
#pragma once

#include "mpm/solver/plan.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

/// Refuses what contact between bodies is not built for.
void check_contact(const Spec& spec);
/// The same of a body whose particles are shifted.
void check_packing(const Spec& spec, const BodySpec& body);

}  // namespace mpm
