// Domain: the life of a step, and what happens when the clock halts.
#pragma once

#include "mpm/kernels/transfers.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

template <class X, class T, int D>
Pass<X, T, D> Domain<X, T, D>::pass(Body& body, int number, int parity_to) {
    Pass<X, T, D> p{};
    p.exec = &exec_;
    p.grid = grid_view(parity_to);
    p.body = body.view();
    p.group = body.plan.group;
    p.clock = clock_buffer_.data();
    p.numbers = numbers_.data() + number;
    p.fault_particle = &clock_buffer_.data()->fault_particle;
    p.strays = &clock_buffer_.data()->strays;
    p.deposited = clock_buffer_.data()->deposited;
    p.body_number = std::uint64_t(number);
    for (std::size_t k = 0; k < body.parameters.size(); ++k) p.parameters[k] = body.parameters[k];
    p.carry = body.plan.carry;
    p.stress_only = body.plan.stress_only;
    p.turn = turn_step();
    if constexpr (X::is_device) p.arrivals = exec_.arrivals();
    p.scratch = body.scratch.data();
    const bool stages = share_ && !X::is_device;
    p.destinations = stages ? share_->destinations[std::size_t(number)].data() : neighbours_.data();
    p.staged = stages ? table_.slots : none_staged;
    p.full_homes = body.all_full_homes;
    p.coloured = body.coloured.data();
    p.colour_start = body.colour_start.data();
    p.colours = int(body.colour_start.size()) - 1;
    return p;
}

