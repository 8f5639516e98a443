// Particles that have come behind a surface, at sorts.
#pragma once

#include "mpm/kernels/boundaries.hpp"

namespace mpm {

/// Puts particles of a fluid's home blocks that stand behind a linear surface at rest before it
/// again, along its normal and by no more than a quarter of a cell. Between the lines of nodes
/// towards two faces that meet, velocities do not vanish on either, and what comes through there
/// goes with the field beyond the plane, whose normal velocities are those before it, reversed: it
/// would never come back. Sums stay as they are; what a particle weighs at a node differs by a part
/// of a step.
template <class X, class T, int D>
struct PutBeforeSurfaces {
    BlockTableView<D> table;
    BodyView<T, D> body;
    BoundaryView<D> boundaries;
    const std::uint32_t* touched;  // per slot: may a boundary hold nodes of it

    static constexpr int lanes = home_lanes<X>;
    static constexpr double most = 0.25, deepest = 1.5;  // cells

    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int32_t slot = body.home[i / lanes];
        if (!touched[slot]) return;
        for_each_of_lane<X>(body, slot, int(i % lanes),
                            [&](std::uint32_t p, int cell) { put(p, cell, slot); });
    }
    MPM_INLINE void put(std::uint32_t p, int cell, std::int32_t slot) const {
        int home[D];
        Block<D>::coordinates(cell, home);
        double x[D];
        for (int a = 0; a < D; ++a)
            x[a] = (double(table.corners[std::int64_t(slot) * D + a] + home[a]) + 0.5 +
                    double(body.offset[a][p])) *
                   boundaries.cell_size;
        for (int b = 0; b < boundaries.count; ++b) {
            const BoundaryRecord<D>& r = boundaries.records[b];
            if (!r.active || r.surface == 0 || !r.law[0].linear || r.share != 0 || r.limited)
                continue;
            const SurfaceRecord<D>& s = boundaries.surfaces[r.surface - 1];
            if (!s.at_rest()) continue;
            double normal[D], distance;
            if (!s.field.at(x, distance, normal)) continue;
            const double behind = -distance / boundaries.cell_size;
            if (!(behind > 0) || behind > deepest) continue;
            const double by = behind < most ? behind : most;
            for (int a = 0; a < D; ++a) {
                const double to = double(body.offset[a][p]) + by * normal[a];
                // As far as a sort finds it.
                if (to > -1.45 && to < 1.45) body.offset[a][p] = T(to);
            }
            return;
        }
    }
};

}  // namespace mpm
