// The structures of DLPack 1.0 (dmlc.github.io/dlpack), as other libraries read them from a
// capsule, and what makes such a capsule of a dense column.
#pragma once

#include <pybind11/pybind11.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "mpm/solver/engine.hpp"

namespace mpm::python {

namespace py = pybind11;

namespace dlpack {

inline constexpr std::int32_t cpu = 1, cuda = 2;
inline constexpr std::uint8_t unsigned_integer = 1, floating = 2;
inline constexpr std::uint64_t is_copied = 2;

struct Device {
    std::int32_t type, id;
};
struct DataType {
    std::uint8_t code, bits;
    std::uint16_t lanes;
};
struct Tensor {
    void* data;
    Device device;
    std::int32_t axes;
    DataType type;
    std::int64_t* shape;
    std::int64_t* strides;
    std::uint64_t byte_offset;
};
/// Before version 1.
struct Managed {
    static constexpr const char* name = "dltensor";
    Tensor tensor;
    void* context;
    void (*deleter)(Managed*);
};
struct ManagedVersioned {
    static constexpr const char* name = "dltensor_versioned";
    struct {
        std::uint32_t major, minor;
    } version;
    void* context;
    void (*deleter)(ManagedVersioned*);
    std::uint64_t flags;
    Tensor tensor;
};

/// Lives as long as the last user of the tensor, whoever that is. `Held` has a `column` and lets go
/// of it properly.
template <class M, class Held>
struct Context {
    M managed{};
    std::vector<std::int64_t> shape, strides;
    Held held;
};

/// The capsule of a column; whoever takes the tensor out of it renames it and calls its deleter.
template <class M, class Held>
py::capsule capsule(Held held, int device, bool copied) {
    auto* c =
        new Context<M, Held>{.managed = {}, .shape = {}, .strides = {}, .held = std::move(held)};
    const DenseColumn& column = c->held.column;
    c->shape.assign(column.shape.begin(), column.shape.end());
    c->strides.assign(c->shape.size(), 1);
    for (std::size_t a = c->shape.size(); a-- > 1;) c->strides[a - 1] = c->strides[a] * c->shape[a];
    const DataType type = {column.type == 'd' ? floating : unsigned_integer, 64, 1};
    c->managed.tensor = {column.data.get(),
                         {device < 0 ? cpu : cuda, device < 0 ? 0 : device},
                         std::int32_t(c->shape.size()),
                         type,
                         c->shape.data(),
                         c->strides.data(),
                         0};
    if constexpr (requires { c->managed.version; }) {
        c->managed.version = {1, 0};
        c->managed.flags = copied ? is_copied : 0;
    }
    c->managed.context = c;
    c->managed.deleter = [](M* m) {
        if (!Py_IsInitialized()) return;  // the process ends, and the memory with it
        const py::gil_scoped_acquire locked;
        delete static_cast<Context<M, Held>*>(m->context);
    };
    return py::capsule(&c->managed, M::name, [](PyObject* self) {
        // Renamed where somebody has taken it.
        if (!PyCapsule_IsValid(self, M::name)) return;
        auto* m = static_cast<M*>(PyCapsule_GetPointer(self, M::name));
        m->deleter(m);
    });
}

}  // namespace dlpack

}  // namespace mpm::python
