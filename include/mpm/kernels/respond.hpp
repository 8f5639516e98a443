// The material's part of the phased step, for one particle or several side by side and without a
// kernel: state, velocity and position advance, and what is to be deposited is left in scratch. See
// phase.hpp.
#pragma once

#include "mpm/kernels/phase.hpp"
#include "mpm/physics/shape/parallelepiped.hpp"

namespace mpm {

/// A particle that stands further than this from its home cell's centre makes the clock sort: what
/// a scheme adds to its path is in no bound on the drift.
inline constexpr double far_from_home = 1.0;

/// What a deposit puts on a node is at most its share of the node's mass times
///   |value| + reach sum |slope| + pull sum |stress|.
/// With gradients of shapes a share of the largest mass around: these functions are dominated by
/// three of their neighbours.
struct DepositBound {
    double reach, pull;
    template <class G>
    MPM_INLINE static DepositBound of(const KernelChoice& k, G least_half_edge) {
        const bool shapes = k.gradient == GradientForm::shapes;
        switch (k.kernel) {
            case Kernel::linear:
            case Kernel::ddmp:
                return {1, 3};
            case Kernel::quadratic:
                return {1.5, shapes ? 3.0 : 6.0};
            case Kernel::cubic:
                return {2, shapes ? 3.0 : 6.0};
            default: {
                const double l = double(least_half_edge);
                return {1 + largest_half_edge, shapes ? 3.0 : 2 * (1 + l) / l};
            }
        }
    }
};

namespace detail {

/// A lane of a number, which of a scalar is the number.
template <class V>
MPM_INLINE ScalarOf<V> lane_of(const V& v, int lane) {
    if constexpr (NumberTraits<V>::lanes == 1)
        return v;
    else
        return v[lane];
}
/// The number whose lanes are f(lane).
template <class V, class F>
MPM_INLINE V by_lanes(const F& f) {
    if constexpr (NumberTraits<V>::lanes == 1) {
        return f(0);
    } else {
        V out;
        MPM_NO_UNROLL for (int l = 0; l < NumberTraits<V>::lanes; ++l) out.raw[l] = f(l);
        return out;
    }
}

}  // namespace detail

/// A particle's volume loss 1 - J after its update.
template <class Material, Smoothing S, class V, int D, class P>
MPM_INLINE V loss_of(const P& pass, const V (&state)[state_reals<Material, D, S>]) {
    constexpr int reals = Material::template reals<D>;
    if constexpr (Material::volumetric || SaysVolume<Material, V, D>) {
        return volume_loss_in<Material, S, V, D>(state);
    } else {
        return detail::by_lanes<V>([&](int l) MPM_INLINE_LAMBDA {
            double real[reals];
            for (int r = 0; r < reals; ++r) real[r] = double(detail::lane_of(state[r], l));
            const double still[D][D] = {};
            return ScalarOf<V>(
                1 - Material::template observe<D>(real, still, pass.parameters).volume_ratio);
        });
    }
}

/// Uniform numbers of a body in the phased step.
template <class Material, class X, class T, int D>
MPM_INLINE StepNumbers<T, Material> phase_numbers(
    const Phase<X, T, D>& phase, const typename Material::template Constants<T>& constants) {
    auto numbers = step_numbers<T, Material>(*phase.pass.numbers, constants, phase.pass.carry,
                                             phase.pass.stress_only);
    numbers.smoothing.lags = phase.n.lags;
    numbers.smoothing.leads = phase.n.leads;
    return numbers;
}

/// What `respond` found. The largest deposits are for sums in fixed point: lanes have none.
template <class G>
struct Responded {
    MaskOf<G> sound;
    MaskOf<G> far;
    G momentum, average;
};

/// The numbers of particle q, where its body keeps them.
template <class X, class T, int D>
struct OneParticle {
    using Number = T;
    using G = typename Pass<X, T, D>::Grid;
    const Pass<X, T, D>& pass;
    std::uint32_t q;
    MPM_INLINE T offset(int a) const { return pass.body.offset[a][q]; }
    MPM_INLINE void set_offset(int a, T x) const { pass.body.offset[a][q] = x; }
    MPM_INLINE T state(int r) const { return pass.body.state[r][q]; }
    MPM_INLINE void set_state(int r, T x) const { pass.body.state[r][q] = x; }
    MPM_INLINE G scratch(int c) const { return pass.scratch[std::size_t(c) * pass.body.count + q]; }
    MPM_INLINE void set_scratch(int c, G x) const {
        pass.scratch[std::size_t(c) * pass.body.count + q] = x;
    }
};

/// A parallelepiped follows F <- (I + dt grad v) F, where the material does not; false where it
/// outgrows its stencil or has no volume left.
template <int D, int C, class X, class T, class G>
MPM_INLINE bool advance_edges(const Phase<X, T, D>& phase, T move, const Affine<G, D, C>& u,
                              std::uint32_t q) {
    Mat<T, D> h, strain;
    const auto stored = [&](int a, int b) -> T& {
        return phase.pass.body.state[phase.n.edges + a * D + b][q];
    };
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
        h.e[a][b] = stored(a, b);
        strain.e[a][b] = move * T(u.slope[b][a]);
    }
    if (phase.n.own_edges) {
        const Mat<T, D> change = product(strain, h);
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
            h.e[a][b] = h.e[a][b] + (strain.e[a][b] + change.e[a][b]);
            stored(a, b) = h.e[a][b];
        }
    }
    const Mat<T, D> edges = half_edges_of(T(phase.n.kernel.half_edge), h);
    bool fits = volume_change(h) > T(-1);
    MPM_UNROLL for (int a = 0; a < D; ++a) fits =
        fits && reach_along(edges, a) <= T(largest_half_edge);
    return fits;
}

