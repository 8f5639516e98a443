// How far ahead sorts look.
#pragma once

#include <cstdlib>
#include <string>

#include "mpm/core/error.hpp"

namespace mpm {

/// Share of the drift that a sort looks ahead (`Decide::sort_for`): the executor's, or what
/// LIBMPM_LOOK_AHEAD asks for, to measure what it brings (design/gpu-step.md). All ranks need the
/// same.
inline double look_ahead_of(double executor) {
    const char* asked = std::getenv("LIBMPM_LOOK_AHEAD");
    if (asked == nullptr || *asked == 0) return executor;
    char* end = nullptr;
    const double share = std::strtod(asked, &end);
    if (*end != 0 || !(share >= 0 && share <= 0.5))
        throw SceneError("LIBMPM_LOOK_AHEAD is '" + std::string(asked) +
                         "'; give a share of the drift, 0 to 0.5");
    return share;
}

}  // namespace mpm
