// What both modules export: Engine and plan. Thin: no defaults, no policy; Python owns those.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <atomic>
#include <functional>

#include "dlpack.hpp"
#include "mpm/exec/fair_mutex.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/merged.hpp"
#include "spec_reader.hpp"

namespace mpm::python {

inline py::array numpy(const Array& a) {
    py::array_t<double> out(std::vector<py::ssize_t>(a.shape.begin(), a.shape.end()));
    std::copy(a.data.begin(), a.data.end(), out.mutable_data());
    return out;
}
inline py::array numpy(const std::vector<std::uint64_t>& v) {
    return py::array_t<std::uint64_t>(py::ssize_t(v.size()), v.data());
}

/// Boxes of a `Window` as readers give them: (lower, upper) of each, m from the domain's corner.
using Boxes = std::vector<std::pair<std::vector<double>, std::vector<double>>>;

inline Window window_of(const Boxes& boxes) {
    Window out;
    for (const auto& [low, high] : boxes) {
        out.low.insert(out.low.end(), low.begin(), low.end());
        out.high.insert(out.high.end(), high.begin(), high.end());
    }
    return out;
}

inline py::dict plan_dict(const Plan& p) {
    py::dict out;
    py::list bodies;
    for (const auto& b : p.bodies) {
        py::list columns;
        for (const auto& c : b.columns) {
            py::dict column;
            column["name"] = c.name;
            column["reals"] = c.reals;
            column["bytes"] = c.bytes;
            columns.append(column);
        }
        py::dict body;
        body["name"] = b.name;
        body["particles"] = b.particles;
        body["columns"] = columns;
        body["bytes_per_particle"] = b.bytes_per_particle;
        body["particle_spacing"] = b.spacing;
        body["elements"] = b.elements;
        body["pipeline"] = p.on_functions ? "modified update" : name_of(b.pipeline);
        body["pipeline_reason"] = b.pipeline_reason;
        bodies.append(body);
    }
    out["bodies"] = bodies;
    py::dict grid;
    grid["channels"] = p.channels;
    grid["bytes_per_node"] = p.bytes_per_node;
    out["grid"] = grid;
    out["pipeline"] = p.on_functions ? "modified update" : p.pipeline();
    out["pipeline_reason"] = p.pipeline_reason();
    out["kernels"] = p.kernels;
    out["time_step"] = p.time_step;
    out["limited_by"] = p.limited_by;
    py::dict memory;
    memory["particles"] = p.memory_particles;
    memory["sort"] = p.memory_sort;
    memory["grid"] = p.memory_grid;
    memory["tables"] = p.memory_tables;
    out["memory"] = memory;
    out["memory_total"] = p.memory_particles + p.memory_sort + p.memory_grid + p.memory_tables;
    return out;
}

inline py::dict fault_dict(const Fault& f) {
    py::dict d;
    d["code"] = f.code;
    d["body"] = f.body;
    d["ids"] = numpy(f.ids);
    d["step"] = f.step;
    d["time"] = f.time;
    d["value"] = f.value;
    d["speed"] = f.speed;
    d["grew_since"] = f.grew_since;
    d["message"] = f.message;
    if (f.element >= 0) d["element"] = f.element;
    return d;
}

inline py::object blob_array(const Blob& b) {
    const auto shape = std::vector<py::ssize_t>(b.shape.begin(), b.shape.end());
    const std::map<char, const char*> types = {{'f', "f4"}, {'d', "f8"}, {'i', "i4"}, {'l', "i8"},
                                               {'I', "u4"}, {'L', "u8"}, {'B', "u1"}};
    py::array a(py::dtype(types.at(b.type)), shape);
    std::copy(b.bytes.begin(), b.bytes.end(), static_cast<unsigned char*>(a.mutable_data()));
    return a;
}

inline State read_state(const py::dict& d) {
    State s;
    for (const auto& [key, value] : d) {
        const auto a = py::array::ensure(value, py::array::c_style);
        if (!a)
            throw SceneError("the saved state's entry '" + key.cast<std::string>() +
                             "' is not an array");
        Blob b;
        const std::map<std::pair<char, py::ssize_t>, char> types = {
            {{'f', 4}, 'f'}, {{'f', 8}, 'd'}, {{'i', 4}, 'i'}, {{'i', 8}, 'l'},
            {{'u', 4}, 'I'}, {{'u', 8}, 'L'}, {{'u', 1}, 'B'}};
        const auto type = types.find({a.dtype().kind(), a.itemsize()});
        if (type == types.end() || a.dtype().byteorder() == '>')
            throw SceneError("the saved state's entry '" + key.cast<std::string>() +
                             "' is an array of " + py::str(a.dtype()).cast<std::string>() +
                             "; expected numbers of 4 or 8 bytes of this machine, or bytes");
        b.type = type->second;
        for (py::ssize_t k = 0; k < a.ndim(); ++k) b.shape.push_back(std::size_t(a.shape(k)));
        const auto* bytes = static_cast<const unsigned char*>(a.data());
        b.bytes.assign(bytes, bytes + a.nbytes());
        s[key.cast<std::string>()] = std::move(b);
    }
    return s;
}

/// An engine with the spec that made it, for what readers ask by name. An engine is for one thread
/// at a time: reading brings nodes up to date and the clock with it, which would take a run on
/// another thread back to the step that the reader found.
struct Handle {
    Spec spec;
    std::unique_ptr<Engine> engine;
    FairMutex mutex;
    std::atomic<std::int64_t> generation{0};  // of the state: counts runs and loads
    // The rest is under Python's lock.
    std::vector<DenseColumn> let_go;  // while another thread works with the engine
    // Of the last boundary of a step at which the engine rested: for who does not want to wait.
    double time = 0, time_step = 0;
    std::int64_t step = 0;

