// What the phased step does between particles and grid (phase.hpp), for one particle: collect and
// spread. They reach nodes by places: small numbers that add up over the axes, of the grid around a
// block or of an arena, whose holder turns them into numbers.
#pragma once

#include <type_traits>

#include "mpm/kernels/phase.hpp"
#include "mpm/physics/shape/dual_domain.hpp"
#include "mpm/physics/shape/parallelepiped.hpp"

namespace mpm {

/// A place is the sum of one part an axis.
template <int D, int W>
struct Places {
    int part[D][W];
};

/// In the grid: 256 times the number of the block, among the 3^D around the home block, and the
/// node in it. `cell` counts from the first of the home block, up to an edge of a block beside it.
template <int W, int D>
MPM_INLINE Places<D, W> places_in_grid(const int (&cell)[D]) {
    Places<D, W> p;
    int side_step = 256, node_step = 1;
    MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
        MPM_UNROLL for (int k = 0; k < W; ++k) {
            const int at = cell[a] + k - W / 2 + Block<D>::edge;
            p.part[a][k] = at / Block<D>::edge * side_step + at % Block<D>::edge * node_step;
        }
        side_step *= 3;
        node_step *= Block<D>::edge;
    }
    return p;
}

/// In an arena of a block and `margin` nodes around it.
template <class Arena, int W, int D, int margin = Block<D>::margin>
MPM_INLINE Places<D, W> places_in_arena(const int (&cell)[D]) {
    Places<D, W> p;
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int k = 0; k < W; ++k) p.part[a][k] =
        (cell[a] + k - W / 2 + margin) * Arena::stride(a);
    return p;
}
/// Does an arena hold all nodes around this cell?
template <int W, int D>
MPM_INLINE bool fits_arena(const int (&cell)[D]) {
    bool fits = true;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        fits = fits && cell[a] - W / 2 + Block<D>::margin >= 0 &&
               cell[a] + W / 2 + Block<D>::margin < Block<D>::arena_edge;
    }
    return fits;
}

/// Calls f(k, place, weight) for the nodes of a stencil; k are their numbers along the axes. Planes
/// of nodes that a particle does not reach are left out.
template <class V, int D, int W, class F>
MPM_INLINE void for_each_node(const Stencil<V, D, W>& s, const Places<D, W>& places, const F& f) {
    int k[D];
    MPM_NO_UNROLL for (k[0] = 0; k[0] < W; ++k[0]) {
        if (all((s.weight[0][k[0]] == V(0)) & (s.slope[0][k[0]] == V(0)))) continue;
        MPM_NO_UNROLL for (k[1] = 0; k[1] < W; ++k[1]) {
            const V plane = s.weight[0][k[0]] * s.weight[1][k[1]];
            const int place = places.part[0][k[0]] + places.part[1][k[1]];
            if constexpr (D == 2) {
                f(k, place, plane);
            } else {
                MPM_UNROLL for (k[2] = 0; k[2] < W; ++k[2])
                    f(k, place + places.part[2][k[2]], plane * s.weight[2][k[2]]);
            }
        }
    }
}

/// How the nodes of a stencil are gone through: plane by plane, as above, or all unrolled and none
/// left out, where there are few of them and registers hold what a loop would index.
struct ByPlanes {
    template <class S, class P, class F>
    MPM_INLINE static void visit(const S& s, const P& places, const F& f) {
        for_each_node(s, places, f);
    }
};
struct Unrolled {
    template <class V, int D, int W, class F>
    MPM_INLINE static void visit(const Stencil<V, D, W>& s, const Places<D, W>& places,
                                 const F& f) {
        // A counter that is part of an array is not unrolled by nvcc.
        MPM_UNROLL for (int i = 0; i < W; ++i) MPM_UNROLL for (int j = 0; j < W; ++j) {
            const V plane = s.weight[0][i] * s.weight[1][j];
            const int place = places.part[0][i] + places.part[1][j];
            if constexpr (D == 2) {
                const int k[] = {i, j};
                f(k, place, plane);
            } else {
                MPM_UNROLL for (int l = 0; l < W; ++l) {
                    const int k[] = {i, j, l};
                    f(k, place + places.part[2][l], plane * s.weight[2][l]);
                }
            }
        }
    }
};

