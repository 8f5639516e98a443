// CUDA driver of bodies of elements: vertices, a thread each; no formula. Each writes numbers of
// its own alone, and what it adds to the grid are integers.
#pragma once

#include "mpm/kernels/cuda/spreading.cuh"
#include "mpm/kernels/element_passes.hpp"

namespace mpm::cuda {

/// Places follow from what is stored: a halted step has changed none, and readers ask at a halt.
template <class X, class T, int D>
__global__ void __launch_bounds__(phase_block)
    locate_step(const __grid_constant__ Pass<X, T, D> pass,
                const __grid_constant__ ElementsView<T, D> mesh, bool at_rest) {
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const std::int32_t* corner = pass.grid.table.corners + std::int64_t(slot) * D;
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += phase_block) {
        int home[D];
        Block<D>::coordinates(pass.body.home_cell(q), home);
        std::int32_t cell[D];
        MPM_UNROLL for (int a = 0; a < D; ++a) cell[a] = corner[a] + home[a];
        if (at_rest) rest_vertex(mesh, pass.body, cell, q);
        locate_vertex(mesh, pass.body, cell, q);
    }
}

/// A vertex and what pushes it; the largest deposits are known here, and not before.
template <class G, class T, int D>
struct PushedVertex {
    Vec<G, D> push;
    G share;  // of the mean vertex' mass
    template <class Nodes, class P, class R, class N, class Add>
    __device__ __forceinline__ void spread(const P& phase, const R& reached, const N& places,
                                           std::uint32_t q, const Add& add) const {
        spread_vertex<Nodes>(
            phase, reached, places, q, push,
            [&](int channel, int place, G amount) { add(channel, place, share * amount); });
    }
};
template <class T, int D>
struct Vertices {
    static constexpr bool tell = true;
    static constexpr bool velocities_then_mass = true;
    ElementsView<T, D> mesh;

    template <class X, class G>
    __device__ __forceinline__ PushedVertex<G, T, D> at(const Phase<X, T, D>& phase,
                                                        std::uint32_t q,
                                                        Largest<G>& largest) const {
        const auto& pass = phase.pass;
        report_inverted<X>(pass, mesh, q);
        PushedVertex<G, T, D> vertex{};
        vertex.share = G(pass.body.state[0][q]);
        MPM_UNROLL for (int c = 0; c < D; ++c) vertex.push[c] = G(mesh.push[c * mesh.vertices + q]);
        largest.see_momentum(vertex_deposit(phase, q, vertex.push));
        return vertex;
    }
};

template <class X, class T, int D>
__global__ void __launch_bounds__(phase_block)
    fill_step(const __grid_constant__ Phase<X, T, D> phase,
              const __grid_constant__ ElementsView<T, D> mesh, const std::uint8_t* near,
              int channel) {
    using G = typename Pass<X, T, D>::Grid;
    if (idle(phase)) return;
    const auto& pass = phase.pass;
    const auto& g = pass.grid;
    const std::int32_t slot = pass.body.home[blockIdx.x];
    if (!near[slot]) return;
    const std::int32_t* neighbours = neighbours_of(g.table, slot);
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    const G scale = G(pass.clock->scale_write[mass_sum]);
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += phase_block) {
        int home[D];
        Block<D>::coordinates(pass.body.home_cell(q), home);
        for_each_filling(
            pass, mesh, slot, home, q, [&](const int(&cell)[D], const Stencil<T, D, 3>& s, T mass) {
                for_each_node(s, places_in_grid<3>(cell), [&](const auto&, int place, T w) {
                    const std::int64_t block =
                        std::int64_t(neighbours[place >> 8]) * g.sum_channels + channel;
                    add_fixed(g.sums + block * block_cells + (place & 255),
                              to_fixed(G(mass * w) * scale));
                });
            });
    }
}

/// One block of threads a home block, in a fixed order, so that the bits never change.
template <class Material, class X, class T, int D>
__global__ void __launch_bounds__(phase_block)
    sum_vertex_energies(const __grid_constant__ Phase<X, T, D> phase,
                        const __grid_constant__ ElementsView<T, D> mesh,
                        const __grid_constant__ typename Material::template Constants<double> k,
                        const std::int32_t* due, const double* energy, double* partial) {
    if (!*due) return;
    const auto& pass = phase.pass;
    __shared__ double parts[3][phase_block];
    const std::int32_t slot = pass.body.home[blockIdx.x];
    const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
    double sum[3] = {};
    for (std::uint32_t q = start[0] + threadIdx.x; q < start[block_cells]; q += phase_block) {
        int home[D];
        Block<D>::coordinates(pass.body.home_cell(q), home);
        add_vertex_energies<Material>(phase, mesh, k, slot, home, q, energy, sum);
    }
    add_in_order(parts, sum, partial + 3 * std::int64_t(blockIdx.x));
}

template <class X, class T, int D>
void locate_vertices(const Pass<X, T, D>& pass, const ElementsView<T, D>& mesh, bool at_rest) {
    pass.exec->launch(&locate_step<X, T, D>, pass.body.homes, 1, phase_block, pass, mesh, at_rest);
}
template <class X, class T, int D>
void spread_vertices(const Phase<X, T, D>& phase, const ElementsView<T, D>& mesh) {
    phase.pass.exec->for_each(phase.pass.body.count, PushVertices<X, T, D>{phase.pass, mesh});
    spread_with(phase, Vertices<T, D>{mesh});
}
template <class X, class T, int D>
void fill_nodes(const Phase<X, T, D>& phase, const ElementsView<T, D>& mesh,
                const std::uint8_t* near, int channel) {
    phase.pass.exec->launch(&fill_step<X, T, D>, phase.pass.body.homes, 1, phase_block, phase, mesh,
                            near, channel);
}
template <class Material, class X, class T, int D>
void element_energies(const Phase<X, T, D>& phase, const ElementsView<T, D>& mesh,
                      const std::int32_t* due, double* energy, double* partial) {
    const auto constants = Material::template constants<double>(phase.pass.parameters);
    FindEnergies<Material, T, D> find{mesh, constants, {}, due, energy};
    for (int k = 0; k < max_parameters; ++k) find.parameters[k] = phase.pass.parameters[k];
    phase.pass.exec->for_each(mesh.pushed.count, find);
    phase.pass.exec->launch(&sum_vertex_energies<Material, X, T, D>, phase.pass.body.homes, 1,
                            phase_block, phase, mesh, constants, due,
                            static_cast<const double*>(energy), partial);
}

template <class Material, class X, class T, int D>
ElementOps<X, T, D> element_instance() {
    ElementOps<X, T, D> ops{};
    ops.kept = kept_reals<Material, D>;
    ops.locate = &locate_vertices<X, T, D>;
    ops.volumes = &find_volumes<Material, X, T, D>;
    ops.forces = &find_forces<Material, X, T, D>;
    ops.spread = &spread_vertices<X, T, D>;
    ops.fill = &fill_nodes<X, T, D>;
    ops.energies = &element_energies<Material, X, T, D>;
    ops.see = &see_element<Material, T, D>;
    return ops;
}

}  // namespace mpm::cuda
