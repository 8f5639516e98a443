#include "mpm/solver/added_materials.hpp"

#include "mpm/kernels/cpu/added_material.hpp"
#include "mpm/solver/added_library.hpp"

namespace mpm {

namespace {

MaterialHost host() {
    constexpr Smoothing none = Smoothing::none, one = Smoothing::one_volume;
    MaterialHost h{};
    h.float2[0] = &cpu::scatter_body<float, 2, none>;
    h.float2[1] = &cpu::scatter_body<float, 2, one>;
    h.float3[0] = &cpu::scatter_body<float, 3, none>;
    h.float3[1] = &cpu::scatter_body<float, 3, one>;
    h.double2[0] = &cpu::scatter_body<double, 2, none>;
    h.double2[1] = &cpu::scatter_body<double, 2, one>;
    h.double3[0] = &cpu::scatter_body<double, 3, none>;
    h.double3[1] = &cpu::scatter_body<double, 3, one>;
    return h;
}

}  // namespace

std::string add_cpu_material(const std::string& path) {
    const auto& added =
        load_added<AddedMaterial, GetAddedMaterial>(path, added_material_symbol, host());
    const std::string name = added.info.name;
    add_material(added.info);
    added_ops<Cpu, float, 2>()[name] = added.float2;
    added_ops<Cpu, float, 3>()[name] = added.float3;
    added_ops<Cpu, double, 2>()[name] = added.double2;
    added_ops<Cpu, double, 3>()[name] = added.double3;
    return name;
}

}  // namespace mpm
