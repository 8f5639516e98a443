// Domain: the whole state, out and in. Order, home cells, drift and the sensors' accumulators are
// part of it, so that a resumed run continues bit for bit on the same backend.
#pragma once

#include <numeric>

#include "mpm/solver/blob.hpp"
#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_scene.hpp"
#include "mpm/solver/saved_clock.hpp"
#include "mpm/solver/saved_state.hpp"
#include "mpm/solver/state_check.hpp"

namespace mpm {

/// Where the particles of a body are stored, cell by cell and in each cell by rank: the order of a
/// saved state. Empty where particles are stored so. `cell`: home byte at each place.
template <class X, class T, int D>
std::vector<std::uint32_t> Domain<X, T, D>::cell_by_cell(const Body& body,
                                                         std::vector<std::uint8_t>* cell) const {
    if constexpr (!X::is_device) return {};
    const std::size_t cells = std::size_t(table_.slots) * block_cells;
    const auto start = body.cell_start.host(cells + 1);
    std::vector<std::uint32_t> places(body.count);
    if (cell) cell->assign(body.count + column_padding, 0);
    place_homes(body.order, start.data(), cells,
                [&](std::size_t c, std::uint32_t rank, std::uint32_t place, std::uint8_t byte) {
                    places[start[c] + rank] = place;
                    if (cell) (*cell)[place] = byte;
                });
    return places;
}

template <class X, class T, int D>
State Domain<X, T, D>::save() {
    if (dead_)
        throw NumericalError(
            "this run has failed; a state that is not finite or not admissible is not saved");
    fetch_clock();
    // A step that wall time ended has not been judged yet.
    if (clock_.fault_particle != no_fault)
        throw NumericalError(
            "a particle has become unusable in the last step; the state is not saved, and the next "
            "step will describe it");
    State s;
    save_clock(s, clock_);
    s["keys"] = detail::to_blob(blocks_.keys().host());
    s["sums"] = detail::to_blob(
        sums_[parity()].host(std::size_t(table_.slots) * plan_.sum_channels * block_cells));
    s["sum_channels"] = detail::to_blob(std::vector<std::int32_t>{plan_.sum_channels});
    std::vector<std::int32_t> body_of(bodies_.size());
    std::iota(body_of.begin(), body_of.end(), 0);
    s["body_of"] = detail::to_blob(body_of);
    s["sorts_of_table"] = detail::to_blob(std::vector<std::int32_t>{sorts_of_table_});
    if (spec_.contact.any())
        s["fields"] = detail::to_blob(std::vector<std::int32_t>{spec_.contact.fields});
    sensors_.save(s);
    if (inflow_.any()) inflow_.save(s);
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        const std::string p = "body" + std::to_string(b) + "_";
        const auto places = cell_by_cell(body);
        const auto in_cells = [&](const auto& column) {
            const auto v = column.host(body.count);
            if (places.empty()) return v;
            auto in_order = v;
            for (std::size_t k = 0; k < places.size(); ++k) in_order[k] = v[places[k]];
            return in_order;
        };
        for (int a = 0; a < D; ++a)
            s[p + "offset" + std::to_string(a)] = detail::to_blob(in_cells(body.offset[a]));
        for (std::size_t r = 0; r < body.state.size(); ++r)
            s[p + "state" + std::to_string(r)] = detail::to_blob(in_cells(body.state[r]));
        s[p + "id"] = detail::to_blob(in_cells(body.id));
        s[p + "cell_start"] =
            detail::to_blob(body.cell_start.host(std::size_t(table_.slots) * block_cells + 1));
        if (body.mesh && body.mesh->kept() > 0)
            s[p + "elements"] = detail::to_blob(kept_here(body));
        if (body.rigid >= 0)
            s[p + "rigid"] = detail::to_blob(rigid_.saved(std::size_t(body.rigid)));
        s[p + "frozen_id"] = detail::to_blob(body.frozen_id);
        s[p + "frozen_position"] = detail::to_blob(body.frozen_position);
        s[p + "frozen_state"] = detail::to_blob(body.frozen_state);
    }
    return s;
}

