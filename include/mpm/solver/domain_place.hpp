// Domain: particles into cells, and the sums that the first step reads.
#pragma once

#include "mpm/kernels/placing.hpp"
#include "mpm/kernels/respond.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

/// Rows of positions that are held at a time.
inline constexpr std::uint64_t piece_rows = std::uint64_t(1) << 22;

/// Calls f(first, rows, position on the device) for the particles of a body.
template <class X, class F>
void for_each_piece(X& exec, const Rows& rows, std::uint64_t count, int width, const F& f) {
    Buffer<X, double> there(exec);
    std::vector<double> here;
    for (std::uint64_t first = 0; first < count; first += piece_rows) {
        const std::uint64_t n = std::min(piece_rows, count - first);
        here.resize(n * width);
        rows(first, first + n, here.data());
        there.assign(here);
        f(first, std::int64_t(n), there.data());
    }
}

/// The fields of velocities of a body's rows, where the executor sees them.
template <class X>
class BodyFields {
public:
    BodyFields(X& exec, const BodySpec& body) : first_(exec), field_(exec), ids_(exec) {
        if (body.fields.empty()) return;
        std::vector<std::uint64_t> first;
        std::vector<std::int32_t> field;
        for (const FieldOfIds& f : body.fields) {
            first.push_back(f.first);
            field.push_back(f.field);
        }
        first_.assign(first);
        field_.assign(field);
        if (!body.ids.empty()) ids_.assign(body.ids);
        count_ = int(first.size());
    }
    FieldsView view() {
        return {first_.data(), field_.data(), count_, ids_.size() > 0 ? ids_.data() : nullptr};
    }

private:
    Buffer<X, std::uint64_t> first_;
    Buffer<X, std::int32_t> field_;
    Buffer<X, std::uint32_t> ids_;
    int count_ = 0;
};

template <class X, class T, int D>
void Domain<X, T, D>::place_particles(const Spec& spec) {
    find_blocks(spec);
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        place_body(bodies_[b], spec.bodies[b]);
        exec_.trim();
    }
}

