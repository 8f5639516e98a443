// Tallies of sensors from Python's description of them (kernels/tally.hpp).
#pragma once

#include <pybind11/pybind11.h>

#include <algorithm>
#include <iterator>
#include <string>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/kernels/tally.hpp"
#include "mpm/solver/spec.hpp"
#include "rows_reader.hpp"

namespace mpm::python {

namespace py = pybind11;
inline TallySpec read_tally(const py::dict& d, const std::string& sensor, const Spec& spec) {
    const auto fail = [&](const std::string& what) {
        throw SceneError("sensor '" + sensor + "': " + what);
    };
    TallySpec t;
    const std::size_t axes = std::size_t(spec.dimension);
    t.body = d["body"].cast<int>();
    if (t.body < 0 || std::size_t(t.body) >= spec.bodies.size())
        fail("there is no body number " + std::to_string(t.body));
    t.first = d["first"].cast<std::uint64_t>();
    t.count = d["count"].cast<std::uint64_t>();
    const BodySpec& body = spec.bodies[std::size_t(t.body)];
    if (t.first < body.first_id || t.first - body.first_id > ids_of(body) ||
        t.count > ids_of(body) - (t.first - body.first_id))
        fail("its ids are not of body '" + body.name + "'");
    if (body.rigid.given || !body.elements.empty())
        fail("sums over particles are not built for body '" + body.name + "'");
    const auto name = d["of"].cast<std::string>();
    const auto* const at = std::find(std::begin(tally_names), std::end(tally_names), name);
    if (at == std::end(tally_names)) fail("there is no sum of '" + name + "'");
    t.of = int(at - std::begin(tally_names));
    if (d.contains("part")) t.part = d["part"].cast<int>();
    if (d.contains("axis")) t.axis = d["axis"].cast<int>();
    if (d.contains("sign")) t.sign = d["sign"].cast<int>();
    if (t.part < 0 || t.part > 8 || t.axis >= spec.dimension || t.sign < -1 || t.sign > 1)
        fail("it asks for a component that there is not");
    if (d.contains("lower")) {
        t.lower = doubles(d["lower"]);
        t.upper = doubles(d["upper"]);
    }
    t.origin = doubles(d["origin"]);
    t.up = doubles(d["up"]);
    t.reference = doubles(d["reference"]);
    if (d.contains("places")) t.places = doubles(d["places"]);
    if (t.origin.size() != axes || t.up.size() != axes || t.reference.size() != axes ||
        (t.lower.size() != axes && !t.lower.empty()) || t.upper.size() != t.lower.size() ||
        (t.places.size() != axes * t.count && !t.places.empty()))
        fail("its points are not of " + std::to_string(axes) + " dimensions");
    return t;
}

}  // namespace mpm::python
