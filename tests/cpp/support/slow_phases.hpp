// The phased step on the device that is none (slow_device.hpp), as src/kernels/cuda/phases.cu and
// cell_phases.cu do it: particles one by one, sums as integers.
#pragma once

#include <cmath>

#include "mpm/kernels/cell_sums.hpp"
#include "mpm/kernels/phase_ops.hpp"
#include "mpm/kernels/respond.hpp"
#include "mpm/kernels/transfers.hpp"
#include "support/slow_device.hpp"
#include "support/slow_engine.hpp"

namespace mpm::test {

template <int D>
using SlowPhase = Phase<SlowDevice, float, D>;

/// Calls f(home number, slot, home cell, particle), the last particle first if asked.
template <int D, class F>
void for_each_of_phase(const SlowPhase<D>& phase, bool backwards, const F& f) {
    const auto& body = phase.pass.body;
    for (std::int32_t k = 0; k < body.homes; ++k) {
        const std::int32_t h = backwards ? body.homes - 1 - k : k, slot = body.home[h];
        const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
        const std::uint32_t n = start[block_cells] - start[0];
        for (std::uint32_t j = 0; j < n; ++j) {
            const std::uint32_t q = start[0] + (backwards ? n - 1 - j : j);
            int home[D];
            Block<D>::coordinates(body.cell[q], home);
            f(h, slot, home, q);
        }
    }
}

template <int W, int D>
void collect_slowly(const SlowPhase<D>& phase) {
    const auto& g = phase.pass.grid;
    for_each_of_phase<D>(phase, false, [&](int, std::int32_t slot, const int(&home)[D], auto q) {
        const std::int32_t* neighbours =
            g.table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
        const Reached<W, SlowDevice, float, D> reached(phase, slot, home, q);
        collect_particle(phase, reached, places_in_grid<W>(reached.at.cell), q, [&](int place) {
            return g.velocity + g.velocity_place(neighbours[place >> 8], place & 255);
        });
    });
}

template <int W, int D>
void spread_slowly(const SlowPhase<D>& phase) {
    const auto& pass = phase.pass;
    const auto& g = pass.grid;
    const SpreadTargets<D> to(phase.n, phase.part, pass.group);
    for_each_of_phase<D>(phase, true, [&](int, std::int32_t slot, const int(&home)[D], auto q) {
        const std::int32_t* neighbours =
            g.table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
        const Reached<W, SlowDevice, float, D> reached(phase, slot, home, q);
        const auto add = [&](int channel, int place, float amount) {
            const auto kind = spread_channel<D>(phase.n, phase.part, channel).kind;
            const double scale =
                pass.body.particle_mass *
                (phase.part == Part::vectors
                     ? pass.clock->sweep_scale
                     : pass.clock->scale_write[kind == SpreadChannel::mass      ? mass_sum
                                               : kind == SpreadChannel::average ? group_sum
                                                                                : momentum_sum]);
            const auto x = std::int32_t(std::lrint(amount * float(scale)));
            std::int32_t* sums =
                g.sums + std::int64_t(neighbours[place >> 8]) * g.sum_channels * block_cells +
                (place & 255);
            sums[to.sum[channel] * block_cells] += x;
            if (phase.part == Part::step && channel == to.channels - 1 && pass.group.weight >= 0)
                sums[pass.group.weight * block_cells] += x;
        };
        spread_particle(phase, reached, places_in_grid<W>(reached.at.cell), q, add);
    });
    if (phase.part != Part::step || !phase.turns) return;
    arrive(pass, pass.body.homes);
}

template <int D>
PhaseOps<SlowDevice, float, D> slow_phase_ops() {
    return {
        [](const SlowPhase<D>& p) {
            if (!idle(p))
                kernel_width(p.n.kernel.kernel) == 3 ? collect_slowly<3>(p) : collect_slowly<5>(p);
        },
        [](const SlowPhase<D>& p) {
            if (!idle(p))
                kernel_width(p.n.kernel.kernel) == 3 ? spread_slowly<3>(p) : spread_slowly<5>(p);
        }};
}

template <int D>
void add_at(const CellTask<D>& task, int column, std::int64_t c, std::int64_t x) {
    SlowDevice::add_integer(reinterpret_cast<std::int64_t*>(&task.cells.at(column, c)), x);
}

template <int W, int D>
void smooth_slowly(const SlowPhase<D>& phase, const CellTask<D>& task, CellPeers* peers) {
    const std::int32_t* neighbours = phase.pass.grid.table.neighbours;
    const auto add = [&] {
        if (idle(phase)) return;
        for_each_of_phase<D>(
            phase, cells_backwards, [&](int, std::int32_t slot, const int(&home)[D], auto q) {
                if (!task.nodal()) {
                    add_to_cells(phase, task, slot, home, q,
                                 [&](int column, std::int64_t c, std::int64_t x) {
                                     add_at(task, column, c, x);
                                 });
                    return;
                }
                const Reached<W, SlowDevice, float, D> reached(phase, slot, home, q);
                add_to_nodes(phase, task, reached, places_in_grid<W>(reached.at.cell), q,
                             [&](int column, int place, std::int64_t x) {
                                 add_at(task, column, cell_number<D>(neighbours, slot, place), x);
                             });
            });
    };
    const auto value = [&] {
        if (idle(phase)) return;
        std::fill_n(task.energies, std::size_t(phase.pass.body.homes) * smoothing_sums, 0.0);
        for_each_of_phase<D>(
            phase, false, [&](int h, std::int32_t slot, const int(&home)[D], auto q) {
                double sum[smoothing_sums] = {};
                if (!task.nodal()) {
                    value_of_cells(phase, task, slot, home, q, sum);
                } else {
                    const Reached<W, SlowDevice, float, D> reached(phase, slot, home, q);
                    value_of_nodes(phase, task, reached, slot, q, sum);
                }
                for (int k = 0; k < smoothing_sums; ++k)
                    task.energies[h * smoothing_sums + k] += sum[k];
            });
    };
    smooth_with_sums(phase, task, peers, add, value);
}

/// The largest deposit, and who is no longer sound.
template <int D>
void tell(const Pass<SlowDevice, float, D>& pass, const Responded<float>& found, std::uint32_t q) {
    const auto larger = [&](int quantity, float x) {
        if (!(double(x) <= pass.deposited[quantity])) pass.deposited[quantity] = double(x);
    };
    if (!found.sound)
        return SlowDevice::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
    larger(momentum_sum, found.momentum);
    larger(group_sum, found.average);
    if (found.far) *pass.strays = ~std::uint64_t(0);
}

template <class Material, Smoothing S, int D>
void add_slow_phases(BodyOps<SlowDevice, float, D>& ops) {
    ops.respond = [](const SlowPhase<D>& phase) {
        if (phase.pass.clock->halt != Halt::none) return;
        const auto numbers = phase_numbers<Material>(
            phase, Material::template constants<float>(phase.pass.parameters));
        const bool due = phase.n.sweeps && phase.pass.clock->step % phase.n.every == 0;
        for (std::uint32_t q = 0; q < phase.pass.body.count; ++q)
            tell(phase.pass, respond_particle<Material, S>(phase, numbers, due, q), q);
    };
    ops.rest = [](const SlowPhase<D>& phase) {
        const auto numbers = phase_numbers<Material>(
            phase, Material::template constants<float>(phase.pass.parameters));
        for (std::uint32_t q = 0; q < phase.pass.body.count; ++q)
            tell(phase.pass, rest_particle<Material, S>(phase, numbers, q), q);
    };
    if constexpr (S == Smoothing::two_volumes) {
        ops.project = [](const SlowPhase<D>& phase) {
            if (phase.pass.clock->halt != Halt::none) return;
            const auto numbers = phase_numbers<Material>(
                phase, Material::template constants<float>(phase.pass.parameters));
            for (std::uint32_t q = 0; q < phase.pass.body.count; ++q) {
                const float j = project_particle<Material, S>(phase, numbers, q);
                double& most = phase.pass.deposited[group_sum];
                most = std::max(most, double(std::abs(j)));
            }
        };
        ops.adopt = &adopt_volume<Material, D>;
    }
    ops.phase_energies = [](const SlowPhase<D>& phase, const std::int32_t*, double* partial) {
        std::fill_n(partial, 3 * phase.pass.body.homes, 1.0);
    };
}

}  // namespace mpm::test

namespace mpm {

template <>
inline PhaseOps<SlowDevice, float, 2> phase_ops<SlowDevice, float, 2>() {
    return test::slow_phase_ops<2>();
}
template <>
inline PhaseOps<SlowDevice, float, 3> phase_ops<SlowDevice, float, 3>() {
    return test::slow_phase_ops<3>();
}
template <int D>
SmoothCells<SlowDevice, float, D> smooth_slowly() {
    return [](const test::SlowPhase<D>& p, const CellTask<D>& task, CellPeers* peers) {
        kernel_width(p.n.kernel.kernel) == 3 ? test::smooth_slowly<3>(p, task, peers)
                                             : test::smooth_slowly<5>(p, task, peers);
    };
}
template <>
inline SmoothCells<SlowDevice, float, 2> smooth_cells<SlowDevice, float, 2>() {
    return smooth_slowly<2>();
}
template <>
inline SmoothCells<SlowDevice, float, 3> smooth_cells<SlowDevice, float, 3>() {
    return smooth_slowly<3>();
}

}  // namespace mpm
