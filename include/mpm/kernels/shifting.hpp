// Particle shifting: where nodes hold more of a fluid than its volumes say, its particles move down
// the gradient of the excess. Velocities and volumes stay as they are.
#pragma once

#include "mpm/kernels/excess.hpp"

namespace mpm {

/// Moves the particles of a body's home blocks, a thread for each cell of a block (on devices for
/// each 64th particle).
template <class G, class T, int D>
struct ShiftParticles {
    BlockTableView<D> table;
    const Clock* clock;
    BodyView<T, D> body;
    const G* excess;
    const std::uint32_t* some;

    MPM_INLINE void operator()(std::int64_t i) const {
        if (clock->halt != Halt::none) return;
        const std::int32_t slot = body.home[i / block_cells];
        const std::int32_t* around = table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
        std::uint32_t any = 0;
        for (int n = 0; n < Block<D>::neighbours; ++n) any |= around[n] < 0 ? 0 : some[around[n]];
        if (!any) return;
        each_of_cell(body, i,
                     [&](std::int32_t of, int cell, std::uint32_t q) { shift(of, cell, q); });
    }
    MPM_INLINE void shift(std::int32_t slot, int cell, std::uint32_t q) const {
        const NodesAround<G> around{excess, 1,
                                    table.neighbours + std::int64_t(slot) * Block<D>::neighbours};
        int home[D];
        Block<D>::coordinates(cell, home);
        Vec<T, D> offset;
        for (int a = 0; a < D; ++a) offset[a] = body.offset[a][q];
        Standing<G, D> at;
        at.find(table.corners + std::int64_t(slot) * D, home, offset);
        const Stencil<G, D, 3> s = stencil_of<3>(KernelChoice{}, at.xi, Vec<G, D>{}, at.in_domain);
        G down[D] = {};
        for_each_node(s, places_in_grid<3>(at.cell), [&](const auto& k, int place, G) {
            const G* found = around(place);
            if (found == nullptr || !(*found > G(shift_band))) return;
            const G e = *found < G(0.5 + shift_band) ? *found - G(shift_band) : G(0.5);
            for (int a = 0; a < D; ++a) down[a] -= e * node_slope(s, k, a);
        });
        for (int a = 0; a < D; ++a) {
            const G most = G(shift_most), by = G(shift_rate / D) * down[a];
            if (by != G(0)) body.offset[a][q] += T(by > most ? most : (by < -most ? -most : by));
        }
    }
};

}  // namespace mpm
