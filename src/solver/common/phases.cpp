// What the phased step of a scene stores and where: from the transfer, the kernel and the forms of
// F-bar.
#include <algorithm>
#include <cmath>

#include "mpm/core/error.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

namespace {

struct Scheme {
    const char* name;
    bool affine;
    Memory memory;
    ShiftRule shift;  // binary stands for the body's own
    bool sweeps;      // of the grid
};
constexpr Scheme schemes[] = {{"PIC", false, Memory::none, ShiftRule::none, false},
                              {"FLIP", false, Memory::flip, ShiftRule::none, false},
                              {"PIC-FLIP", false, Memory::flip, ShiftRule::none, false},
                              {"APIC", true, Memory::none, ShiftRule::none, false},
                              {"AFLIP", true, Memory::flip, ShiftRule::none, false},
                              {"NFLIP", false, Memory::flip, ShiftRule::full, false},
                              {"SFLIP", false, Memory::flip, ShiftRule::binary, false},
                              {"ASFLIP", true, Memory::flip, ShiftRule::binary, false},
                              {"XPIC", false, Memory::xpic, ShiftRule::none, true},
                              {"FMPM", false, Memory::none, ShiftRule::none, true}};

const Scheme& scheme_of(const TransferSpec& t) {
    std::string known;
    for (const Scheme& s : schemes) {
        if (t.scheme == s.name) return s;
        known += (known.empty() ? "" : ", ") + std::string(s.name);
    }
    throw SceneError("transfer '" + t.scheme + "' is unknown; there are " + known);
}

/// First moments are singular where a particle stands on a node of linear or clamped functions.
void refuse_undefined(const Spec& spec, const Scheme& scheme) {
    const KernelSpec& k = spec.kernel;
    const std::string kernel = "kernel '" + std::string(name_of(k.kernel)) + "'";
    if (k.clamped && k.kernel != Kernel::linear && k.kernel != Kernel::quadratic &&
        k.kernel != Kernel::cubic)
        throw SceneError(kernel +
                         " with boundary splines: these are defined for linear, quadratic and "
                         "cubic ones. Leave boundary out");
    if (k.kernel == Kernel::cpdi && k.gradient == GradientForm::moments)
        throw SceneError("gradient 'mls' with " + kernel +
                         ", whose gradients are those of its corners' functions. Use gradient "
                         "'kernel'");
    if (k.kernel == Kernel::ddmp && (!spec.inlets.empty() || spec.start.given))
        throw SceneError(kernel + " with " +
                         (spec.start.given ? "a start from the nodes of a checkpoint" : "inlets") +
                         ": where its forces go depends on all masses at once, and these come "
                         "later. Use another kernel");
    if (!is_linear(k.kernel) && !k.clamped) return;
    const std::string what =
        k.clamped ? std::string(name_of(k.kernel)) + " boundary splines" : kernel;
    if (scheme.affine)
        throw SceneError("transfer '" + spec.transfer.scheme + "' with " + what +
                         ": its affine part divides by the second moment of the functions, which "
                         "is zero at their nodes. Use PIC, FLIP, PIC-FLIP, NFLIP, SFLIP, XPIC or "
                         "FMPM, or another kernel");
    if (k.gradient == GradientForm::moments)
        throw SceneError("gradient 'mls' with " + what +
                         ": it divides by the second moment of the functions, which is zero at "
                         "their nodes. Use gradient 'kernel'");
}

SchemeNumbers numbers_of(const Scheme& scheme, Memory memory, const BodySpec& body) {
    SchemeNumbers n = body.shift;
    n.memory = memory;
    n.affine = scheme.affine;
    n.keep = memory == Memory::none ? 0 : body.keep;
    if (scheme.shift != ShiftRule::binary) n.rule = scheme.shift;
    return n;
}

/// What a body does over cells, and its numerical damping; refuses what its material or the scene's
/// transfer has not.
CellNumbers cells_of(const Spec& spec, const Scheme& scheme, const BodySpec& body) {
    const MaterialInfo& m = material(body.material);
    const std::string who = "body '" + body.name + "': ";
    CellNumbers n;
    n.deformed = spec.deformed_nodes;
    n.smoothing = body.cell_smoothing;
    n.assumed = body.assumed;
    n.part = body.assumed_part;
    n.rate = body.assumed_rate;
    n.force = body.force;
    if (scheme.affine && (n.deformed || n.part != TensorPart::none || damped_particles(body))) {
        const char* what = damped_particles(body) ? "damping changes"
                           : n.deformed           ? "Kernel(moved_nodes=True) changes"
                                                  : "assumed changes";
        throw SceneError(who + what + " the velocity gradient of the particles, which transfer '" +
                         spec.transfer.scheme +
                         "' also carries their momentum by. Give Method(transfer=...) one of PIC, "
                         "FLIP, PIC-FLIP, NFLIP, SFLIP, XPIC or FMPM, or leave it out");
    }
    if (n.smoothing.form != CellForm::none) {
        if (body.smoothing != SmoothingForm::none)
            throw SceneError(who + "smoothing over cells and F-bar at once. Remove one of them");
        const bool volume = body.smoothed_field == "volume";
        if (volume ? !m.volumetric : !m.stores_strain)
            throw SceneError(who + "smoothing of field '" + body.smoothed_field + "', which " +
                             m.name +
                             " does not store; fluids store a volume, LinearElastic a strain. "
                             "Remove smoothing from this body");
        n.components = volume ? 1 : m.reals(spec.dimension);
    }
    if (damped_particles(body)) {
        if (!m.shear_modulus)
            throw SceneError(who + "numerical damping is for elastic solids; " + m.name +
                             " has no shear modulus. Remove damping from this body");
        const double* p = body.parameters.data();
        const double density = m.density(p), l = spec.cell_size;
        n.normal = l * body.damping * density * m.wave_speed(p);
        n.shear = l * body.damping * std::sqrt(density * m.shear_modulus(p));
    }
    return n;
}

}  // namespace

