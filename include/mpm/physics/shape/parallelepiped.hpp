// A particle as a parallelepiped whose edges follow its deformation (CPDI: Sadeghirad, Brannon and
// Burghardt 2011; Yang 2016, 2.40 to 2.43). Inside it the grid's linear functions are replaced by
// what its corners see of them:
//
//   N_i(x) = sum over corners m of N_i(x_m) N_m(x),  x_m = x_p + A xi_m,  xi_m in {-1, 1}^D
//   weight of node i    = 2^-D sum_m N_i(x_m)
//   gradient of node i  = 2^-D sum_m N_i(x_m) A^-T xi_m
//
// with the half-edges as columns of A, all lengths in cells. Node i is the centre of cell i.
#pragma once

#include <limits>

#include "mpm/core/linalg.hpp"
#include "mpm/physics/shape/kernel.hpp"

namespace mpm {

/// Half-edges of a particle that was a cube of half-edge `half`, from F - I.
template <class V, int D>
MPM_INLINE Mat<V, D> half_edges_of(V half, Mat<V, D> displacement_gradient) {
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
        const V e = displacement_gradient.e[a][b] + V(a == b ? 1 : 0);
        displacement_gradient.e[a][b] = half * e;
    }
    return displacement_gradient;
}

/// How far a particle with these half-edges reaches along an axis, cells.
template <class V, int D>
MPM_INLINE V reach_along(const Mat<V, D>& edges, int axis) {
    V out = V(0);
    MPM_UNROLL for (int b = 0; b < D; ++b) out = out + absolute(edges.e[axis][b]);
    return out;
}

/// A node as one corner sees it: its numbers along the axes, 2 being the centre of the cell.
template <int D>
struct CornerNode {
    int k[D];
    int corner;
    MPM_INLINE int operator[](int a) const { return k[a]; }
};

template <class V, int D>
struct CornerStencil {
    static constexpr int width = 5, corners = 1 << D;
    V distance[D][width];  // of a node from the particle
    V inverse[D][D];       // of the sum of weight distance distance^T
    int low[corners][D];   // number of the node below a corner
    V upper[corners][D];   // weight of the node above it
    V pull[corners][D];    // A^-T xi_m, 1/cell

    /// `xi` is the offset from the centre of the cell; the particle reaches `largest_half_edge` at
    /// most.
    MPM_HOST_CALL void find(const Vec<V, D>& xi, const Mat<V, D>& edges) {
        Mat<V, D> moment = product_transposed(edges, edges);
        const Mat<V, D> cofactor = cofactors(edges);
        const V over = V(1) / determinant(edges, cofactor);
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            MPM_UNROLL for (int n = 0; n < width; ++n) distance[a][n] = V(n - width / 2) - xi[a];
        }
        for (int m = 0; m < corners; ++m) {
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                V at = xi[a] + V(width / 2), gradient = V(0);
                MPM_UNROLL for (int b = 0; b < D; ++b) {
                    const V side = V(m >> b & 1 ? 1 : -1);
                    at = at + edges.e[a][b] * side;
                    gradient = gradient + cofactor.e[a][b] * side;
                }
                at = at > V(0) ? smaller(at, V(width - 1)) : V(0);  // not a number is a place too
                low[m][a] = int(at) < width - 2 ? int(at) : width - 2;
                upper[m][a] = on_node_or(at - V(low[m][a]));
                pull[m][a] = over * gradient;
                // Of the linear functions themselves, about where the corner is.
                moment.e[a][a] =
                    moment.e[a][a] + upper[m][a] * (V(1) - upper[m][a]) * V(1.0 / corners);
            }
        }
        const Mat<V, D> turned = cofactors(moment);
        const V scale = V(1) / determinant(moment, turned);
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            MPM_UNROLL for (int b = 0; b < D; ++b) inverse[a][b] = turned.e[a][b] * scale;
        }
    }

    /// A corner a rounding away from a node stands on it: corners of lattices often do, and must
    /// not touch the nodes beyond by chance.
    MPM_INLINE static V on_node_or(V above) {
        constexpr V rounding = V(32) * std::numeric_limits<V>::epsilon();
        return above < rounding ? V(0) : above > V(1) - rounding ? V(1) : above;
    }

    /// Calls f(node, weight) for every node of every corner; a node may come more than once.
    template <class F>
    MPM_INLINE void for_each(const F& f) const {
        for (int m = 0; m < corners; ++m) {
            for (int n = 0; n < corners; ++n) {
                CornerNode<D> node;
                node.corner = m;
                V w = V(1.0 / corners);
                MPM_UNROLL for (int a = 0; a < D; ++a) {
                    const bool above = n >> a & 1;
                    node.k[a] = low[m][a] + (above ? 1 : 0);
                    w = w * (above ? upper[m][a] : V(1) - upper[m][a]);
                }
                f(node, w);
            }
        }
    }
    /// What a node adds to a gradient along an axis, through this corner.
    MPM_INLINE V gradient(const CornerNode<D>& node, V weight, int axis) const {
        return weight * pull[node.corner][axis];
    }
    /// The same by first moments.
    MPM_INLINE V lever(const CornerNode<D>& node, V weight, int axis) const {
        V out = V(0);
        MPM_UNROLL for (int b = 0; b < D; ++b) out =
            out + inverse[axis][b] * distance[b][node.k[b]];
        return weight * out;
    }
};

}  // namespace mpm
