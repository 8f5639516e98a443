// What a guard asks for at a halt: how densely particles lie, and the state of some of them. Scenes
// without a guard never launch these.
#pragma once

#include "mpm/kernels/grid.hpp"

namespace mpm {

/// Adds up the nodes' masses and their squares: (2,) kg, kg^2.
template <class T, class Sum, int D>
struct AddPacking {
    NodeUpdate<T, Sum, D> node;
    const std::uint8_t* counts;  // which blocks count, where ranks hold some together; null: all
    MPM_INLINE void operator()(std::int64_t i, int /*set*/, double* sum) const {
        if (counts && counts[i / block_cells] == 0) return;
        const double m = double(node.mass(std::int32_t(i / block_cells), int(i % block_cells)));
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
