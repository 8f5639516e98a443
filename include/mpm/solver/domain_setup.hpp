// Domain: from a spec to a state ready for its first step.
#pragma once

#include <numeric>

#include "mpm/solver/domain.hpp"

namespace mpm {

template <class X, class T, int D>
template <class FindOps>
Domain<X, T, D>::Domain(const Spec& spec, const Plan& plan, X exec, const FindOps& find_ops,
                        const RankLink<D>& link)
    : spec_(spec), plan_(plan), exec_(std::move(exec)) {
    if (link.comm) {
        share_ = std::make_unique<RankShare<D>>();
        share_->comm = link.comm;
        share_->partition = link.partition;
        share_->rebalance_above = link.rebalance_above;
        if (const RanksSpec& ranks = spec_.ranks; ranks.measured) {
            share_->costs = CostRates(share_->ranks());
            if (ranks.seconds)
                share_->seconds = [&ranks, r = share_->rank()] { return ranks.seconds(r); };
            else
                share_->seconds = &thread_seconds;
        }
    }
    for (int a = 0; a < D; ++a) {
        if (spec_.cells[a] < 1)
            throw SceneError("the domain has no cells along axis " + std::to_string(a));
        table_.keys_of.counts[a] =
            (spec_.cells[a] + Block<D>::edge - 1) / Block<D>::edge + 2 * BlockKeys<D>::rim;
    }
    set_contact();
    least_mass_ = std::numeric_limits<double>::infinity();
    std::vector<BodyConstants> constants;
    for (std::size_t b = 0; b < spec_.bodies.size(); ++b) {
        BodySpec& s = spec_.bodies[b];
        if (std::max(s.count, ids_of(s)) >= (std::uint64_t(1) << 32) - 256) {
            throw CapacityError(
                "body '" + s.name + "' has " + std::to_string(std::max(s.count, ids_of(s))) +
                " particles; one body holds at most 4294967039. Split it into several bodies");
        }
        bodies_.emplace_back(exec_);
        Body& body = bodies_.back();
        body.plan = plan_.bodies[b];
        body.material = &material(s.material);
        body.ops = find_ops(s.material, body.plan.smoothing);
        body.parameters = s.parameters;
        body.first_id = s.first_id;
        body.particle_mass = s.particle_mass;
        const double density = body.material->density(s.parameters.data());
        body.particle_volume = s.particle_mass / density;
        least_mass_ = std::min(least_mass_, s.particle_mass);
        constants.push_back({density, s.smoothing_time, s.smoothing_ratio});
    }
    constants_.assign(constants);
    numbers_.reserve_discard(constants.size());
    groups_.assign(plan_.groups);

    clock_.dt_stable = clock_.dt = clock_.dt_next = plan_.time_step;
    clock_.drift_limit = X::drift_limit;
    clock_.until = std::numeric_limits<double>::infinity();
    clock_.fault_particle = no_fault;
    clock_.log_stride = 1;
    clock_.numbers_dt = -1;
    clock_.stray_limit = ~std::uint64_t(0);
    for (int q = 0; q < quantities; ++q) clock_.unit_read[q] = clock_.scale_write[q] = 1;
    clock_.time = spec_.start.time;
    clock_.step = last_sort_ = spec_.start.step;
    // The first step obeys the same speed limit as every later one.
    double speed = 0;
    for (double v : spec_.start.velocity) speed = std::max(speed, std::abs(v));
    for (const auto& b : spec_.bodies)
        for (double v : b.velocity) speed = std::max(speed, std::abs(v));
    speed += steepest_deposit(spec_);
    if (speed * clock_.dt > 0.5 * spec_.cell_size)
        clock_.dt = clock_.dt_next = 0.5 * spec_.cell_size / speed;

    if (share_) share_->mirrors = boundaries_.mirror_planes();
    if (share_) open_devices();
    set_supplies();
    place_particles(spec_);
    set_sensors();
    if (share_) open_points();
    if (spec_.start.given)
        restore_sensors(spec_.start.sensor_next, spec_.start.sensor_last, spec_.start.sensor_first,
                        spec_.start.load_impulse);
    link_table();
    link_homes();
    first_deposit(spec_);
    exec_.trim();
    for (auto& b : spec_.bodies) {
        b.position = b.pressure = b.state = {};
        b.velocity = b.velocity_gradient = {};
        b.ids = {};
    }
    spec_.start = {};
}

template <class X, class T, int D>
void Domain<X, T, D>::set_sensors() {
    std::vector<LoadCellRecord<D>> loads;
    std::vector<PointRecord<D>> points;
    for (const auto& s : spec_.sensors) {
        sensors_.emplace_back(exec_);
        Sensor& sensor = sensors_.back();
        sensor.spec = s;
        const std::size_t columns = sensor_columns(spec_, int(sensors_.size()) - 1).first.size();
        const std::size_t capacity = std::clamp<std::size_t>(65536 / columns, 16, 4096);
        sensor.times.assign(std::vector<double>(capacity, 0.0));
        sensor.values.assign(std::vector<double>(capacity * columns, 0.0));
        sensor.drained.values.shape = {0, columns};
        if (s.kind == SensorKind::load_cell) {
            LoadCellRecord<D> r{};
            r.sensor = int(sensors_.size()) - 1;
            r.boundary = s.boundary;
            r.faces = s.faces;
            for (int a = 0; a < D; ++a) r.reference[a] = s.reference[a];
            loads.push_back(r);
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
            for (std::size_t k = 0; b < 0 && k < bodies_.size(); ++k)
                if (bodies_[k].material->volumetric) b = int(k);
            if (b < 0) b = 0;
            if (bodies_[b].plan.group.weight >= 0)
                points.back().channel = bodies_[b].plan.group.weight;
            points.back().full = bodies_[b].material->density(bodies_[b].parameters.data()) *
                                 std::pow(spec_.cell_size, D);
        }
        if (s.kind == SensorKind::tracker) {
            const Body& body = bodies_.at(std::size_t(s.body));
            std::vector<std::int32_t> order(s.ids.size());
            std::iota(order.begin(), order.end(), 0);
            std::sort(order.begin(), order.end(),
                      [&](int x, int y) { return s.ids[x] < s.ids[y]; });
            std::vector<std::uint32_t> ids;
            for (int k : order) {
                if (s.ids[k] < body.first_id ||
                    s.ids[k] - body.first_id >= ids_of(spec_.bodies[s.body])) {
                    throw SceneError(
                        "sensor '" + s.name + "': id " + std::to_string(s.ids[k]) +
                        " is not of body '" + body.plan.name + "', whose ids are " +
                        std::to_string(body.first_id) + " to " +
                        std::to_string(body.first_id + ids_of(spec_.bodies[s.body]) - 1));
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
    sensor_records_.assign(records);
    load_count_ = int(loads.size());
    load_cells_.assign(loads);
    point_count_ = int(points.size());
    points_.assign(points);
    load_impulse_.assign(std::vector<double>(std::size_t(load_count_) * load_columns<D>, 0.0));
}

/// The blocks that the boundary of each load cell touches, cell after cell.
template <class X, class T, int D>
void Domain<X, T, D>::list_measured() {
    const std::int64_t slots = table_.slots;
    Buffer<X, std::uint32_t> counts(exec_);
    counts.reserve_discard(load_count_);
    Homes touched;  // of load cells in place of bodies
    for (int c = 0; c < load_count_; ++c) {
        add_homes(touched, counts.data() + c, [&](Buffer<X, std::uint32_t>& flag) {
            boundaries_.touch_measured(c, table_, flag.data());
            if (share_ && X::is_device) {
                exec_.for_each(slots, KeepCounted{counts_.data(), flag.data()});
            } else if constexpr (!X::is_device) {
                for (std::int64_t k = 0; k < slots; ++k)
                    if (!counts_slot(std::size_t(k))) flag.data()[k] = 0;
            }
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
    for (int c = 0; c < load_count_; ++c) {
        exec_.for_each(slots, ListHomes{touched.flag[c].data(), touched.position[c].data(),
                                        measured_slots_.data() + sets[c].first / block_cells});
    }
    measured_.assign(sets);
    measured_places_ = places;
    load_partial_.reserve_discard(std::size_t(places) * load_columns<D>);
    exec_.wait();
}

}  // namespace mpm
