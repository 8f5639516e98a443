// The sensors of a scene: what each is, its ring of rows where kernels fill it, the nodes that load
// cells measure, and the rows that wait to be drained. Knows no particle and no nodal value: who
// samples is handed records to fill (`SamplePoints`, `MeasureLoads`, `TrackParticles`).
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/exec/buffer.hpp"
#include "mpm/exec/sums.hpp"
#include "mpm/kernels/sampling.hpp"
#include "mpm/kernels/sampling_steps.hpp"
#include "mpm/solver/blob.hpp"
#include "mpm/solver/boundaries.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/homes.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/solver/raw_samples.hpp"

namespace mpm {

template <class X>
struct Sensor {
    SensorSpec spec;
    Buffer<X, double> times, values, first;
    Buffer<X, std::uint32_t> ids;
    Buffer<X, std::int32_t> columns;
    Buffer<X, double> partial;  // energy: of each home, then of the parts of their sum
    Buffer<X, SumSet> set;
    std::int64_t homes = -1;     // that `set` and `partial` are for
    std::vector<double> told;    // of a rigid body: its impulses at the sample before
    Buffer<X, Int128> pin_told;  // of a pin: its impulse since then
    Samples drained;
    explicit Sensor(X& x)
        : times(x), values(x), first(x), ids(x), columns(x), partial(x), set(x), pin_told(x) {}
};

template <class X, int D>
class Sensors {
public:
    Sensors(X& exec, const Spec& spec, const Plan& plan);
    Sensors(const Sensors&) = delete;
    Sensors& operator=(const Sensors&) = delete;

    int count() const { return int(sensors_.size()); }
    Sensor<X>& at(int k) { return sensors_[std::size_t(k)]; }
    SensorRecord* records() const { return records_.data(); }

    int load_count() const { return int(load_cells_.size()); }
    const LoadCellRecord<D>* load_cells() const { return load_cells_.data(); }
    /// Of a new table: the blocks that the boundary of each load cell touches, cell after cell.
    /// `counted`: (slots,) those of this rank's to count; null where it is the only one.
    void measure(const BlockTableView<D>& table, Boundaries<X, D>& boundaries,
                 const std::uint8_t* counted);
    SumSets measured() const { return {measured_.data(), load_count(), measured_places_}; }
    const std::int32_t* measured_slots() const { return measured_slots_.data(); }
    const ImpulseScales& scales() const { return scales_; }
    Int128* load_partial() const { return load_partial_.data(); }
    TakeLoad<D> take_load(const Clock* clock) const {
        TakeLoad<D> take{clock, records_.data(), load_cells_.data(), load_impulse_.data(), {}};
        for (int c = 0; c < load_columns<D>; ++c) take.scale[c] = load_scale(c);
        return take;
    }

    /// Those that take samples of a moment, and when: they have nothing to do in other steps.
    MomentSensors moments(bool launched) const {
        return {records_.data(), count(), moments_.data(), int(moments_.size()), launched};
    }
    std::vector<double> moment_intervals() const;

    /// Loads of contacts, and of a new table which of the blocks with several fields count.
    int contact_count() const { return int(contact_loads_.size()); }
    const ContactLoadRecord* contact_loads() const { return contact_loads_.data(); }
    const std::int32_t* contact_sides() const { return contact_sides_.data(); }
    void measure_contacts(const std::vector<std::int32_t>& blocks);
    SumSets met() const { return {met_.data(), contact_count(), met_places_}; }
    const std::int32_t* met_blocks() const { return met_blocks_.data(); }
    Int128* contact_partial() const { return contact_partial_.data(); }
    TakeContact<D> take_contact(const Clock* clock) const {
        TakeContact<D> take{
            clock, records_.data(), contact_loads_.data(), contact_impulse_.data(), {}};
        for (int c = 0; c < contact_columns<D>; ++c) take.scale[c] = contact_scale(c);
        return take;
    }

    /// Gauges and probes, and the functions that a probe sees.
    int point_count() const { return int(points_.size()); }
    const PointRecord<D>* points() const { return points_.data(); }
    const KernelChoice& functions() const { return functions_; }
    /// The blocks that they can read, ascending: of all, or (on the CPU) of those that are due.
    std::vector<std::uint64_t> blocks_of_points(const BlockKeys<D>& keys_of) const {
        return blocks_of(keys_of, points_.host());
    }
    std::vector<std::uint64_t> blocks_of_due_points(const BlockKeys<D>& keys_of) const;

    /// Rows that are in the rings, to those that wait for `drain`, which hands them out once.
    void collect();
    std::vector<Samples> drain();