const char* name_of(Kernel k) {
    constexpr const char* names[] = {"linear", "quadratic", "cubic", "ugimp",
                                     "cpgimp", "cpdi",      "ddmp"};
    return names[int(k)];
}

std::string needs_phases(const Spec& spec) {
    const KernelSpec& k = spec.kernel;
    const Scheme& scheme = scheme_of(spec.transfer);
    if (k.kernel != Kernel::quadratic)
        return "kernel '" + std::string(name_of(k.kernel)) + "' has no other form";
    if (k.clamped) return "boundary splines have no other form";
    if (k.gradient != GradientForm::moments)
        return "gradients of the kernel's functions have no other form";
    if (spec.deformed_nodes) return "gradients by moved nodes stand between the parts of a step";
    if (spec.transfer.scheme != "APIC" && (scheme.memory != Memory::flip || scheme.sweeps))
        return "transfer '" + spec.transfer.scheme + "' has no other form";
    return {};
}

bool stores_in_one_pass(const Spec& spec) {
    return spec.transfer.scheme != "APIC" && needs_phases(spec).empty();
}

std::string needs_phases(const Spec& spec, const BodySpec& b, bool device) {
    if (!b.elements.empty()) return "elements work between the parts of a step";
    if (b.rigid.given) return "rigid bodies move as a whole";
    const MaterialInfo& m = material(b.material);
    if (spec.transfer.scheme == "APIC" ? !m.fused : !m.fuses_memory)
        return "material " + b.material + " has no fused form" +
               (m.fused ? " with transfer '" + spec.transfer.scheme + "'" : "");
    if (!device && works_between_parts(b))
        return "smoothing over cells, assumed fields, damping and placed forces stand between the "
               "parts of a step";
    if (b.smoothing == SmoothingForm::split || b.smoothing == SmoothingForm::literal)
        return "this form of F-bar stands between the parts of a step";
    if (b.smoothing != SmoothingForm::none && !m.volumetric && !device)
        return "F-bar on solids has a fused form on CUDA devices alone";
    return {};
}

void plan_cells(const Spec& spec, Plan& plan) {
    for (std::size_t b = 0; b < spec.bodies.size(); ++b)
        plan.bodies[b].cells = cells_of(spec, scheme_of(spec.transfer), spec.bodies[b]);
}

