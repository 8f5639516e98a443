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

/// Cells from a node beyond which nothing changes what it asks for: further than lines look for
/// other walls.
inline constexpr int wall_sight = 12;

/// What `ClassifyWallNodes` finds of the nodes of listed blocks.
template <int D>
struct FoundWallNodes {
    WallAsks* asks;            // (blocks, nodes)
    std::uint32_t* lines;      // (blocks, nodes, D), packed
    SurfaceNode<D>* surfaces;  // (blocks, nodes); null where no surface is linear
};

/// Which of the touched blocks were in the last list, with nodes that ask for the same at all
/// times: what they ask for depends on their place, on their field of velocities and on boundaries
/// in sight, and stays as long as these rest and act.
template <int D>
struct FindKeptBlocks {
    BlockTableView<D> table;
    BoundaryView<D> boundaries;
    const std::uint32_t* touched;
    const std::uint64_t* keys;  // of the last list, ascending
    std::int32_t count;
    std::int32_t* kept;         // (slots,): place in the last list, or -1
    std::uint32_t* classified;  // (slots,): 1 where its nodes are classified

    MPM_INLINE void operator()(std::int64_t slot) const {
        kept[slot] = touched[slot] && stays(slot) ? find_key(keys, count, table.keys[slot]) : -1;
        classified[slot] = touched[slot] && kept[slot] < 0;
    }
    /// Is nothing in sight that moves, or acts for a time?
    MPM_INLINE bool stays(std::int64_t slot) const {
        for (int b = 0; b < boundaries.count; ++b) {
            const BoundaryRecord<D>& r = boundaries.records[b];
            const bool rests = r.surface == 0 || boundaries.surfaces[r.surface - 1].at_rest();
            if (r.always() && rests) continue;
            bool in_sight = true;  // walls of the domain are everywhere
            for (int a = 0; a < D && (r.is_box || r.surface > 0); ++a) {
                const std::int32_t first = table.corners[slot * D + a];
                in_sight = in_sight && first + Block<D>::edge > r.lower[a] - wall_sight &&
                           first < r.upper[a] + wall_sight;
            }
            if (in_sight) return false;
        }
        return true;
    }
};

/// Lists the touched blocks with their keys; their flags become 1 + their place in the list.
struct ListWallBlocks {
    const std::uint64_t* keys;      // of the table
    const std::uint32_t* position;  // scan of `touched`
    const std::uint32_t* classified;
    const std::uint32_t* classified_position;  // scan of it
    std::uint32_t* touched;
    std::int32_t* list;
    std::uint64_t* list_keys;
    std::int32_t* list_classified;  // places in the list

    MPM_INLINE void operator()(std::int64_t slot) const {
        if (!touched[slot]) return;
        const std::uint32_t place = position[slot];
        touched[slot] = 1 + place;
        list[place] = std::int32_t(slot);
        list_keys[place] = keys[slot];
        if (classified[slot]) list_classified[classified_position[slot]] = std::int32_t(place);
    }
};

/// What is known of the nodes of blocks that were in the last list, into the present one.
template <int D>
struct KeepWallNodes {
    const std::int32_t* blocks;
    const std::int32_t* kept;  // (slots,): `FindKeptBlocks`
    FoundWallNodes<D> from, to;

    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int32_t before = kept[blocks[i / block_cells]];
        if (before < 0) return;
        const std::int64_t k = std::int64_t(before) * block_cells + i % block_cells;
        to.asks[i] = from.asks[k];
        for (int a = 0; a < D; ++a) to.lines[i * D + a] = from.lines[k * D + a];
        if (to.surfaces) to.surfaces[i] = from.surfaces[k];
    }
};

/// In which pass the nodes of listed blocks are moved.
struct FlagWallPasses {
    const WallAsks* asks;
    std::uint32_t* of_pass[wall_passes];  // (blocks, nodes): 1 where it is moved there

    MPM_INLINE void operator()(std::int64_t i) const {
        of_pass[int(WallPass::lines)][i] = asks[i] == WallNode::on_lines;
        of_pass[int(WallPass::held)][i] = asks[i] == WallNode::held;
        of_pass[int(WallPass::all)][i] = WallNode::needs_all(asks[i]);
    }
};

/// What the nodes of listed blocks ask for, their lines, and what they see of linear surfaces,
/// where none of it changes with time. Where something that moves is near or what does not always
/// act may be, or where two surfaces meet, nodes are `unknown` and find out in each step; where
/// something that moves may come they are `watched`, and find out once it has come.
template <int D>
struct ClassifyWallNodes {
    BlockTableView<D> table;
    BoundaryView<D> boundaries;
    const std::int32_t* blocks;
    const std::int32_t* classified;  // places of those in the list that are not kept
    bool edges;                      // those of boxes push (`FollowLines::push_at_edges`)
    FoundWallNodes<D> to;

    MPM_INLINE void operator()(std::int64_t k) const {
        const int n = int(k % block_cells);
        const std::int32_t place = classified[k / block_cells], slot = blocks[place];
        const std::int64_t i = std::int64_t(place) * block_cells + n;
        std::int64_t cell[D];
        table.cell(slot, n, cell);
        bool on = false, edge = false, held = false, surface = false;
        const bool alone = boundaries.holds(table, slot);
        for (int a = 0; a < D; ++a) {
            WallLine line;
            if (boundaries.lines) line = find_line<D>(boundaries, a, cell, alone);
            to.lines[i * D + a] = line.packed();
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
        const bool watched = moving_near<D>(boundaries, cell, wall_sight);
        bool unknown = near > 1 || (watched && moved_near<D>(boundaries, cell, WallNode::aware));
        for (int b = 0; b < boundaries.count; ++b) unknown = unknown || may_change(b, cell);
        if (to.surfaces) {
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
            to.surfaces[i] = seen;
        }
        to.asks[i] =
            unknown ? WallNode::unknown
                    : WallAsks((on ? WallNode::on_lines : 0) | (surface ? WallNode::surface : 0) |
                               (edge ? WallNode::edges : 0) | (held ? WallNode::held : 0) |
                               (watched ? WallNode::watched : 0));
    }
    /// Is a node within the reach of a boundary that acts for a time?
    MPM_INLINE bool may_change(int b, const std::int64_t (&cell)[D]) const {
        const BoundaryRecord<D>& r = boundaries.records[b];
        return !r.always() && near_cells(r, cell, wall_sight);
    }
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
