#include "mpm/solver/state_check.hpp"
#include "mpm/solver/rigid_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "mpm/core/linalg.hpp"
#include "mpm/data/blocks.hpp"
#include "mpm/kernels/sampling.hpp"
#include "mpm/physics/shape/parallelepiped.hpp"
#include "mpm/solver/rank_scene.hpp"
#include "mpm/solver/saved_clock.hpp"
#include "mpm/solver/saved_state.hpp"

namespace mpm {

namespace {

/// Strains beyond which no element goes (physics/material/von_mises.hpp).
constexpr double most_flowed = 1e6;

/// Cells that the step sees a particle beside its home cell at most (`sound`).
constexpr double furthest_offset = 1.75;
/// Rounding of offsets and of the drift that bounds them, cells. A step that adds half a unit in
/// the last place or more is rounded to twice of it at most, one that adds less to nothing.
constexpr double offset_rounding = 1e-4, steps_rounding = 2;
/// Steps of a state may be longer than this version's plan by rounding, or by what versions have
/// changed of their bound; by this it is no step of the scene.
constexpr double longest_step = 2;
/// Sums hold all that particles have deposited, to rounding and the quantum of integers.
constexpr double least_of_mass = 0.99;

std::string number(double x) {
    char text[32];
    std::snprintf(text, sizeof text, "%.9g", x);
    return text;
}

template <int D>
class Check {
public:
    Check(const State& state, const Spec& spec, const Plan& plan)
        : state_(state),
          spec_(spec),
          plan_(plan),
          clock_(saved_clock(state)),
          keys_of_(keys_of_domain<D>(spec)),
          largest_(spec.precision == Precision::single ? std::numeric_limits<float>::max()
                                                       : std::numeric_limits<double>::max()) {
        clock();
        table();
        for (std::size_t b = 0; b < spec_.bodies.size(); ++b) body(b);
        if (state_.has("body" + std::to_string(spec_.bodies.size()) + "_id"))
            throw SceneError("the saved state has more bodies than this scene");
        stored_bodies();
        sums();
        inlets();
        sensors();
    }

private:
    void clock() const {
        if (!(clock_.dt_stable <= longest_step * plan_.time_step))
            refuse_entry("clock_dt_stable", "is " + number(clock_.dt_stable),
                         "at most the scene's time step, " + number(plan_.time_step) + " s");
        if (state_.has("sorts_of_table") && state_.one<std::int32_t>("sorts_of_table") < 0)
            refuse_entry("sorts_of_table", "is negative", "a number of sorts");
    }

    void table() {
        const auto channels = state_.list<std::int32_t>("sum_channels");
        if (channels.size() != 1 || channels[0] != plan_.sum_channels)
            throw SceneError("the saved state has other grid channels than this scene");
        keys_ = state_.list<std::uint64_t>("keys");
        const int fields = state_.has("fields") ? state_.one<std::int32_t>("fields") : 1;
        if (fields != spec_.contact.fields)
            refuse_entry(
                "fields", "is " + std::to_string(fields),
                "the scene's " + std::to_string(spec_.contact.fields) + " fields of velocities");
        std::uint64_t blocks = std::uint64_t(fields);
        for (const std::int64_t n : keys_of_.counts) blocks *= std::uint64_t(n);
        for (std::size_t k = 0; k < keys_.size(); ++k)
            if (keys_[k] >= blocks || (k > 0 && keys_[k] <= keys_[k - 1]))
                refuse_entry("keys",
                             "has " + std::to_string(keys_[k]) + " at place " + std::to_string(k),
                             "ascending numbers below the " + std::to_string(blocks) +
                                 " blocks of the domain");
        if (keys_.size() > std::size_t(std::numeric_limits<std::int32_t>::max()))
            refuse_entry("keys", "has too many elements", "fewer than 2^31");
        held_.assign(keys_.size(), 0.0);
    }

