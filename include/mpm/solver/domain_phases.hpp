// Domain: the phased step, and the sweeps over the grid of XPIC and FMPM.
#pragma once

#include "mpm/solver/domain.hpp"

namespace mpm {

template <class X, class T, int D>
Phase<X, T, D> Domain<X, T, D>::phase(Body& body, int number, int parity_to) {
    Phase<X, T, D> p{};
    p.pass = pass(body, number, parity_to);
    p.n = body.plan.phase;
    if (stresses_apart()) p.masses = sums_[parity()].data();
    return p;
}

template <class X, class T, int D>
void Domain<X, T, D>::reserve_scratch(Body& body) {
    const std::size_t columns = std::size_t(scratch_columns(D, body.plan.phase));
    body.scratch.reserve_discard(columns * body.count + column_padding);
}

/// Nodal velocities from the sums, swept where the transfer asks for it, then `decided`.
template <class X, class T, int D>
template <class Decided>
void Domain<X, T, D>::make_velocities(const Decided& decided) {
    const auto node = node_update(parity());
    if (uplift_.any()) {
        uplift_.find(node, boundaries_);
        uplift_.raise(node, boundaries_);
    }
    if (boundaries_.lists()) move_wall_nodes();
    constexpr bool host = !X::is_device;
    if (boundaries_.has_mirrors())
        make_velocities_with<true, false>(decided);  // lists no nodes
    else if (host && boundaries_.lists())
        make_velocities_with<false, host>(decided);
    else
        make_velocities_with<false, false>(decided);
    if (uplift_.any()) uplift_.lower(node, boundaries_);
}

template <class X, class T, int D>
void Domain<X, T, D>::move_wall_nodes() {
    const auto node = node_update(parity());
    const auto& b = boundaries_;
    const WallNodes<Grid, D> to = wall_nodes();
    const auto move = [&]<WallPass pass>() {
        const auto& nodes = b.nodes_of(pass);
        exec_.for_each_next(std::int64_t(nodes.size()),
                            MoveWallNodes<Grid, Sum, D, pass>{node, b.blocks().data(), nodes.data(),
                                                              b.known(), to});
    };
    if constexpr (X::is_device) move.template operator()<WallPass::lines>();
    move.template operator()<WallPass::held>();
    const auto& all = b.nodes_of(WallPass::all);
    exec_.for_each_next(
        std::int64_t(all.size()),
        SeatWallNodes<Grid, Sum, D>{node, b.blocks().data(), all.data(), b.known(), to.seat});
    move.template operator()<WallPass::all>();
}

template <class X, class T, int D>
template <bool mirrors, bool lines, class Decided>
void Domain<X, T, D>::make_velocities_with(const Decided& decided) {
    const std::int64_t all = std::int64_t(table_.slots) * block_cells;
    const std::int64_t nodes = all + (lines ? wall_nodes().lined_count : 0);
    const bool sweeps = plan_.sweep.residual > 0;
    const auto update = [&](const auto& then) {
        if (plan_.kept.any())
            exec_.template max_each<maxima_count>(
                nodes, grid_update<true, mirrors, lines>(parity()), then);
        else
            exec_.template max_each<maxima_count>(
                nodes, grid_update<false, mirrors, lines>(parity()), then);
    };
    if constexpr (X::is_device) {
        if (contact_blocks_ > 0) {
            update(AfterGrid<D>::keeping(grid_maxima_.data()));
            resolve_contacts(grid_maxima_.data(), decided);
            return;
        }
    } else if (contact_blocks_ > 0 || rigid_.any()) {
        update([&](const double* maxima) {
            resolve_contacts(maxima, [&](const double* all) {
                double found[maxima_count];
                for (int m = 0; m < maxima_count; ++m) found[m] = all[m];
                if (rigid_.any()) resolve_rigid(found);
                decided(static_cast<const double*>(found));
            });
        });
        return;
    }
    if (!sweeps) {
        update(decided);
    } else {
        exec_.template max_each<maxima_count>(nodes, grid_update<true, mirrors, lines>(parity()),
                                              NothingAfter{});
        sweep_grid();
        exec_.template max_each<maxima_count>(
            all, FinishSweep<Grid, Sum, D>{node_update(parity()), plan_.sweep}, decided);
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::sweep_grid() {
    const std::int64_t nodes = std::int64_t(table_.slots) * block_cells;
    const SweepChannels& channels = plan_.sweep;
    Clock* clock = clock_buffer_.data();
    if constexpr (!X::is_device) {
        if (!channels.due(*clock)) return;
    }
    int bits = 0;
    if constexpr (std::is_integral_v<Sum>) bits = X::template sum_bits<T>;
    const SetSweepScale set_scale{clock, bits, tell_ranks()};
    // Where all devices have told it is made.
    const auto set_together = [&] {
        if constexpr (X::is_device) {
            if (!share_) return;
            share_told(told_);
            exec_.single(SetSweepScaleOfAll{set_scale, told_.data(), share_->ranks()});
        }
    };
    exec_.template max_each<maxima_count>(
        nodes, BeginSweep<Grid, Sum, D>{node_update(parity()), channels}, set_scale);
    set_together();
    for (int k = 0; k < plan_.sweeps; ++k) {
        for (std::size_t b = 0; b < bodies_.size(); ++b) {
            if (bodies_[b].homes == 0) continue;
            reserve_scratch(bodies_[b]);
            Phase<X, T, D> p = phase(bodies_[b], int(b), 1 - parity());
            p.part = Part::vectors;
            p.source = channels.residual;
            phase_ops_.collect(p);
            phase_ops_.spread(p);
        }
        complete_sums();
        exec_.template max_each<maxima_count>(
            nodes,
            AdvanceSweep<Grid, Sum, D>{node_update(parity()), sums_[1 - parity()].data(), channels},
            set_scale);
        set_together();
    }
}

/// Room for what a body's particles add to cells.
template <class X, class T, int D>
CellRoom Domain<X, T, D>::cell_room(const Body& body, PeersOfBody* peers) {
    const std::int32_t slots = table_.slots + (peers ? share_->staged : 0);
    cells_.reserve_discard(cell_numbers<D>(body.plan.cells) * std::size_t(slots) * block_cells);
    if (!peers) return {cells_.data()};
    const std::int32_t* staged = share_->staged_of.data() + peers->body;
    return {cells_.data(), peers, table_.slots + staged[0], table_.slots + staged[1]};
}

/// CPUs: rates as the body assumes them, and its state smoothed. A call that adds energy is a
/// fault.
template <class X, class T, int D>
void Domain<X, T, D>::after_collect(Body& body, int number, const Phase<X, T, D>& phase) {
    if constexpr (!X::is_device) {
        const CellNumbers& n = body.plan.cells;
        Clock& clock = *clock_buffer_.data();
        if (clock.halt != Halt::none) return;
        PeersOfBody peers{*this, std::size_t(number)};
        const CellRoom room = cell_room(body, share_ ? &peers : nullptr);
        if (n.changes_rates()) cell_ops<X, T, D>().collected(phase, n, room);
        if (!n.smooths()) return;
        const SmoothingEnergy e = cell_ops<X, T, D>().smooth(phase, n, room);
        if (!e.any) return;
        body.smoothing.add(clock.time, e.before, e.change(), e.index());
        if (e.sound(sizeof(T) == 4 ? 1e-6 : 1e-12)) return;
        clock.halt = Halt::fault;
        clock.fault = FaultKind::smoothing;
        clock.fault_particle = fault_number(std::uint64_t(number), 0);
        clock.fault_value = e.change() / e.before;
    }
}

/// Devices: room for what smoothing of a body adds up, and who adds it.
template <class X, class T, int D>
std::int32_t Domain<X, T, D>::reserve_smoothing(Body& body) {
    if (smoothing_logs_.size() != bodies_.size())
        smoothing_logs_.assign(std::vector<SmoothingLog>(bodies_.size()));
    const auto parts = std::int32_t(exec_.sum_parts(body.homes));
    if (body.smoothing_homes != body.homes) {
        body.smoothing_homes = body.homes;
        body.smoothing_set.assign({SumSet{0, body.homes, 0, parts}});
    }
    smoothing_energies_.reserve_discard(std::size_t(body.homes + parts) * smoothing_sums);
    cell_room(body);
    return parts;
}

/// Devices: the state smoothed, where nothing is asked between steps: what a call did waits there.
template <class X, class T, int D>
void Domain<X, T, D>::smooth_on_device(Body& body, int number, const Phase<X, T, D>& phase) {
    static_assert(SmoothingLog::size >= X::batch);
    const CellNumbers& n = body.plan.cells;
    const std::int32_t parts = reserve_smoothing(body);
    SmoothingLog* log = smoothing_logs_.data() + number;
    CellTask<D> task{};
    task.choice = n.smoothing;
    task.count = std::int64_t(table_.slots) * block_cells;
    task.cells =
        CellColumns<D>::by_column(cell_room(body).cells, n.smoothing, n.components, task.count);
    task.summed = summed_columns(body);
    task.scale = CellScale::of(body.count_of_all);
    task.between = spans_lie_between_nodes(body.plan.phase.kernel.kernel);
    task.energies = smoothing_energies_.data();
    task.beyond = &log->beyond;
    CellsOfDevices peers{*this};
    smooth_cells<X, T, D>()(phase, task, share_ ? &peers : nullptr);
    const TakeSmoothing take =
        TakeSmoothing::of(clock_buffer_.data(), log, body.particle_mass, body.count_of_all,
                          sizeof(T) == 4, n.smoothing, std::uint64_t(number), tell_ranks());
    exec_.template sum_each<smoothing_sums>(
        SumSets{body.smoothing_set.data(), 1, parts}, AddSmoothing{task.energies}, take,
        smoothing_energies_.data() + std::size_t(body.homes) * smoothing_sums, 0, Nothing{});
    if (!share_) return;
    share_told(told_);
    exec_.single(TakeSmoothingOfAll{take, told_.data(), share_->ranks(), fault_elsewhere});
}

/// Numbers that each cell, or node, sums up of a body on devices.
template <class X, class T, int D>
int Domain<X, T, D>::summed_columns(const Body& body) {
    const CellNumbers& n = body.plan.cells;
    return CellColumns<D>::sums(n.smoothing, n.components);
}

/// What calls did since the last look.
template <class X, class T, int D>
void Domain<X, T, D>::collect_smoothing() {
    if (smoothing_logs_.size() == 0) return;
    const std::vector<SmoothingLog> logs = smoothing_logs_.host();
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        std::int64_t& seen = bodies_[b].smoothing_seen;
        for (; seen < logs[b].calls; ++seen) {
            const auto& call = logs[b].call[seen % SmoothingLog::size];
            bodies_[b].smoothing.add(call.time, call.before, call.change, call.index);
        }
    }
}

/// What is deposited: stresses as the body assumes them, and what else pushes it.
template <class X, class T, int D>
void Domain<X, T, D>::after_respond(Body& body, const Phase<X, T, D>& phase) {
    if constexpr (!X::is_device) {
        const CellNumbers& n = body.plan.cells;
        if (!n.changes_deposits() || clock_buffer_.data()->halt != Halt::none) return;
        PeersOfBody peers{*this, std::size_t(phase.pass.body_number)};
        cell_ops<X, T, D>().responded(phase, n, cell_room(body, share_ ? &peers : nullptr));
    }
}

/// Whether a rank without particles of a body has a part in its step.
template <class X, class T, int D>
bool Domain<X, T, D>::meets_over_cells(const Body& body) const {
    return !X::is_device && share_ &&
           body.plan.cells.sums_over_cells(body.plan.phase.velocity >= 0);
}

/// Sums that a step reads itself, as all ranks have added to them.
template <class X, class T, int D>
void Domain<X, T, D>::complete_sums() {
    if (!share_) return;
    if constexpr (X::is_device) {
        share_sums();
        // All have read what is packed, before anyone packs again.
        if (reaches()) meeting_->meet();
    } else {
        end_of_sums(1 - parity(), Added::in_step);
    }
}

/// What phased bodies find at the nodes, and what smoothing over cells makes of the state: before
/// any body is spread, because a fault here halts the clock, and not in the middle of a turn.
template <class X, class T, int D>
void Domain<X, T, D>::collect_bodies(const std::vector<std::size_t>& moving) {
    std::vector<std::size_t> phased, split;
    for (std::size_t b : moving) {
        if (bodies_[b].plan.pipeline != Pipeline::phased || bodies_[b].rigid >= 0) continue;
        phased.push_back(b);
        if (bodies_[b].plan.group.split) split.push_back(b);
    }
    const auto make = [&](std::size_t b) { return phase(bodies_[b], int(b), 1 - parity()); };
    for (std::size_t b : phased) phase_ops_.collect(make(b));
    if (splits()) {
        for (std::size_t b : split) {
            Phase<X, T, D> p = make(b);
            p.part = Part::averages;
            bodies_[b].ops.project(p);
            phase_ops_.spread(p);
        }
        complete_sums();
        exec_.for_each(
            std::int64_t(table_.slots) * block_cells,
            AverageVolumes<Grid, Sum, D>{node_update(parity()), sums_[1 - parity()].data(),
                                         groups_.data(), int(plan_.groups.size())});
        for (std::size_t b : split) phase_ops_.collect(make(b));
    }
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        if constexpr (X::is_device) {
            // A rank without its particles has a part in what cells sum up, unless nobody has any.
            if (body.plan.cells.smooths() && body.count_of_all > 0)
                smooth_on_device(body, int(b), make(b));
        } else if (body.homes > 0 || meets_over_cells(body)) {
            if (body.plan.pipeline == Pipeline::phased && body.rigid < 0)
                after_collect(body, int(b), make(b));
        }
    }
}

/// What is left in scratch, once all masses are in the sums that it goes to.
template <class X, class T, int D>
void Domain<X, T, D>::deposit_stresses(Body& body, int number, int to) {
    if (!stresses_apart()) return;
    Phase<X, T, D> p = phase(body, number, to);
    p.part = Part::stresses;
    p.masses = sums_[to].data();
    phase_ops_.spread(p);
}

}  // namespace mpm
