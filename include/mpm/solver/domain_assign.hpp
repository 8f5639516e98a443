// Domain: particles that are given other velocities or states at the boundary of a step.
//
// Between steps the state is particles and nodal sums, to which they have added momentum, stress
// and volumes already. What a particle adds is linear in its velocity and is known from its state,
// so what it adds at rest with the state it had is taken out of the sums, and what it adds with the
// change of its velocity and its new state put in:
//
//   s <- s + (P(dv, new) - P(0, old))
//
// All else in the sums (affine parts, viscous stress, other bodies) stays. Momentum grows by
// m dv to rounding; a state has the stress for the step to come that it would have deposited.
#pragma once

#include "mpm/solver/domain.hpp"

namespace mpm {

/// Where each of the given rows is stored. Raises `SceneError` for ids that the body has not.
inline std::vector<std::uint32_t> places_of(const std::vector<std::uint64_t>& wanted,
                                            const std::vector<std::uint32_t>& stored,
                                            std::uint64_t first_id, const std::string& who) {
    constexpr std::uint32_t none = ~std::uint32_t(0);
    std::uint32_t most = 0;
    for (std::uint32_t id : stored) most = std::max(most, id);
    std::vector<std::uint32_t> place(stored.empty() ? 0 : std::size_t(most) + 1, none), out;
    for (std::size_t q = 0; q < stored.size(); ++q) place[stored[q]] = std::uint32_t(q);
    for (std::uint64_t id : wanted) {
        const std::uint64_t own = id - first_id;
        if (own >= place.size() || place[own] == none)
            throw SceneError(who + ": there is no moving particle of id " + std::to_string(id) +
                             ", or it is given twice; give ids that the body has, each once");
        out.push_back(std::exchange(place[own], none));
    }
    return out;
}

template <class X, class T, int D>
void Domain<X, T, D>::assign(const Assignment& given) {
    Body& body = bodies_.at(std::size_t(given.body));
    const std::string who = "particles of body '" + body.plan.name + "'";
    if (dead_)
        throw NumericalError(who +
                             " are given values in a run that has failed; resume it from a "
                             "checkpoint");
    if (share_)
        throw SceneError(who +
                         " are given values in a scene that several ranks share, which is "
                         "not built; run it on one device");
    if (body.plan.cells.smooths())
        throw SceneError(who +
                         " are given values, but are smoothed over cells, whose history "
                         "would not know; leave the body's smoothing out");
    fetch_clock();
    if (clock_.fault_particle != no_fault)
        throw NumericalError(who +
                             " are given values, but a particle has become unusable in the "
                             "last step; the next step will describe it");
    velocities_made_ = velocities_wait_ = false;
    const std::size_t n = given.id.size(), width = std::size_t(given.width);
    const bool states = !given.state.empty() || !given.pressure.empty();
    const bool two = body.plan.smoothing == Smoothing::two_volumes;
    if (body.rigid >= 0)
        throw SceneError(who +
                         " are given values, but are of a rigid body, which moves as a whole; "
                         "that is not built");
    if (states && body.mesh)
        throw SceneError(who +
                         " are given a state, but are vertices of elements, whose strain follows "
                         "from where they are; give them a change of velocity alone");
    if (!given.state.empty() && two)
        throw SceneError(who +
                         " are given a state, but F-bar keeps a second volume of theirs "
                         "that would contradict it; give the body no FBar of this form");
    if (!given.pressure.empty() && !body.material->volume_from_pressure)
        throw SceneError(who + " are given a pressure, which is for fluids; give a state");
    if (width > std::size_t(body.material->reals(D)) || given.state.size() != n * width ||
        (!given.change.empty() && given.change.size() != n * D) ||
        (!given.pressure.empty() && given.pressure.size() != n))
        throw SceneError(who + " are given rows that do not fit their ids");
    const auto id = body.id.host(body.count);
    const std::vector<std::uint32_t> place = places_of(given.id, id, body.first_id, who);

    double fastest = 0;
    for (std::size_t k = 0; k < given.change.size(); k += D) {
        double square = 0;
        for (std::size_t a = 0; a < D; ++a) square += given.change[k + a] * given.change[k + a];
        fastest = std::max(fastest, std::sqrt(square));
    }
    const double cells = (clock_.speed + fastest) * clock_.dt / spec_.cell_size;
    if (!given.change.empty() && !(cells <= 0.5))
        throw SceneError(who + ": a change of velocity by " + std::to_string(fastest) +
                         " m/s would take them through " + std::to_string(cells) +
                         " cells in the next step; at most 0.5 may be; change it in smaller "
                         "parts, or give the simulation a shorter time_step");

    // Their columns with what is given, and whether the law has a meaning there.
    std::vector<std::vector<T>> column;
    for (const auto& c : body.state) column.push_back(c.host(body.count));
    std::vector<double> own(column.size());
    const double still[D][D] = {};
    for (std::size_t k = 0; k < n; ++k) {
        const std::uint32_t q = place[k];
        for (std::size_t r = 0; r < width; ++r) column[r][q] = T(given.state[k * width + r]);
        if (!given.pressure.empty())
            for (std::size_t r = 0; r < (two ? 2u : 1u); ++r)
                column[r][q] = T(
                    body.material->volume_from_pressure(given.pressure[k], body.parameters.data()));
        for (std::size_t a = 0; a < D && body.plan.phase.velocity >= 0; ++a)
            if (!given.change.empty())
                column[std::size_t(body.plan.phase.velocity) + a][q] += T(given.change[k * D + a]);
        if (!states) continue;
        for (std::size_t r = 0; r < own.size(); ++r) own[r] = double(column[r][q]);
        const auto seen = body.ops.observe(own.data(), still, body.parameters.data());
        if (!(seen.volume_ratio > 0) || !std::isfinite(seen.pressure + seen.volume_ratio))
            throw SceneError(who + ": the state given to id " + std::to_string(given.id[k]) +
                             " has the volume ratio " + std::to_string(seen.volume_ratio) +
                             " and the pressure " + std::to_string(seen.pressure) +
                             " Pa; give one that " + std::string(body.material->name) +
                             " can have");
    }

    // All of this body at rest as it was; then with the changes.
    const Clock kept = clock_;
    clock_.halt = Halt::none;
    const std::size_t numbers =
        std::size_t(table_.slots) * std::size_t(plan_.sum_channels) * block_cells;
    std::vector<double> sums = sums_as_numbers(sums_[parity()].host(numbers));
    Spec alone;
    alone.bodies.resize(bodies_.size());
    BodySpec& rows = alone.bodies[std::size_t(given.body)];
    const auto chosen = [&](const BodySpec& b) { return &b == &rows; };
    const auto deposited = [&] {
        deposit(alone, chosen, kept.dt);
        return sums_as_numbers(sums_[parity()].host(numbers));
    };
    const auto write = [&](const std::vector<std::vector<T>>& from) {
        for (std::size_t r = 0; r < from.size(); ++r)
            exec_.upload(body.state[r].data(), from[r].data(), from[r].size() * sizeof(T));
    };
    rows.velocity.assign(D, 0.0);
    const std::vector<double> old = deposited();
    write(column);
    if (!given.change.empty()) {
        const std::uint32_t most = *std::max_element(id.begin(), id.end());
        rows.velocity.assign((std::size_t(most) + 1) * D, 0.0);
        for (std::size_t k = 0; k < n; ++k)
            for (std::size_t a = 0; a < D; ++a)
                rows.velocity[std::size_t(given.id[k] - body.first_id) * D + a] =
                    given.change[k * D + a];
    }
    const std::vector<double> now = deposited();
    // Where nothing has changed both are the same bits.
    for (std::size_t k = 0; k < numbers; ++k) sums[k] += now[k] - old[k];
    write(column);  // the deposits took what they were given for the velocities that are stored
    adopt_sums(sums);
    const Clock scaled = clock_;
    clock_ = kept;
    for (int q = 0; q < quantities; ++q) {
        clock_.unit_read[q] = scaled.unit_read[q];
        clock_.scale_write[q] = scaled.scale_write[q];
        clock_.deposited[q] = scaled.deposited[q];
        clock_.deposited_before[q] = scaled.deposited_before[q];
        clock_.deposit_limit[q] = scaled.deposit_limit[q];
    }
    clock_.numbers_dt = -1;
    push_clock();
    exec_.wait();
}

}  // namespace mpm