    void body(std::size_t b) {
        const BodySpec& body = spec_.bodies[b];
        const BodyPlan& plan = plan_.bodies.at(b);
        const std::string p = "body" + std::to_string(b) + "_";
        const auto ids = state_.list<std::uint32_t>(p + "id");
        const auto start =
            state_.list<std::uint32_t>(p + "cell_start", keys_.size() * block_cells + 1);
        for (std::size_t k = 1; k < start.size(); ++k)
            if (start[k] < start[k - 1])
                refuse_entry(p + "cell_start", "falls at place " + std::to_string(k),
                             "numbers that ascend");
        if (start.front() != 0 || start.back() != ids.size())
            refuse_entry(p + "cell_start",
                         "goes from " + std::to_string(start.front()) + " to " +
                             std::to_string(start.back()),
                         "0 to its " + std::to_string(ids.size()) + " particles");
        // Vertices of elements store what part of the mean mass they have.
        std::vector<double> share;
        if (plan.elements > 0) share = state_.numbers(p + "state0", ids.size(), largest_);
        if (plan.elements > 0 && plan.kept > 0)
            state_.numbers(p + "elements", plan.elements * std::size_t(plan.kept), most_flowed);
        if (plan.rigid)
            state_.numbers(p + "rigid", RigidBodies<D>::numbers,
                           std::numeric_limits<double>::max());
        places(body, p, start, share);
        fields(body, p, start, ids);

        const auto frozen = state_.list<std::uint32_t>(p + "frozen_id");
        const std::uint64_t kept = ids_of(body);
        // No larger than the particles need it: an inlet's body may keep billions of ids.
        std::uint64_t end = 0;
        for (const auto* list : {&ids, &frozen})
            for (const std::uint32_t id : *list) end = std::max(end, std::uint64_t(id) + 1);
        std::vector<bool> seen(std::min(end, kept), false);
        for (const auto& [name, list] : {std::pair("id", &ids), std::pair("frozen_id", &frozen)}) {
            for (const std::uint32_t id : *list) {
                if (id >= kept || seen[id])
                    refuse_entry(
                        p + name, "has " + std::to_string(id) + (id < kept ? " twice" : ""),
                        "each of the body's " + std::to_string(kept) + " ids once at most");
                seen[id] = true;
            }
        }
        offsets(p, ids.size());
        const std::size_t columns = std::size_t(plan.state_columns);
        std::vector<std::vector<double>> shape;  // columns that kernels take a particle's size from
        const int first = plan.phase.edges >= 0 ? plan.phase.edges : plan.phase.extent;
        const int count = plan.phase.edges >= 0 ? D * D : D;
        for (std::size_t r = 0; r < columns; ++r) {
            auto column = state_.numbers(p + "state" + std::to_string(r), ids.size(), largest_);
            if (first >= 0 && int(r) >= first && int(r) < first + count)
                shape.push_back(std::move(column));
        }
        for (std::size_t q = 0; first >= 0 && q < ids.size(); ++q)
            if (!reaches(plan.phase, [&](int r) { return shape[std::size_t(r - first)][q]; }))
                refuse_entry(
                    p + "state" + std::to_string(first),
                    "has edges at place " + std::to_string(q) + " that the kernel cannot follow",
                    "edges that enclose a volume, of three cells at most");
        state_.numbers(p + "frozen_position", frozen.size() * D,
                       std::numeric_limits<double>::max());
        state_.numbers(p + "frozen_state", frozen.size() * columns,
                       std::numeric_limits<double>::max());
        if (std::uint64_t(ids.size()) + frozen.size() > kept)
            refuse_entry(p + "id", "has too many elements", "no more than the body's ids");
        ids_end_.push_back(end);
    }

    /// Nobody has gone further from its home cell since the last sort than the clock's drift.
    void offsets(const std::string& p, std::size_t count) const {
        const double most =
            std::min(furthest_offset, 0.5 + steps_rounding * clock_.drift + offset_rounding);
        for (int a = 0; a < D; ++a) {
            const std::string name = p + "offset" + std::to_string(a);
            const auto found = state_.numbers(name, count, furthest_offset);
            for (std::size_t q = 0; q < count; ++q)
                if (std::abs(found[q]) > most)
                    refuse_entry(name, "has " + number(found[q]) + " at place " + std::to_string(q),
                                 "at most " + number(most) +
                                     " cells, half a cell and the way since the last sort");
        }
    }

    template <class Of>
    static bool reaches(const PhaseNumbers& n, const Of& of) {
        if (n.edges >= 0) {
            Mat<double, D> h;
            for (int a = 0; a < D; ++a)
                for (int b = 0; b < D; ++b) h.e[a][b] = of(n.edges + a * D + b);
            const auto edges = half_edges_of(double(n.kernel.half_edge), h);
            for (int a = 0; a < D; ++a)
                if (!(reach_along(edges, a) <= largest_half_edge * (1 + 1e-6))) return false;
            return determinant(edges, cofactors(edges)) > 0;
        }
        for (int a = 0; a < D; ++a) {
            const double half = n.kernel.half_edge * (1 + of(n.extent + a));
            if (!(half > 0 && half <= largest_half_edge * (1 + 1e-6))) return false;
        }
        return true;
    }

