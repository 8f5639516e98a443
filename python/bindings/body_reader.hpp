// Bodies from Python's description of them.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/solver/spec.hpp"
#include "named_values.hpp"
#include "rows_reader.hpp"

namespace mpm::python {

namespace py = pybind11;

/// What a body keeps of a stored velocity, and by which rule it moves with it.
inline void read_share(const py::dict& d, BodySpec& b) {
    b.keep = d["flip"].cast<double>();
    SchemeNumbers& s = b.shift;
    const auto rule = d["rule"].cast<std::string>();
    if (rule != "binary" && rule != "smooth")
        throw SceneError("body '" + b.name + "': shift rule is '" + rule +
                         "'; expected binary or smooth");
    s.rule = rule == "binary" ? ShiftRule::binary : ShiftRule::smooth;
    s.shift_max = d["shift_max"].cast<double>();
    s.shift_min = d["shift_min"].cast<double>();
    s.critical_loss = 1 - d["critical_ratio"].cast<double>();
    s.width = d["width"].cast<double>();
    s.power = d["power"].cast<double>();
    s.zero_below = d["below"].cast<std::string>() == "zero";
    b.guard = d["guard"].cast<bool>();
}

/// Names of smoothing over cells, as Yang (2016) has them.
inline SmoothingChoice read_smoothing(const py::dict& d, const std::string& who) {
    const auto method = d["method"].cast<std::string>();
    using F = CellForm;
    using L = FluxLimiter;
    const std::map<std::string, SmoothingChoice> methods = {
        {"C0", {F::constant, L::none, false, 1, false}},
        {"C1", {F::linear, L::none, false, 1, false}},
        {"NB", {F::nodal, L::none, false, 1, false}},
        {"F0", {F::flux, L::none, false, 1, false}},
        {"F0L1", {F::flux, L::linear, false, 1, false}},
        {"F0L2", {F::flux, L::quadratic, false, 1, false}},
        {"F0A", {F::flux, L::none, true, 1, false}},
        {"F0AL1", {F::flux, L::linear, true, 1, false}},
        {"F0AL2", {F::flux, L::quadratic, true, 1, false}},
        {"F1", {F::linear_flux, L::none, false, 1, false}}};
    SmoothingChoice k = built(methods, method, who + ": smoothing method");
    k.gamma = d["gamma"].cast<double>();
    k.by_inertia = d["by_inertia"].cast<bool>();
    return k;
}

inline void read_between_parts(const py::dict& d, BodySpec& b, int dimension) {
    const std::string who = "body '" + b.name + "'";
    if (d.contains("smoothing")) {
        const py::dict s = d["smoothing"];
        b.cell_smoothing = read_smoothing(s, who);
        b.smoothed_field = s["field"].cast<std::string>();
    }
    if (d.contains("assumed")) {
        const py::dict s = d["assumed"];
        const auto over = s["over"].cast<std::string>(), part = s["part"].cast<std::string>();
        const std::map<std::string, TensorPart> parts = {{"full", TensorPart::full},
                                                         {"volumetric", TensorPart::volumetric},
                                                         {"deviatoric", TensorPart::deviatoric}};
        if ((over != "cell" && over != "node") || !parts.count(part))
            throw SceneError(who + ": assumed fields over '" + over + "' of part '" + part +
                             "' are not built");
        b.assumed.form = over == "cell" ? CellForm::constant : CellForm::nodal;
        b.assumed_part = parts.at(part);
        b.assumed_rate = s["rate"].cast<bool>();
    }
    if (d.contains("damping")) b.damping = d["damping"].cast<double>();
    if (d.contains("force")) {
        const py::dict s = d["force"];
        b.force = {s["axis"].cast<int>(), doubles(s["place"]), doubles(s["value"])};
        const bool fits = b.force.axis >= 0 && b.force.axis < dimension && !b.force.place.empty() &&
                          b.force.value.size() == b.force.place.size() * std::size_t(dimension) &&
                          std::is_sorted(b.force.place.begin(), b.force.place.end());
        if (!fits) throw SceneError(who + ": a force needs as many values as increasing places");
    }
}

inline BodySpec read_body(const py::dict& d, int dimension) {
    BodySpec b;
    b.name = d["name"].cast<std::string>();
    b.material = d["material"].cast<std::string>();
    const MaterialInfo& m = material(b.material);
    const py::dict values = d["parameters"];
    for (int k = 0; k < m.parameter_count; ++k) {
        if (!values.contains(m.parameters[k].name)) {
            throw SceneError("body '" + b.name + "': " + m.name + " needs the parameter " +
                             m.parameters[k].name);
        }
        const double v = values[m.parameters[k].name].cast<double>();
        const Parameter& p = m.parameters[k];
        const bool low = p.lower_open ? v > p.lower : v >= p.lower,
                   high = p.upper_open ? v < p.upper : v <= p.upper;
        if (!low || !high) {
            throw SceneError("body '" + b.name + "': " + p.name + " is " + std::to_string(v) +
                             ", outside " + std::to_string(p.lower) + " to " +
                             std::to_string(p.upper));
        }
        b.parameters.push_back(v);
    }
    b.count = d["count"].cast<std::uint64_t>();
    b.bounds = doubles(d["bounds"]);
    b.particle_mass = d["particle_mass"].cast<double>();
    b.first_id = d["first_id"].cast<std::uint64_t>();
    if (!d["position"].is_none()) {
        b.position =
            read_rows(d["position"], b.count, {dimension}, "body '" + b.name + "': position");
        b.velocity = doubles(d["velocity"]);
        if (b.velocity.size() != std::size_t(dimension) &&
            b.velocity.size() != b.count * dimension) {
            throw SceneError("body '" + b.name + "': " + std::to_string(b.velocity.size()) +
                             " velocity components; expected " + std::to_string(dimension) +
                             ", or as many for each of its " + std::to_string(b.count) +
                             " particles");
        }
        if (d.contains("velocity_gradient")) b.velocity_gradient = doubles(d["velocity_gradient"]);
        const std::size_t square = std::size_t(dimension * dimension),
                          given = b.velocity_gradient.size();
        if (given != 0 && given != square && given != b.count * square) {
            throw SceneError("body '" + b.name + "': " + std::to_string(given) +
                             " components of velocity gradients; expected none, " +
                             std::to_string(square) + ", or as many for each of its " +
                             std::to_string(b.count) + " particles");
        }
    }
    if (!d["pressure"].is_none()) {
        b.pressure =
            read_pressures(d["pressure"], b.count, dimension, "body '" + b.name + "': pressure");
        if (!m.volumetric)
            throw SceneError("body '" + b.name + "': " + m.name +
                             " stores no volume ratio to set a pressure by");
    }
    if (d.contains("id_count")) b.id_count = d["id_count"].cast<std::uint64_t>();
    if (d.contains("state")) {
        const auto width = d["state_width"].cast<int>();
        b.state_width = width;
        b.state = read_rows(d["state"], b.count, {width}, "body '" + b.name + "': state");
    }
    if (d.contains("ids")) {
        b.restored = true;
        const auto ids = py::array_t<std::uint32_t, py::array::c_style>::ensure(d["ids"]);
        if (!ids || std::uint64_t(ids.size()) != b.count)
            throw SceneError("body '" + b.name + "': ids are no array of " +
                             std::to_string(b.count) + " numbers of 32 bits");
        b.ids.assign(ids.data(), ids.data() + ids.size());
    }
    if (d.contains("elements")) {
        const auto e = py::array_t<std::int32_t, py::array::c_style>::ensure(d["elements"]);
        if (!e || e.ndim() != 2 || e.shape(1) != dimension + 1)
            throw SceneError("body '" + b.name + "': elements are no rows of " +
                             std::to_string(dimension + 1) + " numbers of 32 bits");
        b.elements.assign(e.data(), e.data() + e.size());
        const auto volumes = d["element_volumes"].cast<std::string>();
        if (volumes != "element" && volumes != "vertex")
            throw SceneError("body '" + b.name + "': element_volumes is '" + volumes +
                             "'; expected element or vertex");
        b.vertex_volumes = volumes == "vertex";
    }
    if (d.contains("rigid")) {
        const py::dict r = d["rigid"];
        b.rigid.given = true;
        b.rigid.inertia = doubles(r["inertia"]);
        b.rigid.held = r["held"].cast<std::vector<int>>();
        b.rigid.held_turn = r["held_turn"].cast<bool>();
    }
    if (d.contains("volume"))
        b.volume = read_rows(d["volume"], b.count, {}, "body '" + b.name + "': volume");
    if (d.contains("stress")) {
        b.stress = read_rows(d["stress"], b.count, {4}, "body '" + b.name + "': stress");
        if (std::string(m.needs) != "stress")
            throw SceneError("body '" + b.name + "': " + m.name +
                             " stores no stress to begin with");
    }
    if (d.contains("tractions")) {
        for (const auto& item : d["tractions"]) {
            const py::dict t = item.cast<py::dict>();
            TractionSpec pull;
            pull.particles = t["particles"].cast<std::vector<std::uint64_t>>();
            for (std::uint64_t p : pull.particles)
                if (p >= b.count)
                    throw SceneError("body '" + b.name + "': a traction names particle " +
                                     std::to_string(p) + " of " + std::to_string(b.count));
            if (b.elements.empty()) {
                pull.length = t["length"].cast<double>();
            } else {
                pull.area = t["area"].cast<std::vector<double>>();
                if (pull.area.size() != pull.particles.size())
                    throw SceneError("body '" + b.name + "': a traction has " +
                                     std::to_string(pull.area.size()) + " areas for " +
                                     std::to_string(pull.particles.size()) + " vertices");
            }
            pull.value = read_table(t["value"], dimension, "body '" + b.name + "': traction");
            b.tractions.push_back(std::move(pull));
        }
    }
    if (d.contains("element_stress")) b.element_stress = doubles(d["element_stress"]);
    if (d.contains("pins")) {
        for (const auto& item : d["pins"]) {
            const py::dict given = item.cast<py::dict>();
            PinSpec pin;
            pin.vertices = given["vertices"].cast<std::vector<std::uint64_t>>();
            pin.axes = given["axes"].cast<std::vector<int>>();
            for (const std::uint64_t v : pin.vertices)
                if (v >= b.count)
                    throw SceneError("body '" + b.name + "': a pin names vertex " +
                                     std::to_string(v) + " of " + std::to_string(b.count));
            if (!given["displacement"].is_none())
                pin.displacement =
                    read_table(given["displacement"], dimension, "body '" + b.name + "': pin");
            b.pins.push_back(std::move(pin));
        }
    }
    const py::dict f = d["fbar"];
    const auto form = f["form"].cast<std::string>();
    const std::map<std::string, SmoothingForm> forms = {
        {"none", SmoothingForm::none},
        {"one-volume", SmoothingForm::one_volume},
        {"one-volume-gradient", SmoothingForm::one_volume_gradient},
        {"two-volume", SmoothingForm::two_volume},
        {"stress-only", SmoothingForm::stress_only},
        {"split", SmoothingForm::split},
        {"literal", SmoothingForm::literal}};
    b.smoothing = built(forms, form, "body '" + b.name + "': F-bar form");
    b.smoothing_time = f["time"].cast<double>();
    b.smoothing_ratio = f["ratio"].cast<double>();
    if (f.contains("shifting")) b.shifts = f["shifting"].cast<bool>();
    if (f.contains("density")) b.density = f["density"].cast<bool>();
    if (d.contains("transfer")) read_share(d["transfer"], b);
    read_between_parts(d, b, dimension);
    return b;
}

}  // namespace mpm::python
