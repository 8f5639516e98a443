#include "mpm/solver/plan.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "mpm/core/error.hpp"
#include "mpm/data/blocks.hpp"
#include "mpm/kernels/cell_sums.hpp"
#include "mpm/kernels/sorting.hpp"
#include "mpm/kernels/surface_lines.hpp"
#include "mpm/kernels/tally.hpp"
#include "mpm/solver/element_mesh.hpp"
#include "mpm/solver/plan_checks.hpp"
#include "mpm/solver/surface_blocks.hpp"

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

/// Home blocks of all bodies and one layer around each, from the bodies' bounds; and of those the
/// ones that boundaries touch which only some scenes have (kernels/wall_nodes.hpp).
struct EstimatedSlots {
    double all = 0, touched = 0;
};

template <int D>
EstimatedSlots estimated_slots(const Spec& spec) {
    const double block = spec.cell_size * Block<D>::edge;
    const bool lists = lists_wall_nodes(spec.boundaries);
    EstimatedSlots slots;
    for (const auto& b : spec.bodies) {
        double n = 1, first[D], last[D];  // with the layer; one past
        for (int a = 0; a < D; ++a) {
            first[a] = std::floor(b.bounds[a] / block + 1e-9) - 1;
            last[a] = std::max(std::ceil(b.bounds[D + a] / block - 1e-9), first[a] + 2) + 1;
            n *= last[a] - first[a];
        }
        slots.all += n;
        if (!lists) continue;
        double of_body = 0;
        for (const BoundarySpec& wall : spec.boundaries) {
            const bool own = wall.is_box || !wall.surface.keys.empty();
            double apart = 1, met = 1;  // blocks inside of faces; blocks of the box
            for (int a = 0; a < D; ++a) {
                const double from = own ? wall.lower[a] / double(Block<D>::edge) : 0,
                             to = own ? wall.upper[a] / double(Block<D>::edge)
                                      : double(spec.cells[std::size_t(a)]) / Block<D>::edge;
                double inner = last[a] - first[a];
                if (wall.present[2 * a] && first[a] < from + 1) inner -= from + 1 - first[a];
                if (wall.present[2 * a + 1] && last[a] > to - 1) inner -= last[a] - (to - 1);
                apart *= std::max(inner, 0.0);
                met *= std::max(std::min(last[a], to + 1) - std::max(first[a], from - 1), 0.0);
            }
            of_body += own ? met : n - apart;
        }
        slots.touched += std::min(of_body, n);
    }
    return slots;
}

/// What limits the time step of one body, s.
struct StepLimit {
    double wave;     // its fastest wave crosses the share `cfl` of a cell
    double viscous;  // viscosity takes its share of the stable limit; infinite without any
    double stable;   // beyond it a lone particle is unstable
};

/// A deposit with stress takes the slope C to C - 4 dt tau / (rho dx^2). With nu = mu / rho, the
/// step is stable for any particles and held nodes while
///     4 nu dt / dx^2 + d (c dt / dx)^2 <= 1,
/// since |v|^2 + dx^2 / 4 |C|^2 of a particle never exceeds the mean of its nodes (Bessel); a lone
/// particle attains the bound (digest, fact 5, without viscosity). Viscosity may take what the
/// waves leave, at most half: then no strain rate changes its sign within a step, and J may
/// reach 2.
StepLimit step_limit(const Spec& spec, double c, double nu) {
    const double dx = spec.cell_size, d = spec.dimension, cfl = spec.cfl;
    const double lone = dx / (c * std::sqrt(d)), diffusion = dx * dx / (4 * nu);
    const double part = std::min(0.5, std::max(1 - d * cfl * cfl, 0.1));
    const double r = lone / (2 * diffusion);
    return {cfl * dx / c, part * diffusion, lone / (r + std::sqrt(1 + r * r))};
}

std::string limit_text(const BodySpec& body, const char* what, double value, const char* unit) {
    char text[64];
    std::snprintf(text, sizeof text, "%s %.4g %s", what, value, unit);
    return "body '" + body.name + "': " + text;
}

