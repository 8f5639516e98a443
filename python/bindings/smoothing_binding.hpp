// Smoothing of fields on given points.
#pragma once

#include "body_reader.hpp"
#include "mpm/kernels/cpu/smooth_points.hpp"

namespace mpm::python {

/// (field (n, components), rows (passes, 3): energy before, after, of the mean everywhere)
inline py::tuple smooth_points(const Doubles& field, const Doubles& mass, const Doubles& position,
                               double cell_size, const py::dict& choice, int passes) {
    const auto count = field.shape(0);
    const auto dimension = position.ndim() == 2 ? int(position.shape(1)) : 0;
    if (field.ndim() != 2 || mass.size() != count || position.ndim() != 2 ||
        position.shape(0) != count || dimension < 1 || dimension > 3)
        throw SceneError("smoothing: field, mass and position do not belong to as many points");
    py::array_t<double> out({count, field.shape(1)});
    std::copy(field.data(), field.data() + field.size(), out.mutable_data());
    const cpu::PointField points{dimension,       std::int64_t(count), int(field.shape(1)),
                                 position.data(), mass.data(),         cell_size};
    const SmoothingChoice k = read_smoothing(choice, "smoothing");
    std::vector<SmoothingEnergy> energies;
    double* data = out.mutable_data();
    {
        py::gil_scoped_release unlocked;
        energies = cpu::smooth_points(points, k, passes, data);
    }
    py::array_t<double> rows({py::ssize_t(energies.size()), py::ssize_t(3)});
    double* to = rows.mutable_data();
    for (const SmoothingEnergy& e : energies)
        for (double x : {e.before, e.after, e.uniform}) *to++ = x;
    return py::make_tuple(out, rows);
}

inline void bind_smoothing(py::module_& m) {
    m.def("smooth_points", &smooth_points, py::arg("field"), py::arg("mass"), py::arg("position"),
          py::arg("cell_size"), py::arg("choice"), py::arg("passes"),
          "A field (n, components) on points, smoothed over cells, and energies of each pass.");
}

}  // namespace mpm::python
