// Domain: what readers ask for. Everything is computed on the host in double precision from copies,
// so looking never changes a run.
#pragma once

#include "mpm/kernels/reading.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

/// Nodal velocities of the state as it stands: the grid half of the coming step without its
/// consequences. They are already there when the last run ended at a halt of the clock; a sort or a
/// fresh load leaves them to be made.
template <class X, class T, int D>
void Domain<X, T, D>::prepare_velocities() {
    if (dead_) return;
    fetch_clock();
    if (velocities_made_) return;
    const Clock kept = clock_;
    clock_.halt = Halt::none;
    push_clock();
    exec_.single(begin_step());
    make_velocities(NothingAfter{});
    wait_for_sweeps();
    clock_ = kept;
    push_clock();
    velocities_made_ = true;
}

/// XPIC and FMPM sweep the grid for them with all ranks, while readers are each rank's own: what
/// leaves a new state makes them too.
template <class X, class T, int D>
void Domain<X, T, D>::prepare_swept_velocities() {
    if (!share_ || plan_.sweep.residual <= 0) return;
    const GiveUp on_failure{meeting_.get()};
    if constexpr (X::is_device) {
        // Nobody asks for memory while another rank's kernels wait.
        for (Body& body : bodies_) reserve_scratch(body);
        meet_hosts();
    }
    prepare_velocities();
}

template <class X, class T, int D>
std::vector<std::string> Domain<X, T, D>::attribute_names(int body) const {
    std::vector<std::string> names = {"id",     "position",       "velocity",       "mass",
                                      "volume", "density",        "pressure",       "stress",
                                      "speed",  "kinetic_energy", "elastic_energy", "volume_ratio"};
    names.push_back("velocity_gradient");
    const Body& b = bodies_.at(std::size_t(body));
    if (std::string(b.material->needs) == "deformation_gradient")
        names.push_back("deformation_gradient");
    if (b.material->plastic) names.push_back("plastic_strain");
    if (b.material->yields) names.push_back("yields");
    if (b.plan.smoothing == Smoothing::two_volumes) names.push_back("volume_ratio_smoothed");
    if (b.mesh) {
        // F is an element's.
        names.erase(std::remove(names.begin(), names.end(), "deformation_gradient"), names.end());
        names.erase(std::remove(names.begin(), names.end(), "yields"), names.end());
        for (const char* name :
             {"element_stress", "element_pressure", "element_volume_ratio", "element_energy"})
            names.push_back(name);
        if (b.material->plastic) names.push_back("element_plastic_strain");
    }
    return names;
}

