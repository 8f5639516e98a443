// Domain: the life of a step, and what happens when the clock halts.
#pragma once

#include "mpm/kernels/pinned_vertices.hpp"
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
    p.destinations =
        stages ? share_->destinations[std::size_t(number)].data() : blocks_.neighbours().data();
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
    const Decide<D> decide{
        clock_buffer_.data(), spec_.cell_size,    constants_.data(), numbers_.data(),
        int(bodies_.size()),  sensors_.records(), sensors_.count(),  bits,
        least_mass_,          plan_.wave_speed,   plan_.beyond,      inflow_.records(),
        inflow_.count(),      inflow_.mass(),     plan_.shift,       drives_.data(),
        int(drives_.size())};
    if constexpr (X::is_device) {
        if (share_) {
            make_velocities(AfterGrid<D>::telling(
                {clock_buffer_.data(), boxes_.data(), share_->rank(), int(boxes_.size())}));
            share_told(votes_);
            exec_.single(DecideByVotes<D>{decide, clock_buffer_.data(), votes_.data(),
                                          share_->ranks(), sensors_.moments(sampling_)});
            return;
        }
        make_velocities(AfterGrid<D>::deciding(decide, sensors_.moments(sampling_)));
    } else {
        if (share_)
            return make_velocities(
                DecideTogether<D>{decide, clock_buffer_.data(), share_.get(), now()});
        // A run that ended at this step has made them; what it lacked was leave to go on.
        if (!std::exchange(velocities_wait_, false))
            make_velocities([&](const double* maxima) {
                std::copy(maxima, maxima + maxima_count, maxima_.begin());
            });
        decide(maxima_.data());
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::run_sensors() {
    if (sensors_.count() == 0) return;
    const auto node = node_update(parity());
    Clock* clock = clock_buffer_.data();
    const SamplePoints<Grid, Sum, D> points = sample_points();
    const bool loads = sensors_.load_count() > 0;
    const bool lifts = uplift_.any() && (loads || sensors_.contact_count() > 0 || rigid_.any());
    if (lifts) uplift_.raise(node, boundaries_);
    if (loads && contact_blocks_ > 0)
        exec_.template sum_each<load_columns<D>>(
            sensors_.measured(),
            MeasureLoads<Grid, Sum, D, true>{node, sensors_.measured_slots(), sensors_.load_cells(),
                                             sensors_.scales(), boundaries_.known(), wall_seats(),
                                             contact_view()},
            sensors_.take_load(clock), sensors_.load_partial(), 0, Nothing{});
    const int points_here = share_ || !sampling_ ? 0 : sensors_.point_count();
    if ((loads || points_here > 0) && contact_blocks_ == 0) {
        exec_.template sum_each<load_columns<D>>(
            sensors_.measured(),
            MeasureLoads<Grid, Sum, D>{node, sensors_.measured_slots(), sensors_.load_cells(),
                                       sensors_.scales(), boundaries_.known(), wall_seats()},
            sensors_.take_load(clock), sensors_.load_partial(), points_here, points);
    } else if (points_here > 0) {
        exec_.for_each_large(points_here, points);
    }
    if (sensors_.contact_count() > 0)
        exec_.template sum_each<contact_columns<D>>(
            sensors_.met(),
            MeasureContacts<Grid, Sum, D>{{node, contact_view(), boundaries_.known()},
                                          sensors_.met_blocks(),
                                          sensors_.contact_loads(),
                                          sensors_.contact_sides(),
                                          sensors_.scales()},
            sensors_.take_contact(clock), sensors_.contact_partial(), 0, Nothing{});
    tell_rigid_loads();
    if (lifts) {
        uplift_.lower(node, boundaries_);
        if (loads)
            exec_.template sum_each<load_columns<D>>(
                sensors_.measured(),
                uplift_.measured(node, boundaries_, sensors_.measured_slots(),
                                 sensors_.load_cells(), sensors_.scales()),
                AddToLoad<D>{sensors_.take_load(clock).impulse}, sensors_.load_partial(), 0,
                Nothing{});
    }
    if (!sampling_) return;
    run_tallies();
    if (share_) {
        if constexpr (X::is_device)
            tell_points();
        else
            sample_points_together(points);
    }
    for (int k = 0; k < sensors_.count(); ++k) {
        Sensor<Base>& s = sensors_.at(k);
        SensorRecord* record = sensors_.records() + k;
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
        if (s.spec.kind == SensorKind::pin_force)
            exec_.single(SamplePin<D>{clock, record, sensors_.scales().impulse, s.pin_told.data()});
        if constexpr (!X::is_device) {
            if (s.spec.kind == SensorKind::rigid_motion) sample_rigid(s, *record);
        }
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::sample_energy(Sensor<Base>& s, SensorRecord* record) {
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
        if (bodies_[b].homes > 0 && bodies_[b].rigid >= 0) {
            add_rigid_energy(bodies_[b], &record->due, partial);
        } else if (bodies_[b].homes > 0 && bodies_[b].plan.any_transfer()) {
            reserve_deposits(bodies_[b]);
            Phase<X, T, D> p = phase(bodies_[b], int(b), parity());
            p.due = &record->due;
            p.part = Part::speeds;
            if (p.n.velocity < 0) phase_ops_.collect(p);
            if (Body& body = bodies_[b]; body.mesh) {
                locate_elements(body, int(b));
                body.elements.energies(p, body.mesh->view(), &record->due, body.mesh->energy(),
                                       partial);
            } else {
                body.ops.phase_energies(p, &record->due, partial);
            }
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
    const std::size_t columns = std::size_t(deposit_columns(D, body.plan));
    if (columns > 0) body.scratch.reserve_discard(columns * body.count + column_padding);
}

/// Devices: blocks of threads whose last one of a step turns the clock.
template <class X, class T, int D>
std::uint64_t Domain<X, T, D>::workers_of(const Body& body) const {
    switch (body.plan.pipeline) {
        case Pipeline::phased:
            return std::uint64_t(body.homes);
        case Pipeline::two_pass:
            return std::uint64_t(body.homes) * (std::uint64_t(body.ops.channels) + 1);
        case Pipeline::two_pass_keeping:
            return std::uint64_t(body.homes) * (std::uint64_t(body.ops.channels) + 1 + D);
        default:
            return std::uint64_t(body.pairs > 0 ? body.pairs : body.full_homes) +
                   std::uint64_t(lone_blocks(body.lone_count));
    }
}

/// The particles' half of a step, each body by its own pipeline.
template <class X, class T, int D>
void Domain<X, T, D>::run_bodies() {
    spread_packed();
    std::vector<std::size_t> moving;
    std::uint64_t workers = 0;
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        if (bodies_[b].homes == 0 && !meets_over_cells(bodies_[b])) continue;
        moving.push_back(b);
        reserve_deposits(bodies_[b]);
        workers += workers_of(bodies_[b]);
    }
    collect_bodies(moving);
    move_vertices(moving);
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
            (body.order == HomeOrder::by_chunk ? body.ops.split : body.ops.fused)(p.pass);
            if (body.lone_count > 0) body.ops.lone(p.pass);
            break;
        case Pipeline::keeping:
            (body.order == HomeOrder::by_chunk ? body.ops.split_keep : body.ops.keep)(p);
            break;
        case Pipeline::two_pass_keeping:
            body.ops.keep(p);
            break;
        case Pipeline::two_pass:
            body.ops.gather(p.pass);
            body.ops.scatter(p.pass);
            break;
        case Pipeline::phased:
            if (body.rigid >= 0) {
                move_rigid(body, p);
                break;
            }
            p.turns = true;
            if (!body.mesh) {  // vertices have moved
                body.ops.respond(p);
                after_respond(body, p);
            }
            spread_body(body, p, true);
            break;
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::one_step() {
    if constexpr (X::is_device) {
        sampling_ = expected_.next();
        update_grid();
        run_sensors();
        run_bodies();
        if (share_) {
            share_sums();
            if (sampling_) sample_told_points();
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
        exec_.single(EndStep{clock_buffer_.data(), spec_.cell_size, plan_.shift});
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
    const GiveUp on_failure{meeting_.get()};
    velocities_made_ = false;
    tallies_.stale = true;  // readers may have given particles other numbers
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
            if (inflow_.any()) n = std::min(n, inflow_.steps_to_next(X::batch));
            if (clock_.steps_left >= 0) n = std::min<std::int64_t>(n, clock_.steps_left + 1);
            if (std::isfinite(until)) {
                n = std::int64_t(std::min(
                    double(n), std::floor(std::max(0.0, until - clock_.time) / clock_.dt) + 2));
            }
            bool wall_over = false;
            // What is uploaded waits for all that is queued: now that is nothing.
            if (tallies_.any()) list_tallied();
            if (share_) {
                // Nobody asks for memory while another rank's kernels wait.
                for (Body& body : bodies_) {
                    reserve_deposits(body);
                    if (body.plan.cells.smooths()) reserve_smoothing(body);
                }
                run_together(n, wall_over);
            }
            const double t0 = now();
            exec_.single(begin_step());
            expected_.read(clock_);
            const std::int64_t before = clock_.step;
            for (std::int64_t k = 0; k < std::max<std::int64_t>(n, 1); ++k) one_step();
            if (share_) meeting_->wait();
            fetch_clock();
            collect_smoothing();
            if (share_) {
                const auto done = std::uint64_t(clock_.step - before);
                share_->bytes_of_sums += done * share_->bytes_a_step;
                share_->bytes_of_vertices += done * share_->vertices_a_step;
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
            sensors_.collect();
            expected_.missed = true;
            clock_.halt = Halt::none;
            push_clock();
        } else if (clock_.halt == Halt::until || clock_.halt == Halt::steps) {
            result.reason = clock_.halt == Halt::until ? "until" : "steps";
            // On a device sweeps of launches that found the clock halted are left half done.
            velocities_made_ = !X::is_device || plan_.sweep.residual <= 0;
            velocities_wait_ = !X::is_device && !share_ && !rigid_.any();
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
    prepare_swept_velocities();
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

/// What a fault says of the particle that it names is in its columns.
template <class X, class T, int D>
Fault Domain<X, T, D>::describe_fault() {
    const auto describe = [&](std::size_t number, std::size_t place) {
        const Body& body = bodies_.at(number);
        FailedParticle out;
        std::uint32_t id = 0;
        exec_.download(&id, body.id.data() + place, sizeof id);
        out.id = body.first_id + id;
        const auto read = [&](const std::vector<Buffer<X, T>>& columns) {
            std::vector<double> numbers;
            for (const auto& column : columns) {
                T x;
                exec_.download(&x, column.data() + place, sizeof x);
                numbers.push_back(double(x));
            }
            return numbers;
        };
        out.offset = read(body.offset);
        out.state = read(body.state);
        return out;
    };
    const Fault fault = mpm::describe_fault<D>(spec_, plan_, clock_, describe);
    if (clock_.fault == FaultKind::particle && clock_.fault_particle != fault_elsewhere) {
        Body& body = bodies_.at(std::size_t(clock_.fault_particle >> 40));
        if (body.mesh && body.mesh->inverted() != no_fault) return describe_element(body, fault);
    }
    return fault;
}

}  // namespace mpm
