// What laws say to elements whose energy has the volumetric part lambda / 2 (ln J)^2.
#pragma once

#include "mpm/physics/material/elasticity.hpp"

namespace mpm {

struct LogarithmicVolume {
    static constexpr bool hyperelastic = true;
    /// U' of J - 1, Pa.
    template <class V, class T>
    MPM_INLINE static V volume_pressure(V change, const Elasticity<T>& k) {
        return k.lame * log1p_of(change) / (T(1) + change);
    }
    /// U, J/m^3.
    template <class V, class T>
    MPM_INLINE static V volume_energy(V change, const Elasticity<T>& k) {
        const V log_J = log1p_of(change);
        return T(0.5) * k.lame * log_J * log_J;
    }
};

}  // namespace mpm
