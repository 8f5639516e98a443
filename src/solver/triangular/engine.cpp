#include <algorithm>
#include <cmath>
#include <limits>

#include "mpm/core/error.hpp"
#include "mpm/solver/functions_engine.hpp"

namespace mpm {

using triangular::Point;
using triangular::Trouble;

namespace {

/// Steps between two looks at the largest frequency. A grid function starves over tens of steps.
constexpr int watch_every = 4;
/// A time step that had to shrink to this part of the first one will never get anywhere.
constexpr double starved = 1e-3;

triangular::MassOptions mass_options(const FunctionsSpec& f) {
    triangular::MassOptions o;
    using triangular::MassForm;
    using triangular::Solver;
    o.form = f.mass == "lumped"              ? MassForm::lumped
             : f.mass == "partial-rows"      ? MassForm::partial_rows
             : f.mass == "partial-symmetric" ? MassForm::partial_symmetric
                                             : MassForm::consistent;
    o.solver = f.solver == "cg"           ? Solver::conjugate_gradients
               : f.solver == "richardson" ? Solver::richardson
                                          : Solver::direct;
    o.tolerance = f.tolerance;
    o.iterations = f.iterations;
    o.deactivate_below = f.deactivate_below;
    return o;
}

}  // namespace

FunctionsEngine::FunctionsEngine(const Spec& spec)
    : spec_(spec), method_(make_basis(spec.functions), mass_options(spec.functions), spec.threads) {
    if (spec.dimension != 2) {
        throw SceneError("grid: functions over cells are built in two dimensions, dimension is " +
                         std::to_string(spec.dimension) + "; use dimension=2");
    }
    if (spec.leaving == Leaving::freeze) {
        throw SceneError(
            "leaving is 'freeze', which is not built for grids of functions; use "
            "'stop' or 'delete'");
    }
    for (const BodySpec& b : spec.bodies) place_body(b);
    for (BodySpec& b : spec_.bodies) {
        b.position = b.pressure = b.volume = b.stress = nullptr;
        b.velocity = {};
    }
    method_.start();
    find_parts();
    hold_active();
    const auto outside = method_.relocate();
    for (std::size_t b = 0; b < outside.size(); ++b) {
        if (outside[b].empty()) continue;
        const auto& body = method_.bodies()[b];
        const Point& x = body.position[outside[b].front()];
        throw SceneError("body '" + body.name + "': " + std::to_string(outside[b].size()) +
                         " of its particles lie outside the grid, the first at (" +
                         std::to_string(x[0]) + ", " + std::to_string(x[1]) +
                         ") m from the lower corner; enlarge the mesh or move the body");
    }
    method_.sort_by_cell();
    bool loads = false;
    for (const SensorSpec& s : spec_.sensors) {
        loads = loads || s.kind == SensorKind::load_cell;
        SensorState state;
        state.first_energy = std::numeric_limits<double>::quiet_NaN();
        state.waiting.values.shape = {0, sensor_columns(spec_, int(sensors_.size())).first.size()};
        sensors_.push_back(std::move(state));
    }
    method_.measure_loads(loads);
    make_ready();
    if (spec_.time_step > stable_) {
        char text[256];
        std::snprintf(text, sizeof text,
                      "time_step is %.6g s; the longest stable one of this scene is %.6g s, 2 / "
                      "omega_max of its mass and stiffness. Lower it, or leave it out and set cfl",
                      spec_.time_step, stable_);
        throw SceneError(text);
    }
    if (!std::isfinite(dt_)) {
        throw SceneError(
            "grid: no function is free to move; all are held or without particles. "
            "Refine the mesh or hold fewer sides");
    }
}

void FunctionsEngine::hold_active() {
    std::vector<int> now;
    std::vector<triangular::Hold> holds;
    for (std::size_t p = 0; p < parts_.size(); ++p) {
        const BoundarySpec& b = spec_.boundaries[std::size_t(parts_[p].boundary)];
        if (!(b.start <= time_ && time_ < b.end)) continue;
        now.push_back(int(p));
        holds.push_back(parts_[p].hold);
    }
    if (held_ && now == active_) return;
    held_ = true;
    active_ = now;
    method_.hold(holds);
    watched_at_ = -1;  // another system: its largest frequency is not known
}

Point FunctionsEngine::velocity_of(int boundary, double time) const {
    const BoundarySpec& b = spec_.boundaries[std::size_t(boundary)];
    return b.moves ? table_at(b.motion, time) : Point(0, 0);
}

Point FunctionsEngine::gravity_at(double time) const { return table_at(spec_.gravity, time); }

std::vector<Point> FunctionsEngine::hold_velocities(double time) const {
    std::vector<Point> out;
    for (int p : active_) out.push_back(velocity_of(parts_[std::size_t(p)].boundary, time));
    return out;
}

void FunctionsEngine::charge(const char* phase) {
    const auto now = std::chrono::steady_clock::now();
    if (phase) timings_[phase] += std::chrono::duration<double>(now - mark_).count();
    mark_ = now;
}

void FunctionsEngine::fail(const Trouble& t) {
    Fault f;
    f.code = t.code;
    // What befalls the grid as a whole is no body's.
    if (t.body >= 0) f.body = method_.bodies()[std::size_t(t.body)].name;
    f.ids = t.ids;
    std::sort(f.ids.begin(), f.ids.end());
    f.step = step_;
    f.time = time_;
    f.value = t.value;
    f.speed = t.speed;
    f.grew_since = -1;
    f.message = t.message;
    fault_ = f;
}

/// Particles in their cells, matrices and forces, and the time step. False after a fault.
bool FunctionsEngine::make_ready() {
    if (fault_) return false;
    if (ready_) return true;
    charge(nullptr);
    const auto outside = method_.relocate();
    for (std::size_t b = 0; b < outside.size(); ++b) {
        if (outside[b].empty()) continue;
        auto& body = method_.bodies()[b];
        Removed r;
        r.body = int(b);
        r.step = step_;
        for (std::size_t p : outside[b]) {
            r.ids.push_back(body.id[p]);
            r.position.data.insert(r.position.data.end(),
                                   {body.position[p][0], body.position[p][1]});
        }
        if (spec_.leaving == Leaving::stop) {
            fail({"left-domain", int(b), r.ids, 0, body.velocity[outside[b].front()].norm(), ""});
            return false;
        }
        r.policy = "delete";
        r.position.shape = {r.ids.size(), 2};
        removed_.push_back(std::move(r));
        body.erase(outside[b]);
    }
    charge("locate");
    hold_active();
    if (const auto trouble = method_.prepare(time_, gravity_at(time_))) {
        fail(*trouble);
        return false;
    }
    charge("assemble");
    watch_step();
    charge("watch");
    ready_ = !fault_;
    return ready_;
}

void FunctionsEngine::watch_step() {
    const bool afresh = watched_at_ < 0;
    // A function that has only just been reached has next to no mass: no time to wait then.
    const bool due = step_ % watch_every == 0 || method_.cells_changed();
    if (!afresh && (watched_at_ == step_ || !due)) return;
    stable_ = method_.stable_step(afresh);
    watched_at_ = step_;
    if (std::isinf(stable_) && dt_ > 0) return;  // no particle is left to limit it
    dt_ = spec_.time_step > 0 ? spec_.time_step : spec_.cfl * stable_;
    if (first_dt_ == 0) first_dt_ = dt_;
    char text[256];
    if (!(dt_ <= stable_)) {
        std::snprintf(text, sizeof text,
                      "the longest stable step has fallen to %.4g s; functions at a nearly empty "
                      "cell have lost their mass (smallest %.3g kg/m)",
                      stable_, method_.mass().smallest_mass());
        fail({"unstable-step", -1, {}, stable_, 0, text});
    } else if (!std::isfinite(dt_) || dt_ < starved * first_dt_) {
        std::snprintf(text, sizeof text,
                      "the stable step has fallen from %.4g s to %.4g s; functions at a nearly "
                      "empty cell have lost their mass (smallest %.3g kg/m)",
                      first_dt_, dt_, method_.mass().smallest_mass());
        fail({"starved", -1, {}, dt_, 0, text});
    }
}

RunResult FunctionsEngine::run(std::int64_t steps, double until, double wall) {
    RunResult r;
    const auto began = std::chrono::steady_clock::now();
    charge(nullptr);
    while (true) {
        if (!make_ready()) {
            r.reason = "fault";
            r.fault = *fault_;
            break;
        }
        sample_due();
        charge("sensors");
        if (r.steps == steps) {
            r.reason = "steps";
            break;
        }
        if (time_ >= until) {
            r.reason = "until";
            break;
        }
        if (std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count() >
            wall) {
            r.reason = "wall";
            break;
        }
        triangular::Surroundings around;
        around.gravity = gravity_at(time_);
        const auto before = hold_velocities(time_);
        around.hold_velocity = hold_velocities(time_ + dt_);
        for (std::size_t h = 0; h < before.size(); ++h)
            around.hold_acceleration.push_back((around.hold_velocity[h] - before[h]) / dt_);
        const auto trouble = method_.step(dt_, around);
        take_impulses();
        ++step_;
        ++r.steps;
        time_ += dt_;
        ready_ = false;
        charge("step");
        if (trouble) fail(*trouble);
    }
    r.time = time_;
    return r;
}

void FunctionsEngine::take_impulses() {
    auto& impulses = method_.impulses();
    for (std::size_t s = 0; s < sensors_.size(); ++s) {
        const SensorSpec& spec = spec_.sensors[s];
        if (spec.kind != SensorKind::load_cell) continue;
        for (std::size_t h = 0; h < active_.size(); ++h) {
            const HeldPart& part = parts_[std::size_t(active_[h])];
            const bool whole = !spec_.boundaries[std::size_t(part.boundary)].segments.empty();
            if (part.boundary != spec.boundary || !(whole || spec.faces >> part.face & 1)) continue;
            auto& sum = sensors_[s].impulse;
            const auto& j = impulses[h];
            sum[0] += j[0];
            sum[1] += j[1];
            sum[2] += j[2] - (spec.reference[0] * j[1] - spec.reference[1] * j[0]);
        }
    }
    for (auto& j : impulses) j = {0, 0, 0};
}

void FunctionsEngine::sample_due() {
    for (std::size_t s = 0; s < sensors_.size(); ++s) {
        SensorState& state = sensors_[s];
        const double interval = spec_.sensors[s].interval;
        if (interval <= 0 ? state.next > step_ : time_ < double(state.next) * interval) continue;
        sample(s);
        if (interval <= 0)
            state.next = step_ + 1;
        else
            while (time_ >= double(state.next) * interval) ++state.next;
    }
}

void FunctionsEngine::sample(std::size_t s) {
    const SensorSpec& spec = spec_.sensors[s];
    SensorState& state = sensors_[s];
    const double nothing = std::numeric_limits<double>::quiet_NaN();
    std::vector<double> row;
    switch (spec.kind) {
        case SensorKind::load_cell: {
            const double elapsed = time_ - state.last_time;
            state.last_time = time_;
            if (!(elapsed > 0)) return;  // the first sample has nothing to average over
            for (double& j : state.impulse) {
                row.push_back(j / elapsed);
                j = 0;
            }
            break;
        }
        case SensorKind::velocity_probe: {
            const auto field = method_.velocity_field(hold_velocities(time_));
            const auto v = method_.value_at(field, Point(spec.position[0], spec.position[1]));
            row = {v ? (*v)[0] : nothing, v ? (*v)[1] : nothing};
            break;
        }
        case SensorKind::tracker: {
            const auto& body = method_.bodies()[std::size_t(spec.body)];
            for (std::uint64_t id : spec.ids) {
                const std::size_t p = body.place_of(id);
                if (p == body.count()) {
                    row.insert(row.end(), 4, nothing);
                    continue;
                }
                row.insert(row.end(), {body.position[p][0], body.position[p][1],
                                       body.velocity[p][0], body.velocity[p][1]});
            }
            break;
        }
        case SensorKind::energy: {
            const auto [kinetic, elastic, potential] = energies(spec.body);
            const double total = kinetic + elastic + potential;
            if (!(state.first_energy == state.first_energy)) state.first_energy = total;
            row = {kinetic, elastic, potential, state.first_energy - total};
            break;
        }
        case SensorKind::contact_load:
        case SensorKind::rigid_motion:
        case SensorKind::pin_force:
            throw SceneError("sensor '" + spec.name +
                             "': contacts are not built for grids of functions; leave it out");
        case SensorKind::wave_gauge:
            throw SceneError("sensor '" + spec.name +
                             "': a wave gauge is not built for grids of functions; use "
                             "ParticleTracker or VelocityProbe");
        case SensorKind::tally:
            throw SceneError("sensor '" + spec.name +
                             "': sums over particles are not taken in the step of a grid of "
                             "functions; read them at step boundaries");
    }
    state.waiting.time.push_back(time_);
    state.waiting.values.data.insert(state.waiting.values.data.end(), row.begin(), row.end());
    ++state.waiting.values.shape[0];
}

/// Kinetic, elastic and potential energy of one body, or of all with -1.
std::array<double, 3> FunctionsEngine::energies(int chosen) const {
    double kinetic = 0, elastic = 0, potential = 0;
    const Point g = gravity_at(time_);
    for (std::size_t b = 0; b < method_.bodies().size(); ++b) {
        if (chosen >= 0 && chosen != int(b)) continue;
        const auto& body = method_.bodies()[b];
        for (std::size_t p = 0; p < body.count(); ++p) {
            kinetic += 0.5 * body.mass[p] * body.velocity[p].squaredNorm();
            potential -= body.mass[p] * g.dot(body.position[p]);
            elastic +=
                body.volume[p] * body.law->observe(body.state_of(p), body.rate[p]).elastic_energy;
        }
    }
    return {kinetic, elastic, potential};
}

Condition FunctionsEngine::condition(int) {
    Condition c;
    const auto energy = energies(-1);
    c.kinetic = energy[0];
    c.elastic = energy[1];
    c.potential = energy[2];
    for (const auto& body : method_.bodies()) {
        double sum = 0;
        for (std::size_t p = 0; p < body.count(); ++p) {
            sum += body.law->observe(body.state_of(p), body.rate[p]).volume_ratio;
            c.mass += body.mass[p];
            c.speed = std::max(c.speed, body.velocity[p].norm());
        }
        c.volume_ratio.push_back(body.count() > 0 ? sum / double(body.count())
                                                  : std::numeric_limits<double>::quiet_NaN());
    }
    return c;
}

std::vector<Samples> FunctionsEngine::drain() {
    std::vector<Samples> out;
    for (SensorState& s : sensors_) {
        const std::size_t width = s.waiting.values.shape[1];
        out.push_back(std::exchange(s.waiting, Samples{}));
        s.waiting.values.shape = {0, width};
    }
    return out;
}

std::map<std::string, double> FunctionsEngine::statistics() const {
    return {{"cells", double(method_.basis().cells())},
            {"filled_cells", double(method_.filled_cells())},
            {"functions", double(method_.basis().functions())},
            {"inactive_unknowns", double(method_.mass().inactive())},
            {"smallest_mass", method_.mass().smallest_mass()},
            {"reciprocal_condition", method_.mass().reciprocal_condition()},
            {"solver_iterations", double(method_.mass().iterations())},
            {"stable_step", stable_},
            {"bytes", method_.bytes()}};
}

std::unique_ptr<Engine> make_functions_engine(const Spec& spec) {
    return std::make_unique<FunctionsEngine>(spec);
}

}  // namespace mpm
