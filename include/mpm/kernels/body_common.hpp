// What the drivers of all backends share around the formulae of one particle: uniform numbers, the
// cell a particle stands in, the checks of its state, its energies. No loop over particles and no
// memory.
#pragma once

#include "mpm/kernels/particle.hpp"
#include "mpm/kernels/pass.hpp"

namespace mpm {

template <class T, class Material>
MPM_INLINE StepNumbers<T, Material> step_numbers(
    const BodyNumbers& n, const typename Material::template Constants<T>& constants, bool carry,
    bool stress_only) {
    return {T(n.move),
            T(n.rate),
            T(n.impulse),
            constants,
            {T(n.ratio), carry ? T(1) : T(0), stress_only}};
}

/// Index of the lowest node of a cell's stencil in an arena with the strides of `Layout`.
template <class Layout, int D>
MPM_INLINE int stencil_origin(const int (&cell)[D]) {
    int n = 0;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        n += (cell[a] + Block<D>::margin - 1) * Layout::stride(a);
    }
    return n;
}

/// Distance of node 0 .. 3^D - 1 of a stencil from its lowest node.
template <class Layout, int D>
MPM_INLINE int stencil_place(int node) {
    if constexpr (D == 2) {
        return node / 3 * Layout::stride(0) + node % 3 * Layout::stride(1);
    } else {
        return node / 9 * Layout::stride(0) + node / 3 % 3 * Layout::stride(1) +
               node % 3 * Layout::stride(2);
    }
}

/// Offset within what the step can see, and a state for which the material's law means something.
/// False also for what is not a number.
template <class Material, class V, int D, int R>
MPM_INLINE MaskOf<V> sound(const Vec<V, D>& xi, const V (&state)[R]) {
    V own[Material::template reals<D>];
    MPM_UNROLL for (int r = 0; r < Material::template reals<D>; ++r) own[r] = state[r];
    MaskOf<V> ok = Material::template admissible<V, D>(own);
    MPM_UNROLL for (int a = 0; a < D; ++a) { ok = ok & (absolute(xi[a]) <= V(ScalarOf<V>(1.75))); }
    return ok;
}

/// What a deposit puts on any node is no more than this times its share of the node's mass:
/// |value| + 3/2 sum |slope|, the largest over channels [First, Last). `sound`: where something is
/// not a number, somebody else says so.
template <int First, int Last, bool sound = false, class V, int D, int C>
MPM_INLINE V deposit_size(const Affine<V, D, C>& u) {
    using T = ScalarOf<V>;
    V most = V(T(0));
    [[maybe_unused]] V all = V(T(0));
    MPM_UNROLL for (int c = First; c < Last; ++c) {
        V tilt = absolute(u.slope[0][c]);
        MPM_UNROLL for (int a = 1; a < D; ++a) tilt = tilt + absolute(u.slope[a][c]);
        const V size = absolute(u.value[c]) + T(1.5) * tilt;
        most = larger(most, size);
        if constexpr (!sound) all = all + size;
    }
    if constexpr (sound) return most;
    return most + all * T(0);  // not-a-number anywhere is not-a-number here
}

/// Number of a particle in a fault report: the smallest is kept.
MPM_INLINE std::uint64_t fault_number(std::uint64_t body, std::uint32_t particle) {
    return body << 40 | particle;
}

/// Adds one particle's kinetic, elastic and potential energy in J (2D: J/m), the last relative to
/// the lower corner. `home` is its home cell in the block, whose first cell is `corner`; `square`
/// is that of its speed.
template <class Material, class T, int D, class P>
MPM_INLINE void add_energies_of(const P& pass, const std::int64_t (&corner)[D],
                                const int (&home)[D], const Vec<T, D>& xi, double square,
                                const T* state, double (&sum)[3]) {
    const double dx = 1 / pass.numbers->rate;
    double height = 0;
    for (int a = 0; a < D; ++a)
        height += pass.clock->gravity[a] * (double(corner[a] + home[a]) + 0.5 + double(xi[a])) * dx;
    double real[Material::template reals<D>];
    for (int r = 0; r < Material::template reals<D>; ++r) real[r] = double(state[r]);
    const double still[D][D] = {};
    const auto o = Material::template observe<D>(real, still, pass.parameters);
    sum[0] += 0.5 * pass.body.particle_mass * square;
    sum[1] += pass.body.particle_volume * o.elastic_energy;
    sum[2] -= pass.body.particle_mass * height;
}
/// The same, with the velocity that the grid gives it.
template <class Material, class T, int D, int C, class Lines, class P>
MPM_INLINE void add_energies(const P& pass, const Lines& lines, const std::int64_t (&corner)[D],
                             const int (&home)[D], const Vec<T, D>& xi, const T* state,
                             double (&sum)[3]) {
    int cell[D];
    Vec<T, D> local;
    for (int a = 0; a < D; ++a) {
        const int shift = cell_shift(xi[a]);
        cell[a] = home[a] + shift;
        local[a] = xi[a] - T(shift);
    }
    using G = typename P::Grid;
    const auto u = gather<C, G, D>(lines, quadratic_weights<G, D>(as<G>(local)),
                                   stencil_origin<Lines, D>(cell));
    double square = 0;
    for (int a = 0; a < D; ++a) square += double(u.value[a]) * double(u.value[a]);
    add_energies_of<Material>(pass, corner, home, xi, square, state, sum);
}

/// A material that says nothing: the second half of the two-pass form knows none.
struct Inert {
    static constexpr bool volumetric = true;
    template <class T>
    struct Constants {};
    template <class T>
    static Constants<T> constants(const double*) {
        return {};
    }
    template <int D>
    static constexpr int reals = 1;
};

}  // namespace mpm