/// d weight / d x_a of node k.
template <class V, int D, int W>
MPM_INLINE V node_slope(const Stencil<V, D, W>& s, const int (&k)[D], int axis) {
    V out = V(1);
    MPM_UNROLL for (int a = 0; a < D; ++a) out =
        out * (a == axis ? s.slope[a][k[a]] : s.weight[a][k[a]]);
    return out;
}
/// What node k adds to a gradient along an axis, and takes of a stress: gradients of the shapes, or
/// first moments.
template <class V, int D, int W>
MPM_INLINE V node_lever(const Stencil<V, D, W>& s, const int (&k)[D], V weight, int axis) {
    return weight * s.distance[axis][k[axis]] * s.inverse[axis];
}
template <class V, int D, int W>
MPM_INLINE V node_along(const Stencil<V, D, W>& s, const int (&k)[D], V weight, int axis,
                        bool shapes) {
    return shapes ? node_slope(s, k, axis) : node_lever(s, k, weight, axis);
}

namespace detail {

template <class S, int D, int W, class F>
MPM_INLINE void for_each_own_node(const S& s, const Places<D, W>& places, const F& f) {
    s.for_each([&](const auto& k, auto weight) {
        int place = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) place += places.part[a][k[a]];
        f(k, place, weight);
    });
}

}  // namespace detail

/// The same for particles that are parallelepipeds, and for gradients of the dual domain.
template <class V, int D, class F>
MPM_INLINE void for_each_node(const CornerStencil<V, D>& s, const Places<D, 5>& places,
                              const F& f) {
    detail::for_each_own_node(s, places, f);
}
template <class V, int D, class F>
MPM_INLINE void for_each_node(const DualStencil<V, D>& s, const Places<D, 5>& places, const F& f) {
    detail::for_each_own_node(s, places, f);
}
template <class V, int D>
MPM_INLINE V node_lever(const CornerStencil<V, D>& s, const CornerNode<D>& k, V weight, int axis) {
    return s.lever(k, weight, axis);
}
template <class V, int D>
MPM_INLINE V node_along(const CornerStencil<V, D>& s, const CornerNode<D>& k, V weight, int axis,
                        bool) {
    return s.gradient(k, weight, axis);
}
template <class V, int D>
MPM_INLINE V node_lever(const DualStencil<V, D>& s, const DualNode<D>& k, V weight, int axis) {
    return weight * s.distance[axis][k[axis]] * s.inverse[axis];
}
template <class V, int D>
MPM_INLINE V node_along(const DualStencil<V, D>& s, const DualNode<D>& k, V, int axis, bool) {
    return s.gradients[k.number][axis];
}

/// Where a particle stands: its cell counted from its home block's first, its offset there, and the
/// cell in the domain.
template <class G, int D>
struct Standing {
    int cell[D];
    Vec<G, D> xi;
    std::int64_t in_domain[D];

    template <class T>
    MPM_INLINE void find(const std::int32_t* corner, const int (&home)[D],
                         const Vec<T, D>& offset) {
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const int shift = cell_shift(offset[a]);
            cell[a] = home[a] + shift;
            xi[a] = G(offset[a] - T(shift));
            in_domain[a] = corner[a] + cell[a];
        }
    }
};

/// Half-edges of a particle, cells: what GIMP averages over; `state(r)` is number r of what it
/// stores.
template <int D, class State>
MPM_INLINE auto half_edges(const PhaseNumbers& n, const State& state) {
    using G = decltype(state(0));
    Vec<G, D> half;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        half[a] = G(n.kernel.half_edge);
        if (n.extent >= 0) half[a] = half[a] * (G(1) + state(n.extent + a));
    }
    return half;
}

/// Half-edges of a parallelepiped, cells; `state(r)` is number r of what its particle stores.
template <int D, class State>
MPM_INLINE auto half_edges_at(const PhaseNumbers& n, const State& state) {
    using G = decltype(state(0));
    Mat<G, D> h;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        MPM_UNROLL for (int b = 0; b < D; ++b) h.e[a][b] = state(n.edges + a * D + b);
    }
    return half_edges_of(G(n.kernel.half_edge), h);
}