    void look() {
        time = engine->time();
        time_step = engine->time_step();
        step = engine->step();
    }
};

/// Around whatever asks an engine; begins and ends with Python's lock. Whoever waits does so
/// without it, because the one who is waited for may want it.
class Entry {
public:
    explicit Entry(Handle& h) : handle_(h) {
        if (h.mutex.try_lock()) return;
        const py::gil_scoped_release others;
        h.mutex.lock();
    }
    ~Entry() {
        handle_.look();
        handle_.let_go.clear();
        handle_.mutex.unlock();
    }
    Entry(const Entry&) = delete;
    Entry& operator=(const Entry&) = delete;

private:
    Handle& handle_;
};

/// What an engine says to `ask`; others have Python's lock meanwhile. No Python code may run
/// inside, a finalizer say, which could ask the engine in its turn.
template <class Ask>
auto ask(Handle& h, const Ask& question) {
    const Entry entry(h);  // until after the lock is back
    const py::gil_scoped_release others;
    return question(*h.engine);
}

/// A dense column in the memory of an engine, which it keeps alive.
struct Held {
    py::object engine;
    DenseColumn column;

    Held(py::object e, DenseColumn c) : engine(std::move(e)), column(std::move(c)) {}
    Held(Held&&) = default;
    Held(const Held&) = delete;
    Held& operator=(const Held&) = delete;
    ~Held() {
        if (!engine || !column.data) return;
        Handle& h = handle();
        if (!h.mutex.try_lock()) {
            h.let_go.push_back(std::move(column));
            return;
        }
        column.data.reset();
        h.mutex.unlock();
    }
    Handle& handle() const { return engine.cast<Handle&>(); }
};

struct ColumnHandle {
    Held held;
    int device = -1;