template <class X, class T, int D>
void Domain<X, T, D>::update_grid() {
    if constexpr (!X::is_device) exec_.single(begin_step());  // a device did at the last turn
    int bits = 0;
    if constexpr (std::is_integral_v<Sum>) bits = X::template sum_bits<T>;
    const Decide<D> decide{clock_buffer_.data(),
                           spec_.cell_size,
                           constants_.data(),
                           numbers_.data(),
                           int(bodies_.size()),
                           sensor_records_.data(),
                           int(sensors_.size()),
                           bits,
                           least_mass_,
                           plan_.wave_speed,
                           plan_.beyond,
                           supplies_.data(),
                           int(spec_.inlets.size()),
                           supplied_mass_};
    if constexpr (X::is_device) {
        if (share_) {
            make_velocities(AfterGrid<D>::telling(
                {clock_buffer_.data(), boxes_.data(), share_->rank(), int(boxes_.size())}));
            share_votes();
            exec_.single(
                DecideByVotes<D>{decide, clock_buffer_.data(), votes_.data(), share_->ranks()});
            return;
        }
        make_velocities(AfterGrid<D>::deciding(decide));
    } else {
        if (share_)
            return make_velocities(
                DecideTogether<D>{decide, clock_buffer_.data(), share_.get(), now()});
        make_velocities(decide);
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::run_sensors() {
    if (sensors_.empty()) return;
    const auto node = node_update(parity());
    Clock* clock = clock_buffer_.data();
    const SamplePoints<Grid, Sum, D> points = sample_points();
    bool measured = load_count_ == 0;
    if constexpr (!X::is_device) {
        if (!measured && contact_blocks_ > 0) {
            measured = true;
            exec_.template sum_each<load_columns<D>>(
                SumSets{measured_.data(), load_count_, measured_places_},
                MeasureLoads<Grid, Sum, D, true>{node, measured_slots_.data(), load_cells_.data(),
                                                 spec_.cell_size, contact_view()},
                TakeLoad<D>{clock, sensor_records_.data(), load_cells_.data(),
                            load_impulse_.data()},
                load_partial_.data(), share_ ? 0 : point_count_, points);
        }
    }
    if (!measured) {
        exec_.template sum_each<load_columns<D>>(
            SumSets{measured_.data(), load_count_, measured_places_},
            MeasureLoads<Grid, Sum, D>{node, measured_slots_.data(), load_cells_.data(),
                                       spec_.cell_size},
            TakeLoad<D>{clock, sensor_records_.data(), load_cells_.data(), load_impulse_.data()},
            load_partial_.data(), share_ ? 0 : point_count_, points);
    } else if (load_count_ == 0 && point_count_ > 0 && !share_) {
        exec_.for_each_large(point_count_, points);
    }
    if (share_) {
        if constexpr (X::is_device)
            tell_points();
        else
            sample_points_together(points);
    }
    for (std::size_t k = 0; k < sensors_.size(); ++k) {
        Sensor& s = sensors_[k];
        SensorRecord* record = sensor_records_.data() + k;
        if constexpr (!X::is_device) {
            if (!record->due) continue;
        }
        if (s.spec.kind == SensorKind::tracker) {
            Body& body = bodies_[s.spec.body];
            exec_.single(OpenTrack{clock, record});
            exec_.for_each_large(
                body.homes,
                TrackParticles<Grid, T, D, X::is_device>{
                    table_, velocity_.data(), plan_.velocity_channels, body.plan.phase,
                    kernel_width(spec_.kernel.kernel) != 3, record, body.view(), s.ids.data(),
                    s.columns.data(), int(s.spec.ids.size()), spec_.cell_size});
        }
        if (s.spec.kind == SensorKind::energy) sample_energy(s, record);
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::sample_energy(Sensor& s, SensorRecord* record) {
    const auto chosen = [&](std::size_t b) { return s.spec.body < 0 || s.spec.body == int(b); };
    std::int64_t homes = 0;
    for (std::size_t b = 0; b < bodies_.size(); ++b)
        if (chosen(b)) homes += bodies_[b].homes;
    const std::int64_t parts = exec_.sum_parts(homes);
    if (s.homes != homes) {
        s.homes = homes;
        s.set.assign({SumSet{0, homes, 0, std::int32_t(parts)}});
        s.partial.reserve_discard(std::size_t(homes + parts) * 3);
    }
    std::int64_t at = 0;
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        if (!chosen(b)) continue;
        double* partial = s.partial.data() + 3 * at;
        if (bodies_[b].homes > 0 && bodies_[b].plan.any_transfer()) {
            reserve_deposits(bodies_[b]);
            Phase<X, T, D> p = phase(bodies_[b], int(b), parity());
            p.due = &record->due;
            p.part = Part::speeds;
            if (p.n.velocity < 0) phase_ops_.collect(p);
            bodies_[b].ops.phase_energies(p, &record->due, partial);
        } else if (bodies_[b].homes > 0) {
            bodies_[b].ops.energies(pass(bodies_[b], int(b), parity()), &record->due, partial);
        }
        at += bodies_[b].homes;
    }
    exec_.template sum_each<3>(SumSets{s.set.data(), 1, std::int32_t(parts)},
                               AddEnergies{record, s.partial.data()},
                               TakeEnergy{clock_buffer_.data(), record, s.first.data()},
                               s.partial.data() + 3 * homes, 0, Nothing{});
}

/// What lies between the passes over a body's particles.
template <class X, class T, int D>
void Domain<X, T, D>::reserve_deposits(Body& body) {
    if (body.plan.pipeline == Pipeline::phased) reserve_scratch(body);
    if (body.plan.pipeline != Pipeline::two_pass) return;
    const std::size_t columns = std::size_t(body.ops.channels) * (1 + D);
    body.scratch.reserve_discard(columns * body.count + column_padding);
}

/// Devices: blocks of threads whose last one of a step turns the clock.
template <class X, class T, int D>
std::uint64_t Domain<X, T, D>::workers_of(const Body& body) const {
    switch (body.plan.pipeline) {
        case Pipeline::phased:
            return std::uint64_t(body.homes);
        case Pipeline::two_pass:
            return std::uint64_t(body.homes) * (std::uint64_t(body.ops.channels) + 1);
        default:
            return std::uint64_t(body.full_homes) + std::uint64_t(lone_blocks(body.lone_count));
    }
}

/// The particles' half of a step, each body by its own pipeline.
template <class X, class T, int D>
void Domain<X, T, D>::run_bodies() {
    std::vector<std::size_t> moving;
    std::uint64_t workers = 0;
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        if (bodies_[b].homes == 0) continue;
        moving.push_back(b);
        reserve_deposits(bodies_[b]);
        workers += workers_of(bodies_[b]);
    }
    collect_bodies(moving);
    if constexpr (X::is_device) {
        if (moving.empty()) exec_.single(turn_step());
        if (workers >= ~std::uint32_t(0))
            throw CapacityError("more than 2^32 - 2 blocks of threads in one step");
        // Small bodies run beside the largest: sums are integers, so nobody's order matters.
        std::stable_sort(moving.begin(), moving.end(), [&](std::size_t a, std::size_t b) {
            return bodies_[a].homes < bodies_[b].homes;
        });
        if (moving.size() > 1) exec_.side_stream();
    }
    for (std::size_t b : moving) {
        if constexpr (X::is_device) {
            if (b == moving.back()) exec_.main_stream();
        }
        advance_body(bodies_[b], int(b), std::uint32_t(workers));
    }
    if (stresses_apart()) complete_sums();  // masses
    for (std::size_t b : moving) deposit_stresses(bodies_[b], int(b), 1 - parity());
    if constexpr (X::is_device) {
        if (moving.size() > 1) exec_.join();
    }
}

/// What is left of a body's step once all bodies have been collected.
template <class X, class T, int D>
void Domain<X, T, D>::advance_body(Body& body, int number, std::uint32_t workers) {
    Phase<X, T, D> p = phase(body, number, 1 - parity());
    p.pass.workers = workers;
    switch (body.plan.pipeline) {
        case Pipeline::fused:
            body.ops.fused(p.pass);
            if (body.lone_count > 0) body.ops.lone(p.pass);
            break;
        case Pipeline::keeping:
            body.ops.keep(p);
            break;
        case Pipeline::two_pass:
            body.ops.gather(p.pass);
            body.ops.scatter(p.pass);
            break;
        case Pipeline::phased:
            p.turns = true;
            body.ops.respond(p);
            after_respond(body, p);
            phase_ops_.spread(p);
            break;
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::one_step() {
    if constexpr (X::is_device) {
        update_grid();
        run_sensors();
        run_bodies();
        if (share_) {
            share_sums();
            sample_told_points();
        }
        ++clock_.step;  // what the queue assumes; fetch_clock() brings the truth
    } else {
        const auto seconds = [&] { return share_ && share_->seconds ? share_->seconds() : 0; };
        const double t0 = now(), begins = seconds();
        update_grid();
        const double t1 = now();
        run_sensors();
        const double t2 = now();
        if (clock_buffer_.data()->halt == Halt::none) {
            const double at = seconds();
            run_bodies();
            // What this rank has done, and not what it has waited for others.
            if (share_ && share_->seconds) {
                // A scene at rest may have no sort for as long as it runs.
                if (share_->worked.size() == CostRates::most_steps) share_->worked.clear();
                share_->worked.push_back(share_->votes_at - begins + (seconds() - at));
            }
            if (share_) end_of_sums(1 - parity(), Added::in_step);
        }
        exec_.single(EndStep{clock_buffer_.data(), spec_.cell_size});
        const double t3 = now();
        timings_["grid"] += t1 - t0;
        timings_["sensors"] += t2 - t1;
        timings_["particles"] += t3 - t2;
        fetch_clock();
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::fetch_clock() {
    exec_.download(&clock_, clock_buffer_.data(), sizeof clock_);
}

template <class X, class T, int D>
RunResult Domain<X, T, D>::run(std::int64_t steps, double until, double wall) {
    RunResult result;
    if (dead_) {
        result.reason = "fault";
        result.time = clock_.time;
        result.fault = fault_;
        return result;
    }
    const double began = now();
    // What a rank that fails has queued shall not wait for the others.
    struct GiveUp {
        typename X::Meeting* meeting;
        int before = std::uncaught_exceptions();
        ~GiveUp() {
            if (meeting && std::uncaught_exceptions() > before) meeting->give_up();
        }
    };
    const GiveUp on_failure{meeting_.get()};
    fetch_clock();
    const std::int64_t first_step = clock_.step;
    clock_.until = until;
    clock_.steps_left = steps;  // negative: no limit
    clock_.halt = Halt::none;
    push_clock();
    if (share_) share_->wall_ends = began + wall;
    while (true) {
        if constexpr (X::is_device) {
            // As many steps as there will probably be before the next sort; a wrong guess costs
            // launches that do nothing, or a look too many.
            std::int64_t n = std::min<std::int64_t>(X::batch, steps_to_sort());
            if (!spec_.inlets.empty()) n = std::min(n, steps_to_supply());
            if (clock_.steps_left >= 0) n = std::min<std::int64_t>(n, clock_.steps_left + 1);
            if (std::isfinite(until)) {
                n = std::int64_t(std::min(
                    double(n), std::floor(std::max(0.0, until - clock_.time) / clock_.dt) + 2));
            }
            bool wall_over = false;
            if (share_) {
                // Nobody asks for memory while another rank's kernels wait.
                for (Body& body : bodies_) reserve_deposits(body);
                run_together(n, wall_over);
            }
            const double t0 = now();
            exec_.single(begin_step());
            const std::int64_t before = clock_.step;
            for (std::int64_t k = 0; k < std::max<std::int64_t>(n, 1); ++k) one_step();
            if (share_) meeting_->wait();
            fetch_clock();
            collect_smoothing();
            if (share_) {
                share_->bytes_of_sums += std::uint64_t(clock_.step - before) * share_->bytes_a_step;
                // Nobody goes on to what frees memory while another rank's kernels wait.
                wall_over = now() - began > wall;
                std::int64_t none = 0;
                run_together(none, wall_over);
                share_->wall_over = wall_over;
            }
            timings_["steps"] += now() - t0;
        } else {
            one_step();
        }
        if (clock_.halt == Halt::sort || clock_.halt == Halt::supply) {
            if (!(clock_.halt == Halt::sort ? sort() : supply())) {
                // The state is whole: the same run may go on under another policy, or be read.
                result.reason = "fault";
                result.fault = fault_;
                break;
            }
            clock_.halt = Halt::none;
            push_clock();
        } else if (clock_.halt == Halt::samples) {
            collect_samples();
            clock_.halt = Halt::none;
            push_clock();
        } else if (clock_.halt == Halt::until || clock_.halt == Halt::steps) {
            result.reason = clock_.halt == Halt::until ? "until" : "steps";
            break;
        } else if (clock_.halt == Halt::fault) {
            fault_ = describe_fault();
            dead_ = true;
            result.reason = "fault";
            result.fault = fault_;
            break;
        } else if (share_ ? share_->wall_over : now() - began > wall) {
            result.reason = "wall";
            break;
        }
    }
    result.steps = clock_.step - first_step;
    result.time = clock_.time;
    return result;
}

/// How many steps the drift allows, and the strays if they go on growing in proportion to the steps
/// since the last sort.
template <class X, class T, int D>
std::int64_t Domain<X, T, D>::steps_to_sort() const {
    double n = double(X::batch);
    const double share = clock_.speed * clock_.dt / spec_.cell_size;
    if (share > 0) n = std::min(n, std::floor((clock_.drift_limit - clock_.drift) / share) + 1);
    const double since = double(clock_.step - last_sort_);
    if (clock_.strays > 0 && since > 0) {
        // Of several ranks each counts its own, and those of all call for a sort.
        const double strays = double(clock_.strays) * (share_ ? share_->ranks() : 1);
        const double all = since * std::sqrt(double(clock_.stray_limit) / strays);
        n = std::min(n, std::ceil(all - since) + 1);
    } else if (since == 0 && sort_interval_ > 0) {
        n = std::min(n, double(sort_interval_) + 1);
    }
    return std::int64_t(std::max(n, 1.0));
}

/// The first step from which on the fastest node never again was slower than a tenth of what it is
/// now.
template <class X, class T, int D>
std::int64_t Domain<X, T, D>::growth_start() const {
    std::int64_t since = 0;
    for (int k = 0; k < clock_.log_count; ++k)
        if (!(clock_.log_speed[k] > 0.1 * clock_.speed)) since = clock_.log_step[k];
    return since;
}

template <class X, class T, int D>
Fault Domain<X, T, D>::describe_fault() {
    Fault f;
    f.step = clock_.step;
    f.time = clock_.time;
    f.speed = clock_.speed;
    f.grew_since = growth_start();
    f.value = clock_.fault_value;
    if (clock_.fault == FaultKind::outran) {
        f.code = clock_.fault_value < 1e299 ? "outran-cell" : "non-finite";
        f.message = clock_.fault_value < 1e299
                        ? "a node would carry its particles across more than one cell in one step"
                        : "a nodal velocity is not finite";
        return f;
    }
    if (clock_.fault == FaultKind::fixed_point) {
        const double* limit = clock_.deposit_limit;
        const bool grew = clock_.deposited[momentum_sum] > limit[momentum_sum] ||
                          clock_.deposited[group_sum] > limit[group_sum];
        f.code = std::isfinite(f.value) ? "fixed-point" : "non-finite";
        f.message = !std::isfinite(f.value) ? "what particles deposit is not finite"
                    : grew
                        ? "what particles deposit grew more than 16-fold beyond that of the last "
                          "two steps and no longer fits its fixed-point scale"
                        : "the stress of a particle is so large for the time step that all "
                          "motion would round away beside it";
        return f;
    }
    if (clock_.fault == FaultKind::crowded) {
        f.code = "crowded-node";
        f.message =
            "more bodies with fields of velocities of their own meet at a node than contact "
            "keeps apart";
        return f;
    }
    if (clock_.fault_particle == fault_elsewhere) return f;
    const std::size_t b = clock_.fault_particle >> 40;
    if (clock_.fault == FaultKind::smoothing) {
        f.body = bodies_.at(b).plan.name;
        f.code = std::isfinite(f.value) ? "smoothing-energy" : "non-finite";
        f.message = std::isfinite(f.value)
                        ? "smoothing over cells has added energy to the field that it smooths"
                        : "what smoothing over cells has found is not finite";
        return f;
    }
    const std::size_t k = clock_.fault_particle & ((std::uint64_t(1) << 40) - 1);
    Body& body = bodies_.at(b);
    f.body = body.plan.name;
    --f.step;  // found by the step after
    std::uint32_t id = 0;
    exec_.download(&id, body.id.data() + k, sizeof id);
    f.ids = {body.first_id + id};
    if (clock_.fault == FaultKind::smoothing_range) {
        ++f.step;  // found at once
        f.code = "smoothing-range";
        f.message =
            "the field that is smoothed is larger than sums of smoothing over cells can hold on "
            "a device";
        for (auto& column : body.state) {
            T x;
            exec_.download(&x, column.data() + k, sizeof x);
            if (std::isfinite(double(x))) continue;
            f.code = "non-finite";
            f.message = "what it stores is not finite";
        }
        return f;
    }
    f.code = "inverted";
    double furthest = 0;
    for (auto& column : body.offset) {
        T x;
        exec_.download(&x, column.data() + k, sizeof x);
        if (!std::isfinite(double(x))) f.code = "non-finite";
        furthest = std::max(furthest, std::abs(double(x)));
    }
    std::vector<double> state;
    double widest = 0;  // half-edge of cpGIMP and CPDI
    for (auto& column : body.state) {
        T x;
        exec_.download(&x, column.data() + k, sizeof x);
        state.push_back(double(x));
        if (!std::isfinite(double(x))) f.code = "non-finite";
    }
    for (int a = 0; a < D && body.plan.phase.extent >= 0; ++a)
        widest = std::max(widest, body.plan.phase.kernel.half_edge *
                                      (1 + state[std::size_t(body.plan.phase.extent + a)]));
    bool flat = false;
    if (body.plan.phase.edges >= 0) {
        const auto edges = half_edges_at<D>(body.plan.phase, [&](int r) { return state[r]; });
        for (int a = 0; a < D; ++a) widest = std::max(widest, reach_along(edges, a));
        flat = !(determinant(edges, cofactors(edges)) > 0);
    }
    const std::string follows =
        std::string("its edges, which kernel '") + name_of(spec_.kernel.kernel) + "' follows, ";
    if (widest > largest_half_edge && f.code != "non-finite") {
        f.code = "stretched";
        f.value = 2 * widest;
        f.message = follows + "grew beyond three cells";
    } else if (flat && f.code != "non-finite") {
        f.code = "stretched";
        f.message = follows + "enclose no volume any more";
    } else if (f.code == "non-finite") {
        f.message = "its position or state is not finite";
    } else if (furthest > 1.75) {
        f.code = "outran-cell";
        f.value = furthest;
        f.message = "it moved further than the step can see";
    } else {
        f.code = body.material->volumetric ? "compressed" : "inverted";
        f.value = state.empty() ? 0 : state[0];
        f.message = body.material->limits;
    }
    return f;
}

}  // namespace mpm