/// The functions of particle q.
template <class G, class T, int D, int W>
MPM_INLINE void find_stencil(Stencil<G, D, W>& s, const PhaseNumbers& n, const BodyView<T, D>& body,
                             const Standing<G, D>& at, std::uint32_t q) {
    const auto half = half_edges<D>(n, [&](int r) { return G(body.state[r][q]); });
    s = stencil_of<W>(n.kernel, at.xi, half, at.in_domain);
}
template <class G, class T, int D>
MPM_INLINE void find_stencil(DualStencil<G, D>& s, const PhaseNumbers& n,
                             const BodyView<T, D>& body, const Standing<G, D>& at,
                             std::uint32_t q) {
    find_stencil(static_cast<Stencil<G, D, 5>&>(s), n, body, at, q);
    s.find(at.xi);
}
template <class G, class T, int D>
MPM_INLINE void find_stencil(CornerStencil<G, D>& s, const PhaseNumbers& n,
                             const BodyView<T, D>& body, const Standing<G, D>& at,
                             std::uint32_t q) {
    s.find(at.xi, half_edges_at<D>(n, [&](int r) { return G(body.state[r][q]); }));
}

/// Where particle q stands, whose home cell is `home` of the block in `slot`, and its functions
/// there.
template <int W, class X, class T, int D, class S = Stencil<typename Pass<X, T, D>::Grid, D, W>>
struct Reached {
    using G = typename Pass<X, T, D>::Grid;
    Standing<G, D> at;
    S stencil;

    MPM_INLINE Reached(const Phase<X, T, D>& phase, std::int32_t slot, const int (&home)[D],
                       std::uint32_t q) {
        stand(phase, slot, home, q);
        find_stencil(stencil, phase.n, phase.pass.body, at, q);
    }
    /// Where all have the same functions, which do not depend on the particle; known when this is
    /// compiled they leave nothing to ask.
    MPM_INLINE Reached(const Phase<X, T, D>& phase, std::int32_t slot, const int (&home)[D],
                       std::uint32_t q, const KernelChoice& kernel) {
        stand(phase, slot, home, q);
        stencil = stencil_within<W>(kernel, at.xi, Vec<G, D>{}, at.in_domain);
    }

private:
    MPM_INLINE void stand(const Phase<X, T, D>& phase, std::int32_t slot, const int (&home)[D],
                          std::uint32_t q) {
        const auto& pass = phase.pass;
        Vec<T, D> offset;
        MPM_UNROLL for (int a = 0; a < D; ++a) offset[a] = pass.body.offset[a][q];
        at.find(pass.grid.table.corners + std::int64_t(slot) * D, home, offset);
    }
};

/// Quadratic splines, away from clamped ends: the same functions for all, known when a pass is
/// compiled, whose nodes then need no loop.
inline bool of_splines(const KernelChoice& k) {
    return k.kernel == Kernel::quadratic && !k.clamped;
}
template <bool Splines>
using NodesOf = std::conditional_t<Splines, Unrolled, ByPlanes>;
template <int W, bool Splines, class X, class T, int D>
MPM_INLINE Reached<W, X, T, D> reach(const Phase<X, T, D>& phase, std::int32_t slot,
                                     const int (&home)[D], std::uint32_t q) {
    if constexpr (Splines)
        return Reached<W, X, T, D>(phase, slot, home, q, KernelChoice{});
    else
        return Reached<W, X, T, D>(phase, slot, home, q);
}

/// What a launch asks of the transfers of all its particles.
struct TransferNumbers {
    Part part;
    int source;   // sweeps: channel of nodal velocities that is gathered
    int average;  // channel of the averaged volume, or -1
    bool carry;   // F-bar: its gradient is deposited

    template <class X, class T, int D>
    MPM_INLINE static TransferNumbers of(const Phase<X, T, D>& phase) {
        return {phase.part, phase.part == Part::vectors ? phase.source : 0,
                phase.n.channels > D ? phase.pass.group.average : -1, phase.pass.carry};
    }
};

