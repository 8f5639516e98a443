// Inlets: how far the water of each has moved in, which layers of particles are due, and the rows
// of those that are about to join their bodies. Knows no column of a body: whoever sorts takes the
// rows over.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/exec/buffer.hpp"
#include "mpm/kernels/supplying.hpp"
#include "mpm/solver/blob.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/solver/rank_scene.hpp"
#include "mpm/solver/time_tables.hpp"

namespace mpm {

/// Rows that an inlet adds to a body at one moment.
struct Arrival {
    int body;
    BodySpec rows;
};

template <class X, int D>
class Inflow {
public:
    Inflow(X& exec, const Spec& spec, const Plan& plan);
    Inflow(const Inflow&) = delete;
    Inflow& operator=(const Inflow&) = delete;

    bool any() const { return !inlets_.empty(); }
    int count() const { return int(inlets_.size()); }
    /// As the clock sees them.
    SupplyRecord* records() const { return records_.data(); }
    /// What layers of one step may add to a node, kg.
    double mass() const { return mass_; }

    /// All layers that are due become arrivals. Until `take` the inlets' own counters stay.
    void begin(const Clock& clock);
    std::vector<Arrival>& arrivals() { return arrivals_; }
    bool arrives() const { return !arrivals_.empty(); }
    /// How many particles are about to join a body.
    std::uint32_t arriving(std::size_t body) const;
    /// Their blocks are occupied too; `keys` gets them, `found` is raised where the table lacks
    /// one.
    void mark(const BlockTableView<D>& table, Buffer<X, std::uint32_t>& occupied,
              std::uint32_t* found, Buffer<X, std::uint64_t>& keys);
    /// Of the arrivals, the rows in blocks of this rank; `homes` gets these.
    void keep_own(const Spec& spec, const BlockPartition<D>& partition, int rank,
                  const BlockKeys<D>& keys_of, std::vector<std::uint64_t>& homes);
    /// The arrivals are there: the counters go on. What has come in.
    std::vector<Flow> take();
    void end() { arrivals_.clear(); }

    /// How many steps there probably are before the next layer is due, at most about `most`.
    std::int64_t steps_to_next(int most) const;

    void save(State& state) const;
    void load(const State& state);

private:
    /// Of a body, what its rows are made with.
    struct Fed {
        std::string name;
        std::vector<double> parameters;
        std::uint64_t room;
        double particle_mass, particle_volume;
    };
    std::vector<Arrival> due_layers(const Clock& clock);