template <class X, class T, int D>
Attributes Domain<X, T, D>::attributes(int number, const std::vector<std::string>& names,
                                       const Window& window) {
    Body& body = bodies_.at(std::size_t(number));
    const auto known = attribute_names(number);
    const auto asked = [&](const char* name) {
        return std::find(names.begin(), names.end(), name) != names.end();
    };
    for (const auto& n : names) {
        // Not for readers: what particles store, and which of them the run has set aside.
        if (n == "state" || n == "frozen") continue;
        if (std::find(known.begin(), known.end(), n) == known.end()) {
            std::string list;
            for (const auto& k : known) list += (list.empty() ? "" : ", ") + k;
            throw SceneError("body '" + body.plan.name + "' has no attribute '" + n + "'; it has " +
                             list);
        }
    }
    const bool moving = asked("velocity_gradient") || asked("velocity") || asked("speed") ||
                        asked("kinetic_energy") || asked("stress") || asked("pressure") ||
                        asked("yields");
    const bool constitutive = asked("volume") || asked("density") || asked("pressure") ||
                              asked("stress") || asked("elastic_energy") || asked("volume_ratio") ||
                              asked("deformation_gradient") || asked("plastic_strain") ||
                              asked("yields");
    const bool all = window.everywhere() || body.mesh != nullptr;
    const ParticleSnapshot<T, D> seen =
        all ? all_particles(body, blocks_)
            : particles_in(window, memory(), body, blocks_, spec_.cell_size);
    const std::size_t active = seen.count, n = active + body.frozen_id.size();

    Attributes out;
    out.id.resize(n);
    for (std::size_t k = 0; k < active; ++k) out.id[k] = body.first_id + seen.id[k];
    for (std::size_t k = active; k < n; ++k) out.id[k] = body.first_id + body.frozen_id[k - active];
    const auto make = [&](const char* name, std::size_t width, std::size_t rank) -> double* {
        if (!asked(name)) return nullptr;
        Array& a = out.values[name];
        a.shape = {n};
        for (std::size_t r = 0; r < rank; ++r) a.shape.push_back(D);
        a.data.assign(n * width, 0.0);
        return a.data.data();
    };
    double* position = make("position", D, 1);
    double* velocity = make("velocity", D, 1);
    double* mass = make("mass", 1, 0);
    double* volume = make("volume", 1, 0);
    double* density = make("density", 1, 0);
    double* pressure = make("pressure", 1, 0);
    double* stress = make("stress", D * D, 2);
    double* speed = make("speed", 1, 0);
    double* kinetic = make("kinetic_energy", 1, 0);
    double* elastic = make("elastic_energy", 1, 0);
    double* ratio = make("volume_ratio", 1, 0);
    double* gradient = make("deformation_gradient", D * D, 2);
    double* rates = make("velocity_gradient", D * D, 2);
    double* plastic = make("plastic_strain", 1, 0);
    double* yields = make("yields", 1, 0);
    double* smoothed = make("volume_ratio_smoothed", 1, 0);
    double* frozen = make("frozen", 1, 0);
    const std::size_t stored = std::size_t(body.plan.state_columns);
    double* raw = make("state", stored, 0);
    if (raw) out.values["state"].shape.push_back(stored);
    for (std::size_t k = active; frozen && k < n; ++k) frozen[k] = 1;

    if (moving) prepare_velocities();
    const bool some = moving && active > 0;
    const std::vector<Grid> grid =
        some ? values_of(memory(), velocity_, seen.nodes,
                         std::size_t(block_cells) * std::size_t(plan_.velocity_channels))
             : std::vector<Grid>();
    const std::vector<Sum> masses =
        some && stresses_apart()
            ? values_of(memory(), sums_[parity()], seen.nodes,
                        std::size_t(block_cells) * std::size_t(plan_.sum_channels))
            : std::vector<Sum>();
    const T* columns[max_state_columns] = {};
    for (std::size_t r = 0; r < seen.state.size(); ++r) columns[r] = seen.state[r].data();
    const double dx = spec_.cell_size, m = body.particle_mass, V = body.particle_volume;

    const auto observed = tally_body(body, LawByPointer<D>{body.ops.observe, body.ops.adopt});
    const auto fill = [&](std::size_t q, const double* x, const double* v,
                          const double(&rate)[D][D], const double* s) {
        double square = 0;
        for (int a = 0; a < D; ++a) {
            if (position) position[q * D + a] = x[a];
            if (velocity) velocity[q * D + a] = v[a];
            square += v[a] * v[a];
        }
        if (mass) mass[q] = m;
        if (speed) speed[q] = std::sqrt(square);
        if (kinetic) kinetic[q] = 0.5 * m * square;
        for (int k = 0; rates && k < D * D; ++k) rates[q * D * D + k] = rate[k / D][k % D];
        for (std::size_t r = 0; raw && r < stored; ++r) raw[q * stored + r] = s[r];
        if (smoothed) smoothed[q] = 1 - s[observed.reals];
        if (!constitutive) return;
        const Observation<D> o = observe_particle(observed, s, rate);
        const double J = o.volume_ratio;
        if (volume) volume[q] = V * J;
        if (density) density[q] = m / (V * J);
        if (ratio) ratio[q] = J;
        if (pressure) pressure[q] = o.pressure;
        if (elastic) elastic[q] = V * o.elastic_energy;
        if (plastic) plastic[q] = o.plastic_strain;
        if (yields) yields[q] = o.yields ? 1 : 0;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) {
                if (stress) stress[(q * D + a) * D + b] = o.stress[a][b];
                if (gradient) gradient[(q * D + a) * D + b] = o.deformation[a][b];
            }
    };

    exec_.host_for(std::int64_t(seen.home.size()), [&](std::int64_t h) {
        const std::int32_t home = seen.home[std::size_t(h)];
        std::int64_t block[D];
        table_.keys_of.block(seen.keys[std::size_t(home)], block);
        const std::uint32_t* of = seen.starts(home);
        HomeCells homes = seen.homes(home);
        for (std::uint32_t q = of[0]; q < of[block_cells]; ++q) {
            int at[D];
            Block<D>::coordinates(homes.of(q), at);
            double x[D], v[D] = {}, rate[D][D] = {}, s[max_state_columns];
            Vec<double, D> own;
            std::int32_t corner[D];
            for (int a = 0; a < D; ++a) {
                own[a] = double(seen.offset[std::size_t(a)][q]);
                corner[a] = std::int32_t(block[a] * Block<D>::edge);
                x[a] = (double(corner[a] + at[a]) + 0.5 + own[a]) * dx;
            }
            for (std::size_t r = 0; r < seen.state.size(); ++r) s[r] = double(seen.state[r][q]);
            if (moving) {
                const std::int32_t* around = seen.around(home);
                Standing<double, D> stands;
                stands.find(corner, at, own);
                const bool wide = kernel_width(spec_.kernel.kernel) != 3;
                const StoredNumbers<T> numbers{columns, q};
                const NodesAround<Grid> node{grid.data(), plan_.velocity_channels, around};
                particle_velocity<X::is_device, D>(body.plan.phase, wide, stands, numbers, node, v);
                if (constitutive || rates)
                    particle_rate<X::is_device, D>(
                        body.plan.phase, wide, stands, numbers, node,
                        HasMass<Sum>{masses.data(), plan_.sum_channels, around}, dx, rate);
            }
            fill(q, x, v, rate, s);
        }
    });
    const double still[D][D] = {}, rest[D] = {};
    for (std::size_t k = active; k < n; ++k) {
        fill(k, &body.frozen_position[(k - active) * D], rest, still,
             &body.frozen_state[(k - active) * std::size_t(body.plan.state_columns)]);
    }
    if (body.mesh) see_elements(body, number, names, out);
    return out;
}

