// CPU driver of bodies of elements: loops; no formula. Each loop writes numbers of its own alone.
#pragma once

#include "mpm/kernels/cpu/spreading.hpp"
#include "mpm/kernels/elements.hpp"

namespace mpm::cpu {

inline int element_threads(const Cpu& exec, std::int64_t count) {
    return count > 2048 ? exec.threads() : 1;
}

/// Calls f(home cell in the domain, vertex in storage order) for the vertices of a body.
template <class T, int D, class F>
void for_each_vertex(const Pass<Cpu, T, D>& pass, const F& f) {
#pragma omp parallel for schedule(dynamic, 8) \
    num_threads(element_threads(*pass.exec, pass.body.count))
    for (std::int32_t h = 0; h < pass.body.homes; ++h) {
        const std::int32_t slot = pass.body.home[h];
        const std::int32_t* corner = pass.grid.table.corners + std::int64_t(slot) * D;
        for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
            std::int32_t cell[D];
            for (int a = 0; a < D; ++a) cell[a] = corner[a] + home[a];
            f(cell, q);
        });
    }
}

template <class T, int D>
void locate_vertices(const Pass<Cpu, T, D>& pass, const ElementsView<T, D>& mesh, bool at_rest) {
    for_each_vertex<T, D>(pass, [&](const std::int32_t(&cell)[D], std::uint32_t q) {
        if (at_rest) rest_vertex(mesh, pass.body, cell, q);
        locate_vertex(mesh, pass.body, cell, q);
    });
}

template <class Material, class T, int D>
void find_volumes(const Pass<Cpu, T, D>& pass, const ElementsView<T, D>& mesh) {
    const auto k = Material::template constants<T>(pass.parameters);
#pragma omp parallel num_threads(element_threads(*pass.exec, mesh.measured.count))
    {
#pragma omp for schedule(static)
        for (std::int64_t n = 0; n < mesh.measured.count; ++n) grow_element(mesh, mesh.measured[n]);
#pragma omp for schedule(static)
        for (std::int64_t n = 0; n < mesh.pressed.count; ++n)
            press_vertex<Material>(mesh, k, mesh.pressed[n]);
    }
}

template <class Material, class T, int D>
void find_forces(const Pass<Cpu, T, D>& pass, const ElementsView<T, D>& mesh) {
    const auto k = Material::template constants<T>(pass.parameters);
#pragma omp parallel for schedule(static) \
    num_threads(element_threads(*pass.exec, mesh.pushed.count))
    for (std::int64_t n = 0; n < mesh.pushed.count; ++n) {
        const std::int64_t e = mesh.pushed[n];
        if (!push_element<Material>(mesh, k, e, pass.clock->dt))
            Cpu::keep_smallest(mesh.inverted, std::uint64_t(e));
    }
}

template <int W, class T, int D>
void spread_vertices_of(const Phase<Cpu, T, D>& phase, const ElementsView<T, D>& mesh) {
    using A = SpreadArena<T, D, W>;
    const auto& pass = phase.pass;
    const SpreadTargets<D> to(phase.n, phase.part, pass.group);
    for_each_colour<A>(phase, [&](A& arena, std::int32_t slot) {
        std::memset(arena.sums, 0, sizeof arena.sums);
        for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
            const Reached<W, Cpu, T, D> reached(phase, slot, home, q);
            const T m = T(pass.body.particle_mass) * pass.body.state[0][q];
            const Vec<T, D> push = push_of_step(pass, mesh, q);
            spread_vertex(phase, reached, places_in_arena<A, W, D, A::margin>(reached.at.cell), q,
                          push, [&](int channel, int place, T amount) {
                              arena.sums[place][channel] += m * amount;
                          });
        });
        flush_arena<W>(phase, to, arena, slot);
    });
}
template <class T, int D>
void spread_vertices(const Phase<Cpu, T, D>& phase, const ElementsView<T, D>& mesh) {
    if (idle(phase)) return;
    if (kernel_width(phase.n.kernel.kernel) == 3)
        spread_vertices_of<3>(phase, mesh);
    else
        spread_vertices_of<5>(phase, mesh);
}

/// One number a node, of all that points beside a block's vertices reach.
template <class T, int D>
struct FillArena {
    static constexpr int margin = 3, edge = Block<D>::edge + 2 * margin,
                         nodes = D == 2 ? edge * edge : edge * edge * edge;
    T sums[nodes];
    static constexpr int stride(int axis) {
        int s = 1;
        for (int a = D - 1; a > axis; --a) s *= edge;
        return s;
    }
};
template <class T, int D>
void fill_nodes(const Phase<Cpu, T, D>& phase, const ElementsView<T, D>& mesh,
                const std::uint8_t* near, int channel) {
    if (idle(phase)) return;
    using A = FillArena<T, D>;
    const auto& pass = phase.pass;
    for_each_colour<A>(phase, [&](A& arena, std::int32_t slot) {
        if (!near[slot]) return;
        std::memset(arena.sums, 0, sizeof arena.sums);
        for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
            for_each_filling(pass, mesh, slot, home, q,
                             [&](const int(&cell)[D], const Stencil<T, D, 3>& s, T mass) {
                                 for_each_node(s, places_in_arena<A, 3, D, A::margin>(cell),
                                               [&](const auto&, int place, T w) {
                                                   arena.sums[place] += mass * w;
                                               });
                             });
        });
        for_each_run<D, A::margin>(
            pass.destinations + std::int64_t(slot) * Block<D>::neighbours,
            [&](int at, std::int32_t target, int node, int length) {
                T* sums = pass.grid.sums +
                          (std::int64_t(target) * pass.grid.sum_channels + channel) * block_cells +
                          node;
                for (int k = 0; k < length; ++k) sums[k] += arena.sums[at + k];
            });
    });
}

template <class Material, class T, int D>
void element_energies(const Phase<Cpu, T, D>& phase, const ElementsView<T, D>& mesh,
                      const std::int32_t* due, double* energy, double* partial) {
    if (!*due) return;
    const auto& pass = phase.pass;
    const auto k = Material::template constants<double>(pass.parameters);
#pragma omp parallel for schedule(static) \
    num_threads(element_threads(*pass.exec, mesh.pushed.count))
    for (std::int64_t n = 0; n < mesh.pushed.count; ++n) {
        const std::int64_t e = mesh.pushed[n];
        energy[e] = see_element<Material>(mesh, e, pass.parameters).own_energy / (D + 1);
    }
#pragma omp parallel for schedule(dynamic, 8) \
    num_threads(element_threads(*pass.exec, pass.body.count))
    for (std::int32_t h = 0; h < pass.body.homes; ++h) {
        const std::int32_t slot = pass.body.home[h];
        double sum[3] = {};
        for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
            add_vertex_energies<Material>(phase, mesh, k, slot, home, q, energy, sum);
        });
        for (int n = 0; n < 3; ++n) partial[3 * h + n] = sum[n];
    }
}

template <class Material, class T, int D>
ElementOps<Cpu, T, D> element_instance() {
    ElementOps<Cpu, T, D> ops{};
    ops.kept = kept_reals<Material, D>;
    ops.locate = &locate_vertices<T, D>;
    ops.volumes = &find_volumes<Material, T, D>;
    ops.forces = &find_forces<Material, T, D>;
    ops.spread = &spread_vertices<T, D>;
    ops.fill = &fill_nodes<T, D>;
    ops.energies = &element_energies<Material, T, D>;
    ops.see = &see_element<Material, T, D>;
    return ops;
}

}  // namespace mpm::cpu
