// From the dictionary that crosses the seam (design/engine-contract.md) to a Spec. What Python has
// validated is checked again only where it would corrupt a run.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/exec/rank_processes.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/solver/spec.hpp"
#include "rows_reader.hpp"
#include "tally_reader.hpp"

namespace mpm::python {

namespace py = pybind11;

/// What a name stands for; `what` says in an error whose name it is.
template <class Value>
Value built(const std::map<std::string, Value>& names, const std::string& name,
            const std::string& what) {
    const auto it = names.find(name);
    if (it == names.end()) throw SceneError(what + " '" + name + "' is not built");
    return it->second;
}

inline TableSpec read_table(const py::dict& d, int dimension, const std::string& owner) {
    TableSpec t;
    t.time = doubles(d["time"]);
    t.value = doubles(d["value"]);
    const auto end = d["end"].cast<std::string>();
    t.end = end == "repeat" ? TableEnd::repeat : (end == "zero" ? TableEnd::zero : TableEnd::hold);
    if (t.time.empty() || t.value.size() != t.time.size() * std::size_t(dimension)) {
        throw SceneError(owner + ": a time table needs as many rows of " +
                         std::to_string(dimension) + " values as times, and at least one");
    }
    for (std::size_t k = 1; k < t.time.size(); ++k)
        if (!(t.time[k] > t.time[k - 1])) throw SceneError(owner + ": times must increase");
    return t;
}

inline int face_number(const std::string& face, int dimension) {
    const std::string axes = "xyz";
    const auto axis = face.size() == 2 ? axes.find(face[0]) : std::string::npos;
    if (axis == std::string::npos || int(axis) >= dimension || (face[1] != '-' && face[1] != '+')) {
        throw SceneError("face '" + face +
                         "' is not one of x-, x+, y-, y+, z-, z+ of this dimension");
    }
    return int(axis) * 2 + (face[1] == '+');
}

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

inline TransferSpec read_transfer(const py::dict& d) {
    return {d["scheme"].cast<std::string>(), d["order"].cast<int>(),
            d["every"].cast<std::int64_t>()};
}

inline KernelSpec read_kernel(const py::dict& d) {
    const auto name = d["name"].cast<std::string>(), gradient = d["gradient"].cast<std::string>();
    const std::map<std::string, Kernel> kernels = {
        {"linear", Kernel::linear}, {"quadratic", Kernel::quadratic}, {"cubic", Kernel::cubic},
        {"ugimp", Kernel::ugimp},   {"cpgimp", Kernel::cpgimp},       {"cpdi", Kernel::cpdi},
        {"ddmp", Kernel::ddmp}};
    const Kernel kernel = built(kernels, name, "kernel");
    if (gradient != "mls" && gradient != "kernel")
        throw SceneError("gradient is '" + gradient + "'; expected mls or kernel");
    return {kernel, gradient == "mls" ? GradientForm::moments : GradientForm::shapes,
            d["boundary"].cast<bool>(), d.contains("modified") && d["modified"].cast<bool>()};
}

inline StartSpec read_start(const py::dict& d, int dimension) {
    StartSpec s;
    s.given = true;
    s.time = d["time"].cast<double>();
    s.time_step = d["time_step"].cast<double>();
    s.step = d["step"].cast<std::int64_t>();
    const auto whole = [&](const char* name) {
        const auto a = py::array_t<std::int64_t, py::array::c_style>::ensure(d[name]);
        if (!a) throw SceneError(std::string("start: ") + name + " is no array of whole numbers");
        return std::vector<std::int64_t>(a.data(), a.data() + a.size());
    };
    s.cell = whole("cell");
    s.velocity = doubles(d["velocity"]);
    const std::size_t nodes = s.cell.size() / std::size_t(dimension);
    if (s.velocity.size() != s.cell.size() || s.cell.size() % std::size_t(dimension) != 0)
        throw SceneError("start: there are not as many velocities as cells");
    for (const auto& [name, value] : d["averages"].cast<py::dict>()) {
        auto& average = s.averages[name.cast<std::string>()] = doubles(value);
        if (average.size() != nodes)
            throw SceneError("start: there are not as many averages as cells");
    }
    s.sensor_next = whole("sensor_next");
    s.sensor_last = doubles(d["sensor_last"]);
    s.sensor_first = doubles(d["sensor_first"]);
    s.load_impulse = doubles(d["load_impulse"]);
    return s;
}

inline Response read_response(const std::string& kind) {
    const std::map<std::string, Response> kinds = {{"sticky", Response::sticky},
                                                   {"slip", Response::slip},
                                                   {"separable", Response::separable},
                                                   {"mirror", Response::mirror},
                                                   {"mirror-sticky", Response::mirror_sticky},
                                                   {"prescribed", Response::prescribed}};
    return built(kinds, kind, "response");
}

inline MotionSpec read_motion(const py::dict& d, int components, const std::string& who) {
    return {read_table(d["table"], components, who), d["places"].cast<bool>()};
}

inline SurfaceSpec read_surface(const py::dict& d, int dimension, const std::string& who) {
    SurfaceSpec s;
    const auto keys = py::array_t<std::int64_t, py::array::c_style>::ensure(d["keys"]);
    const auto place = py::array_t<std::int32_t, py::array::c_style>::ensure(d["place"]);
    const auto values = py::array_t<float, py::array::c_style>::ensure(d["values"]);
    const std::int64_t corners = dimension == 2 ? 81 : 729;
    if (!keys || !place || !values || keys.size() != place.size() * dimension ||
        place.size() == 0 || values.size() % corners != 0)
        throw SceneError(who + ": its distances do not fit its blocks");
    s.keys.assign(keys.data(), keys.data() + keys.size());
    s.place.assign(place.data(), place.data() + place.size());
    s.values.assign(values.data(), values.data() + values.size());
    for (std::int32_t p : s.place)
        if (p < -1 || p >= values.size() / corners)
            throw SceneError(who + ": a block names values that are not there");
    s.origin = doubles(d["origin"]);
    s.spacing = d["spacing"].cast<double>();
    const std::map<std::string, Decay> functions = {
        {"free", Decay::free},           {"linear", Decay::linear},
        {"quadratic", Decay::quadratic}, {"flipped", Decay::flipped},
        {"cosine", Decay::cosine},       {"constrained", Decay::constrained}};
    s.decay = built(functions, d["decay"].cast<std::string>(), who + ": decay function");
    s.thickness = d["thickness"].cast<double>();
    if (!d["path"].is_none()) s.path = read_motion(d["path"], dimension, who);
    if (!d["turn"].is_none()) {
        s.turn = read_motion(d["turn"], 1, who);
        s.about = doubles(d["about"]);
        s.axis = doubles(d["axis"]);
    }
    return s;
}

inline BoundarySpec read_boundary(const py::dict& d, int dimension) {
    BoundarySpec b;
    b.name = d["name"].cast<std::string>();
    const auto shape = d["kind"].cast<std::string>();
    b.is_box = shape == "box";
    if (d.contains("surface"))
        b.surface = read_surface(d["surface"], dimension, "boundary '" + b.name + "'");
    if (d.contains("within")) b.within = doubles(d["within"]);
    if (b.is_box || d.contains("surface")) {
        b.lower = d["lower"].cast<std::vector<int>>();
        b.upper = d["upper"].cast<std::vector<int>>();
        if (int(b.lower.size()) != dimension || int(b.upper.size()) != dimension) {
            throw SceneError("boundary '" + b.name +
                             "': its box needs one lower and one upper cell an axis");
        }
    }
    if (d.contains("segments")) b.segments = doubles(d["segments"]);
    b.present.assign(2 * dimension, 0);
    b.law.assign(2 * dimension, SurfaceLaw{});
    for (const auto& [face, response] : d["faces"].cast<py::dict>()) {
        const int f = face_number(face.cast<std::string>(), dimension);
        const py::dict r = response.cast<py::dict>();
        const auto kind = r["kind"].cast<std::string>();
        b.present[f] = 1;
        b.law[f].response = read_response(kind);
        if (r.contains("axes")) b.law[f].axes = r["axes"].cast<int>();
        b.law[f].static_friction = r["static_friction"].cast<double>();
        b.law[f].dynamic_friction = r["dynamic_friction"].cast<double>();
        b.law[f].linear = r["linear"].cast<bool>();
        b.law[f].cautious = r.contains("cautious") && r["cautious"].cast<bool>();
    }
    b.start = d["start"].cast<double>();
    b.end = d["end"].cast<double>();
    if (!d["velocity"].is_none()) {
        b.moves = true;
        b.motion = read_table(d["velocity"], dimension, "boundary '" + b.name + "'");
    }
    return b;
}

inline InletSpec read_inlet(const py::dict& d, const Spec& spec) {
    InletSpec s;
    s.name = d["name"].cast<std::string>();
    const std::string who = "inlet '" + s.name + "'";
    s.body = d["body"].cast<int>();
    if (s.body < 0 || std::size_t(s.body) >= spec.bodies.size())
        throw SceneError(who + ": there is no body " + std::to_string(s.body));
    const BodySpec& body = spec.bodies[std::size_t(s.body)];
    s.face = face_number(d["face"].cast<std::string>(), spec.dimension);
    s.spacing = d["spacing"].cast<double>();
    s.points = doubles(d["points"]);
    const std::size_t n = s.points.size() / std::size_t(spec.dimension);
    if (n == 0 || s.points.size() != n * std::size_t(spec.dimension) || !(s.spacing > 0))
        throw SceneError(who + ": its layers need points and a spacing above 0 m");
    for (std::size_t k = 0; k < s.points.size(); ++k) {
        const double size = double(spec.cells[k % std::size_t(spec.dimension)]) * spec.cell_size;
        if (!(s.points[k] >= 0 && s.points[k] < size))
            throw SceneError(who + ": a point of its layers lies outside the domain");
    }
    if (!d["pressure"].is_none()) {
        s.pressure = doubles(d["pressure"]);
        if (s.pressure.size() != n || !material(body.material).volumetric)
            throw SceneError(who + ": its pressures do not fit its points or material");
    }
    s.next_id = d["next_id"].cast<std::uint64_t>();
    s.velocity = read_table(d["velocity"], 1, who);
    for (double v : s.velocity.value)
        if (!(v >= 0)) throw SceneError(who + ": its velocity is below 0 m/s");
    return s;
}

inline OutletSpec read_outlet(const py::dict& d, int dimension) {
    return {d["name"].cast<std::string>(), face_number(d["face"].cast<std::string>(), dimension)};
}

inline SensorSpec read_sensor(const py::dict& d, const Spec& spec) {
    SensorSpec s;
    s.name = d["name"].cast<std::string>();
    const std::map<std::string, SensorKind> kinds = {{"load-cell", SensorKind::load_cell},
                                                     {"wave-gauge", SensorKind::wave_gauge},
                                                     {"velocity-probe", SensorKind::velocity_probe},
                                                     {"tracker", SensorKind::tracker},
                                                     {"contact-load", SensorKind::contact_load},
                                                     {"energy", SensorKind::energy},
                                                     {"rigid-motion", SensorKind::rigid_motion},
                                                     {"pin-force", SensorKind::pin_force},
                                                     {"tally", SensorKind::tally}};
    s.kind = built(kinds, d["kind"].cast<std::string>(), "sensor '" + s.name + "': kind");
    s.interval = d["interval"].cast<double>();
    const auto check = [&](int index, std::size_t count, const char* what) {
        if (index < 0 || std::size_t(index) >= count) {
            throw SceneError("sensor '" + s.name + "': there is no " + what + " number " +
                             std::to_string(index));
        }
    };
    if (s.kind == SensorKind::load_cell) {
        s.boundary = d["boundary"].cast<int>();
        check(s.boundary, spec.boundaries.size(), "boundary");
        for (const auto& f : d["faces"])
            s.faces |= 1 << face_number(f.cast<std::string>(), spec.dimension);
        s.reference = doubles(d["reference"]);
    }
    if (s.kind == SensorKind::wave_gauge || s.kind == SensorKind::velocity_probe)
        s.position = doubles(d["position"]);
    if (s.kind == SensorKind::wave_gauge) {
        s.axis = d["axis"].cast<int>();
        check(s.axis, std::size_t(spec.dimension), "axis");
    }
    if (d.contains("body")) s.body = d["body"].cast<int>();
    if (s.kind == SensorKind::tracker) check(s.body, spec.bodies.size(), "body");
    if (s.kind == SensorKind::rigid_motion) {
        check(s.body, spec.bodies.size(), "body");
        if (!spec.bodies[std::size_t(s.body)].rigid.given)
            throw SceneError("sensor '" + s.name + "': body '" +
                             spec.bodies[std::size_t(s.body)].name + "' is not rigid");
    }
    if (s.kind == SensorKind::pin_force) {
        check(s.body, spec.bodies.size(), "body");
        s.pin = d["pin"].cast<int>();
        check(s.pin, spec.bodies[std::size_t(s.body)].pins.size(), "pin of its body");
    }
    if (s.kind == SensorKind::tracker) s.ids = d["ids"].cast<std::vector<std::uint64_t>>();
    if (s.kind == SensorKind::tally)
        for (const auto& t : d["tallies"])
            s.tallies.push_back(read_tally(t.cast<py::dict>(), s.name, spec));
    if (s.kind == SensorKind::contact_load) {
        s.sides = d["sides"].cast<std::vector<std::int32_t>>();
        s.fields = d["fields"].cast<std::vector<std::int32_t>>();
        const std::size_t kinds = spec.contact.density.size();
        bool fits = spec.contact.any() && s.sides.size() == kinds * kinds &&
                    (s.fields.empty() || s.fields.size() == 2);
        for (const auto field : s.fields)
            fits = fits && field >= 0 && field < std::int32_t(spec.contact.fields);
        if (!fits)
            throw SceneError("sensor '" + s.name + "': its sides and fields are not those of " +
                             std::to_string(kinds) + " kinds of fields");
    }
    return s;
}

inline FunctionsSpec read_functions(const py::dict& d) {
    FunctionsSpec f;
    f.kind = d["kind"].cast<std::string>();
    if (f.kind == "splines") {
        for (int a = 0; a < 2; ++a) {
            f.knots[a] = doubles(d["knots"][py::int_(a)]);
            f.degrees[a] = d["degree"][py::int_(a)].cast<int>();
        }
    } else if (f.kind == "triangular") {
        f.vertices = doubles(d["vertices"]);
        const auto t =
            py::array_t<int, py::array::c_style | py::array::forcecast>::ensure(d["triangles"]);
        if (!t) throw SceneError("grid: triangles are not an array of vertex numbers");
        f.triangles.assign(t.data(), t.data() + t.size());
        f.basis = d["basis"].cast<std::string>();
        f.degree = d["degree"].cast<int>();
        if (!d["split"].is_none()) f.split = doubles(d["split"]);
    } else {
        throw SceneError("grid: kind '" + f.kind + "' is not built");
    }
    const py::dict m = d["mass"];
    f.mass = m["kind"].cast<std::string>();
    f.solver = m["solver"].cast<std::string>();
    f.tolerance = m["tolerance"].cast<double>();
    f.iterations = m["iterations"].cast<int>();
    f.deactivate_below = m["deactivate_below"].cast<double>();
    return f;
}

/// Fields of velocities: of each body, their kinds, and the law of each pair of kinds.
inline void read_contact(const py::dict& d, Spec& s) {
    ContactSpec& c = s.contact;
    c.fields = d["fields"].cast<int>();
    if (d.contains("rigid")) c.rigid = d["rigid"].cast<int>();
    c.kind = d["kind"].cast<std::vector<int>>();
    c.density = doubles(d["density"]);
    c.law_of = d["law_of"].cast<std::vector<int>>();
    for (const auto& item : d["laws"]) {
        const py::dict given = item.cast<py::dict>();
        ContactLaw law;
        const auto kind = given["kind"].cast<std::string>();
        if (kind != "friction" && kind != "fluid")
            throw SceneError("contact: a law of kind '" + kind + "' is not built");
        law.kind = kind == "fluid" ? ContactKind::fluid : ContactKind::friction;
        law.static_friction = given["static_friction"].cast<double>();
        law.dynamic_friction = given["dynamic_friction"].cast<double>();
        law.fill = given["fill"].cast<double>();
        c.laws.push_back(law);
    }
    const auto of_body = d["of_body"].cast<std::vector<int>>();
    const std::size_t kinds = c.density.size();
    bool fits = c.fields >= 1 && c.rigid >= 0 && c.rigid < c.fields &&
                c.kind.size() == std::size_t(c.fields) && of_body.size() == s.bodies.size() &&
                c.law_of.size() == kinds * kinds;
    for (const int kind : c.kind) fits = fits && kind >= 0 && std::size_t(kind) < kinds;
    for (const int field : of_body) fits = fits && field >= 0 && field < c.fields;
    for (std::size_t k = 0; fits && k < kinds * kinds; ++k)
        fits = c.law_of[k] >= -1 && c.law_of[k] < int(c.laws.size()) &&
               c.law_of[k] == c.law_of[k % kinds * kinds + k / kinds];
    for (const double density : c.density) fits = fits && density > 0;
    if (!fits) throw SceneError("contact: its fields, kinds and laws do not fit each other");
    if (!c.any()) return;
    for (std::size_t b = 0; b < s.bodies.size(); ++b) s.bodies[b].fields = {{0, of_body[b]}};
}

inline Spec read_spec(const py::dict& d) {
    Spec s;
    s.dimension = d["dimension"].cast<int>();
    if (s.dimension != 2 && s.dimension != 3) {
        throw SceneError("dimension is " + std::to_string(s.dimension) +
                         "; built are 2 (plane strain) and 3");
    }
    const auto precision = d["precision"].cast<std::string>();
    if (precision == "single") {
        s.precision = Precision::single;
    } else if (precision == "mixed") {
        s.precision = Precision::mixed;
    } else if (precision == "double") {
        s.precision = Precision::double_;
    } else {
        throw SceneError("precision is '" + precision + "'; expected single, mixed or double");
    }
    s.device = d["device"].cast<int>();
    if (d.contains("shared_device")) s.shared_device = d["shared_device"].cast<bool>();
    s.pipeline = d["pipeline"].cast<std::string>();
    s.threads = d["threads"].cast<int>();
    if (d.contains("ranks")) {
        const py::dict r = d["ranks"];
        s.ranks.count = r["count"].cast<int>();
        if (r.contains("devices")) s.ranks.devices = r["devices"].cast<std::vector<int>>();
        if (r.contains("processes"))
            s.ranks.processes = r["processes"].cast<std::shared_ptr<RankProcesses>>();
        if (r.contains("axis")) s.ranks.axis = r["axis"].cast<int>();
        if (r.contains("rebalance_above"))
            s.ranks.rebalance_above = r["rebalance_above"].cast<double>();
        if (r.contains("planes")) s.ranks.planes = r["planes"].cast<std::vector<std::int64_t>>();
        if (r.contains("measured")) s.ranks.measured = r["measured"].cast<bool>();
    }
    s.cell_size = d["cell_size"].cast<double>();
    s.cells = d["cells"].cast<std::vector<std::int64_t>>();
    if (d.contains("grid")) s.functions = read_functions(d["grid"]);
    if (d.contains("transfer")) s.transfer = read_transfer(d["transfer"]);
    if (d.contains("kernel")) s.kernel = read_kernel(d["kernel"]);
    if (d.contains("deformed_nodes")) s.deformed_nodes = d["deformed_nodes"].cast<bool>();
    s.gravity = read_table(d["gravity"], s.dimension, "gravity");
    s.cfl = d["cfl"].cast<double>();
    s.time_step = d["time_step"].is_none() ? 0 : d["time_step"].cast<double>();
    const auto leaving = d["leaving"].cast<std::string>();
    s.leaving = leaving == "freeze" ? Leaving::freeze
                                    : (leaving == "delete" ? Leaving::remove : Leaving::stop);
    for (const auto& b : d["bodies"])
        s.bodies.push_back(read_body(b.cast<py::dict>(), s.dimension));
    if (s.bodies.empty()) throw SceneError("the scene has no body; add one with scene.add_body");
    if (d.contains("ranks") && d["ranks"].contains("groups")) {  // of each body
        const auto groups = d["ranks"]["groups"].cast<std::vector<int>>();
        s.ranks.grouped = true;
        for (std::size_t b = 0; b < s.bodies.size(); ++b) s.bodies[b].groups = {{0, groups.at(b)}};
    }
    int restricted = 0;
    for (const auto& item : d["boundaries"]) {
        const py::dict b = item.cast<py::dict>();
        s.boundaries.push_back(read_boundary(b, s.dimension));
        if (!b.contains("bodies")) continue;
        if (restricted == 64)
            throw SceneError("boundary '" + s.boundaries.back().name +
                             "' is the 65th for some bodies alone; at most 64 may be");
        s.boundaries.back().restricted = restricted;
        for (const auto index : b["bodies"].cast<std::vector<std::size_t>>())
            s.bodies.at(index).held_by |= std::uint64_t(1) << restricted;
        ++restricted;
    }
    if (d.contains("contact")) read_contact(d["contact"], s);
    for (const auto& x : d["sensors"]) s.sensors.push_back(read_sensor(x.cast<py::dict>(), s));
    if (d.contains("inlets"))
        for (const auto& x : d["inlets"]) s.inlets.push_back(read_inlet(x.cast<py::dict>(), s));
    if (d.contains("outlets"))
        for (const auto& x : d["outlets"])
            s.outlets.push_back(read_outlet(x.cast<py::dict>(), s.dimension));
    if (d.contains("stored_as")) s.stored_as = d["stored_as"].cast<std::vector<int>>();
    if (d.contains("start")) s.start = read_start(d["start"], s.dimension);
    return s;
}

}  // namespace mpm::python
