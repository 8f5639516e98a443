// A material that is compiled while the library runs, from a header of the user's, into a shared
// library of its own. It has the instances that a built-in one has, and nothing else: what knows no
// material (the second half of the two-pass form) it is given by the library that loads it.
#pragma once

#include <cstddef>

#include "mpm/kernels/cpu/body_pass.hpp"
#include "mpm/kernels/phase.hpp"

namespace mpm {

/// What both sides must lay out alike; anything else was compiled from other headers.
struct MaterialLayout {
    std::size_t info = sizeof(MaterialInfo), pass = sizeof(Pass<Cpu, double, 3>),
                phase = sizeof(Phase<Cpu, double, 3>), ops = sizeof(BodyOps<Cpu, double, 3>),
                clock = sizeof(Clock), observation = sizeof(Observation<3>);
    char version[32] = LIBMPM_VERSION;

    bool operator==(const MaterialLayout&) const = default;
};

/// What the library gives: the passes that are compiled once, without and with an averaged volume.
struct MaterialHost {
    template <class T, int D>
    using Scatter = void (*)(const Pass<Cpu, T, D>&);
    MaterialLayout layout;
    Scatter<float, 2> float2[2];
    Scatter<float, 3> float3[2];
    Scatter<double, 2> double2[2];
    Scatter<double, 3> double3[2];

    template <class T, int D>
    MPM_INLINE Scatter<T, D> scatter(Smoothing s) const {
        const int k = s == Smoothing::none ? 0 : 1;
        if constexpr (std::is_same_v<T, float> && D == 2)
            return float2[k];
        else if constexpr (std::is_same_v<T, float>)
            return float3[k];
        else if constexpr (D == 2)
            return double2[k];
        else
            return double3[k];
    }
};

/// What it gets: the material's description and its instances.
struct AddedMaterial {
    MaterialLayout layout;
    MaterialInfo info;
    BodyOps<Cpu, float, 2> (*float2)(Smoothing);
    BodyOps<Cpu, float, 3> (*float3)(Smoothing);
    BodyOps<Cpu, double, 2> (*double2)(Smoothing);
    BodyOps<Cpu, double, 3> (*double3)(Smoothing);
};

/// The one name that such a library exports.
inline constexpr const char* added_material_symbol = "libmpm_added_material";
using GetAddedMaterial = const AddedMaterial* (*)(const MaterialHost*);

}  // namespace mpm

// Written once in a unit that has included the header of `Material`. One unit for all precisions
// and dimensions, as of a built-in law: what the compiler inlines, and with it the last bit,
// depends on what else a unit holds.
#define MPM_ADDED_MATERIAL(Material)                                            \
    namespace mpm {                                                             \
    static MaterialHost added_host;                                             \
    namespace cpu {                                                             \
    template <class T, int D, Smoothing S>                                      \
    void scatter_body(const Pass<Cpu, T, D>& pass) {                            \
        added_host.scatter<T, D>(S)(pass);                                      \
    }                                                                           \
    }                                                                           \
    template <>                                                                 \
    BodyOps<Cpu, float, 2> body_ops<Cpu, float, 2, Material>(Smoothing s) {     \
        return cpu_body_ops<float, 2, Material>(s);                             \
    }                                                                           \
    template <>                                                                 \
    BodyOps<Cpu, float, 3> body_ops<Cpu, float, 3, Material>(Smoothing s) {     \
        return cpu_body_ops<float, 3, Material>(s);                             \
    }                                                                           \
    template <>                                                                 \
    BodyOps<Cpu, double, 2> body_ops<Cpu, double, 2, Material>(Smoothing s) {   \
        return cpu_body_ops<double, 2, Material>(s);                            \
    }                                                                           \
    template <>                                                                 \
    BodyOps<Cpu, double, 3> body_ops<Cpu, double, 3, Material>(Smoothing s) {   \
        return cpu_body_ops<double, 3, Material>(s);                            \
    }                                                                           \
    }                                                                           \
    extern "C" __attribute__((visibility("default"))) const mpm::AddedMaterial* \
    libmpm_added_material(const mpm::MaterialHost* host) {                      \
        using namespace mpm;                                                    \
        static const AddedMaterial added{{},                                    \
                                         describe_material<Material>(),         \
                                         &body_ops<Cpu, float, 2, Material>,    \
                                         &body_ops<Cpu, float, 3, Material>,    \
                                         &body_ops<Cpu, double, 2, Material>,   \
                                         &body_ops<Cpu, double, 3, Material>};  \
        if (added.layout == host->layout) added_host = *host;                   \
        return &added;                                                          \
    }
