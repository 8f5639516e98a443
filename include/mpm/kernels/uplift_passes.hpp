// Passes over the nodes above water in the gap below solids (kernels/uplift.hpp): which they are,
// what the gaps add to their sums and leave of what rubs there, and what a load cell hears of it.
#pragma once

#include "mpm/kernels/uplift.hpp"

namespace mpm {

/// Which records each node of the listed blocks is a foot of.
template <int D>
struct MarkFeet {
    BlockTableView<D> table;
    BoundaryView<D> boundaries;
    const std::int32_t* blocks;
    const UpliftRecord* records;
    int count;
    int axis, up;
    std::uint32_t* mask;  // (blocks, nodes)
    std::uint32_t* flag;  // the same: 1 where any

    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int32_t slot = blocks[i / block_cells];
        std::int64_t cell[D];
        table.cell(slot, int(i % block_cells), cell);
        std::uint32_t found = 0;
        for (int k = 0; k < count; ++k)
            if (acts_across<D>(boundaries.records[records[k].boundary], boundaries.cell_size, cell,
                               axis) &&
                on_bed_of<D>(boundaries, records[k].boundary, cell, axis, up).is == OnBed::foot)
                found |= std::uint32_t(1) << k;
        mask[i] = found;
        flag[i] = found != 0;
    }
};

/// Finds what the gaps add to the momenta of the nodes above them, and keeps these as they are and
/// with it; and what rubs there, of bodies that share the water's velocities.
template <class T, class Sum, int D>
struct FindUplift {
    NodeUplift<T, Sum, D> of;
    const std::int32_t* blocks;
    const std::int32_t* feet;   // by (listed block, node)
    const std::uint32_t* mask;  // (blocks, nodes)
    Sum *before, *with;         // (feet, D)
    T* rubbing;                 // as `RubbingParts` has it; null with contacts
    std::int64_t nodes;         // of the listed blocks

    MPM_INLINE void operator()(std::int64_t k) const {
        const NodeUpdate<T, Sum, D>& node = of.node;
        if (node.clock->halt != Halt::none) return;
        const std::int32_t i = feet[k];
        const std::int32_t slot = blocks[i / block_cells];
        const int n = i % block_cells;
        Vec<double, D> impulse{};
        // What rubs asks for all that is lifted: in a second round, if there may be several.
        const int rounds = rubbing && of.uplift.count > 1 ? 2 : 1;
        for (int round = 0; round < rounds; ++round)
            for (int r = 0; r < of.uplift.count; ++r) {
                if (!(mask[i] >> r & 1)) continue;
                const auto gap = of.gap(slot, n, of.uplift.records[r]);
                for (int a = 0; a < D && round == 0; ++a) impulse[a] += gap.lifts(a);
                if (rubbing && round == rounds - 1) rub(i, r, gap, impulse);
            }
        for (int a = 0; a < D; ++a) {
            const Sum p = node.sums(slot, n)[(1 + a) * block_cells];
            before[k * D + a] = p;
            if constexpr (std::is_integral_v<Sum>)
                with[k * D + a] = p + Sum(rint(impulse[a] / node.clock->unit_read[momentum_sum]));
            else
                with[k * D + a] = p + Sum(impulse[a]);
        }
    }
    /// At all rows of the place, of which no other has any. Where a base has gone none says so any
    /// more, as in a new table.
    MPM_INLINE void rub(std::int32_t i, int r, const typename NodeUplift<T, Sum, D>::Gap& gap,
                        const Vec<double, D>& lifted) const {
        T* const parts = rubbing + r * nodes;
        if (!(gap.mass > 0) && parts[i] == T(0)) return;
        const UpliftRecord& record = of.uplift.records[r];
        std::int64_t cell[D];
        of.node.cell(blocks[i / block_cells], i % block_cells, cell);
        const T part = gap.mass > 0 ? T(1 + of.rubbing_part(cell, record, gap, lifted)) : T(0);
        of.each_held_row(cell, record.boundary,
                         [&](int, std::int32_t slot, int n, const double(&)[D]) {
                             const std::uint32_t listed = of.node.touched[slot];
                             if (listed > 0)
                                 parts[std::int64_t(listed - 1) * block_cells + n] = part;
                         });
    }
};

