// Boundaries, inlets and outlets from Python's description of them.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

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
    b.uplift = d.contains("uplift") && d["uplift"].cast<bool>();
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

}  // namespace mpm::python