/// What a particle stores beside its material's numbers, and the memory that this takes.
void add_columns(Plan& plan, const BackendTraits& backend, int D, BodyPlan& p) {
    const int real = backend.real();
    const auto state = [&](const char* name, int numbers, int& at) {
        at = p.state_columns;
        p.state_columns += numbers;
        p.columns.push_back({name, numbers, numbers * real});
    };
    if (p.phase.scheme.memory != Memory::none) state("velocity", D, p.phase.velocity);
    if (p.phase.kernel.kernel == Kernel::cpgimp) state("stretch", D, p.phase.extent);
    if (p.phase.own_edges) state("edges", D * D, p.phase.edges);
    if (p.state_columns > max_state_columns)
        throw SceneError("body '" + p.name + "' would store " + std::to_string(p.state_columns) +
                         " numbers a particle beside its position; at most " +
                         std::to_string(max_state_columns) +
                         " fit. Use a transfer that stores no velocity, or another kernel");
    p.columns.push_back({"id", 1, 4});
    if (backend.device) p.columns.push_back({"cell", 1, 1});
    const int deposit = deposit_columns(D, p);
    if (deposit > 0) p.columns.push_back({"deposit", deposit, deposit * backend.grid_real()});
    for (const auto& c : p.columns) p.bytes_per_particle += c.bytes;
    const double particles = double(p.particles);
    plan.memory_particles += particles * p.bytes_per_particle;
    // Cells and order, then the order and spare columns (Domain::sort).
    const int spare = real * std::min(permuted_together(p.particles), D + p.state_columns);
    plan.memory_sort =
        std::max(plan.memory_sort, particles * std::max(backend.device ? 12 : 8, 4 + spare));
}

/// Refuses a pipeline that the scene or one of its bodies has not.
void check_pipeline(const Spec& spec, const BackendTraits& backend) {
    const std::string& asked = spec.pipeline;
    if (asked == "auto" || asked == "phased" || asked == by_body) return;
    if (asked != "fused" && asked != "two-pass")
        throw SceneError("pipeline is '" + asked + "'; expected auto, fused, two-pass or phased");
    if (asked == "two-pass" && stores_in_one_pass(spec) && backend.fused)
        throw SceneError(
            "pipeline 'two-pass' is not built for transfers that store velocities in " +
            backend.numbers() + " precision on " + backend.name +
            ", where these have one pass; this scene asks for " + spec.transfer.scheme +
            ". Use pipeline=\"auto\" or \"phased\", or name transfer \"APIC\"");
    std::string why = needs_phases(spec);
    for (const BodySpec& body : spec.bodies) {
        if (!why.empty()) break;
        why = needs_phases(spec, body, backend.device);
        if (!why.empty()) why = "body '" + body.name + "' asks for more: " + why;
    }
    if (!why.empty())
        throw SceneError("pipeline '" + asked +
                         "' has quadratic splines with transfer APIC, F-bar on fluids in its fused "
                         "forms, and not every material; this scene asks for others: " +
                         why + ". Use pipeline=\"auto\" or \"phased\"");
    if (asked == "fused" && !backend.fused)
        throw SceneError("pipeline 'fused' is not built for " + backend.numbers() +
                         " precision on " + backend.name +
                         "; use pipeline=\"auto\" or \"two-pass\"");
}

/// The pipeline of a body: that which was asked for, or the one with the fewest passes that it has.
void choose_pipeline(const Spec& spec, const BackendTraits& backend, const BodySpec& body,
                     BodyPlan& p) {
    const std::string registers = backend.numbers() + " precision on " + backend.name +
                                  " has no fused form: too many sums for the registers of one "
                                  "worker";
    const bool keeps = stores_in_one_pass(spec);
    std::string why = needs_phases(spec);
    if (why.empty()) why = needs_phases(spec, body, backend.device);
    if (spec.pipeline == "phased" || !why.empty()) {
        p.pipeline = Pipeline::phased;
        p.pipeline_reason = why;
    } else if (keeps && !backend.fused) {
        p.pipeline = Pipeline::two_pass_keeping;
        p.pipeline_reason = registers;
    } else if (keeps) {
        p.pipeline = Pipeline::keeping;
        p.pipeline_reason =
            "quadratic splines and fluids: one pass over the particles, with the velocity that "
            "they store";
    } else if (spec.pipeline == "two-pass" || !backend.fused) {
        p.pipeline = Pipeline::two_pass;
        p.pipeline_reason = registers;
    } else {
        p.pipeline_reason = "quadratic splines and affine transfer: one pass over the particles";
    }
    if (spec.pipeline != "auto" && spec.pipeline != by_body) p.pipeline_reason = "asked for";
}

}  // namespace

