// Nodes of the blocks that boundaries touch, in scenes with boundaries that only some have: listed
// by what they ask for when the table of blocks is made, moved in passes of their own before the
// pass over all nodes. There their long functions would cost every node registers and a stack. On
// hosts those on lines alone are moved in that pass, from pieces of their own (design/walls.md, 7).
#pragma once

#include "mpm/kernels/grid.hpp"

namespace mpm {

/// Hears whether any boundary acts on a node, whatever it then leaves.
struct Acted {
    bool* acted;
    template <class... A>
    MPM_INLINE void operator()(const A&...) const {
        *acted = true;
    }
};

/// What the nodes of the listed blocks ask for, their lines, and what they see of linear surfaces,
/// where none of it changes with time. Where something that moves is near or what does not always
/// act may be, or where two surfaces meet, nodes are `unknown` and find out in each step; where
/// something that moves may come they are `watched`, and find out once it has come.
template <int D>
struct ClassifyWallNodes {
    BlockTableView<D> table;
    BoundaryView<D> boundaries;
    const std::int32_t* blocks;
    bool edges;                           // those of boxes push (`FollowLines::push_at_edges`)
    WallAsks* asks;                       // (blocks, nodes)
    std::uint32_t* lines;                 // (blocks, nodes, D), packed
    SurfaceNode<D>* surfaces;             // (blocks, nodes); null where no surface is linear
    std::uint32_t* of_pass[wall_passes];  // (blocks, nodes): 1 where it is moved there

    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int32_t slot = blocks[i / block_cells];
        int at[D];
        Block<D>::coordinates(int(i % block_cells), at);
        std::int64_t cell[D];
        for (int a = 0; a < D; ++a) cell[a] = table.corners[std::int64_t(slot) * D + a] + at[a];
        bool on = false, edge = false, held = false, surface = false;
        const bool alone = boundaries.holds(table, slot);
        for (int a = 0; a < D; ++a) {
            WallLine line;
            if (boundaries.lines) line = find_line<D>(boundaries, a, cell, alone);
            lines[i * D + a] = line.packed();
            on = on || line.form != WallLine::none;
            // Those that it shares its line with push there as well.
            for (int by = -2; by < 3 && edges; ++by) {
                std::int64_t there[D];
                moved_along<D>(cell, a, by, there);
                each_edge<D>(boundaries, there, [&](int, int, int, double) { edge = true; });
            }
        }
        Vec<double, D> v{};
        apply_boundaries<true>(boundaries, cell, v, Acted{&held});
        int beside = -1, near = 0;
        for (int b = 0; b < boundaries.count && boundaries.surface_lines; ++b) {
            const BoundaryRecord<D>& r = boundaries.records[b];
            if (r.surface == 0 || !r.law[0].linear) continue;
            if (!SurfaceView<D>(boundaries, boundaries.surfaces[r.surface - 1], cell).known)
                continue;
            beside = b;
            ++near;
        }
        const bool watched = moving_near<D>(boundaries, cell, far_off);
        bool unknown = near > 1 || (watched && moved_near<D>(boundaries, cell, WallNode::aware));
        for (int b = 0; b < boundaries.count; ++b) unknown = unknown || may_change(b, cell);
        if (surfaces) {
            SurfaceNode<D> seen;
            if (near == 1 && !unknown) {
                const BoundaryRecord<D>& r = boundaries.records[beside];
                const SurfaceRecord<D>& s = boundaries.surfaces[r.surface - 1];
                const SurfaceView<D> view(boundaries, s, cell);
                const SurfaceLine<D> line = surface_line<D>(boundaries, beside, cell, alone);
                seen = SurfaceNode<D>(beside, view, line);
                if (!watched && line.state != SurfaceLine<D>::on && view.axis >= 0 &&
                    view.distance < 2.2 && !view.deep() && near_edge<D>(boundaries, s, cell, view))
                    seen.cut = CutSpline<D>(boundaries, s, cell);
                if (line.state == SurfaceLine<D>::held) {
                    double x[D], there[D];
                    node_position<D>(cell, boundaries.cell_size, x);
                    s.to_body(x, there);
                    s.field.at(there, seen.lead, seen.normal);
                }
                // What a line towards a wall would have of a surface near it goes the long way.
                surface = on || seen.pushed() || line.state != SurfaceLine<D>::away;
            }
            surfaces[i] = seen;
        }
        asks[i] = unknown
                      ? WallNode::unknown
                      : WallAsks((on ? WallNode::on_lines : 0) | (surface ? WallNode::surface : 0) |
                                 (edge ? WallNode::edges : 0) | (held ? WallNode::held : 0) |
                                 (watched ? WallNode::watched : 0));
        of_pass[int(WallPass::lines)][i] = asks[i] == WallNode::on_lines;
        of_pass[int(WallPass::held)][i] = asks[i] == WallNode::held;
        of_pass[int(WallPass::all)][i] = WallNode::needs_all(asks[i]);
    }
    /// Is a node within the reach of a boundary that acts for a time?
    MPM_INLINE bool may_change(int b, const std::int64_t (&cell)[D]) const {
        const BoundaryRecord<D>& r = boundaries.records[b];
        return !r.always() && near_cells(r, cell, far_off);
    }
    static constexpr int far_off = 12;  // further than lines look for other walls
};

