// Bodies of elements: of every law that is one of F alone, or flows with Hencky's stress.
#include "mpm/kernels/cpu/elements.hpp"

#include "mpm/core/error.hpp"
#include "mpm/kernels/model_headers.inc"

namespace mpm {

namespace {

template <class T, int D, class Material>
void take(const std::string& name, ElementOps<Cpu, T, D>& ops) {
    if constexpr (for_elements<Material>) {
        if (name == Material::name) ops = cpu::element_instance<Material, T, D>();
    }
}

template <class T, int D>
ElementOps<Cpu, T, D> find(const std::string& name) {
    ElementOps<Cpu, T, D> ops{};
#define MPM_MODEL(Model) take<T, D, Model>(name, ops);
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
    if (!ops.forces) throw SceneError("material '" + name + "' is not built for elements");
    return ops;
}

template <class T, int D>
BodyOps<Cpu, T, D> vertices() {
    BodyOps<Cpu, T, D> ops{};
    cpu::add_phases<VertexCarrier, Smoothing::none, T, D>(ops);
    return ops;
}

}  // namespace

#define MPM_ELEMENTS(T, D)                                                  \
    template <>                                                             \
    ElementOps<Cpu, T, D> element_ops<Cpu, T, D>(const std::string& name) { \
        return find<T, D>(name);                                            \
    }                                                                       \
    template <>                                                             \
    BodyOps<Cpu, T, D> vertex_ops<Cpu, T, D>() {                            \
        return vertices<T, D>();                                            \
    }
MPM_ELEMENTS(float, 2)
MPM_ELEMENTS(float, 3)
MPM_ELEMENTS(double, 2)
MPM_ELEMENTS(double, 3)
#undef MPM_ELEMENTS

}  // namespace mpm
