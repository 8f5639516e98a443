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
struct BodyPlan {
    std::string name;
    std::uint64_t particles = 0;
    std::vector<PlanColumn> columns;
    int bytes_per_particle = 0;
    Smoothing smoothing = Smoothing::none;
    bool carry = false, stress_only = false;
    GroupChannels group;
    int state_columns = 0;
    PhaseNumbers phase;  // of the phased step
    CellNumbers cells;   // and between its parts
    double spacing = 0;
};
struct Plan {
    std::vector<BodyPlan> bodies;
    std::vector<GroupChannels> groups;
    std::vector<std::string> channels;  // of the sums
    int sum_channels = 0, velocity_channels = 0;
    int bytes_per_node = 0;
    bool fused = true;
    bool phased = false;
    bool keeps = false;   // fused, with a transfer that stores velocities
    KeptChannels kept;    // where the transfer stores velocities
    SweepChannels sweep;  // of XPIC and FMPM
    int sweeps = 0;       // per step
    double beyond =
        0;  // the largest share of a deposit that a particle moves with, beside the grid's
    bool on_functions = false;  // functions over cells in place of the regular grid
    std::string pipeline_reason;
    std::vector<std::string> kernels;
    std::string pipeline() const { return phased ? "phased" : fused ? "fused" : "two-pass"; }
    double time_step = 0;
    double wave_speed = 0;
    std::string limited_by;
    double memory_particles = 0, memory_sort = 0, memory_grid = 0, memory_tables = 0;
};

Plan make_plan(const Spec& spec, const BackendTraits& backend);

const char* name_of(Kernel kernel);

/// True where a scene asks for more than the fused step of affine transfer has. Smoothing over
/// cells alone is done before a step where sums of cells are integers, in any pipeline.
bool needs_phases(const Spec& spec, bool device);
/// True where the fused step of schemes that store velocities has all of it.
bool can_keep(const Spec& spec, bool device);
/// Adds to a plan whose bodies are there what they do over cells; refuses what does not fit.
void plan_cells(const Spec& spec, Plan& plan);
/// Adds to a plan whose bodies are there what the scene's transfer stores.
void plan_phases(const Spec& spec, Plan& plan);

}  // namespace mpm
