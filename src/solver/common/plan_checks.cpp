#include "mpm/solver/plan_checks.hpp"

#include "mpm/core/error.hpp"

namespace mpm {

void check_contact(const Spec& spec, const BackendTraits& backend) {
    if (!spec.contact.any()) return;
    const auto refuse = [](const std::string& what, const std::string& remedy) {
        throw SceneError("contact between bodies is not built for " + what + "; " + remedy +
                         ", or remove the contacts");
    };
    if (backend.device) refuse(backend.name, "use device=\"cpu\"");
    if (!spec.functions.kind.empty()) refuse("grids of functions", "use square cells");
    if (spec.kernel.kernel != Kernel::quadratic || spec.kernel.clamped)
        refuse("other kernels than plain quadratic splines, by which it measures gaps",
               "use kernel=\"quadratic\"");
    if (spec.transfer.scheme == "XPIC" || spec.transfer.scheme == "FMPM")
        refuse("the sweeps of transfer '" + spec.transfer.scheme + "'",
               "use APIC or another transfer");
    if (spec.start.given) refuse("runs that continue from another", "start the scene afresh");
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

void check_shifting(const Spec& spec, const BodySpec& body) {
    const auto refuse = [&](const std::string& what) {
        throw SceneError("body '" + body.name + "': FBar(shifting=True) " + what +
                         "; leave shifting out");
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
