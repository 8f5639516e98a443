// The list of materials, from the one place that names them (src/kernels/models.cmake), and those
// that were added since.
#include "mpm/core/error.hpp"
#include "mpm/kernels/model_headers.inc"
#include "mpm/physics/element.hpp"
#include "mpm/physics/material/rigid.hpp"
#include "mpm/solver/added_materials.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

namespace {

/// Entries are pointed at, so that they may not move.
constexpr std::size_t most_materials = 1024;

/// No kernel has it: its bodies are moved as a whole.
MaterialInfo rigid() {
    MaterialInfo m{};
    m.name = Rigid::name;
    m.summary = Rigid::summary;
    m.source = Rigid::source;
    m.needs = Rigid::needs;
    m.limits = Rigid::limits;
    m.parameters = Rigid::parameters;
    m.parameter_count = int(sizeof(Rigid::parameters) / sizeof(Parameter));
    m.density = &Rigid::density;
    m.wave_speed = &Rigid::wave_speed;
    m.reals = [](int) { return 0; };
    return m;
}

std::vector<MaterialInfo>& list() {
    static std::vector<MaterialInfo> all = [] {
        std::vector<MaterialInfo> built;
        built.reserve(most_materials);
#define MPM_MODEL(Model) built.push_back(describe_material<Model>());
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
        built.push_back(rigid());
        return built;
    }();
    return all;
}

}  // namespace

const std::vector<MaterialInfo>& materials() { return list(); }

bool material_of_elements(const std::string& name) {
#define MPM_MODEL(Model) \
    if (name == Model::name) return for_elements<Model>;
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
    return false;
}

bool material_of_vertex_volumes(const std::string& name) {
#define MPM_MODEL(Model) \
    if (name == Model::name) return for_vertex_volumes<Model>;
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
    return false;
}

int kept_by_element(const std::string& name, int dimension) {
#define MPM_MODEL(Model) \
    if (name == Model::name) return dimension == 2 ? kept_reals<Model, 2> : kept_reals<Model, 3>;
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
    return 0;
}

void add_material(const MaterialInfo& info) {
    for (const MaterialInfo& m : list())
        if (std::string(m.name) == info.name)
            throw SceneError("material '" + std::string(info.name) +
                             "' is there already; give the new law another name");
    if (list().size() == most_materials)
        throw SceneError("material '" + std::string(info.name) + "' is one more than the " +
                         std::to_string(most_materials) + " that a process may have");
    list().push_back(info);
}

}  // namespace mpm