/// Gathers, for a particle or for those of a cell side by side. `read(place)` gives a node's
/// velocities by channel, `put(column, number)` writes to scratch.
template <class G, class Nodes = ByPlanes, int D, int W, class S, class Read, class Put>
MPM_INLINE void collect_by(const PhaseNumbers& n, const TransferNumbers& t, const S& s,
                           const Places<D, W>& places, const Read& read, const Put& put) {
    constexpr int most = D + 1;
    const G none = G(ScalarOf<G>(0));
    if (t.part != Part::step) {
        if (t.part == Part::averages) return;
        G value[D];
        MPM_UNROLL for (int a = 0; a < D; ++a) value[a] = none;
        Nodes::visit(s, places, [&](const auto&, int place, G w) MPM_INLINE_LAMBDA {
            const auto u = read(place);
            MPM_UNROLL for (int a = 0; a < D; ++a) value[a] += w * u[t.source + a];
        });
        MPM_UNROLL for (int a = 0; a < D; ++a) put(a, value[a]);
        return;
    }
    G value[most], slope[D][most], affine[D][D], before[D], filtered[D];
    MPM_UNROLL for (int c = 0; c < most; ++c) {
        value[c] = none;
        MPM_UNROLL for (int a = 0; a < D; ++a) slope[a][c] = none;
    }
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        before[a] = filtered[a] = none;
        MPM_UNROLL for (int c = 0; c < D; ++c) affine[a][c] = none;
    }
    MaskOf<G> guarded = none < none;
    const bool shapes = n.kernel.gradient == GradientForm::shapes, separate = n.separate_affine();
    Nodes::visit(s, places, [&](const auto& k, int place, G w) MPM_INLINE_LAMBDA {
        const auto u = read(place);
        G along[D];
        MPM_UNROLL for (int a = 0; a < D; ++a) along[a] = node_along(s, k, w, a, shapes);
        MPM_UNROLL for (int c = 0; c < D; ++c) {
            const auto v = u[c];
            value[c] += w * v;
            MPM_UNROLL for (int a = 0; a < D; ++a) slope[a][c] += along[a] * v;
        }
        if (t.average >= 0) {
            const auto j = u[t.average];
            value[D] += w * j;
            MPM_UNROLL for (int a = 0; a < D; ++a) slope[a][D] += along[a] * j;
        }
        if (separate) {
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                const G lever = node_lever(s, k, w, a);
                MPM_UNROLL for (int c = 0; c < D; ++c) affine[a][c] += lever * u[c];
            }
        }
        if (n.before >= 0) {
            MPM_UNROLL for (int a = 0; a < D; ++a) before[a] += w * u[n.before + a];
        }
        if (n.filtered >= 0) {
            MPM_UNROLL for (int a = 0; a < D; ++a) filtered[a] += w * u[n.filtered + a];
        }
        if (n.guard >= 0) {
            if (u[n.guard] > ScalarOf<G>(0)) guarded = guarded | (w > none);
        }
    });
    const Scratch<D> column{n.channels};
    MPM_UNROLL for (int c = 0; c < most; ++c) {
        if (c >= n.channels) continue;
        put(column.value(c), value[c]);
        MPM_UNROLL for (int a = 0; a < D; ++a) put(column.slope(a, c), slope[a][c]);
    }
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        MPM_UNROLL for (int c = 0; c < D; ++c) {
            if (separate) put(column.stress(a, c), affine[a][c]);
        }
        if (n.before >= 0) put(column.before(a), before[a]);
        if (n.filtered >= 0) put(column.filtered(a), filtered[a]);
    }
    if (n.guard >= 0) put(column.guard(), select(guarded, G(ScalarOf<G>(1)), none));
}
/// The same of particle q, into its scratch.
template <class Nodes = ByPlanes, int W, class X, class T, int D, class S, class Read>
MPM_INLINE void collect_particle(const Phase<X, T, D>& phase, const Reached<W, X, T, D, S>& reached,
                                 const Places<D, W>& places, std::uint32_t q, const Read& read) {
    using G = typename Pass<X, T, D>::Grid;
    const std::size_t count = phase.pass.body.count;
    collect_by<G, Nodes>(phase.n, TransferNumbers::of(phase), reached.stencil, places, read,
                         [&](int c, G x) { phase.pass.scratch[std::size_t(c) * count + q] = x; });
}

