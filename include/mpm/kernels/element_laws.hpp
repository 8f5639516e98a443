// The laws that bodies of elements are built for, by name: for the unit of a backend that compiles
// them. Every law that is one of F alone, or flows with Hencky's stress.
#pragma once

#include <string>

#include "mpm/core/error.hpp"
#include "mpm/kernels/elements.hpp"
#include "mpm/kernels/model_headers.inc"

namespace mpm {

/// `make.template operator()<Material>()` of the law with this name.
template <class Ops, class Make>
Ops element_ops_of(const std::string& name, const Make& make) {
    Ops ops{};
    const auto take = [&]<class Material>() {
        if constexpr (for_elements<Material>) {
            if (name == Material::name) ops = make.template operator()<Material>();
        }
    };
#define MPM_MODEL(Model) take.template operator()<Model>();
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
    if (!ops.forces) throw SceneError("material '" + name + "' is not built for elements");
    return ops;
}

}  // namespace mpm
