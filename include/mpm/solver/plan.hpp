// What a scene will cost, decided before anything is allocated; the engine allocates by the same
// decisions.
#pragma once

#include <string>
#include <vector>

#include "mpm/kernels/cell_smoothing.hpp"
#include "mpm/kernels/grid.hpp"
#include "mpm/kernels/phase.hpp"
#include "mpm/kernels/sweep.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

/// All materials that were built, in the order of src/kernels/models.cmake.
const std::vector<MaterialInfo>& materials();
const MaterialInfo& material(const std::string& name);

/// Is it a law that elements are built for (physics/element.hpp)?
bool material_of_elements(const std::string& name);
/// Whether volumes of vertices may take the place of its elements' own.
bool material_of_vertex_volumes(const std::string& name);
/// Numbers that an element of it keeps.
int kept_by_element(const std::string& name, int dimension);

/// What the backend that will run the scene is like.
struct BackendTraits {
    bool device = false;
    std::string name;
    Precision precision = Precision::single;
    bool fused = true;  // has the fused form in this precision
    std::string numbers() const {
        return precision == Precision::single  ? "single"
               : precision == Precision::mixed ? "mixed"
                                               : "double";
    }
    /// Bytes of a particle's numbers, and of the grid's and what goes to it and comes from it.
    int real() const { return precision == Precision::single ? 4 : 8; }
    int grid_real() const { return precision == Precision::double_ ? 8 : 4; }
};
BackendTraits cpu_traits(Precision precision);
BackendTraits cuda_traits(Precision precision);

struct PlanColumn {
    std::string name;
    int reals;
    int bytes;
};
/// In how many passes a step visits the particles of a body (design/pipelines.md).
enum class Pipeline {
    fused,             // one
    keeping,           // one, for a transfer that stores velocities
    two_pass,          // gather and advance; deposit
    two_pass_keeping,  // the same for a transfer that stores velocities
    phased             // collect; respond; spread
};
/// As users know it: those for transfers that store velocities have the names of the others.
const char* name_of(Pipeline pipeline);

struct BodyPlan {
    std::string name;
    std::uint64_t particles = 0;
    Pipeline pipeline = Pipeline::fused;
    std::string pipeline_reason;
    /// One of the forms that know all kernels and transfers, and their channels at the nodes.
    bool any_transfer() const { return pipeline == Pipeline::phased || keeps(); }
    /// One of the forms in one or two passes of a transfer that stores velocities.
    bool keeps() const {
        return pipeline == Pipeline::keeping || pipeline == Pipeline::two_pass_keeping;
    }
    std::vector<PlanColumn> columns;
    int bytes_per_particle = 0;
    Smoothing smoothing = Smoothing::none;
    bool carry = false, stress_only = false;
    GroupChannels group;
    int state_columns = 0;
    PhaseNumbers phase;  // of the phased step
    CellNumbers cells;   // and between its parts
    double spacing = 0;
    std::uint64_t elements = 0;  // whose vertices the particles are
    bool rigid = false;          // moved as a whole
    bool vertex_volumes = false;
    int kept = 0;  // numbers an element
};
/// Numbers a particle of what it leaves between the passes of its pipeline.
int deposit_columns(int dimension, const BodyPlan& body);
struct Plan {
    std::vector<BodyPlan> bodies;
    std::vector<GroupChannels> groups;
    std::vector<std::string> channels;  // of the sums
    int sum_channels = 0, velocity_channels = 0;
    int bytes_per_node = 0;
    KeptChannels kept;    // where the transfer stores velocities
    int filled = -1;      // sum: what mass by elements differs by from that of their vertices
    SweepChannels sweep;  // of XPIC and FMPM
    int sweeps = 0;       // per step
    double beyond =
        0;  // the largest share of a deposit that a particle moves with, beside the grid's
    bool on_functions = false;  // functions over cells in place of the regular grid
    double shift = 0;           // that particles may be shifted by in a step that shifts, cells
    bool density = false;       // are volumes of a body led by the density of the grid
    std::vector<std::string> kernels;
    /// That of all bodies, or `by_body` where they differ.
    std::string pipeline() const;
    /// Why: of all bodies, or of each group that has a reason of its own.
    std::string pipeline_reason() const;
    bool some(Pipeline pipeline) const;
    double time_step = 0;
    double wave_speed = 0;
    std::string limited_by;
    double memory_particles = 0, memory_sort = 0, memory_grid = 0, memory_tables = 0;
};

/// The pipeline of a scene whose bodies have several; asked for by this name, it is "auto".
inline constexpr const char* by_body = "by-body";

Plan make_plan(const Spec& spec, const BackendTraits& backend);

const char* name_of(Kernel kernel);

/// Why no body of the scene can do without the phased step; empty where some may.
std::string needs_phases(const Spec& spec);
/// The same of one body, where the scene allows it. Smoothing over cells alone is done before a
/// step where sums of cells are integers, in any pipeline.
std::string needs_phases(const Spec& spec, const BodySpec& body, bool device);
/// True where the scene's transfer stores velocities, and nothing else of it needs the phased step.
bool stores_in_one_pass(const Spec& spec);
/// Adds to a plan whose bodies are there what they do over cells; refuses what does not fit.
void plan_cells(const Spec& spec, Plan& plan);
/// Refuses what bodies of elements are not built for, by its name.
void check_elements(const Spec& spec);
/// Refuses what rigid bodies are not built for, by its name.
void check_rigid(const Spec& spec, const BackendTraits& backend);
/// Refuses pins of bodies that have no vertices.
void check_pins(const Spec& spec);
/// Adds to a plan whose bodies are there what the scene's transfer stores.
void plan_phases(const Spec& spec, Plan& plan);

}  // namespace mpm
