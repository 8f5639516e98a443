// Bodies of elements, and their vertices as particles.
#include "mpm/kernels/cpu/elements.hpp"

#include "mpm/kernels/element_laws.hpp"

namespace mpm {

namespace {

template <class T, int D>
BodyOps<Cpu, T, D> vertices() {
    BodyOps<Cpu, T, D> ops{};
    cpu::add_phases<VertexCarrier, Smoothing::none, T, D>(ops);
    return ops;
}

}  // namespace

#define MPM_ELEMENTS(T, D)                                                                   \
    template <>                                                                              \
    ElementOps<Cpu, T, D> element_ops<Cpu, T, D>(const std::string& name) {                  \
        return element_ops_of<ElementOps<Cpu, T, D>>(                                        \
            name, []<class Material>() { return cpu::element_instance<Material, T, D>(); }); \
    }                                                                                        \
    template <>                                                                              \
    BodyOps<Cpu, T, D> vertex_ops<Cpu, T, D>() {                                             \
        return vertices<T, D>();                                                             \
    }
MPM_ELEMENTS(float, 2)
MPM_ELEMENTS(float, 3)
MPM_ELEMENTS(double, 2)
MPM_ELEMENTS(double, 3)
#undef MPM_ELEMENTS

}  // namespace mpm
