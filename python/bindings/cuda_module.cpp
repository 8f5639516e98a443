// libmpm._cuda: the CUDA backend, built when nvcc is found and loaded only when asked for. It
// loads without a driver.
#include <sstream>

#include "engine_binding.hpp"
#include "mpm/exec/cuda_devices.hpp"
#include "mpm/solver/added_materials.hpp"

namespace py = pybind11;

PYBIND11_MODULE(_cuda, m) {
    m.doc() = "Compiled core of libmpm: CUDA backend.";
    mpm::python::bind_engine(m, mpm::make_cuda_engine, mpm::plan_scene);
    m.def("add_material", &mpm::add_cuda_material, py::arg("path"),
          "Loads the library of a material that was compiled for itself; returns its name.");
    m.def(
        "build_info",
        [] {
            py::dict d;
            d["version"] = LIBMPM_VERSION;
            d["compiler"] = "g++ " __VERSION__;
            d["cuda"] = true;
            d["openmp"] = false;
            d["instruction_set"] = "cuda";
            d["dimensions"] = std::vector<int>{2, 3};
            d["precisions"] = std::vector<std::string>{"single", "mixed", "double"};
            std::vector<std::string> names;
            for (const auto& material : mpm::materials()) names.push_back(material.name);
            d["materials"] = names;
            d["threads"] = 0;
            d["cuda_runtime"] = mpm::cuda_runtime();
            std::vector<std::string> architectures;
            std::istringstream text(LIBMPM_CUDA_ARCHITECTURES);
            for (std::string one; std::getline(text, one, ',');) architectures.push_back(one);
            d["architectures"] = architectures;
            return d;
        },
        "How this library was built.");
    m.def(
        "devices",
        [] {
            py::list out;
            for (const auto& device : mpm::cuda_devices()) {
                py::dict d;
                d["index"] = device.index;
                d["name"] = device.name;
                d["memory"] = device.memory;
                d["free"] = device.free;
                d["compute_capability"] = device.compute_capability;
                out.append(d);
            }
            return out;
        },
        "The CUDA devices; raises DeviceError with the reason when there are none.");
}
