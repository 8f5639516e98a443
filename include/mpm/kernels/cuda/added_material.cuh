// A material that is compiled while the library runs, on CUDA devices: as on the CPU
// (kernels/cpu/added_material.hpp). Its library has a CUDA runtime of its own; both share the
// device's primary context, and with it memory and streams.
#pragma once

#include <cstddef>

#include "mpm/kernels/cuda/body_pass.cuh"
#include "mpm/kernels/phase.hpp"

namespace mpm {

/// What both sides must lay out alike; anything else was compiled from other headers.
struct CudaMaterialLayout {
    std::size_t info = sizeof(MaterialInfo), pass = sizeof(Pass<Cuda, double, 3>),
                phase = sizeof(Phase<Cuda, double, 3>), ops = sizeof(BodyOps<Cuda, double, 3>),
                clock = sizeof(Clock), observation = sizeof(Observation<3>);
    char version[32] = LIBMPM_VERSION;

    bool operator==(const CudaMaterialLayout&) const = default;
};

/// For every precision and dimension: `Of<X, T, D>` of each.
template <template <class, class, int> class Of>
struct OfAllDevices {
    Of<Cuda, float, 2> float2;
    Of<Cuda, float, 3> float3;
    Of<Cuda, double, 2> double2;
    Of<Cuda, double, 3> double3;
    Of<CudaMixed, double, 2> mixed2;
    Of<CudaMixed, double, 3> mixed3;

    template <class X, class T, int D>
    Of<X, T, D> of() const {
        if constexpr (std::is_same_v<X, CudaMixed>) {
            if constexpr (D == 2)
                return mixed2;
            else
                return mixed3;
        } else if constexpr (std::is_same_v<T, float>) {
            if constexpr (D == 2)
                return float2;
            else
                return float3;
        } else {
            if constexpr (D == 2)
                return double2;
            else
                return double3;
        }
    }
};

template <class X, class T, int D>
using ScatterOnDevice = void (*)(const Pass<X, T, D>&, int channels, int plain);
template <class X, class T, int D>
using OpsOnDevice = BodyOps<X, T, D> (*)(Smoothing);

/// What the library gives: the passes that are compiled once, and how a failed call is told.
struct CudaMaterialHost {
    CudaMaterialLayout layout;
    OfAllDevices<ScatterOnDevice> scatter;
    void (*check)(cudaError_t, const char*, const char*, int);
};

/// What it gets: the material's description and its instances.
struct AddedCudaMaterial {
    CudaMaterialLayout layout;
    MaterialInfo info;
    OfAllDevices<OpsOnDevice> ops;
};

/// The one name that such a library exports.
inline constexpr const char* added_cuda_material_symbol = "libmpm_added_cuda_material";
using GetAddedCudaMaterial = const AddedCudaMaterial* (*)(const CudaMaterialHost*);

}  // namespace mpm

/// Written once in a unit that has included the header of `Material`.
#define MPM_ADDED_CUDA_MATERIAL(Material)                                                          \
    namespace mpm {                                                                                \
    static CudaMaterialHost added_host;                                                            \
    namespace cuda {                                                                               \
    template <class X, class T, int D>                                                             \
    void scatter_body(const Pass<X, T, D>& pass, int channels, int plain) {                        \
        added_host.scatter.of<X, T, D>()(pass, channels, plain);                                   \
    }                                                                                              \
    void check(cudaError_t status, const char* what, const char* file, int line) {                 \
        added_host.check(status, what, file, line);                                                \
    }                                                                                              \
    }                                                                                              \
    }                                                                                              \
    extern "C" __attribute__((visibility("default"))) const mpm::AddedCudaMaterial*                \
    libmpm_added_cuda_material(const mpm::CudaMaterialHost* host) {                                \
        using namespace mpm;                                                                       \
        static const AddedCudaMaterial added{                                                      \
            {},                                                                                    \
            describe_material<Material>(),                                                         \
            {&cuda_body_ops<Cuda, float, 2, Material>, &cuda_body_ops<Cuda, float, 3, Material>,   \
             &cuda_body_ops<Cuda, double, 2, Material>, &cuda_body_ops<Cuda, double, 3, Material>, \
             &cuda_body_ops<CudaMixed, double, 2, Material>,                                       \
             &cuda_body_ops<CudaMixed, double, 3, Material>}};                                     \
        if (added.layout == host->layout) added_host = *host;                                      \
        return &added;                                                                             \
    }
