#include "mpm/solver/plan_checks.hpp"

#include <algorithm>

#include "mpm/core/error.hpp"

namespace mpm {

void check_contact(const Spec& spec) {
    if (!spec.contact.any()) return;
    const auto refuse = [](const std::string& what, const std::string& remedy) {
        throw SceneError("contact between bodies is not built for " + what + "; " + remedy +
                         ", or remove the contacts");
    };
    if (!spec.functions.kind.empty()) refuse("grids of functions", "use square cells");
    if (spec.kernel.kernel != Kernel::quadratic || spec.kernel.clamped)
        refuse("other kernels than plain quadratic splines, by which it measures gaps",
               "use kernel=\"quadratic\"");
    if (spec.transfer.scheme == "XPIC" || spec.transfer.scheme == "FMPM")
        refuse("the sweeps of transfer '" + spec.transfer.scheme + "'",
               "use APIC or another transfer");
    for (const BoundarySpec& b : spec.boundaries) {
        if (mirrors(b)) refuse("boundary '" + b.name + "', which mirrors", "use Slip or Sticky");
    }
    for (const BodySpec& b : spec.bodies) {
        if (b.smoothing == SmoothingForm::split)
            refuse("body '" + b.name + "' with F-bar in its split form", "use another form");
        if (b.cell_smoothing.form != CellForm::none || b.assumed_part != TensorPart::none)
            refuse("body '" + b.name + "', which is smoothed or assumed over cells",
                   "leave smoothing and assumed out");
    }
    for (const InletSpec& inlet : spec.inlets) {
        const auto& fields = spec.bodies.at(std::size_t(inlet.body)).fields;
        if (!fields.empty() && fields[0].field != 0)
            refuse("inlet '" + inlet.name + "' into a body that a contact names",
                   "feed another body");
    }
}

void check_pins(const Spec& spec) {
    for (const BodySpec& b : spec.bodies)
        if (!b.pins.empty() && b.elements.empty())
            throw SceneError("body '" + b.name +
                             "' has pins, which hold vertices of elements; it is made of "
                             "particles");
}

void check_rigid(const Spec& spec, const BackendTraits& backend) {
    for (std::size_t k = 0; k < spec.bodies.size(); ++k) {
        const BodySpec& b = spec.bodies[k];
        if (!b.rigid.given) continue;
        const auto refuse = [&](const std::string& what, const std::string& remedy) {
            throw SceneError("rigid body '" + b.name + "' is not built for " + what + "; " +
                             remedy + ", or give it an elastic material");
        };
        if (!spec.functions.kind.empty()) refuse("grids of functions", "use square cells");
        if (backend.device) refuse(backend.name, "use device=\"cpu\"");
        if (spec.ranks.count > 1) refuse(std::to_string(spec.ranks.count) + " ranks", "use one");
        if (b.restored || !b.ids.empty())
            refuse("particles that are continued from another run", "start the scene afresh");
        if (!b.elements.empty()) refuse("elements", "fill it with particles");
        if (b.smoothing != SmoothingForm::none || works_between_parts(b))
            refuse("F-bar, smoothing or assumed fields, numerical damping or placed forces",
                   "leave them out");
        if (b.pressure || b.state) refuse("a pressure or a stress to begin with", "leave it out");
        for (const BoundarySpec& wall : spec.boundaries)
            if (std::any_of(wall.law.begin(), wall.law.end(),
                            [](const SurfaceLaw& law) { return law.linear; }))
                refuse("boundary '" + wall.name + "', whose cells strain linearly",
                       "use linear=False");
        for (const InletSpec& inlet : spec.inlets)
            if (std::size_t(inlet.body) == k)
                refuse("inlet '" + inlet.name + "'", "feed another body");
        const int own = b.fields.size() == 1 ? b.fields[0].field : -1;
        if (spec.contact.rigid < 1 || own < spec.contact.bending())
            throw SceneError("rigid body '" + b.name +
                             "' has no field of velocities of its own among the last of them");
        const std::size_t numbers = spec.dimension == 2 ? 1 : 9;
        if (!b.rigid.inertia.empty() && b.rigid.inertia.size() != numbers)
            throw SceneError("rigid body '" + b.name + "' has " +
                             std::to_string(b.rigid.inertia.size()) +
                             " numbers of inertia; expected " + std::to_string(numbers));
        for (const int axis : b.rigid.held)
            if (axis < 0 || axis >= spec.dimension)
                throw SceneError("rigid body '" + b.name + "' is held along axis " +
                                 std::to_string(axis) + " of " + std::to_string(spec.dimension));
    }
}

void check_packing(const Spec& spec, const BodySpec& body) {
    const std::string option = body.shifts ? "shifting" : "density";
    const auto refuse = [&](const std::string& what) {
        throw SceneError("body '" + body.name + "': FBar(" + option + "=True) " + what +
                         "; leave " + option + " out");
    };
    if (body.smoothing == SmoothingForm::none)
        refuse("compares nodes with the volumes that F-bar averages");
    if (!spec.functions.kind.empty()) refuse("is not built for grids of functions");
    if (spec.kernel.kernel != Kernel::quadratic || spec.kernel.clamped)
        refuse("is built for plain quadratic splines");
    if (spec.contact.any()) refuse("is not built beside contacts");
    if (!body.elements.empty()) refuse("is not built for bodies of elements");
}

}  // namespace mpm
