// Domain: from a spec to a state ready for its first step.
#pragma once

#include <numeric>

#include "mpm/solver/domain.hpp"

namespace mpm {

/// Of bodies whose particles are moved as a whole: nothing is done by particle.
template <class X, class T, int D>
BodyOps<X, T, D> rigid_ops() {
    BodyOps<X, T, D> ops{};
    ops.channels = D;
    ops.observe = [](const double*, const double(&)[D][D], const double*) {
        Observation<D> o{};
        o.volume_ratio = 1;
        for (int a = 0; a < D; ++a) o.deformation[a][a] = 1;
        return o;
    };
    return ops;
}

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
        if (s.rigid.given)
            body.ops = rigid_ops<X, T, D>();
        else if (s.elements.empty())
            body.ops = find_ops(s.material, body.plan.smoothing);
        if constexpr (X::is_device) {
            const bool splits = (body.plan.pipeline == Pipeline::fused && body.ops.split) ||
                                (body.plan.pipeline == Pipeline::keeping && body.ops.split_keep);
            if (splits && exec_.shares_work()) body.order = HomeOrder::by_chunk;
        }
        body.parameters = s.parameters;
        body.first_id = s.first_id;
        body.particle_mass = s.particle_mass;
        const double density = body.material->density(s.parameters.data());
        body.particle_volume = s.particle_mass / density;
        double lightest = s.particle_mass;
        if (!s.elements.empty()) {
            make_mesh(body, s);
            lightest = *std::min_element(body.mesh->mass().begin(), body.mesh->mass().end());
        }
        if (s.rigid.given) make_rigid(body, s);
        least_mass_ = std::min(least_mass_, lightest);
        constants.push_back({density, s.smoothing_time, s.smoothing_ratio});
    }
    // With forces from gradients of shapes the lightest nodes are fast without bound: there even
    // those that all particles share count by their mass.
    light_mass_ = spec_.kernel.gradient == GradientForm::shapes
                      ? least_mass_
                      : light_mass(least_mass_, kernel_width(spec_.kernel.kernel), D);
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
    std::vector<TimeTableView> drives;
    for (const BodySpec& b : spec_.bodies)
        for (const PinSpec& pin : b.pins) {
            const TableSpec& t = pin.displacement;
            const TimeTableView table{t.time.data(), t.value.data(), std::int32_t(t.time.size()), D,
                                      t.end};
            if (table.count > 0) speed = std::max(speed, driven_speed<D>(&table, 1, 0, clock_.dt));
        }
    for (const Body& body : bodies_) {
        if (!body.mesh) continue;
        for (const TimeTableView& goal : body.mesh->goals())
            if (goal.count > 0) drives.push_back(goal);
    }
    drives_.assign(drives);
    if (speed * clock_.dt > 0.5 * spec_.cell_size)
        clock_.dt = clock_.dt_next = 0.5 * spec_.cell_size / speed;

    if (share_) {
        share_->together = boundaries_.blocks_together(blocks_.view().keys_of);
        blocks_.share(share_->together);
    }
    if (share_) open_devices();
    place_particles(spec_);
    make_tallies();
    expected_.intervals = sensors_.moment_intervals();
    if (share_) open_points();
    if (spec_.start.given)
        sensors_.restore(spec_.start.sensor_next, spec_.start.sensor_last, spec_.start.sensor_first,
                         spec_.start.load_impulse, clock_);
    link_table();
    link_homes();
    for (Body& body : bodies_)
        if (body.mesh) place_mesh(body);
    if (share_) link_meshes(true);
    first_deposit(spec_);
    prepare_swept_velocities();
    exec_.trim();
    for (auto& b : spec_.bodies) {
        b.position = b.pressure = b.state = {};
        b.velocity = b.velocity_gradient = {};
        b.elements = {};
        b.all_vertices = {};
        b.ids = {};
    }
    spec_.start = {};
}

}  // namespace mpm
