// libmpm._core: the CPU backend, always built.
#include <omp.h>

#include "basis_binding.hpp"
#include "engine_binding.hpp"
#include "mpm/physics/material/tait_fluid.hpp"
#include "mpm/solver/functions_engine.hpp"
#include "smoothing_binding.hpp"

namespace py = pybind11;

namespace {

/// What the loader picks for the cloned loops on this processor.
const char* instruction_set() {
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512cd")) {
        return "x86-64-v4";
    }
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
        __builtin_cpu_supports("bmi2"))
        return "x86-64-v3";
    return "x86-64";
}

template <class T>
py::array_t<T> equation_of_state(const py::array_t<T, py::array::c_style>& j, double bulk_modulus,
                                 double exponent) {
    const double parameters[] = {1.0, bulk_modulus, exponent, 0.0};
    const auto constants = mpm::TaitFluid::constants<T>(parameters);
    py::array_t<T> out(j.size());
    for (py::ssize_t k = 0; k < j.size(); ++k)
        out.mutable_data()[k] = mpm::TaitFluid::pressure(j.data()[k], constants);
    return out;
}

}  // namespace

PYBIND11_MODULE(_core, m) {
    m.doc() = "Compiled core of libmpm: CPU backend (OpenMP).";
    mpm::python::bind_engine(m, mpm::make_cpu_engine, [](const auto& spec, const auto& backend) {
        return spec.functions.kind.empty() ? mpm::plan_scene(spec, backend)
                                           : mpm::plan_functions(spec);
    });
    mpm::python::bind_basis(m);
    mpm::python::bind_smoothing(m);
    m.def("material_table", &mpm::python::material_table,
          "Descriptions of all materials and their parameters.");
    m.def(
        "build_info",
        [] {
            py::dict d;
            d["version"] = LIBMPM_VERSION;
            d["compiler"] = "g++ " __VERSION__;
#if defined(LIBMPM_WITH_CUDA)
            d["cuda"] = true;
#else
            d["cuda"] = false;
#endif
            d["openmp"] = true;
            d["instruction_set"] = instruction_set();
            d["dimensions"] = std::vector<int>{2, 3};
            d["precisions"] = std::vector<std::string>{"single", "double"};
            std::vector<std::string> names;
            for (const auto& material : mpm::materials()) names.push_back(material.name);
            d["materials"] = names;
            d["threads"] = omp_get_max_threads();
            return d;
        },
        "How this library was built and what it will use.");
    m.def("equation_of_state", &equation_of_state<float>, py::arg("j").noconvert(),
          py::arg("bulk_modulus"), py::arg("exponent"),
          "Pressure [Pa] of TaitFluid for volume losses j = 1 - J, in the precision of j.");
    m.def("equation_of_state", &equation_of_state<double>, py::arg("j").noconvert(),
          py::arg("bulk_modulus"), py::arg("exponent"));
}
