// What readers see of an engine on functions.
#include <algorithm>
#include <cmath>

#include "mpm/core/error.hpp"
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

Attributes FunctionsEngine::attributes(int number, const std::vector<std::string>& names,
                                       const Window&) {
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
Array FunctionsEngine::grid(const std::string& name, const Window&) {
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

}  // namespace mpm
