// From the dictionary that crosses the seam (design/engine-contract.md) to a Spec. What Python has
// validated is checked again only where it would corrupt a run.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "body_reader.hpp"
#include "boundary_reader.hpp"
#include "mpm/core/error.hpp"
#include "mpm/exec/rank_processes.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/solver/spec.hpp"
#include "named_values.hpp"
#include "rows_reader.hpp"
#include "tally_reader.hpp"

namespace mpm::python {

namespace py = pybind11;

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
