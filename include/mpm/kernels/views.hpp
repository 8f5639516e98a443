// What kernels see of a simulation: pointers and sizes, no ownership.
#pragma once

#include <type_traits>

#include "mpm/data/blocks.hpp"
#include "mpm/kernels/clock.hpp"

namespace mpm {

inline constexpr int max_state_columns = 16;

/// Nodal values of all active blocks, by block, channel, node: entry (slot * channels + c) * 64 +
/// node.
template <class T, class Sum, int D>
struct GridView {
    BlockTableView<D> table;
    T* velocity;  // D velocities [m/s], then one averaged j per F-bar group
    int velocity_channels;
    Sum* sums;  // mass [kg], D momenta [kg m/s], then per group mass * j [kg] and, where it
                // differs, the group's mass
    int sum_channels;
};

/// Where one F-bar group keeps its channels; -1: absent (`weight` < 0: the nodal mass serves).
struct GroupChannels {
    int average = -1;
    int sum = -1;
    int weight = -1;
};

template <class T, int D>
struct BodyView {
    T* offset[D];                 // from the centre of the home cell, cells
    T* state[max_state_columns];  // the material's reals, then the blended volume where it is
                                  // stored
    const std::uint32_t* id;      // counted from the body's first
    std::uint32_t count;
    const std::uint32_t* cell_start;  // (slots * 64 + 1)
    const std::int32_t* home;         // slots that hold particles, ascending
    std::int32_t homes;
    double particle_mass;    // kg (2D: kg/m)
    double particle_volume;  // m^3 at zero strain (2D: m^2)
};

template <class T, class Sum>
MPM_INLINE T from_sum(Sum s, double scale) {
    if constexpr (std::is_integral_v<Sum>) {
        return T(double(s) / scale);
    } else {
        return s;
    }
}

}  // namespace mpm
