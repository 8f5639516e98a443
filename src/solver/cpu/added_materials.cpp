#include "mpm/solver/added_materials.hpp"

#include <dlfcn.h>

#include "mpm/core/error.hpp"
#include "mpm/kernels/cpu/added_material.hpp"

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

[[noreturn]] void refuse(void* library, const std::string& why) {
    if (library) ::dlclose(library);
    throw SceneError("the compiled material " + why);
}

}  // namespace

std::string add_cpu_material(const std::string& path) {
    // It stays: scenes and engines point at what it holds.
    void* library = ::dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        const char* why = ::dlerror();
        refuse(nullptr, "'" + path + "' cannot be loaded: " + (why ? why : "no reason given"));
    }
    const auto get = reinterpret_cast<GetAddedMaterial>(::dlsym(library, added_material_symbol));
    if (!get) refuse(library, "'" + path + "' exports no " + added_material_symbol);
    const MaterialHost ours = host();
    const AddedMaterial* added = get(&ours);
    if (!(added->layout == ours.layout))
        refuse(library, "'" + path + "' was compiled from other headers than this library, " +
                            LIBMPM_VERSION + "; delete it and compile it anew");
    const std::string name = added->info.name;
    add_material(added->info);
    added_ops<Cpu, float, 2>()[name] = added->float2;
    added_ops<Cpu, float, 3>()[name] = added->float3;
    added_ops<Cpu, double, 2>()[name] = added->double2;
    added_ops<Cpu, double, 3>()[name] = added->double3;
    return name;
}

}  // namespace mpm
