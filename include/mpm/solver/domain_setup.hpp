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
    clock_.look_ahead = look_ahead_;
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
    gravity_ = upload_table(spec_.gravity, D);

    set_boundaries();
    if (share_) list_mirrors();
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
TimeTableView Domain<X, T, D>::upload_table(const TableSpec& table, int components) {
    table_memory_.emplace_back(exec_);
    table_memory_.back().assign(table.time);
    const double* time = table_memory_.back().data();
    table_memory_.emplace_back(exec_);
    table_memory_.back().assign(table.value);
    return {time, table_memory_.back().data(), std::int32_t(table.time.size()), components,
            table.end};
}

template <class X, class T, int D>
MotionView Domain<X, T, D>::upload_motion(const MotionSpec& motion, int components) {
    MotionView view{};
    if (motion.table.time.empty()) return view;
    view.table = upload_table(motion.table, components);
    if (motion.of_places) return view;
    table_memory_.emplace_back(exec_);
    table_memory_.back().assign(motion.travelled());
    view.travelled = table_memory_.back().data();
    return view;
}

template <class X, class T, int D>
SurfaceRecord<D> Domain<X, T, D>::surface(const SurfaceSpec& s) {
    SurfaceRecord<D> r{};
    // Keys ascend as the blocks' numbers do, last axis fastest.
    const std::size_t blocks = s.keys.size() / D;
    std::vector<std::pair<std::uint64_t, std::int32_t>> found;
    for (int a = 0; a < D; ++a) {
        std::int64_t low = s.keys[std::size_t(a)], high = low;
        for (std::size_t k = 0; k < blocks; ++k) {
            low = std::min(low, s.keys[k * D + a]);
            high = std::max(high, s.keys[k * D + a]);
        }
        r.field.low[a] = low;
        r.field.counts[a] = high - low + 1;
        r.field.origin[a] = s.origin[std::size_t(a)];
        r.about[a] = s.about.empty() ? 0 : s.about[std::size_t(a)];
    }
    for (std::size_t k = 0; k < blocks; ++k) {
        std::uint64_t key = 0;
        for (int a = 0; a < D; ++a)
            key = key * std::uint64_t(r.field.counts[a]) +
                  std::uint64_t(s.keys[k * D + a] - r.field.low[a]);
        found.emplace_back(key, s.place[k]);
    }
    std::sort(found.begin(), found.end());
    std::vector<std::uint64_t> keys;
    std::vector<std::int32_t> places;
    for (const auto& [key, place] : found) {
        keys.push_back(key);
        places.push_back(place);
    }
    surface_keys_.emplace_back(exec_).assign(keys);
    surface_places_.emplace_back(exec_).assign(places);
    surface_values_.emplace_back(exec_).assign(s.values);
    r.field.keys = surface_keys_.back().data();
    r.field.place = surface_places_.back().data();
    r.field.value = surface_values_.back().data();
    r.field.count = std::int32_t(blocks);
    r.field.per_metre = 1 / s.spacing;
    r.decay = s.decay;
    r.thickness = s.thickness;
    r.path = upload_motion(s.path, D);
    r.turn = upload_motion(s.turn, 1);
    for (int a = 0; a < 3; ++a) r.axis[a] = s.axis.empty() ? (a == 2) : s.axis[std::size_t(a)];
    for (int a = 0; a < D; ++a) r.rotation[a][a] = 1;
    return r;
}