/// `p` holds the particle's numbers, or those of several: `OneParticle`.
template <class Material, Smoothing S, class X, class T, int D, class P>
MPM_INLINE Responded<typename P::G> respond(const Phase<X, T, D>& phase,
                                            const StepNumbers<T, Material>& k, bool due,
                                            const P& p) {
    using V = typename P::Number;
    using G = typename P::G;
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    constexpr bool alone = NumberTraits<V>::lanes == 1;
    const PhaseNumbers& n = phase.n;
    const SchemeNumbers& scheme = n.scheme;
    const Scratch<D> column{C};
    const V zero = V(T(0));

    Vec<V, D> xi;
    V state[R];
    MPM_UNROLL for (int a = 0; a < D; ++a) xi[a] = p.offset(a);
    MPM_UNROLL for (int r = 0; r < R; ++r) state[r] = p.state(r);
    Affine<G, D, C> u, out;
    MPM_UNROLL for (int c = 0; c < C; ++c) {
        u.value[c] = p.scratch(column.value(c));
        MPM_UNROLL for (int a = 0; a < D; ++a) u.slope[a][c] = p.scratch(column.slope(a, c));
    }
    if (n.separate_affine()) {
        MPM_UNROLL for (int c = 0; c < D; ++c) MPM_UNROLL for (int a = 0; a < D; ++a)
            p.set_scratch(column.slope(a, c), p.scratch(column.stress(a, c)));
    }
    const Mat<V, D> tau = update_state<Material, S, true, V, D, G>(u, state, k, out);
    MPM_UNROLL for (int r = 0; r < R; ++r) p.set_state(r, state[r]);

    // Velocities: what is kept, and what moves the particle.
    Vec<V, D> kept, moves;
    MPM_UNROLL for (int a = 0; a < D; ++a) kept[a] = moves[a] = V(u.value[a]);
    if (scheme.memory == Memory::flip) {
        const T alpha = n.sweeps && due ? T(0) : T(scheme.keep);
        V share = zero;
        if (scheme.rule != ShiftRule::none) {
            const V loss = loss_of<Material, S, V, D>(phase.pass, state);
            share = detail::by_lanes<V>([&](int l) MPM_INLINE_LAMBDA {
                return shift_share(scheme, detail::lane_of(loss, l));
            });
            if (n.guard >= 0) share = select(zero < V(p.scratch(column.guard())), zero, share);
        }
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const V unseen = alpha * (p.state(n.velocity + a) - V(p.scratch(column.before(a))));
            kept[a] = kept[a] + unseen;
            moves[a] = moves[a] + share * unseen;
        }
    } else if (scheme.memory == Memory::xpic) {
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const V own = p.state(n.velocity + a), before = V(p.scratch(column.before(a)));
            const V filtered = due ? V(p.scratch(column.filtered(a))) : own;
            kept[a] = filtered + V(u.value[a]) - before;
            moves[a] = moves[a] - T(0.5) * (V(u.value[a]) - before) - T(0.5) * (own - filtered);
        }
    }
    MaskOf<V> fine = zero <= zero, far = zero < zero;
    V least_edge = V(T(n.kernel.half_edge));
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        if (n.velocity >= 0) p.set_state(n.velocity + a, kept[a]);
        if (n.extent >= 0) {
            V stretch = p.state(n.extent + a);
            stretch = stretch + k.move * V(u.slope[a][a]) * (T(1) + stretch);
            p.set_state(n.extent + a, stretch);
            const V edge = T(n.kernel.half_edge) * (T(1) + stretch);
            fine = fine & (edge <= V(T(largest_half_edge))) & (zero < edge);
            least_edge = smaller(least_edge, edge);
        }
        xi[a] = xi[a] + k.move * moves[a];
        p.set_offset(a, xi[a]);
        far = far | (absolute(xi[a]) > V(T(far_from_home)));
    }
    if constexpr (alone) {
        if (n.edges >= 0) fine = fine && advance_edges<D, C>(phase, k.move, u, p.q);
    }

    const auto force = G(T(0.25) * k.impulse);  // dt / (rho0 dx)
    fine = fine & sound<Material>(xi, state);
    Responded<G> found{fine, far, G(ScalarOf<G>(0)), G(ScalarOf<G>(0))};
    MPM_UNROLL for (int c = 0; c < D; ++c) {
        p.set_scratch(column.value(c), G(kept[c]));
        MPM_UNROLL for (int a = 0; a < D; ++a)
            p.set_scratch(column.stress(a, c), force * G(tau.e[c][a]));
    }
    if constexpr (C > D) {
        p.set_scratch(column.value(D), out.value[D]);
        MPM_UNROLL for (int a = 0; a < D; ++a) p.set_scratch(column.slope(a, D), out.slope[a][D]);
    }
    if constexpr (alone) {
        const DepositBound bound = DepositBound::of(n.kernel, least_edge);
        MPM_UNROLL for (int c = 0; c < D; ++c) {
            G tilt = G(0), pull = G(0);
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                pull = pull + absolute(force * G(tau.e[c][a]));
                if (scheme.affine) tilt = tilt + absolute(p.scratch(column.slope(a, c)));
            }
            found.momentum = larger(found.momentum, absolute(G(kept[c])) + G(bound.reach) * tilt +
                                                        G(bound.pull) * pull);
            // Keeps not-a-number.
            found.momentum = found.momentum + (absolute(G(kept[c])) + tilt + pull) * G(0);
        }
        if constexpr (C > D) {
            found.average = absolute(out.value[D]);
            MPM_UNROLL for (int a = 0; a < D; ++a) found.average =
                found.average + G(bound.reach) * absolute(out.slope[a][D]);
        }
    }
    return found;
}
template <class Material, Smoothing S, class X, class T, int D>
MPM_INLINE Responded<typename Pass<X, T, D>::Grid> respond_particle(
    const Phase<X, T, D>& phase, const StepNumbers<T, Material>& k, bool due, std::uint32_t q) {
    return respond<Material, S>(phase, k, due, OneParticle<X, T, D>{phase.pass, q});
}

