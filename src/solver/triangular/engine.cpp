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

Point table_at(const TableSpec& t, double time) {
    double out[2];
    TimeTableView{t.time.data(), t.value.data(), std::int32_t(t.time.size()), 2, t.end}.at(time,
                                                                                           out);
    return {out[0], out[1]};
}

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

void FunctionsEngine::place_body(const BodySpec& b) {
    const MaterialInfo& info = material(b.material);
    triangular::Particles body;
    body.name = b.name;
    body.law = make_law(b.material, b.parameters);
    const std::size_t n = b.count, reals = std::size_t(body.law->reals());
    std::vector<double> row(2 * n);
    b.position(0, n, row.data());
    const bool each = b.velocity.size() == 2 * n && n != 1;
    const double density = info.density(b.parameters.data());
    for (std::size_t p = 0; p < n; ++p) {
        body.id.push_back(b.first_id + p);
        body.position.emplace_back(row[2 * p], row[2 * p + 1]);
        const std::size_t v = each ? 2 * p : 0;
        body.velocity.emplace_back(b.velocity[v], b.velocity[v + 1]);
    }
    body.displacement.assign(n, Point(0, 0));
    body.volume.assign(n, b.particle_mass / density);
    if (b.volume) b.volume(0, n, body.volume.data());
    for (double v : body.volume) body.mass.push_back(v * density);
    body.state.assign(n * reals, 0.0);
    if (b.pressure) {
        std::vector<double> pressure(n);
        b.pressure(0, n, pressure.data());
        for (std::size_t p = 0; p < n; ++p)
            body.state[p * reals] = info.volume_from_pressure(pressure[p], b.parameters.data());
    }
    if (b.stress) {
        std::vector<double> stress(4 * n);
        b.stress(0, n, stress.data());
        for (std::size_t p = 0; p < n; ++p)
            std::copy_n(stress.begin() + std::ptrdiff_t(4 * p), 4,
                        body.state.begin() + std::ptrdiff_t(p * reals));
    }
    for (const TractionSpec& t : b.tractions) {
        triangular::Traction pull;
        pull.particles.assign(t.particles.begin(), t.particles.end());
        pull.length = t.length;
        pull.value = [table = t.value](double time) { return table_at(table, time); };
        body.tractions.push_back(std::move(pull));
    }
    method_.bodies().push_back(std::move(body));
}

// Outer edges that belong to each face of the domain, or lie on the segments of an outline
// boundary.
void FunctionsEngine::find_parts() {
    const auto& basis = method_.basis();
    const auto& outline = basis.outline();
    const double near = 1e-6 * basis.spacing();  // vertices of files are rounded
    for (std::size_t b = 0; b < spec_.boundaries.size(); ++b) {
        const BoundarySpec& boundary = spec_.boundaries[b];
        if (boundary.is_box) {
            throw SceneError("boundary '" + boundary.name +
                             "': a box cannot lie in a grid of functions; cut it out of the mesh "
                             "and hold that part of the outline");
        }
        const auto add = [&](int face, const std::string& what, const auto& belongs) {
            const SurfaceLaw& law = boundary.law[std::size_t(face)];
            if (law.response == Response::separable) {
                throw SceneError("boundary '" + boundary.name +
                                 "': a separable response is not built for grids of functions; use "
                                 "Sticky() or Slip()");
            }
            HeldPart part{int(b), face, {{}, law.response == Response::slip}};
            double length = 0;
            for (std::size_t e = 0; e < outline.size(); ++e) {
                if (!belongs(outline[e])) continue;
                part.hold.edges.push_back(int(e));
                length += (outline[e].end - outline[e].start).norm();
            }
            if (part.hold.edges.empty()) {
                throw SceneError("boundary '" + boundary.name +
                                 "': no edge of the grid's outline " + "lies on " + what +
                                 "; check its coordinates against the mesh, " +
                                 "or name the sides that there are with DomainWalls(faces=...)");
            }
            parts_.push_back(std::move(part));
            return length;
        };
        if (!boundary.segments.empty()) {
            double wanted = 0;
            const auto segment = [&](std::size_t s) {
                return std::pair(Point(boundary.segments[s], boundary.segments[s + 1]),
                                 Point(boundary.segments[s + 2], boundary.segments[s + 3]));
            };
            for (std::size_t s = 0; s + 3 < boundary.segments.size(); s += 4)
                wanted += (segment(s).second - segment(s).first).norm();
            const double found = add(0, "it", [&](const triangular::OuterEdge& e) {
                for (std::size_t s = 0; s + 3 < boundary.segments.size(); s += 4) {
                    const auto [from, to] = segment(s);
                    const Point along = (to - from).normalized();
                    const auto on = [&](const Point& x) {
                        const double at = (x - from).dot(along);
                        return std::abs(triangular::cross(along, x - from)) < near && at > -near &&
                               at < (to - from).norm() + near;
                    };
                    if (on(e.start) && on(e.end)) return true;
                }
                return false;
            });
            if (std::abs(found - wanted) > 1e-6 * wanted) {
                throw SceneError("boundary '" + boundary.name +
                                 "': edges of the grid's outline lie "
                                 "on " +
                                 std::to_string(found) + " m of its " + std::to_string(wanted) +
                                 " m; give it corners that are vertices of the outline");
            }
            continue;
        }
        for (int face = 0; face < 4; ++face) {
            if (!boundary.present[std::size_t(face)]) continue;
            const Eigen::Index axis = face / 2;
            const double at = face % 2 ? basis.upper()[axis] : basis.lower()[axis];
            const std::string name = std::string(face / 2 ? "y" : "x") + (face % 2 ? "+" : "-");
            add(face, "face " + name, [&](const triangular::OuterEdge& e) {
                return std::abs(e.start[axis] - at) < near && std::abs(e.end[axis] - at) < near;
            });
        }
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

double FunctionsEngine::charge(const char* phase) {
    const auto now = std::chrono::steady_clock::now();
    const double spent = std::chrono::duration<double>(now - mark_).count();
    mark_ = now;
    if (phase) timings_[phase] += spent;
    return spent;
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
            double kinetic = 0, elastic = 0, potential = 0;
            const Point g = gravity_at(time_);
            for (std::size_t b = 0; b < method_.bodies().size(); ++b) {
                if (spec.body >= 0 && spec.body != int(b)) continue;
                const auto& body = method_.bodies()[b];
                for (std::size_t p = 0; p < body.count(); ++p) {
                    kinetic += 0.5 * body.mass[p] * body.velocity[p].squaredNorm();
                    potential -= body.mass[p] * g.dot(body.position[p]);
                    elastic += body.volume[p] *
                               body.law->observe(body.state_of(p), body.rate[p]).elastic_energy;
                }
            }
            const double total = kinetic + elastic + potential;
            if (!(state.first_energy == state.first_energy)) state.first_energy = total;
            row = {kinetic, elastic, potential, state.first_energy - total};
            break;
        }
        case SensorKind::wave_gauge:
            throw SceneError("sensor '" + spec.name +
                             "': a wave gauge is not built for grids of functions; use "
                             "ParticleTracker or VelocityProbe");
    }
    state.waiting.time.push_back(time_);
    state.waiting.values.data.insert(state.waiting.values.data.end(), row.begin(), row.end());
    ++state.waiting.values.shape[0];
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