/// The slots that a window touches, all fields of a block behind each other.
template <class X, class T, int D>
NodesSeen<typename Domain<X, T, D>::Sum> Domain<X, T, D>::nodes_in(const Window& window) {
    NodesSeen<Sum> out;
    const auto keys = blocks_.keys().host();
    out.slots = blocks_in<D>(window, table_.keys_of, keys, spec_.cell_size, 0);
    for (const std::int32_t slot : out.slots) out.keys.push_back(keys[std::size_t(slot)]);
    if (!out.slots.empty())
        out.sums = values_of(memory(), sums_[parity()], out.slots,
                             std::size_t(block_cells) * std::size_t(plan_.sum_channels));
    return out;
}

template <class X, class T, int D>
Array Domain<X, T, D>::grid(const std::string& name, const Window& window) {
    check_grid_attribute(name);
    if (name == "velocity")
        prepare_velocities();
    else
        fetch_clock();
    const NodesSeen<Sum> seen = nodes_in(window);
    const bool scalar = name == "mass";
    const std::size_t width = std::size_t(block_cells) * std::size_t(plan_.velocity_channels);
    const std::vector<Grid> velocity = name == "velocity" && !seen.slots.empty()
                                           ? values_of(memory(), velocity_, seen.slots, width)
                                           : std::vector<Grid>();
    Array out;
    std::size_t n = 0;
    for (std::size_t row = 0; row < seen.slots.size(); ++row) {
        if (!counts_slot(std::size_t(seen.slots[row]))) continue;
        const std::size_t end = end_of_fields(seen.keys, row);
        if (end == row) continue;
        std::int64_t block[D];
        table_.keys_of.block(seen.keys[row], block);
        for (int node = 0; node < block_cells; ++node) {
            double m = 0, mean[D] = {};
            int found = 0;
            for (std::size_t k = row; k < end; ++k) {
                const double own =
                    from_sum<double>(seen.sums[k * std::size_t(plan_.sum_channels) * block_cells +
                                               std::size_t(node)],
                                     clock_.unit_read[mass_sum]);
                if (!(own > negligible_mass<Grid> * least_mass_)) continue;
                m += own;
                ++found;
                if (velocity.empty()) continue;
                const Grid* u = &velocity[(k * block_cells + std::size_t(node)) *
                                          std::size_t(plan_.velocity_channels)];
                for (int a = 0; a < D; ++a)
                    mean[a] =
                        found == 1 ? double(u[a]) : mean[a] + own / m * (double(u[a]) - mean[a]);
            }
            if (found == 0) continue;
            ++n;
            int at[D];
            Block<D>::coordinates(node, at);
            if (scalar) {
                out.data.push_back(m);
                continue;
            }
            for (int a = 0; a < D; ++a) {
                out.data.push_back(name == "position"
                                       ? (double(block[a] * Block<D>::edge + at[a]) + 0.5) *
                                             spec_.cell_size
                                       : mean[a]);
            }
        }
    }
    out.shape = scalar ? std::vector<std::size_t>{n} : std::vector<std::size_t>{n, std::size_t(D)};
    return out;
}