/// Whether the nodes are to have what the gaps add: while no clock has halted.
struct MayLift {
    const Clock* clock;
    std::uint32_t* lifted;
    MPM_INLINE void operator()() const { *lifted = clock->halt == Halt::none; }
};
struct NotLifted {
    std::uint32_t* lifted;
    MPM_INLINE void operator()() const { *lifted = 0; }
};

/// Gives the nodes the sums with what the gaps add, or takes that away again: checkpoints keep the
/// sums without, and a reader's velocities begin with these. Nothing where they have not been
/// lifted.
template <class T, class Sum, int D>
struct SetFeet {
    GridView<T, Sum, D> grid;
    const std::int32_t* blocks;
    const std::int32_t* feet;
    const Sum* from;
    const std::uint32_t* lifted;

    MPM_INLINE void operator()(std::int64_t k) const {
        if (*lifted == 0) return;
        const std::int32_t i = feet[k];
        Sum* const s = grid.sums +
                       std::int64_t(blocks[i / block_cells]) * grid.sum_channels * block_cells +
                       i % block_cells;
        for (int a = 0; a < D; ++a) s[(1 + a) * block_cells] = from[k * D + a];
    }
};

/// What the water in a gap presses on the bed below it counts for the load cell of the boundary
/// that has the gap: the boundary itself takes that much less.
template <class T, class Sum, int D>
struct MeasureUplift {
    NodeUplift<T, Sum, D> of;
    const std::uint32_t* touched;  // (slots,): 1 + place among the listed blocks
    const std::uint32_t* mask;     // (listed blocks, nodes)
    const std::int32_t* slots;     // blocks that the boundaries of load cells touch
    const LoadCellRecord<D>* cells;
    ImpulseScales scales;

    /// Of a load cell; -1 where its boundary has no gap, or it hears nothing of the face that has.
    MPM_INLINE int record_of(int number) const {
        const LoadCellRecord<D>& cell = cells[number];
        const BoundaryRecord<D>& b = of.node.boundaries.records[cell.boundary];
        const bool top = bool(b.is_box) == (of.up > 0);  // a surface has one face
        if (b.surface == 0 && !(cell.faces >> (2 * of.axis + top) & 1)) return -1;
        for (int r = 0; r < of.uplift.count; ++r)
            if (of.uplift.records[r].boundary == cell.boundary) return r;
        return -1;
    }
    MPM_INLINE bool idle(int number) const { return record_of(number) < 0; }
    MPM_INLINE void operator()(std::int64_t i, int number, Int128* sum) const {
        if (of.node.clock->halt != Halt::none) return;
        const std::int32_t slot = slots[i / block_cells];
        const int n = int(i % block_cells), r = record_of(number);
        const std::uint32_t listed = touched[slot];
        if (r < 0 || listed == 0 || !(mask[std::int64_t(listed - 1) * block_cells + n] >> r & 1))
            return;
        const Vec<double, D> pressed = of(slot, n, of.uplift.records[r]);
        double f[D];
        for (int a = 0; a < D; ++a) f[a] = -pressed[a];
        add_load<D>(of.node, slot, n, cells[number], f, scales, sum);
    }
};

/// Adds to what a load cell has of this step.
template <int D>
struct AddToLoad {
    Int128* impulse;  // (cells, columns)
    MPM_INLINE void operator()(int number, const Int128* sum) const {
        for (int c = 0; c < load_columns<D>; ++c) impulse[number * load_columns<D> + c] += sum[c];
    }
};

}  // namespace mpm
