// What readers see of an engine on functions, and the whole state, out and in.
#include <algorithm>
#include <cmath>

#include "mpm/solver/blob.hpp"
#include "mpm/solver/functions_engine.hpp"

namespace mpm {

using triangular::Point;

std::uint64_t FunctionsEngine::particle_count(int body) const {
    return method_.bodies().at(std::size_t(body)).count();
}

std::vector<std::string> FunctionsEngine::attribute_names(int body) const {
    std::vector<std::string> names = {
        "id",      "position", "velocity", "displacement",   "mass",           "volume",
        "density", "stress",   "pressure", "kinetic_energy", "elastic_energy", "volume_ratio",
        "speed"};
    const MaterialInfo& m = material(spec_.bodies.at(std::size_t(body)).material);
    if (std::string(m.needs) == "deformation_gradient") names.push_back("deformation_gradient");
    if (m.plastic) names.push_back("plastic_strain");
    if (m.yields) names.push_back("yields");
    return names;
}

Attributes FunctionsEngine::attributes(int number, const std::vector<std::string>& names) {
    const auto& body = method_.bodies().at(std::size_t(number));
    const auto known = attribute_names(number);
    const std::size_t n = body.count();
    Attributes out;
    out.id = body.id;
    for (const std::string& name : names) {
        if (std::find(known.begin(), known.end(), name) == known.end()) {
            std::string list;
            for (const auto& k : known) list += (list.empty() ? "" : ", ") + k;
            throw SceneError("body '" + body.name + "' has no attribute '" + name + "'; it has " +
                             list);
        }
        const bool vector = name == "position" || name == "velocity" || name == "displacement";
        const bool tensor = name == "stress" || name == "deformation_gradient";
        Array& a = out.values[name];
        a.shape = {n};
        if (vector || tensor) a.shape.push_back(2);
        if (tensor) a.shape.push_back(2);
        const auto add = [&](const Point& x) { a.data.insert(a.data.end(), {x[0], x[1]}); };
        const auto add_tensor = [&](const double(&t)[2][2]) {
            a.data.insert(a.data.end(), {t[0][0], t[0][1], t[1][0], t[1][1]});
        };
        for (std::size_t p = 0; p < n; ++p) {
            const double speed = body.velocity[p].norm();
            if (name == "position") {
                add(body.position[p]);
            } else if (name == "velocity") {
                add(body.velocity[p]);
            } else if (name == "displacement") {
                add(body.displacement[p]);
            } else if (name == "mass") {
                a.data.push_back(body.mass[p]);
            } else if (name == "speed") {
                a.data.push_back(speed);
            } else if (name == "kinetic_energy") {
                a.data.push_back(0.5 * body.mass[p] * speed * speed);
            } else {
                const auto o = body.law->observe(body.state_of(p), body.rate[p]);
                const double volume = body.volume[p] * o.volume_ratio;
                if (name == "stress")
                    add_tensor(o.stress);
                else if (name == "deformation_gradient")
                    add_tensor(o.deformation);
                else
                    a.data.push_back(name == "volume"           ? volume
                                     : name == "density"        ? body.mass[p] / volume
                                     : name == "pressure"       ? o.pressure
                                     : name == "elastic_energy" ? body.volume[p] * o.elastic_energy
                                     : name == "volume_ratio"   ? o.volume_ratio
                                     : name == "plastic_strain" ? o.plastic_strain
                                                                : double(o.yields));
            }
        }
    }
    return out;
}

/// Control points of the functions that have mass, coefficients of the velocity there, their mass.
Array FunctionsEngine::grid(const std::string& name) {
    if (name != "position" && name != "velocity" && name != "mass")
        throw SceneError("the grid has no '" + name + "'; it has position, velocity and mass");
    if (!make_ready()) throw NumericalError("the grid cannot be read after a fault");
    const auto control = method_.basis().control_points();
    const Eigen::VectorXd mass = method_.function_masses();
    const Eigen::VectorXd velocity = method_.velocity_field(hold_velocities(time_));
    Array a;
    std::size_t n = 0;
    for (std::size_t f = 0; f < control.size(); ++f) {
        const auto i = Eigen::Index(f);
        if (!(mass[i] > 0)) continue;
        ++n;
        if (name == "mass")
            a.data.push_back(mass[i]);
        else if (name == "position")
            a.data.insert(a.data.end(), {control[f][0], control[f][1]});
        else
            a.data.insert(a.data.end(), {velocity[2 * i], velocity[2 * i + 1]});
    }
    a.shape = {n};
    if (name != "mass") a.shape.push_back(2);
    return a;
}

namespace {

Blob points_blob(const std::vector<Point>& points) {
    std::vector<double> numbers;
    for (const Point& p : points) numbers.insert(numbers.end(), {p[0], p[1]});
    return detail::to_blob(numbers);
}
std::vector<Point> points_from(const State& state, const std::string& name) {
    const auto numbers = detail::from_blob<double>(state, name);
    std::vector<Point> out;
    for (std::size_t k = 0; k + 1 < numbers.size(); k += 2)
        out.emplace_back(numbers[k], numbers[k + 1]);
    return out;
}

}  // namespace

State FunctionsEngine::save() {
    if (fault_ && fault_->code != "left-domain")
        throw NumericalError("the state cannot be saved after a fault (" + fault_->code + ")");
    State s;
    s["clock"] = detail::to_blob(std::vector<double>{time_, dt_, first_dt_, stable_});
    s["counters"] = detail::to_blob(std::vector<std::int64_t>{step_, watched_at_});
    s["search"] = detail::to_blob(method_.search());
    for (std::size_t k = 0; k < sensors_.size(); ++k) {
        const SensorState& x = sensors_[k];
        const std::string p = "sensor" + std::to_string(k) + "_";
        s[p + "next"] = detail::to_blob(std::vector<std::int64_t>{x.next});
        s[p + "sums"] = detail::to_blob(std::vector<double>{
            x.last_time, x.first_energy, x.impulse[0], x.impulse[1], x.impulse[2]});
    }
    for (std::size_t b = 0; b < method_.bodies().size(); ++b) {
        const auto& body = method_.bodies()[b];
        const std::string p = "body" + std::to_string(b) + "_";
        s[p + "id"] = detail::to_blob(body.id);
        s[p + "position"] = points_blob(body.position);
        s[p + "velocity"] = points_blob(body.velocity);
        s[p + "displacement"] = points_blob(body.displacement);
        s[p + "volume"] = detail::to_blob(body.volume);
        s[p + "mass"] = detail::to_blob(body.mass);
        s[p + "state"] = detail::to_blob(body.state);
        s[p + "cell"] =
            detail::to_blob(std::vector<std::int32_t>(body.cell.begin(), body.cell.end()));
        std::vector<double> stress, rate;
        for (const auto& t : body.stress) stress.insert(stress.end(), t.begin(), t.end());
        for (const auto& r : body.rate)
            rate.insert(rate.end(), {r.e[0][0], r.e[0][1], r.e[1][0], r.e[1][1]});
        s[p + "stress"] = detail::to_blob(stress);
        s[p + "rate"] = detail::to_blob(rate);
    }
    return s;
}

void FunctionsEngine::load(const State& state) {
    const auto clock = detail::from_blob<double>(state, "clock");
    const auto counters = detail::from_blob<std::int64_t>(state, "counters");
    if (clock.size() != 4 || counters.size() != 2)
        throw SceneError("the saved state's clock is not one of a grid of functions");
    for (std::size_t b = 0; b < method_.bodies().size(); ++b) {
        auto& body = method_.bodies()[b];
        const std::string p = "body" + std::to_string(b) + "_";
        const auto ids = detail::from_blob<std::uint64_t>(state, p + "id");
        // Particles that had left before the state was saved.
        std::vector<std::uint64_t> left = ids;
        std::sort(left.begin(), left.end());
        std::vector<std::size_t> gone;
        for (std::size_t k = 0; k < body.count(); ++k)
            if (!std::binary_search(left.begin(), left.end(), body.id[k])) gone.push_back(k);
        body.erase(gone);
        const auto fits = [&](std::size_t have, std::size_t width) {
            if (body.id != ids || have != width * body.count())
                throw SceneError("the saved state's body '" + body.name +
                                 "' has other particles than this scene's");
        };
        body.position = points_from(state, p + "position");
        fits(body.position.size(), 1);
        body.velocity = points_from(state, p + "velocity");
        body.displacement = points_from(state, p + "displacement");
        body.volume = detail::from_blob<double>(state, p + "volume");
        body.mass = detail::from_blob<double>(state, p + "mass");
        body.state = detail::from_blob<double>(state, p + "state");
        fits(body.state.size(), std::size_t(body.law->reals()));
        const auto cell = detail::from_blob<std::int32_t>(state, p + "cell");
        body.cell.assign(cell.begin(), cell.end());
        const auto stress = detail::from_blob<double>(state, p + "stress");
        const auto rate = detail::from_blob<double>(state, p + "rate");
        fits(stress.size(), 3);
        fits(rate.size(), 4);
        for (std::size_t k = 0; k < body.count(); ++k) {
            std::copy_n(stress.begin() + std::ptrdiff_t(3 * k), 3, body.stress[k].begin());
            for (std::size_t e = 0; e < 4; ++e) body.rate[k].e[e / 2][e % 2] = rate[4 * k + e];
        }
    }
    for (std::size_t k = 0; k < sensors_.size(); ++k) {
        SensorState& x = sensors_[k];
        const std::string p = "sensor" + std::to_string(k) + "_";
        x.next = detail::from_blob<std::int64_t>(state, p + "next").at(0);
        const auto sums = detail::from_blob<double>(state, p + "sums");
        x.last_time = sums.at(0);
        x.first_energy = sums.at(1);
        x.impulse = {sums.at(2), sums.at(3), sums.at(4)};
    }
    time_ = clock[0];
    step_ = counters[0];
    fault_.reset();
    ready_ = false;
    held_ = false;
    hold_active();
    method_.set_search(detail::from_blob<double>(state, "search"));
    dt_ = clock[1];
    first_dt_ = clock[2];
    stable_ = clock[3];
    watched_at_ = counters[1];
}

}  // namespace mpm
