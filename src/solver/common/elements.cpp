// What bodies of elements are built for (design/elements.md).
#include <string>

#include "mpm/core/error.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

namespace {

std::string laws_of_elements() {
    std::string known;
    for (const MaterialInfo& m : materials())
        if (material_of_elements(m.name))
            known += (known.empty() ? "" : ", ") + std::string(m.name);
    return known;
}

/// What one body cannot have; empty where it can.
std::string not_of_elements(const Spec& spec, const BodySpec& b) {
    const std::size_t corners = std::size_t(spec.dimension + 1);
    if (b.elements.size() % corners != 0)
        return std::to_string(b.elements.size()) + " vertices of elements, which are no rows of " +
               std::to_string(corners);
    if (!material_of_elements(b.material))
        return "material " + b.material + "; laws for elements are " + laws_of_elements();
    if (b.smoothing != SmoothingForm::none)
        return "F-bar; volumes of vertices serve in its place, leave fbar out";
    if (works_between_parts(b))
        return "smoothing or assumed fields over cells, numerical damping or placed forces; leave "
               "them out";
    if (b.pressure || b.state) return "a pressure or a stress to begin with; begin at rest";
    if (!b.tractions.empty()) return "tractions; leave them out";
    if (b.restored || !b.ids.empty()) return "vertices that go on from another run; begin afresh";
    return {};
}

}  // namespace

void check_elements(const Spec& spec, const BackendTraits& backend) {
    for (std::size_t k = 0; k < spec.bodies.size(); ++k) {
        const BodySpec& b = spec.bodies[k];
        if (b.elements.empty()) continue;
        const auto refuse = [&](const std::string& what, const std::string& remedy) {
            throw SceneError("body '" + b.name + "' of elements is not built for " + what + "; " +
                             remedy + ", or make it of particles");
        };
        if (!spec.functions.kind.empty()) refuse("grids of functions", "use square cells");
        if (backend.device) refuse(backend.name, "use device=\"cpu\"");
        if (spec.ranks.count > 1) refuse(std::to_string(spec.ranks.count) + " ranks", "use one");
        if ((spec.kernel.kernel != Kernel::quadratic && spec.kernel.kernel != Kernel::cubic) ||
            spec.kernel.clamped)
            refuse("kernel '" + std::string(name_of(spec.kernel.kernel)) +
                       (spec.kernel.clamped ? "' with boundary splines" : "'"),
                   "use plain quadratic or cubic splines");
        if (spec.deformed_nodes) refuse("gradients by moved nodes", "use moved_nodes=False");
        if (spec.transfer.scheme == "XPIC" || spec.transfer.scheme == "FMPM")
            refuse("the sweeps of transfer '" + spec.transfer.scheme + "'",
                   "use APIC or another transfer");
        if (spec.start.given) refuse("runs that continue from another", "start the scene afresh");
        for (const InletSpec& inlet : spec.inlets)
            if (std::size_t(inlet.body) == k)
                refuse("inlet '" + inlet.name + "'", "feed another body");
        const std::string what = not_of_elements(spec, b);
        if (!what.empty())
            throw SceneError("body '" + b.name + "' of elements is not built for " + what);
    }
}

}  // namespace mpm