    /// Home cells lie in the domain, and around a block with particles the table has all blocks.
    void places(const BodySpec& body, const std::string& p, const std::vector<std::uint32_t>& start,
                const std::vector<double>& share) {
        for (std::size_t slot = 0; slot < keys_.size(); ++slot) {
            const std::uint32_t* cells = start.data() + slot * block_cells;
            if (cells[0] == cells[block_cells]) continue;
            std::int64_t block[D];
            keys_of_.block(keys_[slot], block);
            for (int c = 0; c < block_cells; ++c) {
                if (cells[c] == cells[c + 1]) continue;
                int at[D];
                Block<D>::coordinates(c, at);
                for (int a = 0; a < D; ++a) {
                    const std::int64_t cell = block[a] * Block<D>::edge + at[a];
                    if (cell < 0 || cell >= spec_.cells[std::size_t(a)])
                        refuse_entry(p + "cell_start",
                                     "has particles in cell " + std::to_string(cell) + " of axis " +
                                         std::to_string(a),
                                     "cells of the domain");
                }
            }
            each_neighbour(slot, [&](std::int32_t found) {
                if (found < 0)
                    refuse_entry(
                        "keys",
                        "lacks a block beside one with particles of body '" + body.name + "'",
                        "all blocks around those with particles");
            });
            double particles = double(cells[block_cells] - cells[0]);
            if (!share.empty())
                particles = std::accumulate(share.begin() + cells[0],
                                            share.begin() + cells[block_cells], 0.0);
            held_[slot] += body.particle_mass * particles;
        }
    }
    /// Particles lie in blocks of their body's field.
    void fields(const BodySpec& body, const std::string& p, const std::vector<std::uint32_t>& start,
                const std::vector<std::uint32_t>& ids) const {
        for (std::size_t slot = 0; slot < keys_.size() && !body.fields.empty(); ++slot) {
            const std::int64_t here = keys_of_.field(keys_[slot]);
            for (std::uint32_t q = start[slot * block_cells]; q < start[(slot + 1) * block_cells];
                 ++q) {
                int own = 0;
                for (const FieldOfIds& f : body.fields)
                    if (f.first <= ids[q]) own = f.field;
                if (own != here)
                    refuse_entry(p + "cell_start",
                                 "has particle " + std::to_string(ids[q]) + " in field " +
                                     std::to_string(here),
                                 "field " + std::to_string(own) + " of its body");
            }
        }
    }
    template <class F>
    void each_neighbour(std::size_t slot, const F& f) const {
        std::int64_t block[D];
        keys_of_.block(keys_[slot], block);
        const BlockTableView<D> table{keys_of_, std::int32_t(keys_.size()), keys_.data(), nullptr,
                                      nullptr};
        for (int n = 0; n < Block<D>::neighbours; ++n) {
            std::int64_t b[D];
            int rest = n;
            for (int a = D - 1; a >= 0; --a) {
                b[a] = block[a] + rest % 3 - 1;
                rest /= 3;
            }
            f(find_block<D>(table, b, keys_of_.field(keys_[slot])));
        }
    }

    /// As which of its bodies the state stores those of the scene.
    void stored_bodies() const {
        if (!state_.has("body_of")) return;
        const auto of = state_.list<std::int32_t>("body_of");
        std::int32_t last = 0;
        for (std::size_t b = 0; b < of.size(); ++b) {
            if (of[b] < last || of[b] > last + (b > 0))
                refuse_entry("body_of",
                             "has " + std::to_string(of[b]) + " at place " + std::to_string(b),
                             "numbers of bodies from 0 on");
            last = of[b];
        }
        if (of.empty() || std::size_t(last) + 1 != spec_.bodies.size())
            refuse_entry("body_of", "is of other bodies",
                         "the " + std::to_string(spec_.bodies.size()) + " that are stored");
    }

    void sums() const {
        const std::size_t channels = std::size_t(plan_.sum_channels), size = channels * block_cells;
        const auto sums =
            state_.numbers("sums", keys_.size() * size, std::numeric_limits<double>::max(), true);
        const char type = state_.type("sums");
        const double unit = type == 'i' || type == 'l' ? clock_.unit_read[mass_sum] : 1;
        std::vector<double> mass(keys_.size(), 0.0);
        for (std::size_t k = 0; k < keys_.size(); ++k)
            for (std::size_t node = 0; node < block_cells; ++node)
                mass[k] += unit * sums[k * size + node];
        for (std::size_t k = 0; k < keys_.size(); ++k) {
            if (held_[k] == 0) continue;
            double around = 0;
            each_neighbour(k, [&](std::int32_t n) { around += mass[std::size_t(n)]; });
            if (!(around >= least_of_mass * held_[k]))
                refuse_entry(
                    "sums",
                    "has " + number(around) + " kg around block " + std::to_string(keys_[k]),
                    "the " + number(held_[k]) + " kg of the particles in it");
        }
    }