/// What a particle deposits before the first step, from its given velocity in the first D columns
/// of scratch; the stored one where there is any.
template <class Material, Smoothing S, class X, class T, int D>
MPM_INLINE Responded<typename Pass<X, T, D>::Grid> rest_particle(const Phase<X, T, D>& phase,
                                                                 const StepNumbers<T, Material>& k,
                                                                 std::uint32_t q) {
    using G = typename Pass<X, T, D>::Grid;
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    const auto& pass = phase.pass;
    const Scratch<D> column{C};
    const std::size_t count = pass.body.count;
    const auto at = [&](int c) -> G& { return pass.scratch[std::size_t(c) * count + q]; };
    Vec<G, D> velocity;
    T state[R];
    MPM_UNROLL for (int r = 0; r < R; ++r) state[r] = pass.body.state[r][q];
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        velocity[a] = at(a);
        if (phase.n.velocity >= 0) pass.body.state[phase.n.velocity + a][q] = T(velocity[a]);
    }
    StepNumbers<T, Material> quarter = k;
    quarter.impulse = T(0.25) * k.impulse;
    const auto u = resting_particle<Material, S, T, D, G>(velocity, state, quarter);
    const DepositBound bound = DepositBound::of(phase.n.kernel, phase.n.kernel.half_edge);
    Responded<G> found{true, false, G(0), G(0)};
    MPM_UNROLL for (int c = 0; c < C; ++c) {
        at(column.value(c)) = u.value[c];
        G pull = G(0);
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            at(column.slope(a, c)) = G(0);
            if (c < D) {
                at(column.stress(a, c)) = -u.slope[a][c];
                pull = pull + absolute(u.slope[a][c]);
            }
        }
        if (c < D) {
            const G size = absolute(u.value[c]) + G(bound.pull) * pull;
            found.momentum = larger(found.momentum, size) + size * G(0);  // keeps not-a-number
        } else {
            found.average = absolute(u.value[c]);
        }
    }
    return found;
}