template <class X, class T, int D>
void Domain<X, T, D>::load(const State& whole) {
    velocities_made_ = velocities_wait_ = false;
    check(whole);
    State own;
    if (share_) {
        if constexpr (X::is_device) meeting_->begin_anew();
        share_->partition = first_partition<D>(
            table_.keys_of, spec_.ranks, weigh_state(whole, bodies_.size()),
            spec_.ranks.grouped ? group_state(whole, spec_.bodies) : std::vector<GroupWeight>(),
            &share_->partition);
        share_->worked.clear();
        share_->costs = CostRates(share_->ranks());
        own = share_of_state<D>(whole, bodies_.size(), share_->partition, table_.keys_of,
                                share_->together, share_->rank());
    }
    const State& state = share_ ? own : whole;
    clock_ = saved_clock(state);
    // The table's age decides when blocks that emptied go, and with them the order in which
    // energies are added on a device.
    sorts_of_table_ = state.contains("sorts_of_table")
                          ? detail::from_blob<std::int32_t>(state, "sorts_of_table").at(0)
                          : 0;
    clock_.drift_limit = X::drift_limit;
    clock_.look_ahead = look_ahead_;
    const auto keys = detail::from_blob<std::uint64_t>(state, "keys");
    blocks_.assign(keys);
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        const std::string p = "body" + std::to_string(b) + "_";
        body.cell_start.assign(detail::from_blob<std::uint32_t>(state, p + "cell_start"));
        const auto id = detail::from_blob<std::uint32_t>(state, p + "id");
        body.count = std::uint32_t(id.size());
        std::vector<std::uint8_t> cell;
        const auto places = cell_by_cell(body, &cell);
        const auto stored = [&]<class E, class V>(const std::vector<V>& v, E) {
            std::vector<E> out(v.size() + column_padding, E(0));
            for (std::size_t k = 0; k < v.size(); ++k)
                out[places.empty() ? k : places[k]] = E(v[k]);
            return out;
        };
        const auto column = [&](const std::string& name) {
            return stored(detail::numbers(state, p + name), T(0));
        };
        body.id.assign(stored(id, std::uint32_t(0)));
        if constexpr (X::is_device) body.cell.assign(cell);
        // Anew, so that a column takes no more room than it needs.
        const auto renew = [&](Buffer<X, T>& column_of, const std::string& name) {
            column_of = Buffer<X, T>(exec_);
            column_of.assign(column(name));
        };
        for (int a = 0; a < D; ++a) renew(body.offset[a], "offset" + std::to_string(a));
        for (std::size_t r = 0; r < body.state.size(); ++r)
            renew(body.state[r], "state" + std::to_string(r));
        if (body.mesh && body.mesh->kept() > 0) {
            const auto kept = detail::numbers(state, p + "elements");
            body.mesh->keep(std::vector<T>(kept.begin(), kept.end()));
        }
        if (body.rigid >= 0)
            rigid_.restore(std::size_t(body.rigid), detail::from_blob<double>(state, p + "rigid"));
        body.frozen_id = detail::from_blob<std::uint32_t>(state, p + "frozen_id");
        body.frozen_position = detail::from_blob<double>(state, p + "frozen_position");
        body.frozen_state = detail::from_blob<double>(state, p + "frozen_state");
    }

    const int reading = parity();
    const Blob& saved = detail::find(state, "sums");
    if (saved.type == detail::type_code<Sum>()) {
        sums_[reading].assign(detail::from_blob<Sum>(state, "sums"));
    } else {
        // From another backend or precision: through numbers, and onto this backend's scale.
        auto value = detail::numbers(state, "sums");
        const bool was_fixed = saved.type == 'i' || saved.type == 'l';
        for (std::size_t k = 0; was_fixed && k < value.size(); ++k)
            value[k] *= clock_.unit_read[scale_of_sum(k)];
        if (!was_fixed) {
            std::fill_n(clock_.deposited, quantities, 0.0);
            std::fill_n(clock_.deposited_before, quantities, 0.0);
        }
        adopt_sums(value);
    }
    sums_[1 - reading].reserve_discard(sums_[reading].size());

    if (inflow_.any()) inflow_.load(state);
    sensors_.load(state, clock_);
    link_table();
    link_homes();
    if (share_) link_sums();
    if (share_) link_meshes(true);
    push_clock();
    // From where vertices are moved on, of those that nobody has told.
    for (std::size_t b = 0; b < bodies_.size(); ++b)
        if (bodies_[b].mesh && !share_) locate_elements(bodies_[b], int(b));
    meet_hosts();
    dead_ = false;
    for (Body& body : bodies_)
        if (body.mesh) body.mesh->begin_anew();
    smoothing_logs_ = Buffer<X, SmoothingLog>(exec_);
    for (Body& body : bodies_) body.smoothing_seen = 0;
    prepare_swept_velocities();
}

template <class X, class T, int D>
void Domain<X, T, D>::check(const State& state) const {
    check_state(state, spec_, plan_);
    check_laws(state);
}

/// Laws give each particle's numbers a finite pressure: within the range of the precision they may
/// still be no state of the law.
template <class X, class T, int D>
void Domain<X, T, D>::check_laws(const State& state) const {
    const double still[D][D] = {};
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        const Body& body = bodies_[b];
        const std::string p = "body" + std::to_string(b) + "_";
        std::vector<std::vector<double>> column;
        for (std::size_t r = 0; r < std::size_t(body.plan.state_columns); ++r)
            column.push_back(detail::numbers(state, p + "state" + std::to_string(r)));
        if (column.empty()) continue;
        if (body.mesh) {
            const auto id = detail::from_blob<std::uint32_t>(state, p + "id");
            if (id.size() != body.mesh->vertices())
                refuse_entry(p + "id", "has " + std::to_string(id.size()) + " elements",
                             "the " + std::to_string(body.mesh->vertices()) +
                                 " vertices of the body's mesh");
            for (std::size_t q = 0; q < id.size(); ++q) {
                const double share = body.mesh->mass()[id[q]] / body.particle_mass;
                if (!(std::abs(column[0][q] - share) <= 1e-6 * share))
                    refuse_entry(
                        p + "state0",
                        "is " + std::to_string(column[0][q]) + " at place " + std::to_string(q),
                        "the share of the mass that its vertex has, " + std::to_string(share));
            }
        }
        double own[max_state_columns] = {};
        for (std::size_t q = 0; q < column[0].size(); ++q) {
            for (std::size_t r = 0; r < column.size(); ++r) own[r] = column[r][q];
            if (body.plan.smoothing == Smoothing::two_volumes)
                body.ops.adopt(own, own[body.material->reals(D)]);
            const auto seen = body.ops.observe(own, still, body.parameters.data());
            if (!std::isfinite(seen.pressure + seen.volume_ratio))
                refuse_entry(p + "state0",
                             "and those beside it have, at place " + std::to_string(q) +
                                 ", the volume ratio " + std::to_string(seen.volume_ratio) +
                                 " and the pressure " + std::to_string(seen.pressure) + " Pa",
                             "a state of " + std::string(body.material->name));
        }
    }
}

}  // namespace mpm
