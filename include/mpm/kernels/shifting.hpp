// Particle shifting: where nodes hold more of a fluid than its volumes say, its particles move down
// the gradient of the excess. What smooths volumes forgets how near particles stand to each other,
// and stirred water packs and sinks (design/fbar.md, 4). Velocities and volumes stay as they are.
#pragma once

#include "mpm/kernels/grid.hpp"
#include "mpm/kernels/reading.hpp"

namespace mpm {

/// Cell in front of walls that a node stands for: its own, or its image where it lies behind one.
template <int D>
MPM_CALL bool image_before_walls(const BoundaryView<D>& all, const std::int64_t (&cell)[D],
                                 std::int64_t (&image)[D]) {
    const Reconverge at_return;
    bool behind = false;
    for (int a = 0; a < D; ++a) image[a] = cell[a];
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active || r.share != 0 || r.limited) continue;
        if (r.surface > 0) {
            const SurfaceView<D> seen(all, all.surfaces[r.surface - 1], image);
            if (!seen.known || seen.axis < 0 || !(seen.distance < 0)) continue;
            image[seen.axis] += seen.away;
            behind = true;
            continue;
        }
        if (!r.is_box) {
            for (int f = 0; f < 2 * D; ++f) {
                if (!r.present[f]) continue;
                const WallPlane<D> wall(r, f);
                if (wall.place(image[f / 2]) >= 0) continue;
                image[f / 2] = 2 * wall.plane - 1 - image[f / 2];
                behind = true;
            }
            continue;
        }
        int nearest = -1;
        std::int64_t least = 0;
        bool inside = true;
        for (int f = 0; f < 2 * D; ++f) {
            const std::int64_t depth = -1 - WallPlane<D>(r, f).place(image[f / 2]);
            inside = inside && depth >= 0;
            if (r.present[f] && (nearest < 0 || depth < least)) {
                nearest = f;
                least = depth;
            }
        }
        if (!inside || nearest < 0) continue;
        image[nearest / 2] = 2 * WallPlane<D>(r, nearest).plane - 1 - image[nearest / 2];
        behind = true;
    }
    return behind;
}

/// Part of a node's spline that walls leave to what is before them.
template <int D>
MPM_CALL double room_of_node(const BoundaryView<D>& all, const std::int64_t (&cell)[D]) {
    const Reconverge at_return;
    double room = 1;
    for (int b = 0; b < all.count; ++b) {
        const BoundaryRecord<D>& r = all.records[b];
        if (!r.active || r.share != 0 || r.limited) continue;
        if (r.surface > 0) {
            const SurfaceView<D> seen(all, all.surfaces[r.surface - 1], cell);
            if (seen.known) room -= 1 - spline_up_to(seen.distance);
        } else if (r.is_box) {
            double taken = 1;
            for (int a = 0; a < D; ++a) {
                const double at = double(cell[a]) + 0.5;
                taken *=
                    spline_up_to(double(r.upper[a]) - at) - spline_up_to(double(r.lower[a]) - at);
            }
            room -= taken;
        } else {
            for (int f = 0; f < 2 * D; ++f) {
                if (!r.present[f]) continue;
                const WallPlane<D> wall(r, f);
                room *= spline_up_to(double(wall.place(cell[f / 2])) + 0.5);
            }
        }
    }
    return room;
}

/// By how much a fluid overfills each node: mass over that of a full one, less what its averaged
/// volume says, less what disorder alone makes of it.
template <class X, class T, class Sum, int D>
struct FindOverfull {
    NodeUpdate<T, Sum, D> node;
    GroupChannels group;
    double full;          // mass of a full node, kg
    T* overfull;          // (slots, nodes)
    std::uint32_t* some;  // (slots,), zero before: 1 where any node of the block is

    MPM_INLINE void operator()(std::int64_t i) const {
        if (node.clock->halt != Halt::none) return;
        std::int32_t slot = std::int32_t(i / block_cells);
        int n = int(i % block_cells);
        overfull[i] = 0;
        double room = 1;
        if (node.touched[slot]) {
            std::int64_t cell[D], image[D];
            node.cell(slot, n, cell);
            if (image_before_walls<D>(node.boundaries, cell, image))
                slot = node_of_field<D>(node.grid.table, slot, image, n);
            room = room_of_node<D>(node.boundaries, image);
        }
        if (slot < 0 || room < 0.1) return;
        const Sum* s = node.sums(slot, n);
        const double unit = node.clock->unit_read[mass_sum];
        const double mass =
            from_sum<double>(s[(group.weight < 0 ? 0 : group.weight) * block_cells], unit);
        if (!(mass > full * room)) return;
        const double loss =
            from_sum<double>(s[group.sum * block_cells], node.clock->unit_read[group_sum]) / mass;
        const double by = mass / (full * room) - (loss > 0 ? 1 / (1 - loss) : 1.0) - shift_band;
        if (!(by > 0)) return;
        overfull[i] = T(by < 0.5 ? by : 0.5);
        X::raise(&some[i / block_cells]);
    }
};

/// Moves the particles of a body's home blocks, a thread for each cell of a block (on devices for
/// each 64th particle).
template <class G, class T, int D>
struct ShiftParticles {
    BlockTableView<D> table;
    const Clock* clock;
    BodyView<T, D> body;
    const G* overfull;
    const std::uint32_t* some;

    MPM_INLINE void operator()(std::int64_t i) const {
        if (clock->halt != Halt::none) return;
        const std::int32_t slot = body.home[i / block_cells];
        const std::int32_t* around = table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
        std::uint32_t any = 0;
        for (int n = 0; n < Block<D>::neighbours; ++n) any |= around[n] < 0 ? 0 : some[around[n]];
        if (!any) return;
        const int k = int(i % block_cells);
        const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
        const std::uint32_t end = start[body.cell ? block_cells : k + 1];
        for (std::uint32_t q = body.cell ? start[0] + std::uint32_t(k) : start[k]; q < end;
             q += body.cell ? std::uint32_t(block_cells) : 1u)
            shift(slot, body.cell ? int(body.cell[q]) : k, q);
    }
    MPM_INLINE void shift(std::int32_t slot, int cell, std::uint32_t q) const {
        const NodesAround<G> around{overfull, 1,
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
            const G* e = around(place);
            if (e == nullptr || !(*e > G(0))) return;
            for (int a = 0; a < D; ++a) down[a] -= *e * node_slope(s, k, a);
        });
        for (int a = 0; a < D; ++a) {
            const G most = G(shift_most), by = G(shift_rate / D) * down[a];
            if (by != G(0)) body.offset[a][q] += T(by > most ? most : (by < -most ? -most : by));
        }
    }
};

}  // namespace mpm
