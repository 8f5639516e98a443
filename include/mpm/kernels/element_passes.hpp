// Devices: what a step does by element and by number of vertex, a thread each, and how the largest
// deposits of vertices are known. Each writes numbers of its own alone.
#pragma once

#include "mpm/kernels/elements.hpp"

namespace mpm {

template <class T, int D>
struct GrowElements {
    ElementsView<T, D> mesh;
    MPM_INLINE void operator()(std::int64_t n) const { grow_element(mesh, mesh.measured[n]); }
};
template <class Material, class T, int D>
struct PressVertices {
    ElementsView<T, D> mesh;
    typename Material::template Constants<T> constants;
    MPM_INLINE void operator()(std::int64_t n) const {
        press_vertex<Material>(mesh, constants, mesh.pressed[n]);
    }
};
template <class X, class Material, class T, int D>
struct PushElements {
    ElementsView<T, D> mesh;
    typename Material::template Constants<T> constants;
    const Clock* clock;
    MPM_INLINE void operator()(std::int64_t n) const {
        if (clock->halt != Halt::none) return;  // what flows would flow once more
        const std::int64_t e = mesh.pushed[n];
        if (!push_element<Material>(mesh, constants, e, clock->dt))
            X::keep_smallest(mesh.inverted, std::uint64_t(e));
    }
};
/// What pushes each vertex in the coming step, before they are spread: reads that follow from one
/// another, of two dozen elements a vertex, for which many threads have to be under way.
template <class X, class T, int D>
struct PushVertices {
    Pass<X, T, D> pass;
    ElementsView<T, D> mesh;
    MPM_INLINE void operator()(std::int64_t q) const {
        if (pass.clock->halt != Halt::none) return;
        const Vec<T, D> push = push_of_step(pass, mesh, std::uint32_t(q));
        MPM_UNROLL for (int a = 0; a < D; ++a) mesh.push[a * mesh.vertices + q] = push[a];
    }
};
template <class Material, class T, int D>
struct FindEnergies {
    ElementsView<T, D> mesh;
    typename Material::template Constants<double> constants;
    double parameters[max_parameters];
    const std::int32_t* due;
    double* energy;
    MPM_INLINE void operator()(std::int64_t n) const {
        if (!*due) return;
        const std::int64_t e = mesh.pushed[n];
        energy[e] = see_element<Material>(mesh, e, parameters, constants).own_energy / (D + 1);
    }
};

/// The largest that vertex q deposits per mass, as `respond` says it of particles: its `push` is
/// known here, and not before. Keeps not-a-number.
template <class X, class T, int D, class G>
MPM_INLINE G vertex_deposit(const Phase<X, T, D>& phase, std::uint32_t q, const Vec<G, D>& push) {
    const auto& pass = phase.pass;
    const Scratch<D> column{phase.n.channels};
    const auto get = [&](int c) {
        return absolute(pass.scratch[std::size_t(c) * pass.body.count + q]);
    };
    const G reach = G(DepositBound::of(phase.n.kernel, phase.n.kernel.half_edge).reach);
    G most = G(0), all = G(0);
    MPM_UNROLL for (int c = 0; c < D; ++c) {
        G size = get(column.value(c)) + absolute(push[c]);
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            if (phase.n.scheme.affine) size = size + reach * get(column.slope(a, c));
        }
        most = larger(most, size);
        all = all + size;
    }
    return most + all * G(0);
}

/// An element that has turned inside out is reported by those of its vertices that are here.
template <class X, class T, int D>
MPM_INLINE void report_inverted(const Pass<X, T, D>& pass, const ElementsView<T, D>& mesh,
                                std::uint32_t q) {
    const std::uint64_t e = *mesh.inverted;
    if (e == no_fault) return;
    for (int k = 0; k <= D; ++k) {
        if (std::uint32_t(mesh.number(std::int64_t(e), k)) == pass.body.id[q])
            X::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
    }
}

template <class Material, class X, class T, int D>
void find_volumes(const Pass<X, T, D>& pass, const ElementsView<T, D>& mesh) {
    pass.exec->for_each(mesh.measured.count, GrowElements<T, D>{mesh});
    pass.exec->for_each(
        mesh.pressed.count,
        PressVertices<Material, T, D>{mesh, Material::template constants<T>(pass.parameters)});
}
template <class Material, class X, class T, int D>
void find_forces(const Pass<X, T, D>& pass, const ElementsView<T, D>& mesh) {
    pass.exec->for_each(mesh.pushed.count,
                        PushElements<X, Material, T, D>{
                            mesh, Material::template constants<T>(pass.parameters), pass.clock});
}

}  // namespace mpm
