// The functions of a grid, to be looked at and integrated from Python. Positions and lengths in
// metres, relative to the grid's lower corner.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <vector>

#include "mpm/solver/functions_engine.hpp"
#include "mpm/triangular/cubic_powell_sabin.hpp"
#include "mpm/triangular/powell_sabin.hpp"
#include "mpm/triangular/quadrature.hpp"
#include "spec_reader.hpp"

namespace mpm::python {

using triangular::Point;

/// Of the shape (rows, inner...) with as many numbers.
inline py::array_t<double> table(const std::vector<double>& numbers,
                                 const std::vector<py::ssize_t>& inner) {
    py::ssize_t each = 1;
    for (py::ssize_t n : inner) each *= n;
    std::vector<py::ssize_t> shape{py::ssize_t(numbers.size()) / each};
    shape.insert(shape.end(), inner.begin(), inner.end());
    py::array_t<double> out(shape);
    std::copy(numbers.begin(), numbers.end(), out.mutable_data());
    return out;
}
inline void append(std::vector<double>& numbers, const Point& x) {
    numbers.insert(numbers.end(), {x[0], x[1]});
}

class BasisHandle {
public:
    explicit BasisHandle(const FunctionsSpec& spec)
        : basis_(make_basis(spec)), width_(basis_->widest()) {}

    const triangular::Basis& basis() const { return *basis_; }

    py::array_t<int> locate(const Doubles& points) const {
        const auto count = rows(points);
        py::array_t<int> out(count);
        const double* x = points.data();
        int* cell = out.mutable_data();
        const py::gil_scoped_release unlocked;
        // The next point is often near the last one.
        for (py::ssize_t p = 0, guess = 0; p < count; ++p) {
            cell[p] = basis_->locate({x[2 * p], x[2 * p + 1]}, int(guess));
            guess = cell[p];
        }
        return out;
    }

    py::tuple evaluate(const Doubles& points) const {
        const auto count = rows(points);
        const auto width = py::ssize_t(width_);
        py::array_t<int> functions({count, width});
        py::array_t<double> values({count, width});
        py::array_t<double> gradients({count, width, py::ssize_t(2)});
        fill(count, points.data(), functions.mutable_data(), values.mutable_data(),
             gradients.mutable_data());
        return py::make_tuple(functions, values, gradients);
    }

    py::tuple quadrature(int points) const {
        if (points < 1) {
            throw SceneError("quadrature: points_per_direction is " + std::to_string(points) +
                             "; expected 1 or more");
        }
        std::vector<double> position, weight;
        {
            const py::gil_scoped_release unlocked;
            triangular::each_point(*basis_, points, [&](int, const Point& x, double of_x) {
                append(position, x);
                weight.push_back(of_x);
            });
        }
        return py::make_tuple(table(position, {2}), table(weight, {}));
    }

    py::array_t<double> control_points() const {
        std::vector<double> out;
        for (const Point& q : basis_->control_points()) append(out, q);
        return table(out, {2});
    }

    py::array_t<double> outline() const {
        std::vector<double> out;
        for (const auto& edge : basis_->outline()) {
            append(out, edge.start);
            append(out, edge.end);
        }
        return table(out, {2, 2});
    }

    py::object split() const {
        const triangular::Split* split = powell_sabin();
        if (!split) return py::none();
        std::vector<double> inner, sides;
        for (int t = 0; t < basis_->cells(); ++t) {
            append(inner, split->inner(t));
            for (int k = 0; k < 3; ++k) append(sides, split->on_side(t, k));
        }
        return py::make_tuple(table(inner, {2}), table(sides, {3, 2}));
    }