const char* name_of(Pipeline pipeline) {
    switch (pipeline) {
        case Pipeline::two_pass:
        case Pipeline::two_pass_keeping:
            return "two-pass";
        case Pipeline::phased:
            return "phased";
        default:
            return "fused";
    }
}

bool Plan::some(Pipeline pipeline) const {
    return std::any_of(bodies.begin(), bodies.end(),
                       [&](const BodyPlan& p) { return p.pipeline == pipeline; });
}

int deposit_columns(int dimension, const BodyPlan& body) {
    const int affine = body.phase.channels * (1 + dimension);
    switch (body.pipeline) {
        case Pipeline::phased:
            return scratch_columns(dimension, body.phase);
        case Pipeline::two_pass:
            return affine;
        case Pipeline::two_pass_keeping:  // and the affine part without stress
            return affine + dimension * dimension;
        default:
            return 0;
    }
}

std::string Plan::pipeline() const {
    const std::string first = name_of(bodies.empty() ? Pipeline::fused : bodies[0].pipeline);
    for (const BodyPlan& p : bodies)
        if (name_of(p.pipeline) != first) return by_body;
    return first;
}

std::string Plan::pipeline_reason() const {
    struct Group {
        std::string reason, pipeline, first;
        int others = 0;
    };
    std::vector<Group> groups;
    for (const BodyPlan& p : bodies) {
        const auto same = std::find_if(groups.begin(), groups.end(), [&](const Group& g) {
            return g.reason == p.pipeline_reason && g.pipeline == name_of(p.pipeline);
        });
        if (same == groups.end())
            groups.push_back({p.pipeline_reason, name_of(p.pipeline), p.name});
        else
            ++same->others;
    }
    if (groups.size() == 1) return groups[0].reason;
    std::string out;
    for (const Group& g : groups) {
        out += (out.empty() ? "body '" : "; body '") + g.first + "'";
        if (g.others > 0) out += " and " + std::to_string(g.others) + " more";
        out += " " + g.pipeline + ": " + g.reason;
    }
    return out;
}