/// Of the nodes that carry mass, all their fields together.
template <class X, class T, int D>
NodalSums Domain<X, T, D>::sums(const Window& window) {
    fetch_clock();
    const NodesSeen<Sum> seen = nodes_in(window);
    const auto value = sums_as_numbers(seen.sums);
    NodalSums out;
    for (std::size_t row = 0; row < seen.slots.size(); ++row) {
        if (!counts_slot(std::size_t(seen.slots[row]))) continue;
        const std::size_t end = end_of_fields(seen.keys, row);
        if (end == row) continue;
        std::int64_t block[D];
        table_.keys_of.block(seen.keys[row], block);
        for (int node = 0; node < block_cells; ++node) {
            const auto of = [&](std::size_t k, int c) {
                return value[(k * std::size_t(plan_.sum_channels) + std::size_t(c)) * block_cells +
                             std::size_t(node)];
            };
            double mass = 0;
            for (std::size_t k = row; k < end; ++k) mass += of(k, 0);
            if (!(mass > 0)) continue;
            int at[D];
            Block<D>::coordinates(node, at);
            for (int a = 0; a < D; ++a) out.cell.push_back(block[a] * Block<D>::edge + at[a]);
            for (int c = 0; c < plan_.sum_channels; ++c) {
                double sum = of(row, c);
                for (std::size_t k = row + 1; k < end; ++k) sum += of(k, c);
                out.value[plan_.channels[c]].push_back(sum);
            }
        }
    }
    return out;
}

template <class X, class T, int D>
std::map<std::string, double> Domain<X, T, D>::statistics() const {
    std::map<std::string, double> out;
    out["sorts"] = double(sorts_);
    out["tables"] = double(tables_);  // sorts that made a new one
    out["blocks"] = double(table_.slots);
    double lone = 0;
    for (const auto& b : bodies_) lone += b.lone_count;
    out["lone"] = lone;
    out["fastest_node"] = clock_.speed;
    out["drift"] = clock_.drift;
    double bytes = double(blocks_.bytes() + velocity_.bytes() + wall_velocity_.bytes() +
                          wall_changed_.bytes() + wall_seats_.bytes() + excess_.bytes() +
                          packed_.bytes() + sums_[0].bytes() + sums_[1].bytes()) +
                   boundaries_.bytes() + uplift_.bytes();
    bytes += double(cells_.bytes() + smoothing_energies_.bytes() + shared_out_.bytes() +
                    shared_in_.bytes() + told_sums_.bytes() + told_sums_in_.bytes() +
                    told_velocity_.bytes() + told_velocity_in_.bytes());
    for (const auto& b : bodies_) {
        for (const auto& c : b.offset) bytes += double(c.bytes());
        for (const auto& c : b.state) bytes += double(c.bytes());
        if (b.mesh) bytes += double(b.mesh->bytes());
        bytes += double(b.id.bytes() + b.cell.bytes() + b.cell_start.bytes() + b.home.bytes() +
                        b.pair.bytes() + b.lone.bytes() + b.lone_slot.bytes() + b.scratch.bytes());
    }
    out["bytes"] = bytes;
    if (spec_.contact.any()) out["contact_blocks"] = double(contact_blocks_);
    if (rigid_.any()) {
        out["rigid_points"] = double(rigid_points_.size());
        out["rigid_sweeps"] = double(rigid_most_sweeps_);  // the most of any step
        out["rigid_left"] = rigid_left_;                   // m/s, the largest change of a last one
    }
    if (share_) {
        out["rebalances"] = double(share_->rebalances);
        out["migrated"] = double(share_->migrated);
        out["bytes_of_sums"] = double(share_->bytes_of_sums);
        if (has_meshes()) out["bytes_of_vertices"] = double(share_->bytes_of_vertices);
        out["shared_blocks"] =
            X::is_device ? double(share_->shared_blocks) : double(share_->shared.size());
        out["imbalance"] = imbalance(share_->loads);
    }
    if constexpr (X::is_device) {
        const auto peak = exec_.peak();
        out["most_bytes_used"] = double(peak.used);
        out["most_bytes_held"] = double(peak.held);
    }
    return out;
}

}  // namespace mpm
