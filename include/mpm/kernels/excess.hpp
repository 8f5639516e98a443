// By how much a fluid overfills the nodes of the grid: what particle shifting and volumes that are
// led by density work from. What smooths volumes forgets how near particles stand to each other,
// and stirred water packs and sinks (design/fbar.md, 4).
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

/// Density of a fluid at each node over that of a full one, less what its averaged volume says;
/// zero between that and a full one, for particles start at the distances of unloaded water.
/// Negative where there is room, not a number where walls leave too little of the node.
template <class X, class T, class Sum, int D>
struct FindExcess {
    NodeUpdate<T, Sum, D> node;
    GroupChannels group;
    double full;          // mass of a full node, kg
    T* excess;            // (slots, nodes)
    double band;          // what disorder alone makes of it
    std::uint32_t* some;  // (slots,), zero before: 1 where any node of the block has more

    MPM_INLINE void operator()(std::int64_t i) const {
        if (node.clock->halt != Halt::none) return;
        std::int32_t slot = std::int32_t(i / block_cells);
        int n = int(i % block_cells);
        excess[i] = T(nan(""));
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
        const double mass = from_sum<double>(s[(group.weight < 0 ? 0 : group.weight) * block_cells],
                                             node.clock->unit_read[mass_sum]);
        const double density = mass / (full * room);
        const double loss = mass > 0 ? from_sum<double>(s[group.sum * block_cells],
                                                        node.clock->unit_read[group_sum]) /
                                           mass
                                     : 0;
        const double said = loss < 1 ? 1 / (1 - loss) : 1.0;
        const double least = said < 1 ? said : 1.0, most = said > 1 ? said : 1.0;
        const double by = density > most ? density - most : density < least ? density - least : 0;
        excess[i] = T(by);
        if (by > band) X::raise(&some[i / block_cells]);
    }
};

/// Is a block or one of those about it flagged?
template <int D>
MPM_INLINE bool any_about(const BlockTableView<D>& table, std::int32_t slot,
                          const std::uint32_t* flag) {
    const std::int32_t* around = table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
    std::uint32_t any = 0;
    for (int n = 0; n < Block<D>::neighbours; ++n) any |= around[n] < 0 ? 0 : flag[around[n]];
    return any != 0;
}

/// Nodal values as the particles of a body see them, those of home blocks beside flagged blocks.
template <class G, class T, int D>
struct NodesOfParticles {
    BlockTableView<D> table;
    const Clock* clock;
    BodyView<T, D> body;
    const G* value;             // (slots, nodes)
    const std::uint32_t* some;  // (slots,)

    /// f(particle, its functions, places of its nodes, values around) for item i of (home blocks,
    /// cells of a block): where particles are stored cell by cell those of the cell, else each 64th
    /// of the block.
    template <class F>
    MPM_INLINE void each(std::int64_t i, const F& f) const {
        if (clock->halt != Halt::none) return;
        const std::int32_t slot = body.home[i / block_cells];
        if (!any_about(table, slot, some)) return;
        const NodesAround<G> around{value, 1,
                                    table.neighbours + std::int64_t(slot) * Block<D>::neighbours};
        const int k = int(i % block_cells);
        const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
        const std::uint32_t end = start[body.cell ? block_cells : k + 1];
        for (std::uint32_t q = body.cell ? start[0] + std::uint32_t(k) : start[k]; q < end;
             q += body.cell ? std::uint32_t(block_cells) : 1u) {
            int home[D];
            Block<D>::coordinates(body.cell ? body.home_cell(q) : k, home);
            Vec<T, D> offset;
            for (int a = 0; a < D; ++a) offset[a] = body.offset[a][q];
            Standing<G, D> at;
            at.find(table.corners + std::int64_t(slot) * D, home, offset);
            f(q, stencil_of<3>(KernelChoice{}, at.xi, Vec<G, D>{}, at.in_domain),
              places_in_grid<3>(at.cell), around);
        }
    }
};

}  // namespace mpm