void plan_phases(const Spec& spec, Plan& plan) {
    const int D = spec.dimension;
    const Scheme& scheme = scheme_of(spec.transfer);
    refuse_undefined(spec, scheme);
    if (spec.kernel.modified && (spec.kernel.kernel != Kernel::linear || spec.kernel.clamped))
        throw SceneError("modified functions with kernel '" +
                         std::string(name_of(spec.kernel.kernel)) +
                         (spec.kernel.clamped ? "' and boundary splines" : "'") +
                         "; they are defined for linear functions. Leave modified out");
    if (spec.transfer.order < 1 || spec.transfer.every < 1)
        throw SceneError("transfer '" + spec.transfer.scheme + "' has order " +
                         std::to_string(spec.transfer.order) + " and every " +
                         std::to_string(spec.transfer.every) + "; expected at least 1");
    // Steps of FMPM that do not filter are FLIP, which needs a velocity to keep.
    const Memory memory = scheme.sweeps && spec.transfer.every > 1 && scheme.memory == Memory::none
                              ? Memory::flip
                              : scheme.memory;
    const bool guards =
        scheme.shift != ShiftRule::none && std::any_of(spec.bodies.begin(), spec.bodies.end(),
                                                       [](const BodySpec& b) { return b.guard; });
    const int given = plan.velocity_channels;
    const auto more = [&](int numbers) {
        const int at = plan.velocity_channels;
        plan.velocity_channels += numbers;
        return at;
    };
    PhaseNumbers common;
    if (memory != Memory::none) {
        const char* axes[] = {"x", "y", "z"};
        plan.kept.plain = int(plan.channels.size());
        for (int a = 0; a < D; ++a)
            plan.channels.push_back(std::string("plain_momentum_") + axes[a]);
        // Read in one piece of four numbers, the guard behind it.
        if (D == 3 && (plan.some(Pipeline::keeping) || plan.some(Pipeline::two_pass_keeping)))
            plan.velocity_channels = (plan.velocity_channels + 3) / 4 * 4;
        plan.kept.before = more(D);
        if (guards) plan.kept.guard = more(1);
    }
    if (scheme.sweeps) {
        plan.sweeps = spec.transfer.order - 1;
        plan.sweep.every = spec.transfer.every;
        if (memory == Memory::xpic) {
            plan.sweep.source = plan.kept.before;
            plan.sweep.result = common.filtered = more(D);
        }
        plan.sweep.residual = more(D);
    }
    // One group's average is stored with the velocity in one piece of four numbers.
    if (D == 3 && plan.velocity_channels > given)
        plan.velocity_channels = (plan.velocity_channels + 3) / 4 * 4;
    plan.sum_channels = int(plan.channels.size());

    common.kernel.kernel = spec.kernel.kernel;
    common.kernel.gradient = spec.kernel.gradient;
    common.kernel.clamped = spec.kernel.clamped;
    common.kernel.modified = spec.kernel.modified;
    for (int a = 0; a < D; ++a) common.kernel.cells[a] = int(spec.cells[a]);
    common.before = plan.kept.before;
    common.guard = plan.kept.guard;
    common.plain = plan.kept.plain;
    common.sweeps = scheme.sweeps;
    common.every = spec.transfer.every;
    for (std::size_t b = 0; b < spec.bodies.size(); ++b) {
        const BodySpec& body = spec.bodies[b];
        BodyPlan& p = plan.bodies[b];
        p.phase = common;
        p.phase.scheme = numbers_of(scheme, memory, body);
        // A shift would move vertices against the elements that hold them together.
        if (p.elements > 0) p.phase.scheme.rule = ShiftRule::none;
        // What a rigid body's particles carry is its own motion, whatever the others do.
        if (p.rigid) {
            p.phase.scheme = {};
            p.phase.scheme.affine = true;
        }
        if (!body.guard || p.phase.scheme.rule == ShiftRule::none) p.phase.guard = -1;
        p.phase.channels = D + (p.smoothing == Smoothing::none ? 0 : 1);
        p.phase.lags =
            body.smoothing == SmoothingForm::split || body.smoothing == SmoothingForm::literal;
        p.phase.leads = body.smoothing == SmoothingForm::literal;
        const double density = material(body.material).density(body.parameters.data());
        p.phase.kernel.half_edge =
            0.5 * std::pow(body.particle_mass / density, 1.0 / D) / spec.cell_size;
        const bool corners = spec.kernel.kernel == Kernel::cpdi,
                   sized = corners || spec.kernel.kernel == Kernel::ugimp ||
                           spec.kernel.kernel == Kernel::cpgimp;
        if (corners) {
            // F-bar writes back an F of another volume.
            const bool stored =
                material(body.material).stores_gradient && body.smoothing == SmoothingForm::none;
            p.phase.own_edges = !stored;
            if (stored) p.phase.edges = 0;
        }
        const double most = spec.kernel.kernel == Kernel::ugimp ? 0.5 : largest_half_edge;
        if (sized && p.phase.kernel.half_edge > most * (1 + 1e-9))
            throw SceneError("body '" + body.name + "' has particles of " +
                             std::to_string(2 * p.phase.kernel.half_edge) + " cells; kernel '" +
                             name_of(spec.kernel.kernel) + "' takes at most " +
                             std::to_string(2 * most) + ". Use more particles per cell");
        const double rule = p.phase.scheme.rule == ShiftRule::full ? 1 : p.phase.scheme.shift_max;
        // A stored velocity and the grid's are both at most what was deposited.
        plan.beyond = std::max(plan.beyond, p.phase.scheme.rule == ShiftRule::none
                                                ? (memory == Memory::xpic ? 1.0 : 0.0)
                                                : 2 * p.phase.scheme.keep * rule);
    }
}

}  // namespace mpm