    void inlets() const {
        if (spec_.inlets.empty()) return;
        const std::size_t n = spec_.inlets.size();
        constexpr double most = std::numeric_limits<double>::max();
        if (state_.size("supply_moved") != n)
            throw SceneError("the saved state has other inlets than this scene");
        const auto moved = state_.numbers("supply_moved", n, most),
                   last = state_.numbers("supply_last", n, most);
        const auto layers = state_.list<std::uint64_t>("supply_layers", n);
        const auto next = state_.list<std::uint64_t>("supply_next_id", spec_.bodies.size());
        for (std::size_t k = 0; k < n; ++k) {
            const double spacing = spec_.inlets[k].spacing, due = double(layers[k]) * spacing;
            if (moved[k] < 0 || last[k] < 0)
                refuse_entry(moved[k] < 0 ? "supply_moved" : "supply_last", "is negative",
                             "distances, m");
            // Layers come as soon as they are due.
            if (!(due <= moved[k] * (1 + 1e-9) &&
                  moved[k] - last[k] <= (due + spacing) * (1 + 1e-9)))
                refuse_entry("supply_layers",
                             "has " + std::to_string(layers[k]) + " layers of " + number(spacing) +
                                 " m where the water has moved by " + number(moved[k]) + " m",
                             "one for each spacing");
        }
        for (const InletSpec& inlet : spec_.inlets) {
            const std::size_t b = std::size_t(inlet.body);
            if (next[b] < ids_end_[b] || next[b] > ids_of(spec_.bodies[b]))
                refuse_entry("supply_next_id", "has " + std::to_string(next[b]),
                             "an id behind those of the particles, " + std::to_string(ids_end_[b]) +
                                 " to " + std::to_string(ids_of(spec_.bodies[b])));
        }
    }

    /// The state's sensors are the first ones of the scene.
    void sensors() const {
        const auto next = state_.list<std::int64_t>("sensor_next");
        const std::size_t n = next.size();
        if (n > spec_.sensors.size())
            throw SceneError("the saved state has other sensors than this scene");
        const auto last = state_.numbers("sensor_last", n, std::numeric_limits<double>::max());
        const auto first = state_.list<double>("sensor_first", n);
        std::size_t loads = 0, contacts = 0, pins = 0;
        const double now = clock_.time * (1 + 1e-12);
        for (std::size_t k = 0; k < n; ++k) {
            loads += spec_.sensors[k].kind == SensorKind::load_cell;
            contacts += spec_.sensors[k].kind == SensorKind::contact_load;
            pins += spec_.sensors[k].kind == SensorKind::pin_force;
            const double interval = spec_.sensors[k].interval;
            // The next sample is at most one interval ahead, and was not due a step ago.
            const bool fits = interval <= 0 ? next[k] <= clock_.step + 1
                                            : (double(next[k]) - 1) * interval <= now &&
                                                  clock_.time - double(next[k]) * interval <=
                                                      2 * std::max(clock_.dt_stable, interval);
            if (next[k] < 0 || !fits)
                refuse_entry("sensor_next",
                             "has " + std::to_string(next[k]) + " for sensor '" +
                                 spec_.sensors[k].name + "' at " + number(clock_.time) + " s",
                             "the number of the sample that comes next");
            if (last[k] < 0 || last[k] > now)
                refuse_entry("sensor_last", "has " + number(last[k]),
                             "times up to the present one, " + number(clock_.time) + " s");
            // NaN before the first sample.
            if (std::isinf(first[k])) refuse_entry("sensor_first", "has inf", "energies, J");
        }
        impulses("load_impulse", loads * std::size_t(load_columns<D>));
        if (contacts > 0) impulses("contact_impulse", contacts * std::size_t(contact_columns<D>));
        // Earlier versions had pins among what rigid bodies were told, on one rank.
        if (pins > 0 && state_.has("pin_impulse"))
            state_.numbers("pin_impulse", exact_pieces * pins * D,
                           std::numeric_limits<double>::max());
        if (pins > 0 && !state_.has("pin_impulse") && spec_.ranks.count > 1)
            throw SceneError(
                "the saved state has sensors.PinForce of an earlier version, which "
                "had it on one rank, and goes on on " +
                std::to_string(spec_.ranks.count) +
                " ranks; expected one; resume it on one rank, and save it anew");
    }
    /// Three numbers that add up to each; earlier versions saved one.
    void impulses(const char* name, std::size_t count) const {
        const bool in_one = state_.list<double>(name).size() == count;
        state_.numbers(name, in_one ? count : exact_pieces * count,
                       std::numeric_limits<double>::max());
    }

    SavedState state_;
    const Spec& spec_;
    const Plan& plan_;
    Clock clock_;
    BlockKeys<D> keys_of_;
    double largest_;
    std::vector<std::uint64_t> keys_;
    std::vector<double> held_;            // kg of the particles in each block
    std::vector<std::uint64_t> ids_end_;  // of each body: behind its largest
};

}  // namespace

void check_state(const State& state, const Spec& spec, const Plan& plan) {
    if (spec.dimension == 2)
        Check<2>(state, spec, plan);
    else
        Check<3>(state, spec, plan);
}

}  // namespace mpm