/// Pieces of the nodes on lines alone.
template <int D>
struct ListLinedNodes {
    BlockTableView<D> table;
    const std::int32_t* blocks;
    const std::uint32_t* lines;  // (blocks, nodes, D), packed
    const std::uint32_t* flag;   // (blocks, nodes)
    const std::uint32_t* position;
    LinedNode<D>* pieces;

    MPM_INLINE void operator()(std::int64_t i) const {
        if (flag[i])
            pieces[position[i]] =
                LinedNode<D>(table, blocks[i / block_cells], int(i % block_cells), lines + i * D);
    }
};

/// What the nodes that ask for more than lines towards walls would do by themselves.
template <class T, class Sum, int D>
struct SeatWallNodes {
    NodeUpdate<T, Sum, D> node;
    const std::int32_t* blocks;
    const std::int32_t* nodes;  // by (listed block, node)
    KnownNodes<D> known;
    T* seat;

    MPM_INLINE void operator()(std::int64_t k) const {
        if (node.clock->halt != Halt::none) return;
        const std::int64_t i = nodes[k];
        const std::int32_t slot = blocks[i / block_cells];
        const int n = int(i % block_cells);
        std::int64_t cell[D];
        node.cell(slot, n, cell);
        const auto own =
            FollowLines<NodeUpdate<T, Sum, D>, T, D>{node, known, i}.seat(slot, n, cell);
        T* const to = seat + i * (D + 1);
        for (int a = 0; a < D; ++a) to[a] = own.velocity[a];
        to[D] = own.mass;
    }
};

/// Nodes of the listed blocks from their sums to their velocities: of one pass.
template <class T, class Sum, int D, WallPass of>
struct MoveWallNodes {
    NodeUpdate<T, Sum, D> node;
    const std::int32_t* blocks;
    const std::int32_t* nodes;  // by (listed block, node)
    KnownNodes<D> known;
    WallNodes<T, D> to;

    MPM_INLINE void operator()(std::int64_t k) const {
        if (node.clock->halt != Halt::none) return;
        const std::int64_t i = nodes[k];
        const std::int32_t slot = blocks[i / block_cells];
        const int n = int(i % block_cells);
        const T m = node.mass(slot, n);
        if (!(m > T(0))) return;
        bool changed = false;
        const Changed<T, D> seen{&changed};
        const auto p = node.momentum(slot, n);
        Vec<T, D> v;
        if constexpr (of == WallPass::held)
            v = node.held_velocity(slot, n, m, p, seen);
        else if constexpr (of == WallPass::lines)
            v = node.template wall_velocity<true>(slot, n, m, p, known, i, seen);
        else
            v = node.template wall_velocity<false, true>(slot, n, m, p,
                                                         node.known_of(known, i, slot, n), i, seen,
                                                         WallSeats<T>{to.seat, to.asks});
        for (int a = 0; a < D; ++a) to.velocity[i * D + a] = v[a];
        to.changed[i] = changed;
    }
};

}  // namespace mpm
