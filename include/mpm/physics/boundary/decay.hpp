// How a boundary's hold on the nodes fades with their distance from it (Yang 2016, 4.23 to 4.26 and
// Table 5.1; the cosine in the digest's corrected form): 1 on and behind the surface, 0 beyond the
// layer.
#pragma once

#include "mpm/core/number.hpp"

namespace mpm {

enum class Decay : int { free, linear, quadratic, flipped, cosine, constrained };

/// Share of the boundary's change that a node at `r` = distance / thickness takes.
MPM_HD inline double decayed(Decay function, double r) {
    if (r <= 0) return 1;
    // A node on the layer's edge belongs to the layer of a constant hold, whatever rounding does.
    if (function == Decay::constrained) return r <= 1 + 1e-6 ? 1 : 0;
    if (r >= 1 || function == Decay::free) return 0;
    if (function == Decay::linear) return 1 - r;
    if (function == Decay::quadratic) return (1 - r) * (1 - r);
    if (function == Decay::flipped) return 1 - r * r;
    return 0.5 * (1 + cos(3.14159265358979323846 * r));
}

}  // namespace mpm
