// Particle shifting: where nodes hold more of a fluid than its volumes say, its particles move down
// the gradient of the excess. Velocities and volumes stay as they are.
#pragma once

#include "mpm/kernels/excess.hpp"

namespace mpm {

/// Moves the particles of a body's home blocks: items as those of `NodesOfParticles`.
template <class G, class T, int D>
struct ShiftParticles {
    NodesOfParticles<G, T, D> excess;

    MPM_INLINE void operator()(std::int64_t i) const {
        excess.each(i, [&](std::uint32_t q, const auto& s, const auto& places, const auto& around) {
            G down[D] = {};
            for_each_node(s, places, [&](const auto& k, int place, G) {
                const G* found = around(place);
                if (found == nullptr || !(*found > G(shift_band))) return;
                const G e = *found < G(0.5 + shift_band) ? *found - G(shift_band) : G(0.5);
                for (int a = 0; a < D; ++a) down[a] -= e * node_slope(s, k, a);
            });
            for (int a = 0; a < D; ++a) {
                const G most = G(shift_most), by = G(shift_rate / D) * down[a];
                if (by != G(0))
                    excess.body.offset[a][q] += T(by > most ? most : (by < -most ? -most : by));
            }
        });
    }
};

}  // namespace mpm
