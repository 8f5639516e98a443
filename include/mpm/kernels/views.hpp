// What kernels see of a simulation: pointers and sizes, no ownership.
#pragma once

#include <type_traits>

#include "mpm/data/blocks.hpp"
#include "mpm/kernels/clock.hpp"
#include "mpm/kernels/order.hpp"

namespace mpm {

inline constexpr int max_state_columns = 24;

/// Nodal values of all active blocks. Sums by block, channel, node: entry (slot * channels + c) *
/// 64
/// + node, so that neighbouring workers add to neighbouring numbers. Velocities by block, node,
/// channel, so that a reader takes a node in one piece.
template <class T, class Sum, int D>
struct GridView {
    BlockTableView<D> table;
    T* velocity;  // D velocities [m/s], then one averaged j per F-bar group
    int velocity_channels;
    Sum* sums;  // mass [kg], D momenta [kg m/s], then per group mass * j [kg] and, where it
                // differs, the group's mass
    int sum_channels;

    /// Where a node's velocities begin.
    MPM_INLINE std::int64_t velocity_place(std::int32_t slot, int node) const {
        return (std::int64_t(slot) * block_cells + node) * velocity_channels;
    }
};

/// Where one F-bar group keeps its channels; -1: absent (`weight` < 0: the nodal mass serves).
struct GroupChannels {
    int average = -1;
    int sum = -1;
    int weight = -1;
    bool split = false;  // the average is made once more within the step
};

template <class T, int D>
struct BodyView {
    T* offset[D];                 // from the centre of the home cell, cells
    T* state[max_state_columns];  // the material's reals, then the blended volume where it is
                                  // stored
    const std::uint32_t* id;      // counted from the body's first
    std::uint32_t count;
    const std::uint32_t* cell_start;  // (slots * 64 + 1)
    const std::uint8_t* cell;         // devices: `home_byte` of each particle
    const std::int32_t* home;         // slots that hold particles; on devices the full ones first
    std::int32_t homes;
    // Devices: of them, those that are done as blocks; the particles of the others, one by one.
    std::int32_t full_homes;
    // Devices: the full ones two by two along the first axis, -1 where one is missing; 0 pairs: not
    // listed.
    const std::int32_t* pair;
    std::int32_t pairs;
    const std::uint32_t* lone;
    const std::int32_t* lone_slot;
    std::uint32_t lone_count;
    double particle_mass;    // kg (2D: kg/m)
    double particle_volume;  // m^3 at zero strain (2D: m^2)

    /// Devices: a particle's home cell in its block.
    MPM_INLINE int home_cell(std::uint32_t q) const { return home_cell_of(cell[q]); }
};

/// Home cells of a block's particles, asked for in storage order.
struct HomeCells {
    const std::uint32_t* start;  // of the block's cells
    const std::uint8_t* cell;    // home bytes; null where particles are stored cell by cell
    int here = 0;
    MPM_INLINE int of(std::uint32_t q) {
        if (cell) return home_cell_of(cell[q]);
        while (start[here + 1] <= q) ++here;
        return here;
    }
};

template <class T, class Sum>
MPM_INLINE T from_sum(Sum s, double unit) {
    if constexpr (std::is_integral_v<Sum>) {
        return T(s) * T(unit);  // a power of two: rounds once
    } else {
        return s;
    }
}

/// On the host: f(home cell, particle) for the particles of a home block.
template <class T, int D, class F>
MPM_INLINE void for_each_of_block(const BodyView<T, D>& body, std::int32_t slot, const F& f) {
    const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
    for (int c = 0; c < block_cells; ++c) {
        if (start[c] == start[c + 1]) continue;
        int home[D];
        Block<D>::coordinates(c, home);
        for (std::uint32_t q = start[c]; q < start[c + 1]; ++q) f(home, q);
    }
}

/// Workers of a home block where each takes single particles: on a device a particle or two each,
/// as it takes them one after another; on the CPU those of a cell.
template <class X>
inline constexpr int home_lanes = X::is_device ? 256 : block_cells;

/// f(particle, number of its home cell) for those of one worker.
template <class X, class T, int D, class F>
MPM_INLINE void for_each_of_lane(const BodyView<T, D>& body, std::int32_t slot, int lane,
                                 const F& f) {
    const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
    if constexpr (X::is_device) {
        for (std::uint32_t p = start[0] + lane; p < start[block_cells]; p += home_lanes<X>)
            f(p, body.home_cell(p));
    } else {
        for (std::uint32_t p = start[lane]; p < start[lane + 1]; ++p) f(p, lane);
    }
}

/// Of what nodes press on a bed with water in the gap below solids, the part that these rub with:
/// without what water beside them presses there (kernels/uplift.hpp).
template <class T>
struct RubbingParts {
    const T* part = nullptr;  // (records, listed blocks, nodes), 1 more than it is, or 0 where that
                              // of the mass counts; null where no boundary has such a gap
    const std::int32_t* record = nullptr;  // by boundary, -1 without a gap
    std::int64_t nodes = 0;                // of all listed blocks

    /// `touched`: 1 + place of a block among the listed ones.
    MPM_INLINE T at(int boundary, std::uint32_t touched, int node, T of_mass) const {
        if (!part || touched == 0 || record[boundary] < 0) return of_mass;
        const std::int64_t place = std::int64_t(touched - 1) * block_cells + node;
        const T found = part[record[boundary] * nodes + place];
        return found > T(0) ? found - T(1) : of_mass;
    }
};

}  // namespace mpm