/// Spreads what a particle has in scratch, or those of a cell side by side: `get(column)` reads it.
/// Calls add(channel, place, amount) for particles of unit mass, channels as `spread_channel`
/// counts them.
template <class G, int D, int W, class S, class Get, class Add>
MPM_INLINE void spread_by(const PhaseNumbers& n, const TransferNumbers& t, const S& s,
                          const Places<D, W>& places, const Get& get, const Add& add) {
    const Scratch<D> column{n.channels};
    const G none = G(ScalarOf<G>(0));
    if (t.part == Part::averages) {
        const G j = get(column.value(D));
        for_each_node(s, places,
                      [&](const auto&, int place, G w) MPM_INLINE_LAMBDA { add(0, place, w * j); });
        return;
    }
    G value[D];
    MPM_UNROLL for (int c = 0; c < D; ++c) value[c] = get(column.value(c));
    if (t.part == Part::vectors) {
        for_each_node(s, places, [&](const auto&, int place, G w) MPM_INLINE_LAMBDA {
            MPM_UNROLL for (int c = 0; c < D; ++c) add(c, place, w * value[c]);
        });
        return;
    }
    if (t.part == Part::stresses) {
        for_each_node(s, places, [&](const auto& k, int place, G w) MPM_INLINE_LAMBDA {
            MPM_UNROLL for (int c = 0; c < D; ++c) {
                G force = none;
                MPM_UNROLL for (int a = 0; a < D; ++a) force =
                    force + get(column.stress(a, c)) * node_along(s, k, w, a, true);
                add(c, place, -force);
            }
        });
        return;
    }
    const bool shapes = n.kernel.gradient == GradientForm::shapes, smoothed = n.channels > D,
               plain = n.plain >= 0;
    const int mass = n.channels + (plain ? D : 0);
    G slope[D][D], stress[D][D], average = none, tilt[D];
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int c = 0; c < D; ++c) {
        slope[a][c] = n.scheme.affine ? get(column.slope(a, c)) : none;
        stress[a][c] = get(column.stress(a, c));
    }
    MPM_UNROLL for (int a = 0; a < D; ++a) tilt[a] = none;
    if (smoothed) {
        average = get(column.value(D));
        MPM_UNROLL for (int a = 0; a < D; ++a) if (t.carry) tilt[a] = get(column.slope(a, D));
    }
    for_each_node(s, places, [&](const auto& k, int place, G w) MPM_INLINE_LAMBDA {
        G along[D];
        MPM_UNROLL for (int a = 0; a < D; ++a) along[a] = node_along(s, k, w, a, shapes);
        MPM_UNROLL for (int c = 0; c < D; ++c) {
            G at = value[c], force = none;
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                at = at + slope[a][c] * s.distance[a][k[a]];
                force = force + stress[a][c] * along[a];
            }
            add(c, place, w * at - force);
            if (plain) add(n.channels + c, place, w * at);
        }
        if (smoothed) {
            G at = average;
            MPM_UNROLL for (int a = 0; a < D; ++a) at = at + tilt[a] * s.distance[a][k[a]];
            add(D, place, w * at);
        }
        add(mass, place, w);
    });
}
template <int W, class X, class T, int D, class S, class Add>
MPM_INLINE void spread_particle(const Phase<X, T, D>& phase, const Reached<W, X, T, D, S>& reached,
                                const Places<D, W>& places, std::uint32_t q, const Add& add) {
    using G = typename Pass<X, T, D>::Grid;
    const std::size_t count = phase.pass.body.count;
    spread_by<G>(
        phase.n, TransferNumbers::of(phase), reached.stencil, places,
        [&](int c) { return phase.pass.scratch[std::size_t(c) * count + q]; }, add);
}

/// Which nodal sum each channel of a spread goes to.
template <int D>
struct SpreadTargets {
    static constexpr int most = 2 * D + 2;
    int channels;
    int sum[most];
    MPM_INLINE SpreadTargets(const PhaseNumbers& n, Part part, const GroupChannels& group)
        : channels(spread_channels<D>(n, part)) {
        MPM_UNROLL for (int c = 0; c < most; ++c) {
            const SpreadChannel s = spread_channel<D>(n, part, c);
            sum[c] = s.kind == SpreadChannel::momentum  ? 1 + s.axis
                     : s.kind == SpreadChannel::average ? group.sum
                     : s.kind == SpreadChannel::plain   ? n.plain + s.axis
                                                        : 0;
        }
    }
};

}  // namespace mpm