    void save(State& state) const;
    void load(const State& state, const Clock& clock);
    /// Sensors that a run before this one had go on where they were; those behind them start now.
    void restore(const std::vector<std::int64_t>& next, const std::vector<double>& last,
                 const std::vector<double>& first, const std::vector<double>& impulse,
                 const Clock& clock);

private:
    /// Others add up what every step brings.
    static bool of_a_moment(SensorKind kind) {
        return kind != SensorKind::load_cell && kind != SensorKind::contact_load;
    }
    static constexpr std::size_t rigid_loads = D == 2 ? 3 : 6;  // forces, then moments
    double load_scale(int column) const { return column < D ? scales_.impulse : scales_.moment; }
    double contact_scale(int column) const {
        return column < D + 2 ? scales_.impulse : scales_.work;
    }
    std::vector<std::uint64_t> blocks_of(const BlockKeys<D>& keys_of,
                                         const std::vector<PointRecord<D>>& points) const;
    /// Impulses since the last sample: three numbers that add up to each.
    std::vector<double> in_pieces(const Buffer<X, Int128>& sums, int columns,
                                  double (Sensors::*scale)(int) const) const;
    std::vector<Int128> impulse_of(std::vector<double>::const_iterator from, int pieces) const;
    void load_told(const State& state);
    void take_impulse(const std::vector<double>& saved, std::size_t known, SensorKind kind,
                      int columns, double (Sensors::*scale)(int) const,
                      Buffer<X, Int128>& to) const;

