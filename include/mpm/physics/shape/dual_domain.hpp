// Linear functions whose gradients come in part from the grid (DDMP, the dual domain material point
// method: Zhang, Ma and Giguere 2011; Yang 2016, 2.18 to 2.23). The gradient of node i at x is
//
//   alpha(x) grad N_i(x) + (1 - alpha(x)) sum_j N_j(x) B_ji
//   B_ji = int N_j grad N_i dV / int N_j dV,  alpha(x) = 1/2 n^n product of the n = 2^D functions
//                                                        that are not zero at x
//
// for strain rates and for forces, so that what forces do is what strains store. alpha is zero on
// the faces between nodes, where grad N_i jumps. Integrals are over those spans between nodes whose
// nodes all have mass: nowhere else is there anything to push, and no force goes to a node without
// mass. Lengths in cells; node i is the centre of cell i.
#pragma once

#include "mpm/physics/shape/kernel.hpp"

namespace mpm {

/// One of the 4^D nodes around the span that holds a particle.
template <int D>
struct DualNode {
    int k[D];    // numbers along the axes as in a stencil of five nodes
    int number;  // among the 4^D, the last axis fastest
    MPM_INLINE int operator[](int a) const { return k[a]; }
};

template <class V, int D>
struct DualStencil : Stencil<V, D, 5> {
    static constexpr int around = 4, nodes = D == 2 ? 16 : 64, corners = 1 << D;
    int first[D];             // of the four nodes along an axis
    V gradients[nodes][D]{};  // none until they are asked for

    /// Which span a particle at offset `xi` stands in.
    MPM_INLINE void find(const Vec<V, D>& xi) {
        MPM_UNROLL for (int a = 0; a < D; ++a) first[a] = V(1) + xi[a] < V(1) ? 0 : 1;
    }
    /// Weight of the upper node of the span along an axis.
    MPM_INLINE V upper(int axis) const { return this->weight[axis][first[axis] + 2]; }

    MPM_INLINE V alpha() const {
        V out = V(0.5);
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const V s = upper(a), bubble = V(4) * s * (V(1) - s);
            MPM_UNROLL for (int k = 0; k < corners / 2; ++k) out = out * bubble;
        }
        return out;
    }

    /// Calls f(node) for all of the 4^D nodes.
    template <class F>
    MPM_INLINE void for_each_around(const F& f) const {
        for (int n = 0; n < nodes; ++n) {
            DualNode<D> node;
            node.number = n;
            MPM_UNROLL for (int a = 0, rest = n; a < D; ++a) {
                node.k[D - 1 - a] = first[D - 1 - a] + rest % around;
                rest /= around;
            }
            f(node);
        }
    }
    /// Calls f(node, weight) for those that the particle reaches.
    template <class F>
    MPM_INLINE void for_each(const F& f) const {
        for_each_around([&](const DualNode<D>& node) {
            V w = V(1);
            bool any = false;
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                w = w * this->weight[a][node.k[a]];
                any = any || gradients[node.number][a] != V(0);
            }
            if (w != V(0) || any) f(node, w);
        });
    }

    /// Gradients of all nodes; `massive(node)` says whether one has mass.
    template <class Massive>
    MPM_INLINE void find_gradients(const Massive& massive) {
        bool has_mass[nodes], everywhere = true;
        for_each_around([&](const DualNode<D>& node) {
            has_mass[node.number] = massive(node);
            everywhere = everywhere && has_mass[node.number];
        });
        if (everywhere)
            inside();
        else
            at_surface(has_mass);
        const V part = alpha();
        for_each_around([&](const DualNode<D>& node) {
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                V own = this->slope[a][node.k[a]];
                MPM_UNROLL for (int b = 0; b < D; ++b) {
                    if (b != a) own = own * this->weight[b][node.k[b]];
                }
                V& g = gradients[node.number][a];
                g = part * own + (V(1) - part) * g;
            }
        });
    }

private:
    /// Along one axis, of the four nodes: (1 - s, s) between zeros.
    MPM_INLINE V linear(int axis, int node) const {
        const int at = node - first[axis];
        const V s = upper(axis);
        return at == 1 ? V(1) - s : at == 2 ? s : V(0);
    }
    /// All spans around hold mass: products of central differences and the means
    /// (N_{i-1} + 4 N_i + N_{i+1}) / 6.
    MPM_HOST_CALL void inside() {
        V difference[D][around], mean[D][around];
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int n = 0; n < around; ++n) {
            const int k = first[a] + n;
            const V below = n > 0 ? linear(a, k - 1) : V(0),
                    above = n < around - 1 ? linear(a, k + 1) : V(0);
            difference[a][n] = V(0.5) * (below - above);
            mean[a][n] = V(1.0 / 6) * (below + V(4) * linear(a, k) + above);
        }
        for_each_around([&](const DualNode<D>& node) {
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                V g = difference[a][node.k[a] - first[a]];
                MPM_UNROLL for (int b = 0; b < D; ++b) {
                    if (b != a) g = g * mean[b][node.k[b] - first[b]];
                }
                gradients[node.number][a] = g;
            }
        });
    }
    /// Number of a node from its numbers among the four.
    MPM_INLINE static int number_of(const int (&n)[D]) {
        int out = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) out = out * around + n[a];
        return out;
    }
    /// By sums over the spans that hold mass.
    MPM_HOST_CALL void at_surface(const bool (&has_mass)[nodes]) {
        const auto occupied = [&](const int(&span)[D]) {
            for (int c = 0; c < corners; ++c) {
                int n[D];
                MPM_UNROLL for (int a = 0; a < D; ++a) n[a] = span[a] + (c >> a & 1);
                if (!has_mass[number_of(n)]) return false;
            }
            return true;
        };
        for (auto& g : gradients) MPM_UNROLL for (int a = 0; a < D; ++a) g[a] = V(0);
        for (int j = 0; j < corners; ++j) {  // the nodes of the particle's own span
            V weight = V(1);
            int at[D];
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                at[a] = 1 + (j >> a & 1);
                weight = weight * linear(a, first[a] + at[a]);
            }
            int spans[corners], held = 0;
            for (int e = 0; e < corners; ++e) {  // around it
                int span[D];
                MPM_UNROLL for (int a = 0; a < D; ++a) span[a] = at[a] - 1 + (e >> a & 1);
                if (occupied(span)) spans[held++] = e;
            }
            for (int k = 0; k < held; ++k) {
                for (int c = 0; c < corners; ++c) {  // node i of the span
                    int n[D];
                    V same[D], slope[D];  // means over the span of N_j N_i and N_j dN_i, times 2
                    MPM_UNROLL for (int a = 0; a < D; ++a) {
                        n[a] = at[a] - 1 + (spans[k] >> a & 1) + (c >> a & 1);
                        same[a] = V(n[a] == at[a] ? 2.0 / 3 : 1.0 / 3);
                        slope[a] = V(c >> a & 1 ? 1 : -1);
                    }
                    MPM_UNROLL for (int a = 0; a < D; ++a) {
                        V g = weight / V(held) * slope[a];
                        MPM_UNROLL for (int b = 0; b < D; ++b) {
                            if (b != a) g = g * same[b];
                        }
                        gradients[number_of(n)][a] = gradients[number_of(n)][a] + g;
                    }
                }
            }
        }
    }
};

}  // namespace mpm