template <class X, class T, int D>
void Domain<X, T, D>::set_boundaries() {
    std::vector<BoundaryRecord<D>> records, measured;
    std::vector<SurfaceRecord<D>> surfaces;
    for (std::size_t k = 0; k < spec_.boundaries.size(); ++k) {
        const BoundarySpec& s = spec_.boundaries[k];
        BoundaryRecord<D> r{};
        r.is_box = s.is_box;
        // Of splines that end with the domain only the outermost is not zero at the wall.
        const int beyond =
            !spec_.kernel.clamped ? 0 : (spec_.kernel.kernel == Kernel::cubic ? 2 : 1);
        for (int a = 0; a < D; ++a) {
            const bool own = s.is_box || !s.surface.keys.empty();
            r.lower[a] = own ? s.lower[a] : -beyond;
            r.upper[a] = own ? s.upper[a] : int(spec_.cells[a]) + beyond;
        }
        if (!s.surface.keys.empty()) {
            surfaces.push_back(surface(s.surface));
            r.surface = int(surfaces.size());
        }
        bool everyone = s.restricted < 0;
        for (std::size_t b = 0; b < bodies_.size() && s.restricted >= 0; ++b) {
            if (!(spec_.bodies[b].held_by >> s.restricted & 1)) continue;
            const int weight = plan_.bodies[b].group.weight;
            // Without a sum of its own the body's group is all there is.
            everyone = everyone || weight < 0;
            if (weight >= 0) r.share |= std::uint64_t(1) << weight;
        }
        if (everyone) r.share = 0;
        r.limited = !s.within.empty();
        for (int a = 0; a < D && r.limited; ++a) {
            r.within_lower[a] = s.within[std::size_t(a)];
            r.within_upper[a] = s.within[std::size_t(D + a)];
        }
        special_boundaries_ = special_boundaries_ || special(s);
        for (int f = 0; f < 2 * D; ++f) {
            if (!s.present[f] || !mirrors(s.law[f].response)) continue;
            if (r.limited || s.restricted >= 0)
                throw SceneError("boundary '" + s.name +
                                 "' mirrors, which can be limited neither in space nor to bodies");
            if (wide_kernel() && spec_.cells[f / 2] < 2)
                throw SceneError("boundary '" + s.name +
                                 "' mirrors along an axis of one cell, too narrow for this kernel; "
                                 "make it two cells or take another kernel");
        }
        for (int f = 0; f < 2 * D; ++f) {
            r.present[f] = s.present[f];
            r.law[f] = s.law[f];
            r.law[f].linear = s.law[f].linear && s.present[f];
        }
        for (int a = 0; a < D; ++a) {
            const int cells = int(spec_.cells[std::size_t(a)]);
            r.face_lower[a] = std::max(r.lower[a], 0);
            r.face_upper[a] = std::min(r.upper[a], cells);
            r.rows_lower[a] = r.lower[a] <= 0 ? -4 : r.lower[a];
            r.rows_upper[a] = r.upper[a] >= cells ? cells + 4 : r.upper[a];
        }
        r.start = s.start;
        r.end = s.end;
        if (s.moves) r.motion = upload_table(s.motion, D);
        records.push_back(r);
    }
    boundary_records_.assign(records);
    surfaces_.assign(surfaces);
    set_pressures();
    for (const auto& s : spec_.sensors) {
        if (s.kind != SensorKind::load_cell) continue;
        BoundaryRecord<D>& r = measured.emplace_back(records.at(std::size_t(s.boundary)));
        for (int f = 0; f < 2 * D; ++f) r.present[f] = r.present[f] && (s.faces >> f & 1);
    }
    measured_boundaries_.assign(measured);
}

/// Which boundaries there are at all, and what edges of boxes with linear faces ask for: how much
/// each averaged group of bodies presses.
template <class X, class T, int D>
void Domain<X, T, D>::set_pressures() {
    bool boxes = false;
    for (const BoundarySpec& s : spec_.boundaries)
        for (const SurfaceLaw& law : s.law) {
            linear_walls_ = linear_walls_ || law.linear;
            mirrored_walls_ = mirrored_walls_ || mirrors(law.response);
            boxes = boxes || (law.linear && s.is_box);
            linear_surfaces_ = linear_surfaces_ || (law.linear && !s.surface.keys.empty());
        }
    std::vector<GroupPressure> found;
    for (std::size_t b = 0; b < spec_.bodies.size() && boxes; ++b) {
        const GroupChannels& g = plan_.bodies[b].group;
        const MaterialInfo& m = material(spec_.bodies[b].material);
        const auto& values = spec_.bodies[b].parameters;
        double stiffness = 0, exponent = 0;
        for (std::size_t k = 0; k < values.size(); ++k) {
            if (std::string_view(m.parameters[k].name) == "bulk_modulus") stiffness = values[k];
            if (std::string_view(m.parameters[k].name) == "exponent") exponent = values[k];
        }
        const bool known = std::any_of(found.begin(), found.end(),
                                       [&](const GroupPressure& f) { return f.sum == g.sum; });
        if (g.average < 0 || known || !(stiffness > 0 && exponent > 0)) continue;
        const double size = std::pow(spec_.cell_size, D);
        found.push_back({g.sum, std::max(g.weight, 0), stiffness / exponent, exponent,
                         m.density(values.data()) * size});
    }
    pressures_.assign(found);
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
            exec_.for_each(slots,
                           TouchBoundaries<D>{table_, measured_boundaries_.data() + c, 1,
                                              surfaces_.data(), spec_.cell_size, flag.data()});
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
