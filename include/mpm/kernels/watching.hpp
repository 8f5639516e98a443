// What a guard asks for at a halt: how densely particles lie, and the state of some of them. Scenes
// without a guard never launch these.
#pragma once

#include "mpm/kernels/contact.hpp"

namespace mpm {

/// Adds up the nodes' masses and their squares: (2,) kg, kg^2.
template <class T, class Sum, int D>
struct AddPacking {
    NodeUpdate<T, Sum, D> node;
    const std::uint8_t* counts;  // which blocks count, where ranks hold some together; null: all
    MPM_INLINE void operator()(std::int64_t i, int /*set*/, double* sum) const {
        if (counts && counts[i / block_cells] == 0) return;
        const std::int32_t slot = std::int32_t(i / block_cells);
        double m = double(node.mass(slot, int(i % block_cells)));
        if (node.grid.table.keys_of.fields != 1) {
            // All that a node holds counts at the first of its fields.
            std::int32_t first, count;
            find_siblings<D>(node.grid.table, slot, std::int32_t(node.grid.table.keys_of.fields),
                             first, count);
            if (slot != first) return;
            for (std::int32_t k = 1; k < count; ++k)
                m += double(node.mass(first + k, int(i % block_cells)));
        }
        if (!(m > 0)) return;
        sum[0] += m;
        sum[1] += m * m;
    }
};

struct KeepPacking {
    double* out;
    MPM_HD void operator()(int /*set*/, const double* sum) const {
        out[0] = sum[0];
        out[1] = sum[1];
    }
};

/// The state of every `stride`-th particle: (n, columns).
template <class T, int D>
struct TakeStates {
    BodyView<T, D> body;
    int columns;
    std::int64_t stride;
    double* out;
    MPM_INLINE void operator()(std::int64_t i) const {
        for (int r = 0; r < columns; ++r) out[i * columns + r] = double(body.state[r][i * stride]);
    }
};

}  // namespace mpm