    py::array numpy() const {
        const DenseColumn& c = held.column;
        const std::vector<py::ssize_t> shape(c.shape.begin(), c.shape.end());
        py::array out(py::dtype(c.type == 'd' ? "f8" : "u8"), shape);
        const Entry entry(held.handle());
        held.handle().engine->copy_out(c, out.mutable_data());
        return out;
    }
    py::capsule dlpack(bool versioned, bool copied) const {
        const auto column = [&] {
            if (!copied) return held.column;
            const Entry entry(held.handle());
            return held.handle().engine->duplicate(held.column);
        };
        Held given(held.engine, column());
        return versioned
                   ? dlpack::capsule<dlpack::ManagedVersioned>(std::move(given), device, copied)
                   : dlpack::capsule<dlpack::Managed>(std::move(given), device, copied);
    }
};

inline void bind_columns(py::module_& m) {
    py::class_<ColumnHandle>(m, "Column",
                             "Numbers one after another in the memory of an engine's device.",
                             py::module_local())
        .def_property_readonly("shape",
                               [](const ColumnHandle& c) {
                                   py::tuple shape(c.held.column.shape.size());
                                   for (std::size_t a = 0; a < shape.size(); ++a)
                                       shape[a] = c.held.column.shape[a];
                                   return shape;
                               })
        .def_property_readonly(
            "type", [](const ColumnHandle& c) { return c.held.column.type == 'd' ? "<f8" : "<u8"; })
        .def_property_readonly(
            "pointer",
            [](const ColumnHandle& c) {
                return reinterpret_cast<std::uintptr_t>(c.held.column.data.get());
            })
        .def_readonly("device", &ColumnHandle::device)
        .def("numpy", &ColumnHandle::numpy)
        .def("dlpack", &ColumnHandle::dlpack, py::arg("versioned"), py::arg("copied"));
}

using Reals = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Ids = py::array_t<std::uint64_t, py::array::c_style | py::array::forcecast>;
using Factory = std::function<std::unique_ptr<Engine>(const Spec&)>;
using Planner = std::function<Plan(const Spec&, const BackendTraits&)>;

inline void bind_engine(py::module_& m, const Factory& make, const Planner& plan) {
    // Errors become the Python classes of the same name, looked up when first needed.
    py::register_exception_translator([](std::exception_ptr p) {
        const auto raise = [](const char* name, const char* what) {
            const py::object type = py::module_::import("libmpm._src.errors").attr(name);
            PyErr_SetString(type.ptr(), what);
        };
        try {
            if (p) std::rethrow_exception(p);
        } catch (const SceneError& e) {
            raise("SceneError", e.what());
        } catch (const DeviceError& e) {
            raise("DeviceError", e.what());
        } catch (const CapacityError& e) {
            raise("CapacityError", e.what());
        } catch (const NumericalError& e) {
            raise("NumericalError", e.what());
        } catch (const Error& e) {
            raise("Error", e.what());
        }
    });

    m.def(
        "plan",
        [plan](const py::dict& d, const std::string& kind) {
            const Spec spec = read_spec(d);
            const auto traits = kind == "cuda" ? cuda_traits : cpu_traits;
            return plan_dict(plan(spec, traits(spec.precision)));
        },
        py::arg("spec"), py::arg("kind"),
        "What a spec costs on a \"cpu\" or on a \"cuda\" device that need not exist, before "
        "anything "
        "is allocated (design/engine-contract.md).");

    bind_columns(m);
    py::class_<Handle>(m, "Engine",
                       "A simulation on one device, built from a spec (design/engine-contract.md).",
                       py::module_local())
        .def(py::init([make](const py::dict& d) {
                 auto h = std::make_unique<Handle>();
                 h->spec = read_spec(d);
                 {
                     py::gil_scoped_release unlocked;
                     h->engine = make(h->spec);
                 }
                 h->look();
                 for (auto& b : h->spec.bodies) {
                     b.position = b.pressure = b.state = nullptr;
                     b.velocity = b.velocity_gradient = {};
                     b.ids = {};
                 }
                 h->spec.start = {};
                 return h;
             }),
             py::arg("spec"))
        .def(
            "run",
            [](Handle& h, std::int64_t steps, double until, double wall) {
                const RunResult r = ask(h, [&](Engine& e) {
                    ++h.generation;
                    return e.run(steps, until, wall);
                });
                py::dict d;
                d["reason"] = r.reason;
                d["steps"] = r.steps;
                d["time"] = r.time;
                if (r.reason == "fault") d["fault"] = fault_dict(r.fault);
                return d;
            },
            py::arg("steps"), py::arg("until"), py::arg("wall"))
        .def_property_readonly("time", [](const Handle& h) { return h.time; })
        .def_property_readonly("step", [](const Handle& h) { return h.step; })
        .def_property_readonly("time_step", [](const Handle& h) { return h.time_step; })
        .def(
            "particle_count",
            [](Handle& h, int body) {
                return ask(h, [&](Engine& e) { return e.particle_count(body); });
            },
            py::arg("body"))
        .def("drain",
             [](Handle& h) {
                 py::list out;
                 for (const auto& s : ask(h, [](Engine& e) { return e.drain(); })) {
                     out.append(py::make_tuple(
                         py::array_t<double>(py::ssize_t(s.time.size()), s.time.data()),
                         numpy(s.values)));
                 }
                 return out;
             })
        .def(
            "sensor_columns",
            [](const Handle& h, int sensor) { return sensor_columns(h.spec, sensor); },
            py::arg("sensor"))
        .def("removed",
             [](Handle& h) {
                 py::list out;
                 for (const auto& r : ask(h, [](Engine& e) { return e.removed(); }))
                     out.append(
                         py::make_tuple(r.body, numpy(r.ids), numpy(r.position), r.step, r.policy));
                 return out;
             })
        .def("flows",
             [](Handle& h) {
                 py::list out;
                 for (const auto& f : ask(h, [](Engine& e) { return e.flows(); }))
                     out.append(py::make_tuple(f.inlet ? "inlet" : "outlet", f.number, f.time,
                                               f.step, f.particles, f.mass, f.volume));
                 return out;
             })
        .def(
            "smoothing",
            [](Handle& h, int body) {
                const SmoothingHistory s = ask(h, [&](Engine& e) { return e.smoothing(body); });
                py::array_t<double> out({py::ssize_t(s.rows.size()), py::ssize_t(5)});
                double* to = out.mutable_data();
                for (const auto& r : s.rows)
                    for (double x : {r.time, r.calls, r.before, r.change, r.index}) *to++ = x;
                return out;
            },
            py::arg("body"),
            "Rows (time, calls, energy before, its change, I_E) of smoothing over cells.")
        .def(
            "attribute_names",
            [](Handle& h, int body) {
                return ask(h, [&](Engine& e) { return e.attribute_names(body); });
            },
            py::arg("body"))
        .def(
            "attributes",
            [](Handle& h, int body, const std::vector<std::string>& names, const Boxes& within) {
                std::vector<std::string> without_id;
                for (const auto& n : names)
                    if (n != "id") without_id.push_back(n);
                Attributes a = ask(h, [&](Engine& e) {
                    return e.attributes(body, without_id, window_of(within));
                });
                py::dict d;
                d["id"] = numpy(a.id);
                for (const auto& [name, value] : a.values) d[py::str(name)] = numpy(value);
                return d;
            },
            py::arg("body"), py::arg("names"), py::arg("within") = Boxes())
        .def(
            "attribute",
            [](Handle& h, int body, const std::string& name) -> py::object {
                Attributes a = ask(h, [&](Engine& e) {
                    return e.attributes(body, name == "id" ? std::vector<std::string>{}
                                                           : std::vector<std::string>{name});
                });
                if (name == "id") return numpy(a.id);
                return numpy(a.values.at(name));
            },
            py::arg("body"), py::arg("name"))
        .def_property_readonly("generation", [](const Handle& h) { return h.generation.load(); })
        .def(
            "gather",
            [](py::object self, int body, const std::vector<std::string>& names,
               const std::vector<double>& origin) {
                Handle& h = self.cast<Handle&>();
                Gathered from = ask(h, [&](Engine& e) { return e.gather(body, names, origin); });
                py::dict out;
                for (auto& [name, column] : from.columns)
                    out[py::str(name)] = ColumnHandle{Held(self, std::move(column)), from.device};
                return out;
            },
            py::arg("body"), py::arg("names"), py::arg("origin"))
        .def(
            "assign",
            [](Handle& h, int body, const Ids& ids, const Reals& change, const Reals& state,
               const Reals& pressure) {
                Assignment given;
                given.body = body;
                given.id.assign(ids.data(), ids.data() + ids.size());
                given.change.assign(change.data(), change.data() + change.size());
                given.state.assign(state.data(), state.data() + state.size());
                given.width = state.ndim() == 2 ? int(state.shape(1)) : 0;
                given.pressure.assign(pressure.data(), pressure.data() + pressure.size());
                ask(h, [&](Engine& e) {
                    e.assign(given);
                    ++h.generation;
                });
            },
            py::arg("body"), py::arg("ids"), py::arg("change"), py::arg("state"),
            py::arg("pressure"))
        .def(
            "grid",
            [](Handle& h, const std::string& name, const Boxes& within) {
                Array a = ask(h, [&](Engine& e) { return e.grid(name, window_of(within)); });
                return numpy(a);
            },
            py::arg("name"), py::arg("within") = Boxes())
        .def(
            "sums",
            [](Handle& h, const Boxes& within) {
                NodalSums s = ask(h, [&](Engine& e) { return e.sums(window_of(within)); });
                const py::ssize_t d = h.spec.dimension, n = py::ssize_t(s.cell.size()) / d;
                py::dict out;
                out["cell"] = py::array_t<std::int64_t>({n, d}, s.cell.data());
                for (const auto& [name, value] : s.value)
                    out[py::str(name)] = py::array_t<double>(n, value.data());
                return out;
            },
            py::arg("within") = Boxes())
        .def(
            "condition",
            [](Handle& h, int samples) {
                Condition c = ask(h, [&](Engine& e) { return e.condition(samples); });
                py::dict d;
                d["kinetic"] = c.kinetic;
                d["elastic"] = c.elastic;
                d["potential"] = c.potential;
                d["speed"] = c.speed;
                d["mass"] = c.mass;
                d["density"] = c.density;
                d["volume_ratio"] = c.volume_ratio;
                return d;
            },
            py::arg("samples"))
        .def("save",
             [](Handle& h) {
                 State s = ask(h, [&](Engine& e) { return e.save(); });
                 py::dict d;
                 for (const auto& [name, blob] : s) d[py::str(name)] = blob_array(blob);
                 return d;
             })
        .def(
            "load",
            [](Handle& h, const py::dict& d) {
                const State s = read_state(d);
                ask(h, [&](Engine& e) {
                    ++h.generation;
                    e.load(s);
                });
            },
            py::arg("state"))
        .def("timings", [](Handle& h) { return ask(h, [](Engine& e) { return e.timings(); }); })
        .def("statistics",
             [](Handle& h) { return ask(h, [](Engine& e) { return e.statistics(); }); });
}

inline py::list material_table() {
    py::list out;
    for (const auto& m : materials()) {
        py::dict d;
        d["name"] = m.name;
        d["summary"] = m.summary;
        d["source"] = m.source;
        d["needs"] = m.needs;
        d["fbar"] = m.smoothable;
        py::list columns, parameters;
        for (int k = 0; k < m.column_count; ++k) {
            py::dict c;
            c["name"] = m.columns[k].name;
            c["components"] = m.columns[k].components[1];
            c["components_2d"] = m.columns[k].components[0];
            c["meaning"] = m.columns[k].meaning;
            c["unit"] = m.columns[k].unit;
            columns.append(c);
        }
        for (int k = 0; k < m.parameter_count; ++k) {
            const Parameter& p = m.parameters[k];
            py::dict c;
            c["name"] = p.name;
            c["symbol"] = p.symbol;
            c["unit"] = p.unit;
            c["default"] = p.default_value == p.default_value
                               ? py::object(py::float_(p.default_value))
                               : py::object(py::none());
            c["lower"] = p.lower;
            c["upper"] = p.upper;
            c["lower_open"] = p.lower_open;
            c["upper_open"] = p.upper_open;
            c["meaning"] = p.meaning;
            parameters.append(c);
        }
        d["columns"] = columns;
        d["parameters"] = parameters;
        out.append(d);
    }
    return out;
}

}  // namespace mpm::python
