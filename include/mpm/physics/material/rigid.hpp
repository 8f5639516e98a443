// No law: a body whose particles keep their distances. It has a density, no stress and no wave, and
// is moved as a whole (physics/rigid.hpp); no kernel is compiled for it.
#pragma once

#include "mpm/core/linalg.hpp"
#include "mpm/physics/material/description.hpp"

namespace mpm {

struct Rigid {
    static constexpr const char* name = "Rigid";
    static constexpr const char* summary =
        "Rigid body: mass and inertia, six degrees of freedom, no strain and no wave";
    static constexpr const char* source = "Newton's and Euler's laws of motion";
    static constexpr const char* needs = "nothing";
    static constexpr const char* limits = "its position is not finite";
    static constexpr Parameter parameters[] = {
        {"density", "ρ", "kg/m³", required, 0.0, unbounded, true, true, "density"}};
    static double density(const double* p) { return p[0]; }
    static double wave_speed(const double*) { return 0; }
};

}  // namespace mpm
