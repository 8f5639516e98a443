// What readers of a scene's parts share: names, faces, and time tables.
#pragma once

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <map>
#include <string>

#include "mpm/core/error.hpp"
#include "mpm/solver/spec.hpp"
#include "rows_reader.hpp"

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

}  // namespace mpm::python