/// The table: blocks that hold particles, and their neighbours.
template <class X, class T, int D>
void Domain<X, T, D>::find_blocks(const Spec& spec) {
    Buffer<X, std::uint64_t> keys(exec_), first_outside(exec_);
    Buffer<X, std::uint32_t> outside(exec_);
    std::vector<std::uint64_t> homes;
    for (const BodySpec& s : spec.bodies) {
        BodyFields<X> fields(exec_, s);
        outside.assign({0});
        first_outside.assign({~std::uint64_t(0)});
        for_each_piece(
            exec_, s.position, s.count, D,
            [&](std::uint64_t first, std::int64_t n, const double* position) {
                keys.reserve_discard(n);
                FindBlocks<X, D> find{position,
                                      spec.cell_size,
                                      {},
                                      table_.keys_of,
                                      first,
                                      keys.data(),
                                      outside.data(),
                                      first_outside.data(),
                                      fields.view()};
                for (int a = 0; a < D; ++a) find.cells[a] = spec.cells[a];
                exec_.for_each(n, find);
                keys.shrink(std::size_t(exec_.sort_unique(keys.data(), n, table_.keys_of.bits())));
                const auto found = keys.host();
                homes.insert(homes.end(), found.begin(), found.end());
            });
        const std::uint32_t n = outside.host()[0];
        if (n > 0) {
            throw SceneError("body '" + s.name + "': " + std::to_string(n) +
                             " particles lie outside the domain, the first with id " +
                             std::to_string(s.first_id + first_outside.host()[0]) +
                             ". Enlarge the domain or move the body");
        }
    }
    std::sort(homes.begin(), homes.end());
    homes.erase(std::unique(homes.begin(), homes.end()), homes.end());
    keys.assign(homes);
    if (!share_ || !spec_.contact.any()) return blocks_.make(keys);
    if constexpr (X::is_device) {
        Buffer<X, std::uint64_t> table(exec_);
        blocks_.neighbourhood(keys, table);
        hold_fields_of_devices(table);
        blocks_.adopt(table);
    } else {
        blocks_.make(keys);
        auto tables = gather_tables(blocks_.keys());
        hold_all_fields(tables);
        blocks_.assign(tables[std::size_t(share_->rank())]);
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::place_body(Body& body, const BodySpec& s) {
    body.count = std::uint32_t(s.count);
    const std::size_t room = s.count + column_padding;
    for (int a = 0; a < D; ++a) {
        body.offset.emplace_back(exec_);
        body.offset.back().reserve_discard(room);
    }
    for (int r = 0; r < body.plan.state_columns; ++r) {
        body.state.emplace_back(exec_);
        body.state.back().reserve_discard(room);
        body.state.back().zero();
    }
    body.id.reserve_discard(room);
    if constexpr (X::is_device) body.cell.reserve_discard(room);
    Buffer<X, std::uint32_t> cell(exec_);
    cell.reserve_discard(room);
    cell.shrink(s.count);
    BodyFields<X> fields(exec_, s);
    for_each_piece(exec_, s.position, s.count, D,
                   [&](std::uint64_t first, std::int64_t n, const double* position) {
                       PlaceParticles<T, D> place{position,
                                                  spec_.cell_size,
                                                  {},
                                                  table_,
                                                  {},
                                                  cell.data() + first,
                                                  body.id.data() + first,
                                                  std::uint32_t(first),
                                                  fields.view()};
                       for (int a = 0; a < D; ++a) {
                           place.cells[a] = spec_.cells[a];
                           place.offset[a] = body.offset[a].data() + first;
                       }
                       exec_.for_each(n, place);
                   });
    if (!s.ids.empty()) exec_.upload(body.id.data(), s.ids.data(), s.count * sizeof s.ids[0]);
    if (s.state) {
        // A body that begins here is given what its material stores, the first of what it keeps.
        const std::size_t width = std::size_t(s.state_width);
        if (s.restored ? width != body.state.size() : width > body.state.size())
            throw SceneError("body '" + s.name + "' has " + std::to_string(s.state_width) +
                             " numbers a particle to begin with; this run stores " +
                             std::to_string(body.state.size()));
        std::vector<double> rows;
        std::vector<T> column;
        for (std::uint64_t first = 0; first < s.count; first += piece_rows) {
            const std::uint64_t n = std::min(piece_rows, s.count - first);
            rows.resize(n * width);
            column.resize(n);
            s.state(first, first + n, rows.data());
            for (std::size_t r = 0; r < width; ++r) {
                for (std::uint64_t k = 0; k < n; ++k) column[k] = T(rows[k * width + r]);
                exec_.upload(body.state[r].data() + first, column.data(), n * sizeof(T));
            }
        }
    }
    set_pressure(body, s, 0);
    const std::int64_t range = std::int64_t(table_.slots) * block_cells;
    body.cell_start.reserve_discard(range + 2);
    arrange(exec_, cell, range, body.id.data(), body.cell_start.data(), body.cell.data(),
            body.order);
    permute(body, cell.data());
}

/// The states of the particles from `at` on that stand for the pressures they are given, if any.
template <class X, class T, int D>
void Domain<X, T, D>::set_pressure(Body& body, const BodySpec& s, std::uint32_t at) {
    if (!s.pressure) return;
    std::vector<double> pressure;
    std::vector<T> j;
    const int volumes = body.plan.smoothing == Smoothing::two_volumes ? 2 : 1;
    for (std::uint64_t first = 0; first < s.count; first += piece_rows) {
        const std::uint64_t n = std::min(piece_rows, s.count - first);
        pressure.resize(n);
        j.resize(n);
        s.pressure(first, first + n, pressure.data());
        in_parallel(n, 1u << 14, [&](std::uint64_t from, std::uint64_t to) {
            for (std::uint64_t k = from; k < to; ++k)
                j[k] = T(body.material->volume_from_pressure(pressure[k], s.parameters.data()));
        });
        for (int r = 0; r < volumes; ++r)
            exec_.upload(body.state[std::size_t(r)].data() + at + first, j.data(), n * sizeof(T));
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::first_deposit(const Spec& spec) {
    const std::int32_t slots = table_.slots + (share_ ? share_->staged : 0);
    for (auto& s : sums_) {
        s.reserve_discard(std::size_t(slots) * plan_.sum_channels * block_cells);
        s.zero();
    }
    if (share_) link_sums();
    const auto everyone = [](const BodySpec&) { return true; };
    if (spec.start.given)
        start_from(spec);
    else
        deposit(spec, everyone, clock_.dt);
}

/// What the gradients of the bodies' velocities can add to that of a node, at most.
template <class X, class T, int D>
double Domain<X, T, D>::steepest_deposit(const Spec& spec) const {
    double most = 0;
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        const PhaseNumbers& n = bodies_[b].plan.phase;
        const std::vector<double>& gradient = spec.bodies[b].velocity_gradient;
        if (!n.scheme.affine || bodies_[b].rigid >= 0) continue;
        const double reach = DepositBound::of(n.kernel, n.kernel.half_edge).reach;
        for (std::size_t row = 0; row < gradient.size(); row += D) {
            double slope = 0;
            for (std::size_t a = 0; a < D; ++a) slope += std::abs(gradient[row + a]);
            most = std::max(most, reach * slope * spec_.cell_size);
        }
    }
    return most;
}

/// Fills the sums with what the chosen bodies deposit, their stress for a step of `dt`.
template <class X, class T, int D>
template <class Chosen>
void Domain<X, T, D>::deposit(const Spec& spec, const Chosen& chosen, double dt) {
    std::vector<BodyNumbers> numbers;
    for (const BodyConstants& body : constants_.host())
        numbers.push_back(body_numbers(body, spec_.cell_size, clock_.dt, dt));
    numbers_.assign(numbers);
    sums_[parity()].zero();
    const double tilt = steepest_deposit(spec);
    if constexpr (!std::is_integral_v<Sum>) {
        deposit_all(spec, chosen, tilt > 0);
        if (share_) end_of_sums(parity(), tilt > 0 ? Added::tilted : Added::at_rest);
    } else {
        // Once to learn what is deposited, with a mass that cannot be exceeded: all particles of a
        // node's 3^D cells, each with the largest weight.
        Buffer<X, double> found(exec_);
        found.reserve_discard(1);
        double mass = 0;
        for (std::size_t b = 0; b < bodies_.size(); ++b) {
            if (!chosen(spec.bodies[b])) continue;
            const Body& body = bodies_[b];
            exec_.template max_each<1>(std::int64_t(table_.slots) * block_cells,
                                       MostOfCell{body.cell_start.data()}, Keep{found.data()});
            const double widths = body.plan.any_transfer()
                                      ? std::pow(kernel_width(spec_.kernel.kernel), D)
                                      : stencil_nodes<D> * std::pow(0.75, D);
            mass += body.particle_mass * std::max(largest_of_all(found.host()[0]), 1.0) * widths;
        }
        set_scales(std::max(mass, least_mass_) + inflow_.mass(), 1, 1);
        meet_hosts();
        deposit_all(spec, chosen, tilt > 0);
        share_deposits(parity());
        exec_.template max_each<1>(std::int64_t(table_.slots) * block_cells,
                                   LargestNodeMass<Grid, Sum, D>{node_update(parity())},
                                   Keep{found.data()});
        const double heaviest = largest_of_all(found.host()[0]);
        fetch_clock();
        const double calm = 1e-6 * plan_.wave_speed,
                     momentum = largest_of_all(clock_.deposited[momentum_sum]) + tilt,
                     group = largest_of_all(clock_.deposited[group_sum]);
        set_scales(std::max(heaviest, least_mass_) + inflow_.mass(), 2 * std::max(momentum, calm),
                   2 * std::max(group, 1e-7));
        sums_[parity()].zero();
        meet_hosts();
        deposit_all(spec, chosen, tilt > 0);
        share_deposits(parity());
        fetch_clock();
        if (tilt > 0) {
            clock_.deposited[momentum_sum] += tilt;
            push_clock();
        }
    }
}

/// The sums of a run that goes on from another: restored bodies carry that run's nodal velocities
/// and averages on the mass that their particles have now, so that taking particles out or adding
/// others leaves the motion of the rest as it was. New bodies deposit as at any start.
template <class X, class T, int D>
void Domain<X, T, D>::start_from(const Spec& spec) {
    const StartSpec& start = spec.start;
    const std::size_t nodes = start.cell.size() / D,
                      stride = std::size_t(plan_.sum_channels) * block_cells;
    const auto restored = [](const BodySpec& b) { return b.restored; };
    const auto fresh = [](const BodySpec& b) { return !b.restored; };

    // What particles store of their velocity they keep through the deposits below.
    std::vector<std::vector<T>> stored;
    const auto each_stored = [&](const auto& f) {
        for (std::size_t b = 0, k = 0; b < bodies_.size(); ++b) {
            const int first = bodies_[b].plan.phase.velocity;
            for (int a = 0; a < D && first >= 0 && spec.bodies[b].restored; ++a, ++k)
                f(k, bodies_[b].state[std::size_t(first + a)], bodies_[b].count);
        }
    };
    each_stored(
        [&](std::size_t, auto& column, std::size_t n) { stored.push_back(column.host(n)); });
    // The velocities hold the stress of a step as long as that run's was. Restored bodies rest in
    // this deposit, so their momentum is what their stress does in the difference.
    deposit(spec, restored, clock_.dt - start.time_step);
    std::vector<double> sums = sums_as_numbers(sums_[parity()].host());
    std::vector<const std::vector<double>*> averages;
    for (const GroupChannels& g : plan_.groups) {
        const auto found = start.averages.find(plan_.channels[g.sum]);
        averages.push_back(found == start.averages.end() ? nullptr : &found->second);
    }
    // Velocities before forces, which transfers with a memory compare with those after them.
    std::vector<const std::vector<double>*> plain;
    for (int a = 0; a < D && plan_.kept.plain >= 0; ++a) {
        const auto found = start.averages.find(plan_.channels[std::size_t(plan_.kept.plain + a)]);
        if (found == start.averages.end())
            throw SceneError(
                "transfer '" + spec.transfer.scheme +
                "' stores velocities of particles, which the checkpoint's run did not; "
                "go on with the transfer of that run");
        plain.push_back(&found->second);
    }
    const auto keys = blocks_.keys().host();
    for (std::size_t k = 0; k < nodes; ++k) {
        std::int64_t block[D];
        int at[D];
        for (int a = 0; a < D; ++a) {
            const std::int64_t c = start.cell[k * D + a] + Block<D>::edge * BlockKeys<D>::rim;
            block[a] = c / Block<D>::edge - BlockKeys<D>::rim;
            at[a] = int(c % Block<D>::edge);
        }
        const std::uint64_t key = table_.keys_of.key(block);
        // Each field of velocities takes the node's on its own mass; none where all were taken out.
        for (auto at_key = std::lower_bound(keys.begin(), keys.end(), key);
             at_key != keys.end() && table_.keys_of.of_block(*at_key) == key; ++at_key) {
            double* s =
                sums.data() + std::size_t(at_key - keys.begin()) * stride + Block<D>::cell(at);
            for (int a = 0; a < D; ++a)
                s[(1 + a) * block_cells] += start.velocity[k * D + a] * s[0];
            for (std::size_t a = 0; a < plain.size(); ++a)
                s[(std::size_t(plan_.kept.plain) + a) * block_cells] = (*plain[a])[k] * s[0];
            for (std::size_t g = 0; g < averages.size(); ++g) {
                if (averages[g] == nullptr) continue;
                const GroupChannels& c = plan_.groups[g];
                s[c.sum * block_cells] =
                    (*averages[g])[k] * s[c.weight >= 0 ? c.weight * block_cells : 0];
            }
        }
    }

    deposit(spec, fresh, clock_.dt);
    const std::vector<double> added = sums_as_numbers(sums_[parity()].host());
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += added[k];
    adopt_sums(sums);
    each_stored([&](std::size_t k, auto& column, std::size_t n) {
        exec_.upload(column.data(), stored[k].data(), n * sizeof(T));
    });
    push_clock();
}

/// Sums in the units of this moment's clock.
template <class X, class T, int D>
std::vector<double> Domain<X, T, D>::sums_as_numbers(const std::vector<Sum>& sums) const {
    std::vector<double> out(sums.size());
    for (std::size_t k = 0; k < out.size(); ++k)
        out[k] = from_sum<double>(sums[k], clock_.unit_read[scale_of_sum(k)]);
    return out;
}

/// Takes numbers for sums, on this backend's scale.
template <class X, class T, int D>
void Domain<X, T, D>::adopt_sums(const std::vector<double>& value) {
    std::vector<Sum> sums(value.size());
    if constexpr (std::is_integral_v<Sum>) {
        double top[quantities] = {};
        for (std::size_t k = 0; k < value.size(); ++k) {
            double& most = top[scale_of_sum(k)];
            if (!(std::abs(value[k]) <= most)) most = std::abs(value[k]);  // not-a-number stays
        }
        for (double& most : top) most = largest_of_all(most);
        // A layer of an inlet may come before the clock has chosen scales.
        top[mass_sum] += inflow_.mass();
        for (const InletSpec& inlet : spec_.inlets)
            for (double v : inlet.velocity.value)
                top[momentum_sum] = std::max(top[momentum_sum], top[mass_sum] * std::abs(v));
        for (int q = 0; q < quantities; ++q) {
            double scale = 1;
            if (top[q] > 0)
                scale = power_of_two_below(std::ldexp(1.0, X::template sum_bits<T> - 2) / top[q]);
            // The largest deposit is not known; no less than this by the largest sum.
            const double known = deposit_growth * top[q] / top[mass_sum];
            if (q != mass_sum && top[mass_sum] > 0 && !(known <= clock_.deposited[q]))
                clock_.deposited[q] = known;  // not-a-number too: the clock refuses it
            clock_.deposit_limit[q] = std::numeric_limits<double>::infinity();
            clock_.unit_read[q] = 1 / scale;
            clock_.scale_write[q] = scale;
        }
        for (std::size_t k = 0; k < value.size(); ++k)
            sums[k] = Sum(std::llrint(value[k] * clock_.scale_write[scale_of_sum(k)]));
    } else {
        for (std::size_t k = 0; k < value.size(); ++k) sums[k] = Sum(value[k]);
    }
    sums_[parity()].assign(sums);
    sums_[1 - parity()].reserve_discard(sums.size());
}

template <class X, class T, int D>
void Domain<X, T, D>::set_scales(double mass, double momentum_limit, double group_limit) {
    if constexpr (std::is_integral_v<Sum>) {
        const FixedPoint f =
            fixed_point(X::template sum_bits<T>, mass, momentum_limit, group_limit);
        for (int q = 0; q < quantities; ++q) {
            clock_.scale_write[q] = f.scale[q];
            clock_.unit_read[q] = 1 / f.scale[q] + 0 * f.limit[q];  // keeps not-a-number
            clock_.deposit_limit[q] = f.limit[q];
            clock_.deposited[q] = clock_.deposited_before[q] = 0;
        }
    }
}

template <class X, class T, int D>
template <class Chosen>
void Domain<X, T, D>::deposit_all(const Spec& spec, const Chosen& chosen, bool tilted) {
    push_clock();
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        if ((body.homes == 0 && !meets_over_cells(body)) || !chosen(spec.bodies[b])) continue;
        const BodySpec& s = spec.bodies[b];
        deposit_body(body, int(b), s.velocity, s.velocity_gradient, tilted, parity());
    }
    if constexpr (!X::is_device) {
        if (share_ && stresses_apart()) end_of_sums(parity(), Added::at_rest);  // masses
    }
    for (std::size_t b = 0; stresses_apart() && b < bodies_.size(); ++b) {
        if (bodies_[b].homes == 0 || !chosen(spec.bodies[b])) continue;
        deposit_stresses(bodies_[b], int(b), parity());
        bodies_[b].scratch = Buffer<X, Grid>(exec_);
    }
}

/// Adds what the particles of one body deposit with these velocities to the sums of that parity,
/// their stresses where these are not apart. Where the transfer is affine, what they are given of
/// their velocity's gradient is deposited too: without it a turning body loses dx^2 / R^2 of its
/// rate. `tilted` says that any body of this deposit is given one; all then add up by the second
/// half of the two-pass form, whose order of sums is that of every rank.
template <class X, class T, int D>
void Domain<X, T, D>::deposit_body(Body& body, int number, const std::vector<double>& velocity,
                                   const std::vector<double>& gradient, bool tilted, int to) {
    if (body.rigid >= 0) {
        reserve_scratch(body);
        const Phase<X, T, D> p = phase(body, number, to);
        place_rigid(body, p, true);
        phase_ops_.spread(p);
        body.scratch = Buffer<X, Grid>(exec_);
        return;
    }
    const std::size_t n = body.count;
    const bool phases = body.plan.any_transfer(), by_columns = phases || tilted;
    if (by_columns)
        reserve_scratch(body);
    else
        body.scratch.reserve_discard(n * D + column_padding);
    Buffer<X, Grid> given(exec_);
    std::vector<Grid> piece;
    // Number `at` of so many a particle, or for all, into a column of scratch.
    const auto fill = [&](const std::vector<double>& numbers, int width, int at, int column,
                          double scale) {
        Grid* to = body.scratch.data() + std::size_t(column) * n;
        if (numbers.size() == std::size_t(width)) {
            exec_.for_each(std::int64_t(n),
                           Constant<Grid>{Grid(scale * numbers[std::size_t(at)]), to});
            return;
        }
        // By id: of all particles of the body, also where a rank has some of them.
        piece.resize(numbers.size() / std::size_t(width));
        for (std::size_t k = 0; k < piece.size(); ++k)
            piece[k] = Grid(scale * numbers[k * std::size_t(width) + std::size_t(at)]);
        given.assign(piece);
        exec_.for_each(std::int64_t(n), Take<Grid>{body.id.data(), given.data(), to});
    };
    for (int a = 0; a < D; ++a) fill(velocity, D, a, a, 1);
    rest_pinned(body);
    if (by_columns) {
        const Phase<X, T, D> p = phase(body, number, to);
        body.ops.rest(p);
        if (body.mesh) locate_elements(body, number);
        const Scratch<D> column{p.n.channels};
        const bool affine = !gradient.empty() && p.n.scheme.affine;
        for (int c = 0; c < D && affine; ++c)
            for (int a = 0; a < D; ++a)
                fill(gradient, D * D, c * D + a, column.slope(a, c), spec_.cell_size);
        after_respond(body, p);
        if constexpr (!X::is_device) {
            if (!phases) {
                for (int c = 0; c < D; ++c)
                    for (int a = 0; a < D; ++a)
                        exec_.for_each(
                            std::int64_t(n),
                            AddStress<Grid>{p.pass.scratch + std::size_t(column.stress(a, c)) * n,
                                            p.pass.scratch + std::size_t(column.slope(a, c)) * n});
                body.ops.scatter(p.pass);
            }
        }
        if (phases || X::is_device) spread_body(body, p, false);
    } else {
        body.ops.initial(pass(body, number, to));
    }
    exec_.wait();
    if (!stresses_apart()) body.scratch = Buffer<X, Grid>(exec_);
}

}  // namespace mpm
