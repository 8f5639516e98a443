// What a material says about itself. Constructors, validation, representation, serialisation and
// documentation in Python follow from this table (tools/generate_materials.py).
#pragma once

#include <limits>

#include "mpm/core/linalg.hpp"

namespace mpm {

struct Parameter {
    const char* name;
    const char* symbol;
    const char* unit;
    double default_value;  // not-a-number: the user must give it
    double lower;
    double upper;
    bool lower_open;
    bool upper_open;
    const char* meaning;
};

struct Column {
    const char* name;
    int components[2];  // in two and three dimensions
    const char* meaning;
    const char* unit;
};

/// Whether a material is compiled into the fused and two-pass steps too. One that is in few scenes
/// says `static constexpr bool fused = false`: the phased step has every material, at a part of the
/// compile time.
template <class Material>
inline constexpr bool has_fused_form = [] {
    if constexpr (requires { Material::fused; })
        return Material::fused;
    else
        return true;
}();

/// A material whose stress falls out of its update says so by a `respond` that does both.
template <class Material, class V, int D, class T>
concept Responds = requires(V (&state)[Material::template reals<D>], const Mat<V, D>& strain,
                            const typename Material::template Constants<T>& k) {
    Material::respond(state, strain, k);
};

/// Solids that can say what volume a particle has lost, 1 - J. Fluids store it.
template <class Material, class V, int D>
concept SaysVolume = requires(const V (&state)[Material::template reals<D>]) {
    Material::template volume_loss<D>(state);
};
/// Materials whose volume F-bar may smooth: fluids, and solids that can say and scale it.
template <class Material, class V, int D>
concept ScalesVolume = SaysVolume<Material, V, D> &&
    requires(V (&state)[Material::template reals<D>]) {
    Material::template scale_volume<D>(state, state[0], state[0]);
};
template <class Material, int D>
inline constexpr bool smoothable = Material::volumetric || ScalesVolume<Material, double, D>;

/// Whether a material is compiled into the fused step of schemes that store velocities too: shifts
/// ask for its volume there.
template <class Material>
inline constexpr bool fuses_memory = has_fused_form<Material> &&
                                     (Material::volumetric || SaysVolume<Material, double, 3>);

inline constexpr double required = std::numeric_limits<double>::quiet_NaN();
inline constexpr double unbounded = std::numeric_limits<double>::infinity();

/// What the host computes for a reader from one particle's state, in double precision.
template <int D>
struct Observation {
    double volume_ratio;  // J
    double pressure;      // Pa, positive in compression: -tr(sigma) / 3 with the out-of-plane part
    double stress[D][D];  // Cauchy stress, Pa (in-plane part in two dimensions)
    double elastic_energy;     // J per m^3 of undeformed volume
    double deformation[D][D];  // F; identity for materials that do not store it
    double plastic_strain;     // accumulated and equivalent; 0 for materials without any
    bool yields;               // stands on its yield surface after flowing
};

}  // namespace mpm
