// What the grid knows of fluids among solids: how groups of bodies press whose volumes it averages,
// and which fields of velocities have none.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string_view>
#include <vector>

#include "mpm/kernels/wall_lines.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

/// Of each averaged group of bodies with a bulk modulus and an exponent, which fluids have.
template <int D>
std::vector<GroupPressure> group_pressures(const Spec& spec, const Plan& plan) {
    std::vector<GroupPressure> found;
    for (std::size_t b = 0; b < spec.bodies.size(); ++b) {
        const GroupChannels& g = plan.bodies[b].group;
        const MaterialInfo& m = material(spec.bodies[b].material);
        const auto& values = spec.bodies[b].parameters;
        double stiffness = 0, exponent = 0;
        for (std::size_t k = 0; k < values.size(); ++k) {
            if (std::string_view(m.parameters[k].name) == "bulk_modulus") stiffness = values[k];
            if (std::string_view(m.parameters[k].name) == "exponent") exponent = values[k];
        }
        const bool known = std::any_of(found.begin(), found.end(),
                                       [&](const GroupPressure& f) { return f.sum == g.sum; });
        if (g.average < 0 || known || !(stiffness > 0 && exponent > 0)) continue;
        const double size = std::pow(spec.cell_size, D);
        found.push_back({g.sum, std::max(g.weight, 0), stiffness / exponent, exponent,
                         m.density(values.data()) * size});
    }
    return found;
}

/// (fields,): `SolidField` where a field of velocities is of solids alone, in a scene with
/// contacts, else 0.
inline std::vector<std::int32_t> fields_of_solids(const Spec& spec) {
    std::vector<std::int32_t> solid(std::size_t(spec.contact.fields), closes_gaps);
    const auto mark = [&](const BodySpec& body, std::int32_t as) {
        if (body.fields.empty()) solid[0] = as;
        for (const FieldOfIds& f : body.fields) solid[std::size_t(f.field)] = as;
    };
    // What no law keeps apart from others moves, and touches, as a run with one field has it.
    const std::size_t kinds = spec.contact.density.size();
    for (std::size_t f = 0; f < solid.size(); ++f) {
        const auto* laws = spec.contact.law_of.data() + std::size_t(spec.contact.kind[f]) * kinds;
        if (std::all_of(laws, laws + kinds, [](int law) { return law < 0; }))
            solid[f] = held_by_nodes;
    }
    for (const BodySpec& body : spec.bodies)
        if (body.rigid.given || !body.elements.empty()) mark(body, held_by_nodes);
    for (const BodySpec& body : spec.bodies)
        if (material(body.material).volumetric) mark(body, 0);
    return solid;
}

}  // namespace mpm
