#include "mpm/solver/plan.hpp"

#include <algorithm>
#include <cmath>

#include "mpm/core/error.hpp"
#include "mpm/data/blocks.hpp"
#include "mpm/kernels/sorting.hpp"

namespace mpm {

const MaterialInfo& material(const std::string& name) {
    std::string known;
    for (const auto& m : materials()) {
        if (name == m.name) return m;
        known += (known.empty() ? "" : ", ") + std::string(m.name);
    }
    throw SceneError("material '" + name + "' is not built into this library; built are: " + known);
}

BackendTraits cpu_traits(Precision precision) {
    if (precision == Precision::mixed) {
        throw SceneError("precision 'mixed' is not built for the CPU; use precision='double'");
    }
    return {false, "cpu", precision, true};
}
BackendTraits cuda_traits(Precision precision) {
    return {true, "cuda", precision, precision == Precision::single};
}

namespace {

template <int D>
double estimated_slots(const Spec& spec) {
    // Home blocks of all bodies and one layer around each, from the bodies' bounds.
    double slots = 0;
    for (const auto& b : spec.bodies) {
        double n = 1;
        for (int a = 0; a < D; ++a) {
            const double block = spec.cell_size * Block<D>::edge;
            const double first = std::floor(b.bounds[a] / block + 1e-9);
            const double last = std::ceil(b.bounds[D + a] / block - 1e-9);  // one past
            n *= std::max(last - first, 1.0) + 2;
        }
        slots += n;
    }
    return slots;
}

}  // namespace

Plan make_plan(const Spec& spec, const BackendTraits& backend) {
    const int D = spec.dimension;
    if (D != 2 && D != 3) {
        throw SceneError("dimension is " + std::to_string(D) +
                         "; built are 2 (plane strain) and 3");
    }
    if (spec.pipeline != "auto" && spec.pipeline != "fused" && spec.pipeline != "two-pass") {
        throw SceneError("pipeline is '" + spec.pipeline + "'; expected auto, fused or two-pass");
    }
    Plan plan;
    const int real = backend.real();
    const std::string numbers = backend.numbers();

    plan.fused = spec.pipeline == "auto" ? backend.fused : spec.pipeline == "fused";
    if (plan.fused && !backend.fused) {
        throw SceneError("pipeline 'fused' is not built for " + numbers + " precision on " +
                         backend.name + "; use pipeline=\"auto\" or \"two-pass\"");
    }
    plan.pipeline_reason =
        spec.pipeline != "auto" ? "asked for"
        : plan.fused ? "quadratic splines and affine transfer: one pass over the particles"
                     : numbers + " precision on " + backend.name +
                           " has no fused form: too many sums for the registers of one worker";

    // Bodies of equal material and equal F-bar settings average their volume together.
    struct Group {
        const BodySpec* first;
        int members = 0;
    };
    std::vector<Group> groups;
    std::vector<int> group_of(spec.bodies.size(), -1);
    for (std::size_t b = 0; b < spec.bodies.size(); ++b) {
        const BodySpec& body = spec.bodies[b];
        const MaterialInfo& m = material(body.material);
        if (int(body.parameters.size()) != m.parameter_count) {
            throw SceneError("body '" + body.name + "': " + m.name + " takes " +
                             std::to_string(m.parameter_count) + " parameters, " +
                             std::to_string(body.parameters.size()) + " were given");
        }
        if (body.smoothing == SmoothingForm::none) continue;
        if (!m.volumetric) {
            throw SceneError("body '" + body.name +
                             "': F-bar needs a material that stores a volume ratio; " + m.name +
                             " does not. Remove fbar from this body");
        }
        for (std::size_t g = 0; g < groups.size(); ++g) {
            const BodySpec& o = *groups[g].first;
            if (o.material == body.material && o.parameters == body.parameters &&
                o.smoothing == body.smoothing && o.smoothing_time == body.smoothing_time &&
                o.smoothing_ratio == body.smoothing_ratio) {
                group_of[b] = int(g);
            }
        }
        if (group_of[b] < 0) {
            group_of[b] = int(groups.size());
            groups.push_back({&body});
        }
        ++groups[group_of[b]].members;
    }
    if (int(groups.size()) > max_groups) {
        throw SceneError("the scene has " + std::to_string(groups.size()) +
                         " different F-bar settings or materials; at most " +
                         std::to_string(max_groups) +
                         " may be smoothed. Give bodies the same material and FBar, or fbar=None");
    }

    const char* axes[] = {"x", "y", "z"};
    plan.channels = {"mass"};
    for (int a = 0; a < D; ++a) plan.channels.push_back(std::string("momentum_") + axes[a]);
    plan.velocity_channels = D;
    for (auto& g : groups) {
        GroupChannels c;
        c.average = plan.velocity_channels++;
        c.sum = int(plan.channels.size());
        plan.channels.push_back("mass*j:" + g.first->name);
        // Where the group is all there is, the nodal mass is its weight.
        if (g.members != int(spec.bodies.size())) {
            c.weight = int(plan.channels.size());
            plan.channels.push_back("mass:" + g.first->name);
        }
        plan.groups.push_back(c);
    }
    plan.sum_channels = int(plan.channels.size());
    // Sums are kept twice: those being read and those being filled.
    plan.bytes_per_node = (2 * plan.sum_channels + plan.velocity_channels) * backend.grid_real();

    plan.wave_speed = 0;
    for (std::size_t b = 0; b < spec.bodies.size(); ++b) {
        const BodySpec& body = spec.bodies[b];
        const MaterialInfo& m = material(body.material);
        BodyPlan p;
        p.name = body.name;
        p.particles = body.count;
        p.columns.push_back({"position", D, D * real});
        p.state_columns = m.reals(D);
        for (int c = 0; c < m.column_count; ++c) {
            const int n = m.columns[c].components[D - 2];
            p.columns.push_back({m.columns[c].name, n, n * real});
        }
        if (group_of[b] >= 0) {
            p.group = plan.groups[group_of[b]];
            p.smoothing = body.smoothing == SmoothingForm::two_volume ? Smoothing::two_volumes
                                                                      : Smoothing::one_volume;
            p.carry = body.smoothing == SmoothingForm::one_volume_gradient;
            p.stress_only = body.smoothing == SmoothingForm::stress_only;
            if (p.smoothing == Smoothing::two_volumes) {
                p.columns.push_back({"j_smoothed", 1, real});
                ++p.state_columns;
            }
        }
        p.columns.push_back({"id", 1, 4});
        if (backend.device) p.columns.push_back({"cell", 1, 1});
        if (!plan.fused) {
            const int channels = D + (p.smoothing == Smoothing::none ? 0 : 1);
            p.columns.push_back(
                {"deposit", channels * (1 + D), channels * (1 + D) * backend.grid_real()});
        }
        for (const auto& c : p.columns) p.bytes_per_particle += c.bytes;
        const double density = m.density(body.parameters.data());
        p.spacing = std::pow(body.particle_mass / density, 1.0 / D);
        const double c = m.wave_speed(body.parameters.data());
        if (c > plan.wave_speed) {
            plan.wave_speed = c;
            char text[64];
            std::snprintf(text, sizeof text, "%.4g", c);
            plan.limited_by = "body '" + body.name + "': wave speed " + text + " m/s";
        }
        plan.memory_particles += double(body.count) * p.bytes_per_particle;
        // Cells and order, then the order and spare columns (Domain::sort).
        const int spare = real * std::min(permuted_together(body.count), D + p.state_columns);
        plan.memory_sort = std::max(
            plan.memory_sort, double(body.count) * std::max(backend.device ? 12 : 8, 4 + spare));
        plan.bodies.push_back(std::move(p));
    }
    plan.time_step = plan.wave_speed > 0 ? spec.cfl * spec.cell_size / plan.wave_speed : 0;
    if (spec.time_step > 0) {
        // A lone particle is unstable beyond dx / (c sqrt(d)) (digest, fact 5); one factor covers
        // all materials.
        const double stable = spec.cell_size / (plan.wave_speed * std::sqrt(double(D)));
        if (spec.time_step > stable) {
            char text[192];
            std::snprintf(text, sizeof text,
                          "time_step is %.6g s; the stable limit of this scene is %.6g s (%s). ",
                          spec.time_step, stable, plan.limited_by.c_str());
            throw SceneError(std::string(text) + "Lower it, or leave it out and set cfl");
        }
        plan.time_step = spec.time_step;
        plan.limited_by = "given by the caller";
    }

    const double slots = D == 2 ? estimated_slots<2>(spec) : estimated_slots<3>(spec);
    plan.memory_grid = slots * block_cells * plan.bytes_per_node;
    plan.memory_tables = slots * (8 + 4 * (D == 2 ? 9 : 27) + 12) +
                         double(spec.bodies.size()) * slots * block_cells * 4;

    plan.kernels = {"update_grid", "decide"};
    bool loads = false;
    for (const auto& s : spec.sensors) {
        loads = loads || s.kind == SensorKind::load_cell;
        plan.kernels.push_back("sample:" + s.name);
    }
    if (loads) plan.kernels.push_back("measure_loads");
    for (const auto& b : spec.bodies) {
        if (plan.fused) {
            plan.kernels.push_back("fused:" + b.name);
        } else {
            plan.kernels.push_back("gather:" + b.name);
            plan.kernels.push_back("scatter:" + b.name);
        }
    }
    plan.kernels.push_back("end_step");
    plan.kernels.push_back("sort (when drift demands it)");
    return plan;
}

}  // namespace mpm
