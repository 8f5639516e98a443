// What is given particle by particle, from Python: arrays, functions, lattices.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/solver/rows.hpp"

namespace mpm::python {

namespace py = pybind11;
using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

inline std::vector<double> doubles(const py::handle& value) {
    const auto a = Doubles::ensure(value);
    if (!a) throw SceneError("expected an array of numbers");
    return {a.data(), a.data() + a.size()};
}

/// The values of `rows` rows, each of the shape `row`; `what` names them in the error otherwise.
inline Doubles shaped(const py::handle& value, std::uint64_t rows,
                      const std::vector<py::ssize_t>& row, const std::string& what) {
    std::vector<py::ssize_t> shape{py::ssize_t(rows)};
    shape.insert(shape.end(), row.begin(), row.end());
    const auto text = [](const py::handle& x) { return py::str(x).cast<std::string>(); };
    const auto a = Doubles::ensure(value);
    if (a && std::equal(shape.begin(), shape.end(), a.shape(), a.shape() + a.ndim())) return a;
    throw SceneError(what +
                     (a ? " has the shape " + text(a.attr("shape"))
                        : " is no array of numbers but of " + text(py::type::handle_of(value))) +
                     "; expected the shape " + text(py::tuple(py::cast(shape))));
}

/// The points of a lattice that a value says it is: `runs`, pairs of coordinates on the first axis
/// and the section across it, which is such a list again, and for no axes 1 or 0. Null for others.
inline LatticePoints lattice_of(const py::handle& runs, int dimension) {
    if (dimension == 0) return LatticePoints(runs.cast<int>() != 0);
    std::vector<LatticePoints::Run> out;
    for (const py::handle run : runs) {
        const auto pair = run.cast<py::tuple>();
        out.push_back({doubles(pair[0]),
                       std::make_shared<const LatticePoints>(lattice_of(pair[1], dimension - 1))});
    }
    return {dimension, std::move(out)};
}
inline std::shared_ptr<const LatticePoints> read_lattice(const py::handle& value,
                                                         std::uint64_t count, int dimension,
                                                         const std::string& what) {
    if (!py::hasattr(value, "runs") || value.attr("runs").is_none()) return nullptr;
    auto points = std::make_shared<const LatticePoints>(lattice_of(value.attr("runs"), dimension));
    if (points->count() != count)
        throw SceneError(what + " is a lattice of " + std::to_string(points->count()) +
                         " points; expected " + std::to_string(count));
    return points;
}

/// Rows of an array, which is kept and not copied, or those that a Python function gives. The
/// engine may ask for them, and drop them, with or without the GIL.
inline Rows read_rows(py::object value, std::uint64_t count, std::vector<py::ssize_t> row,
                      const std::string& what) {
    const auto keep = [](py::object x) {
        return std::shared_ptr<py::object>(new py::object(std::move(x)), [](py::object* p) {
            py::gil_scoped_acquire locked;
            delete p;
        });
    };
    std::size_t width = 1;
    for (py::ssize_t n : row) width *= std::size_t(n);
    if (const auto points = read_lattice(value, count, int(width), what))
        return lattice_rows(points);
    if (PyCallable_Check(value.ptr())) {
        return [function = keep(std::move(value)), row = std::move(row), width, what](
                   std::uint64_t first, std::uint64_t last, double* out) {
            py::gil_scoped_acquire locked;
            const Doubles a =
                shaped((*function)(first, last), last - first, row,
                       what + "(" + std::to_string(first) + ", " + std::to_string(last) + ")");
            std::copy(a.data(), a.data() + (last - first) * width, out);
        };
    }
    const Doubles a = shaped(value, count, row, what);
    Rows rows([array = keep(a), data = a.data(), width](std::uint64_t first, std::uint64_t last,
                                                        double* out) {
        std::copy(data + first * width, data + last * width, out);
    });
    rows.at_hand = true;
    return rows;
}

/// Pressures: as other rows, or of still water in a lattice, which says its `strength`, `top` and
/// `up`.
inline Rows read_pressures(py::object value, std::uint64_t count, int dimension,
                           const std::string& what) {
    if (const auto points = read_lattice(value, count, dimension, what)) {
        StillWater water{value.attr("strength").cast<double>(), value.attr("top").cast<double>(),
                         doubles(value.attr("up"))};
        if (water.up.size() != std::size_t(dimension))
            throw SceneError(what + ": `up` has " + std::to_string(water.up.size()) +
                             " components; expected " + std::to_string(dimension));
        return still_water_rows(points, std::move(water));
    }
    return read_rows(std::move(value), count, {}, what);
}

}  // namespace mpm::python