    py::object control_triangles() const {
        const triangular::Split* split = powell_sabin();
        if (!split) return py::none();
        // In both bases function 3 v + q comes first and belongs to corner q of vertex v.
        const auto points = basis_->control_points();
        std::vector<double> out;
        for (std::size_t f = 0; f < 3 * split->mesh().vertices().size(); ++f)
            append(out, points[f]);
        return table(out, {3, 2});
    }

private:
    static py::ssize_t rows(const Doubles& points) {
        if (points.ndim() != 2 || points.shape(1) != 2)
            throw SceneError("points: expected the shape (n, 2) in m");
        return points.shape(0);
    }

    void fill(py::ssize_t count, const double* points, int* function, double* value,
              double* gradient) const {
        const py::gil_scoped_release unlocked;
        std::vector<Point> slopes(width_);
        for (py::ssize_t p = 0, guess = 0; p < count; ++p) {
            const Point x(points[2 * p], points[2 * p + 1]);
            const int cell = basis_->locate(x, int(guess));
            if (cell < 0) {
                char text[128];
                std::snprintf(text, sizeof text,
                              "points: number %lld at (%g, %g) m is outside the grid; remove it",
                              static_cast<long long>(p), x[0], x[1]);
                throw SceneError(text);
            }
            guess = cell;
            const auto& here = basis_->on_cell(cell);
            std::fill(std::copy(here.begin(), here.end(), function), function + width_, -1);
            std::fill(value, value + width_, 0.0);
            std::fill(slopes.begin(), slopes.end(), Point(0, 0));
            basis_->evaluate(cell, x, value, slopes.data());
            for (const Point& slope : slopes) {
                *gradient++ = slope[0];
                *gradient++ = slope[1];
            }
            function += width_;
            value += width_;
        }
    }

    const triangular::Split* powell_sabin() const {
        if (const auto* b = dynamic_cast<const triangular::PowellSabin*>(basis_.get()))
            return &b->split();
        if (const auto* b = dynamic_cast<const triangular::CubicPowellSabin*>(basis_.get()))
            return &b->split();
        return nullptr;
    }

    std::unique_ptr<triangular::Basis> basis_;
    std::size_t width_;  // functions of the cell that has most
};

inline void bind_basis(py::module_& m) {
    py::class_<BasisHandle>(m, "Basis", "The functions of a grid over cells.", py::module_local())
        .def(py::init([](const py::dict& grid) {
                 const FunctionsSpec spec = read_functions(grid);
                 const py::gil_scoped_release unlocked;
                 return std::make_unique<BasisHandle>(spec);
             }),
             py::arg("grid"), "From the \"grid\" of a spec (design/engine-contract.md).")
        .def_property_readonly("functions",
                               [](const BasisHandle& h) { return h.basis().functions(); })
        .def_property_readonly("cells", [](const BasisHandle& h) { return h.basis().cells(); })
        .def_property_readonly("degree", [](const BasisHandle& h) { return h.basis().degree(); })
        .def_property_readonly("name", [](const BasisHandle& h) { return h.basis().name(); })
        .def("locate", &BasisHandle::locate, py::arg("points"),
             "Cells (n,) of points (n, 2), -1 outside.")
        .def("evaluate", &BasisHandle::evaluate, py::arg("points"),
             "Numbers (n, k), values (n, k) and gradients (n, k, 2) of the functions at points "
             "(n, 2); a row is filled up with function -1 and zeros.")
        .def("quadrature", &BasisHandle::quadrature, py::arg("points_per_direction"),
             "Points (q, 2) and weights (q,), exact on every piece to degree "
             "2 points_per_direction - 2.")
        .def("control_points", &BasisHandle::control_points,
             "Points (functions, 2) whose sum with the functions is the position.")
        .def("outline", &BasisHandle::outline,
             "Start and end (k, 2, 2) of the pieces of the outline.")
        .def("split", &BasisHandle::split,
             "Inner points (t, 2) and points on the sides (t, 3, 2) of the triangles, or None.")
        .def("control_triangles", &BasisHandle::control_triangles,
             "Corners (v, 3, 2) of the control triangles of the vertices, or None.");
}

}  // namespace mpm::python
