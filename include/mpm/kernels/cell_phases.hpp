// What a body's step does between collect, respond and spread, for one particle: gradients by moved
// nodes, numerical damping, and the numbers that cells or nodes average
// (kernels/cell_smoothing.hpp).
//
//   collected    L <- L (I + dt L)^-1 (Yang 2016, A.8, A.9); then its means where a body assumes
//                them (M8, M9); none of the rate in the form (3.43)
//   smooth       the state as it was, by the cells that the particles stood in
//   responded    tau_ij += 2 l xi sqrt(M rho) d_ij (i = j), sqrt(G rho) (i != j) (A.6); then the
//                means of the stress, by the cells that the particles have come to
#pragma once

#include <algorithm>

#include "mpm/kernels/cell_smoothing.hpp"
#include "mpm/kernels/phase.hpp"

namespace mpm {

/// Cells are the spans between the knots of the grid's functions: those of quadratic splines lie
/// around the nodes, all others between them.
inline bool spans_lie_between_nodes(Kernel k) { return k != Kernel::quadratic; }

/// The cell that a particle stands in, counted from the first of its home block: a place as in
/// `places_in_grid`, and where in the cell.
template <int D>
struct InSpan {
    int place;
    int cell[D];
    Vec<double, D> x;  // from the centre, cells
};
template <class T, int D>
MPM_INLINE InSpan<D> span_of(const BodyView<T, D>& body, const int (&home)[D], std::uint32_t q,
                             bool between) {
    InSpan<D> out{0, {}, {}};
    int side_step = 256, node_step = 1;
    MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
        const T offset = body.offset[a][q];
        const int shift = cell_shift(offset);
        int cell = home[a] + shift + Block<D>::edge;
        double x = double(offset - T(shift));
        if (between) {
            const bool below = T(1) + T(x) < T(1);  // as `linear_slope` has it
            if (below) --cell;
            x += below ? 0.5 : -0.5;
        }
        out.x[a] = x;
        out.cell[a] = cell - Block<D>::edge;
        out.place += cell / Block<D>::edge * side_step + cell % Block<D>::edge * node_step;
        side_step *= 3;
        node_step *= Block<D>::edge;
    }
    return out;
}

/// Number of the cell beside cell `c` of the block table, or -1.
template <int D>
struct NextInBlocks {
    const std::int32_t* neighbours;  // (slots, 3^D)
    MPM_INLINE std::int64_t operator()(std::int64_t c, int axis, int side) const {
        int at[D];
        Block<D>::coordinates(int(c % block_cells), at);
        std::int64_t slot = c / block_cells;
        int beside = Block<D>::neighbours / 2, step = 1;
        for (int a = D - 1; a > axis; --a) step *= 3;
        at[axis] += side ? 1 : -1;
        if (at[axis] < 0) {
            at[axis] += Block<D>::edge;
            beside -= step;
        } else if (at[axis] >= Block<D>::edge) {
            at[axis] -= Block<D>::edge;
            beside += step;
        }
        slot = neighbours[slot * Block<D>::neighbours + beside];
        return slot < 0 ? -1 : slot * block_cells + Block<D>::cell(at);
    }
};

/// Velocity gradient, by the nodes of the beginning of the step, to that by moved nodes; dt grad v
/// in, dt grad v out.
template <class V, int D>
MPM_INLINE Mat<V, D> by_moved_nodes(const Mat<V, D>& strain) {
    Mat<V, D> moved = strain;
    MPM_UNROLL for (int a = 0; a < D; ++a) moved.e[a][a] = moved.e[a][a] + V(1);
    const Mat<V, D> c = cofactors(moved);
    V det = V(0);
    MPM_UNROLL for (int a = 0; a < D; ++a) det = det + moved.e[0][a] * c.e[0][a];
    Mat<V, D> out = product_transposed(strain, c);
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) out.e[a][b] =
        out.e[a][b] / det;
    return out;
}

/// Components of a tensor that means stand for, and how a mean is put back. Of a velocity gradient
/// the spin stays the particle's own: only rates of deformation are assumed.
template <int D>
struct AssumedTensor {
    TensorPart part;
    MPM_INLINE int components() const {
        return part == TensorPart::none ? 0 : part == TensorPart::volumetric ? 1 : D * (D + 1) / 2;
    }
    /// Axes of component k: the diagonal first.
    MPM_INLINE static int first(int k) { return k < D ? k : (D == 2 ? 0 : (k - D + 1) % 3); }
    MPM_INLINE static int second(int k) { return k < D ? k : (D == 2 ? 1 : (k - D + 2) % 3); }

    template <class V>
    MPM_INLINE double component(const Mat<V, D>& m, int k) const {
        const double all = double(trace(m));
        if (part == TensorPart::volumetric) return all;
        const int a = first(k), b = second(k);
        const double v = 0.5 * (double(m.e[a][b]) + double(m.e[b][a]));
        return part == TensorPart::deviatoric && a == b ? v - all / D : v;
    }
    /// `means` by component. The trace is shared out among the axes of the grid, so that a fluid
    /// sees its mean in two dimensions as in three.
    template <class V>
    MPM_INLINE void replace(Mat<V, D>& m, const double* means) const {
        const double all = double(trace(m));
        if (part == TensorPart::volumetric) {
            MPM_UNROLL for (int a = 0; a < D; ++a) m.e[a][a] =
                V(double(m.e[a][a]) + (means[0] - all) / D);
            return;
        }
        for (int k = 0; k < components(); ++k) {
            const int a = first(k), b = second(k);
            if (a == b) {
                m.e[a][a] = V(means[k] + (part == TensorPart::deviatoric ? all / D : 0.0));
                continue;
            }
            const double spin = 0.5 * (double(m.e[a][b]) - double(m.e[b][a]));
            m.e[a][b] = V(means[k] + spin);
            m.e[b][a] = V(means[k] - spin);
        }
    }
};

/// Numbers of one cell, or node, that a body's phases sum up: lumped means at nodes have as many as
/// means of cells.
template <int D>
std::size_t cell_numbers(const CellNumbers& n) {
    const auto width = [](const SmoothingChoice& k, int components) {
        if (components == 0 || k.form == CellForm::none) return 0;
        return CellColumns<D>::columns(k, components);
    };
    SmoothingChoice nodal;  // what a placed force gives back
    nodal.form = CellForm::nodal;
    return std::size_t(std::max({width(n.smoothing, n.components),
                                 width(n.assumed, AssumedTensor<D>{n.part}.components()),
                                 width(nodal, n.force.axis >= 0 ? D : 0)}));
}

}  // namespace mpm
