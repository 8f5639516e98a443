// Domain: from a spec to a state ready for its first step.
#pragma once

#include <numeric>

#include "mpm/solver/domain.hpp"

namespace mpm {

template <class X, class T, int D>
template <class FindOps>
Domain<X, T, D>::Domain(const Spec& spec, const Plan& plan, X exec, const FindOps& find_ops)
    : spec_(spec), plan_(plan), exec_(std::move(exec)) {
    for (int a = 0; a < D; ++a) {
        if (spec_.cells[a] < 1)
            throw SceneError("the domain has no cells along axis " + std::to_string(a));
        table_.keys_of.counts[a] =
            (spec_.cells[a] + Block<D>::edge - 1) / Block<D>::edge + 2 * BlockKeys<D>::rim;
    }
    least_mass_ = std::numeric_limits<double>::infinity();
    std::vector<BodyConstants> constants;
    for (std::size_t b = 0; b < spec_.bodies.size(); ++b) {
        BodySpec& s = spec_.bodies[b];
        if (s.count >= (std::uint64_t(1) << 32) - 256) {
            throw CapacityError(
                "body '" + s.name + "' has " + std::to_string(s.count) +
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
    maxima_.assign(std::vector<double>(maxima_count, 0.0));
    overflow_.assign({0});

    clock_.dt_stable = clock_.dt = clock_.dt_next = plan_.time_step;
    clock_.drift_limit = X::drift_limit;
    clock_.until = std::numeric_limits<double>::infinity();
    clock_.fault_particle = no_fault;
    clock_.log_stride = 1;
    for (int m = 0; m < maxima_count; ++m) clock_.scale_read[m] = clock_.scale_write[m] = 1;
    // The first step obeys the same speed limit as every later one.
    double speed = 0;
    for (const auto& b : spec_.bodies)
        for (double v : b.velocity) speed = std::max(speed, std::abs(v));
    if (speed * clock_.dt > 0.5 * spec_.cell_size)
        clock_.dt = clock_.dt_next = 0.5 * spec_.cell_size / speed;
    gravity_ = upload_table(spec_.gravity, D);

    set_boundaries();
    place_particles(spec_);
    set_sensors();
    link_table();
    for (auto& body : bodies_) list_homes(body);
    first_deposit(spec_);
    for (auto& b : spec_.bodies) b.position = b.velocity = b.pressure = {};
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
void Domain<X, T, D>::set_boundaries() {
    std::vector<BoundaryRecord<D>> records, measured;
    std::vector<bool> is_measured(spec_.boundaries.size(), false);
    for (const auto& s : spec_.sensors)
        if (s.kind == SensorKind::load_cell) is_measured.at(std::size_t(s.boundary)) = true;
    for (std::size_t k = 0; k < spec_.boundaries.size(); ++k) {
        const BoundarySpec& s = spec_.boundaries[k];
        BoundaryRecord<D> r{};
        r.is_box = s.is_box;
        for (int a = 0; a < D; ++a) {
            r.lower[a] = s.is_box ? s.lower[a] : 0;
            r.upper[a] = s.is_box ? s.upper[a] : int(spec_.cells[a]);
        }
        for (int f = 0; f < 2 * D; ++f) {
            r.present[f] = s.present[f];
            r.law[f] = s.law[f];
        }
        r.start = s.start;
        r.end = s.end;
        if (s.moves) r.motion = upload_table(s.motion, D);
        records.push_back(r);
        if (is_measured[k]) measured.push_back(r);
    }
    boundary_records_.assign(records);
    measured_boundaries_.assign(measured);
    measured_boundary_count_ = int(measured.size());
}

template <class X, class T, int D>
void Domain<X, T, D>::place_particles(const Spec& spec) {
    const BlockKeys<D>& keys_of = table_.keys_of;
    struct Placed {
        std::uint64_t key;
        std::uint32_t cell, index;
    };
    std::vector<std::vector<Placed>> placed(bodies_.size());
    std::vector<std::uint64_t> home_keys;
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        const BodySpec& s = spec.bodies[b];
        auto& list = placed[b];
        list.resize(s.count);
        std::vector<std::uint64_t> outside;
        for (std::size_t p = 0; p < s.count; ++p) {
            std::int64_t block[D];
            int cell[D];
            bool inside = true;
            for (int a = 0; a < D; ++a) {
                const double x = s.position[p * D + a] / spec.cell_size;
                const auto c = std::int64_t(std::floor(x));
                inside = inside && x >= 0 && c < spec.cells[a];
                block[a] = c / Block<D>::edge;
                cell[a] = int(c % Block<D>::edge);
            }
            if (!inside) {
                outside.push_back(s.first_id + p);
                continue;
            }
            list[p] = {keys_of.key(block), std::uint32_t(Block<D>::cell(cell)), std::uint32_t(p)};
        }
        if (!outside.empty()) {
            throw SceneError("body '" + s.name + "': " + std::to_string(outside.size()) +
                             " particles lie outside the domain, the first with id " +
                             std::to_string(outside[0]) + ". Enlarge the domain or move the body");
        }
        std::stable_sort(list.begin(), list.end(), [](const Placed& x, const Placed& y) {
            return x.key != y.key ? x.key < y.key : x.cell < y.cell;
        });
        for (std::size_t k = 0; k < list.size(); ++k)
            if (k == 0 || list[k].key != list[k - 1].key) home_keys.push_back(list[k].key);
    }

    std::vector<std::uint64_t> candidates;
    candidates.reserve(home_keys.size() * Block<D>::neighbours);
    for (std::uint64_t key : home_keys) {
        std::int64_t at[D];
        keys_of.block(key, at);
        for (int n = 0; n < Block<D>::neighbours; ++n) {
            std::int64_t b[D];
            int rest = n;
            for (int a = D - 1; a >= 0; --a) {
                b[a] = at[a] + rest % 3 - 1;
                rest /= 3;
            }
            candidates.push_back(keys_of.key(b));
        }
    }
    std::sort(candidates.begin(), candidates.end());
    candidates.erase(std::unique(candidates.begin(), candidates.end()), candidates.end());
    keys_.assign(candidates);
    table_.keys = keys_.data();
    table_.slots = std::int32_t(candidates.size());

    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        const BodySpec& s = spec.bodies[b];
        Body& body = bodies_[b];
        const auto& list = placed[b];
        body.count = std::uint32_t(s.count);
        std::vector<std::uint32_t> start(candidates.size() * block_cells + 1, 0);
        std::size_t slot = 0;
        for (const Placed& p : list) {
            while (candidates[slot] != p.key) ++slot;
            ++start[slot * block_cells + p.cell + 1];
        }
        std::partial_sum(start.begin(), start.end(), start.begin());
        body.cell_start.assign(start);
        std::vector<std::uint32_t> id(s.count + column_padding, 0);
        for (std::size_t k = 0; k < list.size(); ++k) id[k] = list[k].index;
        body.id.assign(id);
        std::vector<T> column(s.count + column_padding, T(0));
        for (int a = 0; a < D; ++a) {
            for (std::size_t k = 0; k < list.size(); ++k) {
                const double x = s.position[std::size_t(list[k].index) * D + a] / spec.cell_size;
                column[k] = T(x - std::floor(x) - 0.5);
            }
            body.offset.emplace_back(exec_);
            body.offset.back().assign(column);
        }
        std::fill(column.begin(), column.end(), T(0));
        for (int r = 0; r < body.plan.state_columns; ++r) {
            if (!s.pressure.empty()) {
                for (std::size_t k = 0; k < list.size(); ++k) {
                    column[k] = T(body.material->volume_from_pressure(s.pressure[list[k].index],
                                                                      s.parameters.data()));
                }
            }
            body.state.emplace_back(exec_);
            body.state.back().assign(column);
        }
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::set_sensors() {
    std::vector<LoadCellRecord<D>> loads;
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
            sensor.load = int(loads.size());
            LoadCellRecord<D> r{};
            r.boundary = s.boundary;
            r.faces = s.faces;
            for (int a = 0; a < D; ++a) r.reference[a] = s.reference[a];
            loads.push_back(r);
        }
        if (s.kind == SensorKind::wave_gauge) {
            // Water alone where its mass has a channel, else everything that has mass.
            int b = s.body;
            for (std::size_t k = 0; b < 0 && k < bodies_.size(); ++k)
                if (bodies_[k].material->volumetric) b = int(k);
            if (b < 0) b = 0;
            if (bodies_[b].plan.group.weight >= 0)
                sensor.gauge_channel = bodies_[b].plan.group.weight;
            sensor.gauge_full = bodies_[b].material->density(bodies_[b].parameters.data()) *
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
                if (s.ids[k] < body.first_id || s.ids[k] - body.first_id >= body.count) {
                    throw SceneError("sensor '" + s.name + "': id " + std::to_string(s.ids[k]) +
                                     " is not of body '" + body.plan.name + "', whose ids are " +
                                     std::to_string(body.first_id) + " to " +
                                     std::to_string(body.first_id + body.count - 1));
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
    load_impulse_.assign(std::vector<double>(std::size_t(load_count_) * load_columns<D>, 0.0));
}

template <class X, class T, int D>
void Domain<X, T, D>::first_deposit(const Spec& spec) {
    for (auto& s : sums_) {
        s.reserve_discard(std::size_t(table_.slots) * plan_.sum_channels * block_cells);
        s.zero();
    }
    // Fixed-point scales of the first deposit, from what is known before anything was summed.
    double mass = 0, momentum = 0, group = 0;
    std::vector<BodyNumbers> numbers(bodies_.size());
    const auto constants = constants_.host();
    double gravity[3] = {};
    TimeTableView{spec_.gravity.time.data(), spec_.gravity.value.data(),
                  std::int32_t(spec_.gravity.time.size()), D, spec_.gravity.end}
        .at(0.0, gravity);
    double g = 0;
    for (int a = 0; a < D; ++a) g += gravity[a] * gravity[a];
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        numbers[b].move = clock_.dt / spec_.cell_size;
        numbers[b].rate = 4 / spec_.cell_size;
        numbers[b].strain = 0;
        numbers[b].impulse = 4 * clock_.dt / (constants[b].density * spec_.cell_size);
        double speed = 0, j = 0;
        for (double v : spec.bodies[b].velocity) speed = std::max(speed, std::abs(v));
        for (double p : spec.bodies[b].pressure)
            j = std::max(j,
                         std::abs(body.material->volume_from_pressure(p, body.parameters.data())));
        double stress = 0;
        for (double p : spec.bodies[b].pressure) stress = std::max(stress, std::abs(p));
        const auto start = body.cell_start.host();
        std::uint32_t most = 1;
        for (std::size_t c = 0; c + 1 < start.size(); ++c)
            most = std::max(most, start[c + 1] - start[c]);
        // All particles of the nodes' 3^D cells, each with its largest weight (3/4)^D.
        const double m = body.particle_mass * most * stencil_nodes<D> * std::pow(0.75, D);
        mass += m;
        momentum += m * (speed + 1.5 * numbers[b].impulse * stress +
                         (std::sqrt(g) * clock_.dt + 1e-6 * plan_.wave_speed));
        group = std::max(group, m * std::max(j, 1e-7));
    }
    const double bound[maxima_count] = {0, mass, momentum, group};
    set_scales(bound);
    numbers_.assign(numbers);
    deposit_all(spec);
    if constexpr (std::is_integral_v<Sum>) {
        // The bound may be far above the sums; once more with the scales that the sums ask for.
        const auto sums = sums_[0].host();
        double top[maxima_count] = {};
        for (std::size_t k = 0; k < sums.size(); ++k) {
            const int m = scale_of_sum(k);
            top[m] = std::max(top[m], std::abs(double(sums[k])) / clock_.scale_write[m]);
        }
        // What cancels in a sum still has to fit alone: no less than a 32nd of the bound.
        for (int m = 0; m < maxima_count; ++m) top[m] = std::max(top[m], bound[m] / 32);
        set_scales(top);
        sums_[0].zero();
        deposit_all(spec);
    }
}

/// Fixed-point scales for sums that reach `top`, with the head room that Decide leaves.
template <class X, class T, int D>
void Domain<X, T, D>::set_scales(const double (&top)[maxima_count]) {
    if constexpr (std::is_integral_v<Sum>) {
        const double room = std::ldexp(1.0, X::template sum_bits<T> - 6);
        for (int m = max_mass; m < maxima_count; ++m) {
            clock_.scale_read[m] = clock_.scale_write[m] = power_of_two_below(room / top[m]);
        }
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::deposit_all(const Spec& spec) {
    push_clock();
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        if (body.count == 0) continue;
        const auto& velocity = spec.bodies[b].velocity;
        const auto id = body.id.host();
        std::vector<T> columns(std::size_t(body.count) * D + column_padding, T(0));
        for (int a = 0; a < D; ++a)
            for (std::size_t k = 0; k < body.count; ++k)
                columns[a * std::size_t(body.count) + k] =
                    T(velocity.size() == std::size_t(D) ? velocity[a]
                                                        : velocity[std::size_t(id[k]) * D + a]);
        body.scratch.assign(columns);
        body.ops.initial(pass(body, int(b), 0));
        exec_.wait();
        body.scratch = Buffer<X, T>(exec_);
    }
}

}  // namespace mpm
