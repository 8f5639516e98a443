// Domain: what keeps a fluid from packing (design/fbar.md, 4).
#pragma once

#include "mpm/kernels/density.hpp"
#include "mpm/kernels/shifting.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

/// Before particles move, while the sums say how full the nodes are that they are about to leave:
/// particles are shifted, volumes led.
template <class X, class T, int D>
void Domain<X, T, D>::spread_packed() {
    if (!(plan_.shift > 0 || plan_.density) || !shifts_in(clock_.step)) return;
    const std::int64_t nodes = std::int64_t(table_.slots) * block_cells;
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        const BodySpec& s = spec_.bodies[b];
        if (!(s.shifts || s.density) || body.homes == 0) continue;
        excess_.reserve_discard(std::size_t(nodes));
        some_excess_.reserve_discard(std::size_t(table_.slots));
        some_excess_.zero();
        const BodyView<T, D> view = body.view();
        const double full =
            view.particle_mass / view.particle_volume * std::pow(spec_.cell_size, D);
        exec_.for_each(
            nodes, FindExcess<X, Grid, Sum, D>{node_update(parity()), body.plan.group, full,
                                               excess_.data(), shift_band, some_excess_.data()});
        const std::int64_t cells = std::int64_t(body.homes) * block_cells;
        if (s.density) {
            packed_.reserve_discard(std::size_t(nodes));
            some_packed_.reserve_discard(std::size_t(table_.slots));
            some_packed_.zero();
            exec_.for_each(nodes,
                           FindPacked<X, Grid, D>{table_, clock_buffer_.data(), excess_.data(),
                                                  packed_.data(), some_packed_.data()});
            exec_.for_each(cells, LeadVolumes<Grid, T, D>{{table_, clock_buffer_.data(), view,
                                                           packed_.data(), some_packed_.data()}});
        }
        if (s.shifts)
            exec_.for_each(cells,
                           ShiftParticles<Grid, T, D>{{table_, clock_buffer_.data(), view,
                                                       excess_.data(), some_excess_.data()}});
    }
}

}  // namespace mpm