/// The blended volume advanced by this step's rate, for the grid to average: F-bar in its split
/// form.
template <class Material, Smoothing S, class X, class T, int D>
MPM_INLINE typename Pass<X, T, D>::Grid project_particle(const Phase<X, T, D>& phase,
                                                         const StepNumbers<T, Material>& k,
                                                         std::uint32_t q) {
    using G = typename Pass<X, T, D>::Grid;
    static_assert(S == Smoothing::two_volumes);
    const auto& pass = phase.pass;
    const Scratch<D> column{D + 1};
    const std::size_t count = pass.body.count;
    Mat<T, D> strain;
    MPM_UNROLL for (int c = 0; c < D; ++c) MPM_UNROLL for (int a = 0; a < D; ++a) strain.e[c][a] =
        k.move * T(pass.scratch[std::size_t(column.slope(a, c)) * count + q]);
    const T j = pass.body.state[Material::template reals<D>][q];
    const G advanced = G(advance_loss<Material>(j, strain));
    pass.scratch[std::size_t(column.value(D)) * count + q] = advanced;
    return advanced;
}

/// A state in double with the volume that its stress follows.
template <class Material, int D>
MPM_HD void adopt_volume(double* state, double loss) {
    if constexpr (Material::volumetric) {
        state[0] = loss;
    } else {
        constexpr int reals = Material::template reals<D>;
        double own[reals];
        for (int r = 0; r < reals; ++r) own[r] = state[r];
        Material::template scale_volume<D>(own, Material::template volume_loss<D>(own), loss);
        for (int r = 0; r < reals; ++r) state[r] = own[r];
    }
}

/// What all backends say alike of an instance.
template <class Material, Smoothing S, class X, class T, int D>
void describe_instance(BodyOps<X, T, D>& ops) {
    ops.state_columns = state_reals<Material, D, S>;
    ops.channels = transfer_channels<D, S>;
    ops.observe = &Material::template observe<D>;
    if constexpr (S == Smoothing::two_volumes) ops.adopt = &adopt_volume<Material, D>;
}

/// Square of a particle's speed: of the velocity that it stores, or that the grid gives it.
template <class X, class T, int D>
MPM_INLINE double speed_squared(const Phase<X, T, D>& phase, std::uint32_t q) {
    double square = 0;
    for (int a = 0; a < D; ++a) {
        const double v =
            phase.n.velocity >= 0
                ? double(phase.pass.body.state[phase.n.velocity + a][q])
                : double(phase.pass.scratch[std::size_t(a) * phase.pass.body.count + q]);
        square += v * v;
    }
    return square;
}

}  // namespace mpm