Plan make_plan(const Spec& spec, const BackendTraits& backend) {
    const int D = spec.dimension;
    if (D != 2 && D != 3) {
        throw SceneError("dimension is " + std::to_string(D) +
                         "; built are 2 (plane strain) and 3");
    }
    check_pipeline(spec, backend);
    check_contact(spec);
    check_elements(spec);
    check_rigid(spec, backend);
    check_pins(spec);
    const bool between =
        spec.deformed_nodes || spec.kernel.modified ||
        std::any_of(spec.bodies.begin(), spec.bodies.end(), [](const BodySpec& b) {
            return b.assumed_part != TensorPart::none || damped_particles(b) || b.force.axis >= 0;
        });
    if (between && backend.device)
        throw SceneError(
            "assumed fields, numerical damping, placed forces, modified functions and gradients "
            "by moved nodes are not built for " +
            backend.name + "; use device=\"cpu\", or remove them");
    const Kernel kernel = spec.kernel.kernel;
    if ((kernel == Kernel::cpdi || kernel == Kernel::ddmp) && backend.device)
        throw SceneError("kernel '" + std::string(name_of(kernel)) + "' is not built for " +
                         backend.name + "; use device=\"cpu\", or another kernel");
    Plan plan;
    const int real = backend.real();
    const std::string numbers = backend.numbers();

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
        if (body.shifts || body.density) check_packing(spec, body);
        if (body.shifts) plan.shift = shift_most;
        plan.density = plan.density || body.density;
        if (body.smoothing == SmoothingForm::none) continue;
        if (!m.smoothable) {
            throw SceneError(
                "body '" + body.name +
                "': F-bar needs a material whose volume can be scaled alone; that of " + m.name +
                " cannot. Remove fbar from this body");
        }
        for (std::size_t g = 0; g < groups.size(); ++g) {
            const BodySpec& o = *groups[g].first;
            if (o.material == body.material && o.parameters == body.parameters &&
                o.smoothing == body.smoothing && o.smoothing_time == body.smoothing_time &&
                o.smoothing_ratio == body.smoothing_ratio && o.held_by == body.held_by) {
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
        c.split = g.first->smoothing == SmoothingForm::split;
        plan.groups.push_back(c);
    }
    // Bodies that boundaries hold apart from others, and that have no such sum yet.
    std::map<std::uint64_t, int> held;
    for (std::size_t b = 0; b < spec.bodies.size(); ++b) {
        const BodySpec& body = spec.bodies[b];
        if (body.held_by == 0 || group_of[b] >= 0 || held.count(body.held_by)) continue;
        held[body.held_by] = int(plan.channels.size());
        plan.channels.push_back("mass:" + body.name);
    }
    if (spec.contact.any() && std::any_of(spec.bodies.begin(), spec.bodies.end(),
                                          [](const BodySpec& b) { return !b.elements.empty(); })) {
        plan.filled = int(plan.channels.size());
        plan.channels.push_back("filled");
    }
    plan.sum_channels = int(plan.channels.size());
    if (!held.empty() && plan.sum_channels > 64)
        throw SceneError("the grid would hold " + std::to_string(plan.sum_channels) +
                         " sums a node; at most 64 where boundaries are for some bodies alone");

    plan.wave_speed = 0;
    double longest = unbounded, stable = unbounded;
    std::string stable_by;
    for (std::size_t b = 0; b < spec.bodies.size(); ++b) {
        const BodySpec& body = spec.bodies[b];
        const MaterialInfo& m = material(body.material);
        BodyPlan p;
        p.name = body.name;
        p.particles = body.count;
        choose_pipeline(spec, backend, body, p);
        p.columns.push_back({"position", D, D * real});
        p.elements = body.elements.size() / std::size_t(D + 1);
        p.vertex_volumes = body.vertex_volumes;
        if (p.elements > 0) {
            p.kept = kept_by_element(body.material, D);
            MeshSizes sizes{p.elements,
                            p.particles,
                            p.vertex_volumes,
                            p.kept,
                            0,
                            0,
                            !body.element_stress.empty(),
                            body.damping > 0};
            for (const TractionSpec& t : body.tractions) sizes.loaded += t.particles.size();
            for (const PinSpec& pin : body.pins) sizes.pinned += pin.vertices.size();
            p.state_columns = 1;
            p.columns.push_back({"mass_share", 1, real});
            plan.memory_particles += D == 2 ? planned_mesh_bytes<2>(sizes, real, backend.device)
                                            : planned_mesh_bytes<3>(sizes, real, backend.device);
        } else {
            p.rigid = body.rigid.given;
            p.state_columns = m.reals(D);
            for (int c = 0; c < m.column_count; ++c) {
                const int n = m.columns[c].components[D - 2];
                p.columns.push_back({m.columns[c].name, n, n * real});
            }
        }
        if (group_of[b] < 0 && body.held_by != 0) p.group.weight = held.at(body.held_by);
        if (group_of[b] >= 0) {
            p.group = plan.groups[group_of[b]];
            const SmoothingForm f = body.smoothing;
            p.smoothing = f == SmoothingForm::two_volume || f == SmoothingForm::split ||
                                  f == SmoothingForm::literal
                              ? Smoothing::two_volumes
                              : Smoothing::one_volume;
            p.carry = body.smoothing == SmoothingForm::one_volume_gradient;
            p.stress_only = body.smoothing == SmoothingForm::stress_only;
            if (p.smoothing == Smoothing::two_volumes) {
                p.columns.push_back({"j_smoothed", 1, real});
                ++p.state_columns;
            }
        }
        const double density = m.density(body.parameters.data());
        p.spacing = std::pow(body.particle_mass / density, 1.0 / D);
        if (p.rigid) {
            // It has no wave; where its particles are from its centre, in double.
            plan.memory_particles += double(p.particles) * 8 * D;
            plan.bodies.push_back(std::move(p));
            continue;
        }
        const double c = m.wave_speed(body.parameters.data());
        plan.wave_speed = std::max(plan.wave_speed, c);
        const double mu = m.viscosity ? m.viscosity(body.parameters.data()) : 0;
        // Numerical damping is a viscosity (Yang 2016, A.6).
        const StepLimit limit =
            step_limit(spec, c, mu / density + body.damping * spec.cell_size * c);
        const std::string by_wave = limit_text(body, "wave speed", c, "m/s"),
                          by_viscosity = limit_text(body, "viscosity", mu, "Pa·s");
        const double own = std::min(limit.wave, limit.viscous);
        if (own < longest) {
            longest = own;
            plan.limited_by = limit.viscous < limit.wave ? by_viscosity : by_wave;
        }
        if (limit.stable < stable) {
            stable = limit.stable;
            // Which of the two terms of the bound is the larger at it.
            const double viscous = 4 * mu / density * stable / (spec.cell_size * spec.cell_size);
            stable_by = viscous > 0.5 ? by_viscosity : by_wave;
        }
        plan.bodies.push_back(std::move(p));
    }
    plan_cells(spec, plan);
    // The fused step knows one kernel and one transfer; their columns a tilted first deposit takes.
    for (BodyPlan& p : plan.bodies) p.phase.channels = D + (p.smoothing == Smoothing::none ? 0 : 1);
    if (std::any_of(plan.bodies.begin(), plan.bodies.end(),
                    [](const BodyPlan& p) { return p.any_transfer(); }))
        plan_phases(spec, plan);
    // Sums are kept twice: those being read and those being filled.
    plan.bytes_per_node = (2 * plan.sum_channels + plan.velocity_channels) * backend.grid_real();
    for (BodyPlan& p : plan.bodies) add_columns(plan, backend, D, p);
    plan.time_step = longest < unbounded ? longest : 0;
    if (spec.time_step > 0) {
        if (spec.time_step > stable) {
            char text[192];
            std::snprintf(text, sizeof text,
                          "time_step is %.6g s; the stable limit of this scene is %.6g s (%s). ",
                          spec.time_step, stable, stable_by.c_str());
            throw SceneError(std::string(text) + "Lower it, or leave it out and set cfl");
        }
        plan.time_step = spec.time_step;
        plan.limited_by = "given by the caller";
    }
    if (!(plan.time_step > 0))
        throw SceneError(
            "no body of the scene has a wave that a time step could follow from; rigid bodies "
            "have none. Give a time_step in s");

    const EstimatedSlots estimate = D == 2 ? estimated_slots<2>(spec) : estimated_slots<3>(spec);
    const double slots = estimate.all;
    plan.memory_grid = slots * block_cells * plan.bytes_per_node;
    plan.memory_tables = slots * (8 + 4 * (D == 2 ? 9 : 27) + 12) +
                         double(spec.bodies.size()) * slots * block_cells * 4;

    std::size_t of_cell = 0;  // one body after another uses the room
    for (const BodyPlan& p : plan.bodies)
        of_cell = std::max(of_cell, D == 2 ? cell_numbers<2>(p.cells) : cell_numbers<3>(p.cells));
    plan.memory_grid += slots * block_cells * 8 * double(of_cell);
    const bool any_smooths = std::any_of(plan.bodies.begin(), plan.bodies.end(),
                                         [](const BodyPlan& p) { return p.cells.smooths(); });
    if (backend.device && any_smooths) plan.memory_tables += slots * 8 * smoothing_sums;

    // Kinds, lines and surfaces of each node, and those of the table before; velocities and places
    // in two lists; on hosts pieces of three in four.
    const bool surfaces =
        std::any_of(spec.boundaries.begin(), spec.boundaries.end(), linear_surface);
    const double known = 1 + 4 * D +
                         double(!surfaces ? 0
                                : D == 2  ? sizeof(SurfaceNode<2>)
                                          : sizeof(SurfaceNode<3>));
    plan.memory_tables += estimate.touched * block_cells *
                          (2 * known + D * backend.grid_real() + 5 + (backend.device ? 0 : 24));
    const bool lifts = std::any_of(spec.boundaries.begin(), spec.boundaries.end(),
                                   [](const BoundarySpec& b) { return b.uplift; });
    // Which of its feet a node is; of one row of each block its number and two sets of momenta.
    if (lifts)
        plan.memory_tables +=
            estimate.touched * block_cells * (4 + (4 + 16.0 * D) / (D == 2 ? 8 : 4));
    if (plan.shift > 0 || plan.density)
        plan.memory_grid += slots * block_cells * backend.grid_real() * (plan.density ? 2 : 1);
    for (const auto& b : spec.boundaries) {
        if (b.surface.keys.empty()) continue;
        const std::uint64_t entries =
            D == 2 ? SurfaceBlocks<2>(b.surface).entries() : SurfaceBlocks<3>(b.surface).entries();
        plan.memory_tables += double(4 * b.surface.values.size() + 8 * b.surface.keys.size() +
                                     4 * b.surface.place.size() + 4 * entries);
    }

    if (spec.contact.any()) plan.memory_tables += 8 * slots;
    const bool mirrored = std::any_of(spec.boundaries.begin(), spec.boundaries.end(),
                                      [](const BoundarySpec& b) { return mirrors(b); });
    plan.kernels = {mirrored ? "update_grid (mirrors)" : "update_grid", "decide"};
    if (spec.contact.rigid > 0) plan.kernels.insert(plan.kernels.begin() + 1, "rigid bodies");
    if (spec.contact.bending() > 1) plan.kernels.insert(plan.kernels.begin() + 1, "contact");
    if (plan.sweeps > 0)
        plan.kernels.insert(plan.kernels.begin() + 1,
                            "sweep (" + std::to_string(plan.sweeps) + " times)");
    if (lists_wall_nodes(spec.boundaries))
        plan.kernels.insert(plan.kernels.begin(), "move_wall_nodes");
    bool loads = false, contacts = false, tallies = false;
    for (const auto& s : spec.sensors) {
        tallies = tallies || s.kind == SensorKind::tally;
        for (const TallySpec& t : s.tallies)  // where its particles were at first
            if (t.of == int(TallyOf::turn))
                plan.memory_particles += 8.0 * spec.dimension * double(t.count);
        loads = loads || s.kind == SensorKind::load_cell;
        contacts = contacts || s.kind == SensorKind::contact_load;
        plan.kernels.push_back("sample:" + s.name);
    }
    if (loads) plan.kernels.push_back("measure_loads");
    if (contacts) plan.kernels.push_back("measure_contacts");
    if (tallies) plan.kernels.push_back("measure_tallies");
    for (const auto& b : plan.bodies) {
        const bool phased = b.pipeline == Pipeline::phased;
        if (b.rigid) {
            plan.kernels.push_back("move:" + b.name);
            plan.kernels.push_back("spread:" + b.name);
            continue;
        }
        if (phased) plan.kernels.push_back("collect:" + b.name);
        if (b.cells.smooths()) plan.kernels.push_back("smooth_cells:" + b.name);
        if (phased) {
            plan.kernels.push_back("respond:" + b.name);
            if (b.vertex_volumes) plan.kernels.push_back("volumes:" + b.name);
            if (b.elements > 0) plan.kernels.push_back("elements:" + b.name);
            plan.kernels.push_back("spread:" + b.name);
            if (b.elements > 0 && plan.filled >= 0) plan.kernels.push_back("fill:" + b.name);
        } else if (b.pipeline == Pipeline::two_pass || b.pipeline == Pipeline::two_pass_keeping) {
            plan.kernels.push_back("gather:" + b.name);
            plan.kernels.push_back("scatter:" + b.name);
        } else {
            plan.kernels.push_back("fused:" + b.name);
        }
    }
    plan.kernels.push_back("end_step");
    for (const auto& inlet : spec.inlets)
        plan.kernels.push_back("supply:" + inlet.name + " (when a layer is due)");
    plan.kernels.push_back("sort (when drift demands it)");
    return plan;
}

}  // namespace mpm
