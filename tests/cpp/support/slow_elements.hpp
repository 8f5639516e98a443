// Bodies of elements on the device that is none (slow_device.hpp), as kernels/cuda/elements.cuh has
// them: vertices one by one, sums as integers.
#pragma once

#include "mpm/kernels/element_passes.hpp"
#include "mpm/physics/material/fixed_corotated.hpp"
#include "mpm/physics/material/von_mises.hpp"
#include "support/slow_phases.hpp"

namespace mpm::test {

template <int D>
void add_slowly(const SlowPhase<D>& phase, std::int32_t block, int channel, int node, double x) {
    const auto& g = phase.pass.grid;
    g.sums[(std::int64_t(block) * g.sum_channels + channel) * block_cells + node] +=
        std::int32_t(std::lrint(float(x)));
}

/// `Splines`: of plain quadratic ones, whose nodes need no loop.
template <int W, bool Splines, int D>
void spread_vertices_slowly(const SlowPhase<D>& phase, const ElementsView<float, D>& mesh) {
    const auto& pass = phase.pass;
    const SpreadTargets<D> to(phase.n, phase.part, pass.group);
    pass.exec->for_each(pass.body.count, PushVertices<SlowDevice, float, D>{pass, mesh});
    for_each_of_phase<D>(phase, true, [&](int, std::int32_t slot, const int(&home)[D], auto q) {
        report_inverted<SlowDevice>(pass, mesh, q);
        const std::int32_t* neighbours =
            pass.grid.table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
        const auto reached = reach<W, Splines>(phase, slot, home, q);
        Vec<float, D> push;
        for (int a = 0; a < D; ++a) push[a] = mesh.push[a * mesh.vertices + q];
        const double size = double(vertex_deposit(phase, q, push));
        if (!(size <= pass.deposited[momentum_sum])) pass.deposited[momentum_sum] = size;
        spread_vertex<NodesOf<Splines>>(
            phase, reached, places_in_grid<W>(reached.at.cell), q, push,
            [&](int channel, int place, float amount) {
                const auto kind = spread_channel<D>(phase.n, phase.part, channel).kind;
                const double scale =
                    pass.body.particle_mass *
                    pass.clock->scale_write[kind == SpreadChannel::mass ? mass_sum : momentum_sum];
                add_slowly(phase, neighbours[place >> 8], to.sum[channel], place & 255,
                           pass.body.state[0][q] * amount * float(scale));
            });
    });
    if (phase.turns) arrive(pass, pass.body.homes);
}

template <class Material, int D>
ElementOps<SlowDevice, float, D> slow_element_ops() {
    using Mesh = ElementsView<float, D>;
    ElementOps<SlowDevice, float, D> ops{};
    ops.kept = kept_reals<Material, D>;
    ops.locate = [](const Pass<SlowDevice, float, D>& pass, const Mesh& mesh, bool at_rest) {
        SlowPhase<D> phase{};
        phase.pass = pass;
        for_each_of_phase<D>(phase, true, [&](int, std::int32_t slot, const int(&home)[D], auto q) {
            std::int32_t cell[D];
            for (int a = 0; a < D; ++a)
                cell[a] = pass.grid.table.corners[std::int64_t(slot) * D + a] + home[a];
            if (at_rest) rest_vertex(mesh, pass.body, cell, q);
            locate_vertex(mesh, pass.body, cell, q);
        });
    };
    ops.volumes = &find_volumes<Material, SlowDevice, float, D>;
    ops.forces = &find_forces<Material, SlowDevice, float, D>;
    ops.spread = [](const SlowPhase<D>& phase, const Mesh& mesh) {
        if (idle(phase)) return;
        const KernelChoice& choice = phase.n.kernel;
        if (of_splines(choice))
            spread_vertices_slowly<3, true>(phase, mesh);
        else if (kernel_width(choice.kernel) == 3)
            spread_vertices_slowly<3, false>(phase, mesh);
        else
            spread_vertices_slowly<5, false>(phase, mesh);
    };
    ops.fill = [](const SlowPhase<D>& phase, const Mesh& mesh, const std::uint8_t* near,
                  int channel) {
        if (idle(phase)) return;
        const auto& pass = phase.pass;
        for_each_of_phase<D>(phase, true, [&](int, std::int32_t slot, const int(&home)[D], auto q) {
            if (!near[slot]) return;
            const std::int32_t* neighbours =
                pass.grid.table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
            for_each_filling(
                pass, mesh, slot, home, q,
                [&](const int(&cell)[D], const Stencil<float, D, 3>& s, float mass) {
                    for_each_node(s, places_in_grid<3>(cell), [&](const auto&, int place, float w) {
                        add_slowly(phase, neighbours[place >> 8], channel, place & 255,
                                   mass * w * float(pass.clock->scale_write[mass_sum]));
                    });
                });
        });
    };
    ops.energies = [](const SlowPhase<D>& phase, const Mesh& mesh, const std::int32_t* due,
                      double* energy, double* partial) {
        if (!*due) return;
        const auto& pass = phase.pass;
        const auto k = Material::template constants<double>(pass.parameters);
        for (std::int64_t n = 0; n < mesh.pushed.count; ++n) {
            const std::int64_t e = mesh.pushed[n];
            energy[e] = see_element<Material>(mesh, e, pass.parameters, k).own_energy / (D + 1);
        }
        std::fill_n(partial, 3 * pass.body.homes, 0.0);
        for_each_of_phase<D>(
            phase, false, [&](int h, std::int32_t slot, const int(&home)[D], auto q) {
                double sum[3] = {};
                add_vertex_energies<Material>(phase, mesh, k, slot, home, q, energy, sum);
                for (int n = 0; n < 3; ++n) partial[3 * h + n] += sum[n];
            });
    };
    ops.see = &see_element<Material, float, D>;
    return ops;
}

template <int D>
ElementOps<SlowDevice, float, D> slow_element_ops_of(const std::string& name) {
    if (name == FixedCorotated::name) return slow_element_ops<FixedCorotated, D>();
    if (name == VonMises::name) return slow_element_ops<VonMises, D>();
    throw Error("the slow device has no elements of " + name);
}
template <int D>
BodyOps<SlowDevice, float, D> slow_vertex_ops() {
    BodyOps<SlowDevice, float, D> ops{};
    add_slow_phases<VertexCarrier, Smoothing::none, D>(ops);
    describe_instance<VertexCarrier, Smoothing::none>(ops);
    return ops;
}

}  // namespace mpm::test

namespace mpm {

template <>
inline ElementOps<SlowDevice, float, 2> element_ops<SlowDevice, float, 2>(const std::string& name) {
    return test::slow_element_ops_of<2>(name);
}
template <>
inline ElementOps<SlowDevice, float, 3> element_ops<SlowDevice, float, 3>(const std::string& name) {
    return test::slow_element_ops_of<3>(name);
}
template <>
inline BodyOps<SlowDevice, float, 2> vertex_ops<SlowDevice, float, 2>() {
    return test::slow_vertex_ops<2>();
}
template <>
inline BodyOps<SlowDevice, float, 3> vertex_ops<SlowDevice, float, 3>() {
    return test::slow_vertex_ops<3>();
}

}  // namespace mpm