    X& exec_;
    double cell_size_;
    std::vector<InletSpec> inlets_;
    std::vector<Fed> bodies_;
    TimeTables<X> tables_{exec_};
    Buffer<X, SupplyRecord> records_{exec_};
    std::vector<std::uint64_t> layers_;   // of each inlet
    std::vector<std::uint64_t> next_id_;  // of each body
    double mass_ = 0;
    std::vector<Arrival> arrivals_;  // while they are sorted in
    /// What the counters are with them.
    struct Coming {
        std::vector<SupplyRecord> records;
        std::vector<std::uint64_t> layers, next_id;
        std::vector<Flow> flows;
    } coming_;
};

template <class X, int D>
Inflow<X, D>::Inflow(X& exec, const Spec& spec, const Plan& plan)
    : exec_(exec), cell_size_(spec.cell_size), inlets_(spec.inlets) {
    if (inlets_.empty()) return;
    for (const BodySpec& body : spec.bodies)
        bodies_.push_back(
            {body.name, body.parameters, ids_of(body), body.particle_mass,
             body.particle_mass / material(body.material).density(body.parameters.data())});
    next_id_.assign(spec.bodies.size(), 0);
    for (std::size_t b = 0; b < next_id_.size(); ++b) next_id_[b] = spec.bodies[b].count;
    std::vector<SupplyRecord> records;
    for (const InletSpec& s : inlets_) {
        records.push_back({tables_.upload(s.velocity, 1), 0, s.spacing, 0});
        auto& next = next_id_.at(std::size_t(s.body));
        next = std::max(next, s.next_id);
        // Points of a layer in any cell of the face, each with the largest weight in a node's
        // cells.
        std::map<std::vector<std::int64_t>, int> in_cell;
        int most = 0;
        for (std::size_t k = 0; k < s.points.size(); k += D) {
            std::vector<std::int64_t> cell;
            for (int a = 0; a < D; ++a)
                cell.push_back(std::int64_t(std::floor(s.points[k + a] / spec.cell_size)));
            most = std::max(most, ++in_cell[cell]);
        }
        double fastest = 0;
        for (double v : s.velocity.value) fastest = std::max(fastest, v);
        const double layers = std::ceil(fastest * plan.time_step / s.spacing);
        const double width = plan.bodies[std::size_t(s.body)].any_transfer()
                                 ? kernel_width(spec.kernel.kernel)
                                 : std::pow(double(stencil_nodes<D>), 1.0 / D) * 0.75;
        mass_ += bodies_[std::size_t(s.body)].particle_mass * most * std::max(layers, 1.0) *
                 std::pow(width, D - 1);
    }
    records_.assign(records);
    layers_.assign(records.size(), 0);
}

template <class X, int D>
std::vector<Arrival> Inflow<X, D>::due_layers(const Clock& clock) {
    auto& [records, layers, next_id, flows] = coming_;
    std::vector<Arrival> arrivals;
    for (std::size_t k = 0; k < records.size(); ++k) {
        const InletSpec& inlet = inlets_[k];
        SupplyRecord& record = records[k];
        if (!(record.moved >= record.due)) continue;
        const std::size_t b = std::size_t(inlet.body), n = inlet.points.size() / D;
        const int axis = inlet.face / 2;
        const double into = inlet.face % 2 == 0 ? 1 : -1;
        std::vector<double> position, pressure, speed(D, 0.0);
        std::vector<std::uint32_t> ids;
        while (record.moved >= record.due) {
            const double further = record.moved - record.due;
            for (std::size_t p = 0; p < n; ++p) {
                for (int a = 0; a < D; ++a)
                    position.push_back(inlet.points[p * D + a] + (a == axis ? into * further : 0));
                if (!inlet.pressure.empty()) pressure.push_back(inlet.pressure[p]);
                ids.push_back(std::uint32_t(next_id[b]++));
            }
            // Not a sum of spacings: it would drift from the water's way.
            record.due = double(++layers[k] + 1) * inlet.spacing;
        }
        const std::uint64_t room = bodies_[b].room;
        if (next_id[b] > room)
            throw CapacityError("inlet '" + inlet.name + "': body '" + bodies_[b].name +
                                "' has had all its " + std::to_string(room) +
                                " particles; give the inlet a larger max_particles");
        // The same table at the same time as the nodes of its zone.
        std::vector<double> time = inlet.velocity.time, value = inlet.velocity.value;
        const TimeTableView table{time.data(), value.data(), std::int32_t(time.size()), 1,
                                  inlet.velocity.end};
        double u = 0;
        table.at(clock.time, &u);
        speed[std::size_t(axis)] = into * u;

        Arrival& arrival = arrivals.emplace_back();
        arrival.body = inlet.body;
        BodySpec& rows = arrival.rows;
        rows.name = bodies_[b].name;
        rows.parameters = bodies_[b].parameters;
        rows.count = ids.size();
        rows.position = rows_of(std::move(position), D);
        if (!pressure.empty()) rows.pressure = rows_of(std::move(pressure), 1);
        rows.velocity = std::move(speed);
        rows.ids = std::move(ids);
        const double added = double(rows.count);
        flows.push_back({true, int(k), clock.time, clock.step, rows.count,
                         added * bodies_[b].particle_mass, added * bodies_[b].particle_volume});
    }
    return arrivals;
}

template <class X, int D>
void Inflow<X, D>::begin(const Clock& clock) {
    coming_ = {records_.host(), layers_, next_id_, {}};
    arrivals_ = due_layers(clock);
}

template <class X, int D>
std::vector<Flow> Inflow<X, D>::take() {
    records_.assign(coming_.records);
    layers_ = std::move(coming_.layers);
    next_id_ = std::move(coming_.next_id);
    return std::exchange(coming_.flows, {});
}

template <class X, int D>
std::uint32_t Inflow<X, D>::arriving(std::size_t body) const {
    std::uint32_t n = 0;
    for (const Arrival& a : arrivals_)
        if (std::size_t(a.body) == body) n += std::uint32_t(a.rows.count);
    return n;
}

template <class X, int D>
void Inflow<X, D>::mark(const BlockTableView<D>& table, Buffer<X, std::uint32_t>& occupied,
                        std::uint32_t* found, Buffer<X, std::uint64_t>& keys) {
    std::vector<std::uint64_t> all;
    for (const Arrival& arrival : arrivals_) {
        std::vector<double> x(arrival.rows.count * D);
        arrival.rows.position(0, arrival.rows.count, x.data());
        for (std::size_t p = 0; p < x.size(); p += D) {
            std::int64_t block[D];
            for (int a = 0; a < D; ++a)
                block[a] = std::int64_t(std::floor(x[p + a] / cell_size_)) / Block<D>::edge;
            all.push_back(table.keys_of.key(block));
        }
    }
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    keys.assign(all);
    exec_.for_each(std::int64_t(all.size()),
                   MarkArrivals<X, D>{table, keys.data(), occupied.data(), found});
}

template <class X, int D>
void Inflow<X, D>::keep_own(const Spec& spec, const BlockPartition<D>& partition, int rank,
                            const BlockKeys<D>& keys_of, std::vector<std::uint64_t>& homes) {
    for (Arrival& arrival : arrivals_) {
        BodySpec& of = arrival.rows;
        auto rows = std::make_shared<RowRuns>();
        std::vector<std::uint32_t> ids;
        const auto keys = detail::keys_of_rows<D>(spec, of, keys_of, 0, of.count);
        for (std::uint64_t row = 0; row < of.count; ++row) {
            if (partition.owner(keys[row]) != rank) continue;
            rows->add(row, row + 1);
            ids.push_back(of.ids[row]);
            homes.push_back(keys[row]);
        }
        of.position = chosen_rows(of.position, rows, D);
        of.pressure = chosen_rows(of.pressure, rows, 1);
        of.ids = std::move(ids);
        of.count = rows->count();
    }
}

template <class X, int D>
std::int64_t Inflow<X, D>::steps_to_next(int most) const {
    double n = double(most);
    for (const SupplyRecord& record : records_.host())
        if (record.last > 0) n = std::min(n, std::ceil((record.due - record.moved) / record.last));
    return std::int64_t(std::max(n, 0.0)) + 1;
}

template <class X, int D>
void Inflow<X, D>::save(State& state) const {
    std::vector<double> moved, last;
    for (const SupplyRecord& r : records_.host()) {
        moved.push_back(r.moved);
        last.push_back(r.last);
    }
    state["supply_moved"] = detail::to_blob(moved);
    state["supply_last"] = detail::to_blob(last);
    state["supply_layers"] = detail::to_blob(layers_);
    state["supply_next_id"] = detail::to_blob(next_id_);
}

template <class X, int D>
void Inflow<X, D>::load(const State& state) {
    const auto moved = detail::from_blob<double>(state, "supply_moved"),
               last = detail::from_blob<double>(state, "supply_last");
    layers_ = detail::from_blob<std::uint64_t>(state, "supply_layers");
    next_id_ = detail::from_blob<std::uint64_t>(state, "supply_next_id");
    auto records = records_.host();
    for (std::size_t k = 0; k < records.size(); ++k) {
        records[k].moved = moved[k];
        records[k].last = last[k];
        records[k].due = double(layers_[k] + 1) * inlets_[k].spacing;
    }
    records_.assign(records);
}

}  // namespace mpm
