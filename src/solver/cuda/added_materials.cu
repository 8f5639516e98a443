#include "mpm/kernels/cuda/added_material.cuh"
#include "mpm/solver/added_library.hpp"
#include "mpm/solver/added_materials.hpp"

namespace mpm {

std::string add_cuda_material(const std::string& path) {
    CudaMaterialHost host{};
    host.scatter.float2 = &cuda::scatter_body<Cuda, float, 2>;
    host.scatter.float3 = &cuda::scatter_body<Cuda, float, 3>;
    host.scatter.double2 = &cuda::scatter_body<Cuda, double, 2>;
    host.scatter.double3 = &cuda::scatter_body<Cuda, double, 3>;
    host.scatter.mixed2 = &cuda::scatter_body<CudaMixed, double, 2>;
    host.scatter.mixed3 = &cuda::scatter_body<CudaMixed, double, 3>;
    host.check = &cuda::check;
    const auto& added =
        load_added<AddedCudaMaterial, GetAddedCudaMaterial>(path, added_cuda_material_symbol, host);
    add_material(added.info);
    const std::string name = added.info.name;
    added_ops<Cuda, float, 2>()[name] = added.ops.float2;
    added_ops<Cuda, float, 3>()[name] = added.ops.float3;
    added_ops<Cuda, double, 2>()[name] = added.ops.double2;
    added_ops<Cuda, double, 3>()[name] = added.ops.double3;
    added_ops<CudaMixed, double, 2>()[name] = added.ops.mixed2;
    added_ops<CudaMixed, double, 3>()[name] = added.ops.mixed3;
    return name;
}

}  // namespace mpm
