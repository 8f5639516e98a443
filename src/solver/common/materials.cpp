// The list of materials, from the one place that names them (src/kernels/models.cmake).
#include "mpm/kernels/model_headers.inc"
#include "mpm/solver/plan.hpp"

namespace mpm {

const std::vector<MaterialInfo>& materials() {
    static const std::vector<MaterialInfo> all = {
#define MPM_MODEL(Model) describe_material<Model>(),
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
    };
    return all;
}

}  // namespace mpm
