// Bodies of elements on devices, for one kind of numbers: a unit each in src/kernels/cuda.
#pragma once

#include "mpm/kernels/cuda/elements.cuh"
#include "mpm/kernels/element_laws.hpp"

namespace mpm::cuda {

template <class X, class T, int D>
ElementOps<X, T, D> find_element_ops(const std::string& name) {
    return element_ops_of<ElementOps<X, T, D>>(
        name, [&]<class Material>() { return element_instance<Material, X, T, D>(); });
}
template <class X, class T, int D>
BodyOps<X, T, D> make_vertex_ops() {
    BodyOps<X, T, D> ops{};
    add_phases<VertexCarrier, Smoothing::none, X, T, D>(ops);
    return ops;
}

#define MPM_ELEMENTS_ON(X, T, D)                                        \
    template <>                                                         \
    ElementOps<X, T, D> element_ops<X, T, D>(const std::string& name) { \
        return cuda::find_element_ops<X, T, D>(name);                   \
    }                                                                   \
    template <>                                                         \
    BodyOps<X, T, D> vertex_ops<X, T, D>() {                            \
        return cuda::make_vertex_ops<X, T, D>();                        \
    }

}  // namespace mpm::cuda