    X& exec_;
    double cell_size_;
    std::int64_t cells_[D];
    KernelChoice functions_;
    std::vector<Sensor<X>> sensors_;
    Buffer<X, SensorRecord> records_{exec_};
    Buffer<X, std::int32_t> moments_{exec_};
    Buffer<X, LoadCellRecord<D>> load_cells_{exec_};
    Buffer<X, PointRecord<D>> points_{exec_};
    ImpulseScales scales_{};
    Buffer<X, Int128> load_impulse_{exec_};
    Buffer<X, Int128> load_partial_{exec_};
    Buffer<X, ContactLoadRecord> contact_loads_{exec_};
    Buffer<X, std::int32_t> contact_sides_{exec_}, met_blocks_{exec_};
    Buffer<X, Int128> contact_impulse_{exec_}, contact_partial_{exec_};
    Buffer<X, SumSet> met_{exec_};  // of loads of contacts: nodes of the blocks in met_blocks_
    std::int32_t met_places_ = 0;
    Buffer<X, SumSet> measured_{exec_};  // of load cells: nodes of the blocks in measured_slots_
    Buffer<X, std::int32_t> measured_slots_{exec_};
    std::int32_t measured_places_ = 0;
};

template <class X, int D>
Sensors<X, D>::Sensors(X& exec, const Spec& spec, const Plan& plan)
    : exec_(exec), cell_size_(spec.cell_size) {
    for (int a = 0; a < D; ++a) cells_[a] = spec.cells[std::size_t(a)];
    functions_.kernel = spec.kernel.kernel;
    functions_.clamped = spec.kernel.clamped;
    for (int a = 0; a < D; ++a) functions_.cells[a] = int(cells_[a]);
    functions_ = functions_of_point(functions_);
    scales_ = impulse_scales(spec, plan);
    std::vector<LoadCellRecord<D>> loads;
    std::vector<PointRecord<D>> points;
    std::vector<ContactLoadRecord> contacts;
    std::vector<std::int32_t> sides;
    for (const auto& s : spec.sensors) {
        sensors_.emplace_back(exec_);
        Sensor<X>& sensor = sensors_.back();
        sensor.spec = s;
        const std::size_t columns = ring_columns(spec, int(sensors_.size()) - 1);
        // There may be hundreds of tallies, whose rows are long.
        const std::size_t room = s.kind == SensorKind::tally ? 16384 : 65536;
        const std::size_t capacity = std::clamp<std::size_t>(room / columns, 64, 4096);
        sensor.times.assign(std::vector<double>(capacity, 0.0));
        sensor.values.assign(std::vector<double>(capacity * columns, 0.0));
        sensor.drained.values.shape = {0, columns};
        if (s.kind == SensorKind::pin_force) sensor.pin_told.assign(std::vector<Int128>(D, 0));
        if (s.kind == SensorKind::load_cell) {
            LoadCellRecord<D> r{};
            r.sensor = int(sensors_.size()) - 1;
            r.boundary = s.boundary;
            r.faces = s.faces;
            for (int a = 0; a < D; ++a) r.reference[a] = s.reference[a];
            loads.push_back(r);
        }
        if (s.kind == SensorKind::contact_load) {
            ContactLoadRecord r{int(sensors_.size()) - 1, {-1, -1}, std::int64_t(sides.size())};
            if (s.fields.size() == 2) std::copy(s.fields.begin(), s.fields.end(), r.fields);
            sides.insert(sides.end(), s.sides.begin(), s.sides.end());
            contacts.push_back(r);
        }
        if (s.kind == SensorKind::wave_gauge || s.kind == SensorKind::velocity_probe) {
            PointRecord<D>& point = points.emplace_back();
            point.sensor = int(sensors_.size()) - 1;
            point.axis = s.kind == SensorKind::wave_gauge ? s.axis : -1;
            for (int a = 0; a < D; ++a) point.position[a] = s.position[a];
        }
        if (s.kind == SensorKind::wave_gauge) {
            // Water alone where its mass has a channel, else everything that has mass.
            int b = s.body;
            for (std::size_t k = 0; b < 0 && k < spec.bodies.size(); ++k)
                if (material(spec.bodies[k].material).volumetric) b = int(k);
            if (b < 0) b = 0;
            const BodySpec& body = spec.bodies.at(std::size_t(b));
            if (plan.bodies.at(std::size_t(b)).group.weight >= 0)
                points.back().channel = plan.bodies[std::size_t(b)].group.weight;
            points.back().full = material(body.material).density(body.parameters.data()) *
                                 std::pow(spec.cell_size, D);
        }
        if (s.kind == SensorKind::tracker) {
            const BodySpec& body = spec.bodies.at(std::size_t(s.body));
            std::vector<std::int32_t> order(s.ids.size());
            std::iota(order.begin(), order.end(), 0);
            std::sort(order.begin(), order.end(),
                      [&](int x, int y) { return s.ids[x] < s.ids[y]; });
            std::vector<std::uint32_t> ids;
            for (int k : order) {
                if (s.ids[k] < body.first_id || s.ids[k] - body.first_id >= ids_of(body)) {
                    throw SceneError("sensor '" + s.name + "': id " + std::to_string(s.ids[k]) +
                                     " is not of body '" + body.name + "', whose ids are " +
                                     std::to_string(body.first_id) + " to " +
                                     std::to_string(body.first_id + ids_of(body) - 1));
                }
                ids.push_back(std::uint32_t(s.ids[k] - body.first_id));
            }
            sensor.ids.assign(ids);
            sensor.columns.assign(order);
        }
        sensor.first.assign({std::numeric_limits<double>::quiet_NaN()});
    }
    std::vector<SensorRecord> records;
    for (auto& s : sensors_) {
        SensorRecord r{};
        r.interval = s.spec.interval;
        r.capacity = std::int32_t(s.times.size());
        r.columns = std::int32_t(s.drained.values.shape[1]);
        r.times = s.times.data();
        r.values = s.values.data();
        records.push_back(r);
    }
    records_.assign(records);
    std::vector<std::int32_t> moments;
    for (std::size_t k = 0; k < sensors_.size(); ++k)
        if (of_a_moment(sensors_[k].spec.kind)) moments.push_back(std::int32_t(k));
    moments_.assign(moments);
    load_cells_.assign(loads);
    points_.assign(points);
    load_impulse_.assign(std::vector<Int128>(loads.size() * load_columns<D>, 0));
    contact_loads_.assign(contacts);
    contact_sides_.assign(sides);
    contact_impulse_.assign(std::vector<Int128>(contacts.size() * contact_columns<D>, 0));
}

template <class X, int D>
std::vector<double> Sensors<X, D>::moment_intervals() const {
    std::vector<double> out;
    for (const auto& s : sensors_)
        if (of_a_moment(s.spec.kind)) out.push_back(s.spec.interval);
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
}

template <class X, int D>
void Sensors<X, D>::measure_contacts(const std::vector<std::int32_t>& blocks) {
    if (contact_count() == 0) return;
    const std::int64_t nodes = std::int64_t(blocks.size()) * block_cells;
    const auto parts = std::int32_t(exec_.sum_parts(nodes));
    std::vector<SumSet> sets;
    for (int c = 0; c < contact_count(); ++c) sets.push_back({0, nodes, c * parts, parts});
    met_blocks_.assign(blocks);
    met_.assign(sets);
    met_places_ = contact_count() * parts;
    contact_partial_.reserve_discard(std::size_t(met_places_) * contact_columns<D>);
}

template <class X, int D>
void Sensors<X, D>::measure(const BlockTableView<D>& table, Boundaries<X, D>& boundaries,
                            const std::uint8_t* counted) {
    if (load_count() == 0) return;
    const std::int64_t slots = table.slots;
    Buffer<X, std::uint32_t> counts(exec_);
    counts.reserve_discard(std::size_t(load_count()));
    Homes<X> touched;  // of load cells in place of bodies
    for (int c = 0; c < load_count(); ++c) {
        touched.add(exec_, slots, counts.data() + c, [&](Buffer<X, std::uint32_t>& flag) {
            boundaries.touch_measured(c, table, flag.data());
            if (counted) exec_.for_each(slots, KeepCounted{counted, flag.data()});
        });
    }
    std::vector<SumSet> sets;
    std::int64_t found = 0;
    std::int32_t places = 0;
    for (const std::uint32_t n : counts.host()) {
        const std::int64_t nodes = std::int64_t(n) * block_cells;
        sets.push_back({found * block_cells, nodes, places, std::int32_t(exec_.sum_parts(nodes))});
        found += n;
        places += sets.back().parts;
    }
    measured_slots_.reserve_discard(found);
    for (int c = 0; c < load_count(); ++c) {
        exec_.for_each(slots, ListHomes{touched.flag[c].data(), touched.position[c].data(),
                                        measured_slots_.data() + sets[c].first / block_cells});
    }
    measured_.assign(sets);
    measured_places_ = places;
    load_partial_.reserve_discard(std::size_t(places) * load_columns<D>);
    exec_.wait();
}

template <class X, int D>
std::vector<std::uint64_t> Sensors<X, D>::blocks_of(
    const BlockKeys<D>& keys_of, const std::vector<PointRecord<D>>& points) const {
    std::vector<std::uint64_t> wanted;
    const std::int64_t reach = kernel_width(functions_.kernel) / 2;
    for (const PointRecord<D>& point : points) {
        std::int64_t low[D], high[D], at[D];  // blocks
        for (int a = 0; a < D; ++a) {
            const std::int64_t last = cells_[a] - 1,
                               cell = std::clamp<std::int64_t>(
                                   std::int64_t(std::floor(point.position[a] / cell_size_)), 0,
                                   last);
            const std::int64_t rim = BlockKeys<D>::rim, edge = Block<D>::edge;
            low[a] = at[a] = ((a == point.axis ? 0 : cell - reach) + rim * edge) / edge - rim;
            high[a] = (a == point.axis ? last : cell + reach) / edge;
        }
        for (bool more = true; more;) {
            wanted.push_back(keys_of.key(at));
            more = false;
            for (int a = D - 1; a >= 0 && !more; --a) {
                more = at[a] < high[a];
                at[a] = more ? at[a] + 1 : low[a];
            }
        }
    }
    std::sort(wanted.begin(), wanted.end());
    wanted.erase(std::unique(wanted.begin(), wanted.end()), wanted.end());
    return wanted;
}

template <class X, int D>
std::vector<std::uint64_t> Sensors<X, D>::blocks_of_due_points(const BlockKeys<D>& keys_of) const {
    std::vector<PointRecord<D>> due;
    for (int k = 0; k < point_count(); ++k)
        if (records_.data()[points_.data()[k].sensor].due) due.push_back(points_.data()[k]);
    return blocks_of(keys_of, due);
}

template <class X, int D>
void Sensors<X, D>::collect() {
    if (sensors_.empty()) return;
    auto records = records_.host();
    bool any_row = false;
    for (std::size_t k = 0; k < sensors_.size(); ++k) {
        SensorRecord& r = records[k];
        if (r.count == 0) continue;
        any_row = true;
        Samples& to = sensors_[k].drained;
        const std::size_t rows = r.count, width = r.columns, have = to.time.size();
        to.time.resize(have + rows);
        to.values.data.resize((have + rows) * width);
        exec_.download(to.time.data() + have, r.times, rows * sizeof(double));
        exec_.download(to.values.data.data() + have * width, r.values,
                       rows * width * sizeof(double));
        to.values.shape = {have + rows, width};
        r.count = 0;
    }
    if (any_row) records_.assign(records);
}

template <class X, int D>
std::vector<Samples> Sensors<X, D>::drain() {
    collect();
    std::vector<Samples> out;
    for (auto& s : sensors_) {
        const std::size_t width = s.drained.values.shape[1];
        out.push_back(std::exchange(s.drained, Samples{}));
        s.drained.values.shape = {0, width};
    }
    return out;
}

}  // namespace mpm

#include "mpm/solver/sensor_states.hpp"
