// What bodies of elements are built for (design/elements.md).
#include <algorithm>
#include <cmath>
#include <string>

#include "mpm/core/error.hpp"
#include "mpm/solver/element_mesh.hpp"
#include "mpm/solver/faults.hpp"
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
        return "smoothing or assumed fields over cells, or placed forces; leave them out";
    if (b.pressure || b.state) return "a pressure to begin with; give it a stress";
    if (!b.element_stress.empty() &&
        b.element_stress.size() !=
            b.elements.size() / corners * std::size_t(spec.dimension == 2 ? 4 : 6))
        return std::to_string(b.element_stress.size()) + " numbers of stress at rest; give each " +
               "element as many as its dimension has";
    if (b.vertex_volumes && !material_of_vertex_volumes(b.material))
        return "volumes of vertices with " + b.material +
               ", whose volume flows; choose volumes of elements";
    if (b.damping > 0 && !material(b.material).shear_modulus)
        return "numerical damping of " + b.material + ", which has no shear modulus; leave it out";
    if (b.restored || !b.ids.empty())
        return "vertices that are continued from another run; start the scene afresh";
    return {};
}

}  // namespace

void check_mesh(const std::string& body, int dimension, const std::vector<double>& position,
                const std::vector<std::int32_t>& element, double cell_size) {
    const std::string who = "body '" + body + "': ";
    const std::size_t D = std::size_t(dimension), corners = D + 1, vertices = position.size() / D;
    if (element.empty() || element.size() % corners != 0)
        throw SceneError(who + "its elements are no rows of " + std::to_string(corners) +
                         " vertices");
    if (element.size() >= ~std::uint32_t(0))
        throw CapacityError(
            who + std::to_string(element.size() / corners) + " elements; one body holds at most " +
            std::to_string(~std::uint32_t(0) / corners) + ". Split it into several bodies");
    std::vector<bool> held(vertices, false);
    const double most = largest_element * std::sqrt(double(dimension));
    for (std::size_t e = 0; e < element.size() / corners; ++e) {
        const std::string which = who + "element " + std::to_string(e);
        const std::int32_t* vertex = element.data() + e * corners;
        double x[4][3] = {}, longest = 0;
        for (std::size_t k = 0; k < corners; ++k) {
            if (vertex[k] < 0 || std::size_t(vertex[k]) >= vertices)
                throw SceneError(which + " names vertex " + std::to_string(vertex[k]) + " of " +
                                 std::to_string(vertices));
            held[std::size_t(vertex[k])] = true;
            for (std::size_t a = 0; a < D; ++a) x[k][a] = position[std::size_t(vertex[k]) * D + a];
            for (std::size_t l = 0; l < k; ++l)
                longest = std::max(
                    longest, std::hypot(x[k][0] - x[l][0], x[k][1] - x[l][1], x[k][2] - x[l][2]));
        }
        const auto rest = [&]<int N>() {
            Mat<double, N> edges;
            for (int a = 0; a < N; ++a)
                for (int k = 0; k < N; ++k) edges.e[a][k] = x[k + 1][a] - x[0][a];
            return ElementAtRest<N>(edges).volume;
        };
        const double volume =
            dimension == 2 ? rest.template operator()<2>() : rest.template operator()<3>();
        if (!(volume > 0))
            throw SceneError(which + " has the volume " + std::to_string(volume) + " m^" +
                             std::to_string(dimension) +
                             "; give its vertices in the order of positive volume, and no flat "
                             "elements");
        if (longest > most * cell_size)
            throw SceneError(which + " has an edge of " + std::to_string(longest) + " m, " +
                             std::to_string(longest / cell_size) + " cells; at most " +
                             std::to_string(most) +
                             " may be, or nodes between its vertices are empty. Refine the mesh, "
                             "or take a cell_size of " +
                             std::to_string(longest / most) + " m");
    }
    for (std::size_t v = 0; v < vertices; ++v)
        if (!held[v])
            throw SceneError(who + "vertex " + std::to_string(v) +
                             " belongs to no element; leave it out");
}

void name_element(Fault& fault, std::uint64_t first_id) {
    std::string vertices;
    for (const std::uint64_t id : fault.ids)
        vertices += (vertices.empty() ? "" : ", ") + std::to_string(id - first_id);
    fault.message = "element " + std::to_string(fault.element) + " of vertices " + vertices;
    if (fault.code == "non-finite")
        fault.message += " has vertices whose places are not finite";
    else if (fault.code == "element-range")
        fault.message +=
            " has left the range of its law: its elastic volume ratio is not within "
            "0.05 to 20, or its plastic strain not below 1e6";
    else
        fault.message += " has shrunk to " + std::to_string(fault.value) +
                         " of its volume at rest, below " + std::to_string(least_element_ratio) +
                         " (crushed or turned inside out)";
}

void check_elements(const Spec& spec) {
    for (std::size_t k = 0; k < spec.bodies.size(); ++k) {
        const BodySpec& b = spec.bodies[k];
        if (b.elements.empty()) continue;
        const auto refuse = [&](const std::string& what, const std::string& remedy) {
            throw SceneError("body '" + b.name + "' of elements is not built for " + what + "; " +
                             remedy + ", or make it of particles");
        };
        if (!spec.functions.kind.empty()) refuse("grids of functions", "use square cells");
        if ((spec.kernel.kernel != Kernel::quadratic && spec.kernel.kernel != Kernel::cubic) ||
            spec.kernel.clamped)
            refuse("kernel '" + std::string(name_of(spec.kernel.kernel)) +
                       (spec.kernel.clamped ? "' with boundary splines" : "'"),
                   "use plain quadratic or cubic splines");
        if (spec.deformed_nodes) refuse("gradients by moved nodes", "use moved_nodes=False");
        if (spec.transfer.scheme == "XPIC" || spec.transfer.scheme == "FMPM")
            refuse("the sweeps of transfer '" + spec.transfer.scheme + "'",
                   "use APIC or another transfer");
        if (b.restored) refuse("what is continued from another run", "start the scene afresh");
        for (const InletSpec& inlet : spec.inlets)
            if (std::size_t(inlet.body) == k)
                refuse("inlet '" + inlet.name + "'", "feed another body");
        const std::string what = not_of_elements(spec, b);
        if (!what.empty())
            throw SceneError("body '" + b.name + "' of elements is not built for " + what);
    }
}

}  // namespace mpm
