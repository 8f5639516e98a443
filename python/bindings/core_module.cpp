// libmpm._core: the CPU backend, always built.
#include <omp.h>
#include <unistd.h>

#include "basis_binding.hpp"
#include "engine_binding.hpp"
#include "mpm/exec/rank_processes.hpp"
#include "mpm/kernels/cpu/levels.hpp"
#include "mpm/physics/material/tait_fluid.hpp"
#include "mpm/solver/added_materials.hpp"
#include "mpm/solver/functions_engine.hpp"
#include "smoothing_binding.hpp"

namespace py = pybind11;

namespace {

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

/// The link of this process to the others of its job.
void bind_processes(py::module_& m) {
    using mpm::Bytes, mpm::RankProcesses;
    const auto bytes_of = [](const py::bytes& given) {
        const std::string_view text = given;
        return Bytes(text.begin(), text.end());
    };
    const auto list_of = [](const std::vector<Bytes>& all) {
        py::list out;
        for (const Bytes& b : all)
            out.append(py::bytes(reinterpret_cast<const char*>(b.data()), b.size()));
        return out;
    };
    // Ctrl-C reaches who waits for others. Python runs handlers in the main thread alone.
    RankProcesses::while_waiting([] {
        if (::gettid() != ::getpid() || !Py_IsInitialized()) return;
        const py::gil_scoped_acquire locked;
        if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    });
    py::class_<RankProcesses, std::shared_ptr<RankProcesses>>(
        m, "Processes", "This process among those of its job (design/ranks.md).")
        .def(py::init([](double seconds) {
                 const py::gil_scoped_release unlocked;
                 return std::make_shared<RankProcesses>(mpm::read_launch(), seconds);
             }),
             py::arg("seconds"))
        .def_property_readonly("rank", &RankProcesses::rank)
        .def_property_readonly("ranks", &RankProcesses::ranks)
        .def_property_readonly("local_rank", &RankProcesses::local_rank)
        .def_property_readonly("local_ranks", &RankProcesses::local_ranks)
        .def_property_readonly("launcher",
                               [](const RankProcesses& p) { return p.launch().launcher; })
        .def(
            "tell_all",
            [=](RankProcesses& p, const py::bytes& given) {
                std::vector<Bytes> in, to(std::size_t(p.ranks()), bytes_of(given));
                {
                    const py::gil_scoped_release unlocked;
                    in = p.exchange(to, p.others());
                }
                in[std::size_t(p.rank())] = to[std::size_t(p.rank())];
                return list_of(in);
            },
            py::arg("given"), "What all gave, by rank.")
        .def(
            "tell_first",
            [=](RankProcesses& p, const py::bytes& given) -> py::object {
                std::vector<Bytes> in, to{std::size_t(p.ranks())};
                if (p.rank() > 0) to[0] = bytes_of(given);
                {
                    const py::gil_scoped_release unlocked;
                    in = p.exchange(std::move(to), p.rank() > 0 ? std::vector<int>{0} : p.others());
                }
                if (p.rank() > 0) return py::none();
                in[0] = bytes_of(given);
                return list_of(in);
            },
            py::arg("given"), "What all gave, by rank, on rank 0; None on the others.")
        .def("stop", &RankProcesses::stop, py::arg("why"),
             py::call_guard<py::gil_scoped_release>());
}

}  // namespace

PYBIND11_MODULE(_core, m) {
    m.doc() = "Compiled core of libmpm: CPU backend (OpenMP).";
    mpm::python::bind_engine(m, mpm::make_cpu_engine, [](const auto& spec, const auto& backend) {
        return spec.functions.kind.empty() ? mpm::plan_scene(spec, backend)
                                           : mpm::plan_functions(spec);
    });
    bind_processes(m);
    mpm::python::bind_basis(m);
    mpm::python::bind_smoothing(m);
    m.def("material_table", &mpm::python::material_table,
          "Descriptions of all materials and their parameters.");
    m.def("add_material", &mpm::add_cpu_material, py::arg("path"),
          "Loads the library of a material that was compiled for itself; returns its name.");
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
            d["instruction_set"] = mpm::cpu::name_of(mpm::cpu::processor_level());
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
