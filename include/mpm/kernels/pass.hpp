// The seam between the solver and the instances compiled for one material: a plain struct of
// functions. The solver never names a material, an instance never sees a scene.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "mpm/kernels/views.hpp"
#include "mpm/physics/material/description.hpp"
#include "mpm/physics/volume_smoothing.hpp"

namespace mpm {

inline constexpr int max_parameters = 16;
/// `Pass::staged` where there is one rank alone.
inline constexpr std::int32_t none_staged = std::numeric_limits<std::int32_t>::max();

/// One body, one step: everything that a pass over its particles needs.
template <class X, class T, int D>
struct Pass {
    static constexpr int dimension = D;
    using Grid = typename X::template Grid<T>;
    using Sum = typename X::template Sum<T>;
    X* exec;
    GridView<Grid, Sum, D> grid;  // velocities to read, sums to fill
    BodyView<T, D> body;
    GroupChannels group;
    const Clock* clock;
    const BodyNumbers* numbers;
    std::uint64_t* fault_particle;
    std::uint64_t* strays;  // devices: counts particles beside their home cell
    double* deposited;      // fixed point: the largest deposits of this step, by quantity
    // Devices: the last worker of a step's passes turns the clock.
    TurnStep<D> turn;
    std::uint32_t workers;  // that are to arrive, of all bodies
    std::uint32_t* arrivals;
    std::uint64_t body_number;
    double parameters[max_parameters];
    bool carry;        // F-bar: deposit the gradient of j
    bool stress_only;  // F-bar: only the pressure sees the blend
    Grid* scratch;     // two-pass: (channels * (1 + D), count), what a particle deposits
    // CPU: to which slots a block's sums go, (slots, 3^D): those of its neighbours, but for blocks
    // that other ranks hold too. Slots from `staged` on take them without the particle's mass
    // (kernels/staging.hpp).
    const std::int32_t* destinations;
    std::int32_t staged;
    std::int32_t full_homes;       // devices: of all ranks
    const std::int32_t* coloured;  // CPU: home blocks by colour; blocks of one colour share no node
    const std::int32_t* colour_start;  // (colours + 1)
    int colours;
};

/// Host-side answers about one particle.
template <int D>
using Observe = Observation<D> (*)(const double* state, const double (&rate)[D][D],
                                   const double* parameters);

template <class X, class T, int D>
struct Phase;

template <class X, class T, int D>
struct BodyOps {
    using Run = void (*)(const Pass<X, T, D>&);
    using RunPhase = void (*)(const Phase<X, T, D>&);
    Run fused;      // null where this backend and precision have no fused form
    Run split;      // devices: the fused form of bodies that are stored by chunk, or null
    Run lone;       // devices: the fused form for particles in nearly empty blocks
    RunPhase keep;  // the fused form of schemes that store velocities (kernels/keep.hpp), or null
    RunPhase split_keep;  // devices: the same of bodies that are stored by chunk, or null
    bool pairs;           // devices: these two have room for two homes beside each other
    Run gather;           // two-pass, first half
    Run scatter;          // two-pass, second half
    Run initial;          // deposit of resting particles; velocities in scratch (D, count)
    // Where *due is set, per home block: kinetic, elastic, potential energy.
    void (*energies)(const Pass<X, T, D>&, const std::int32_t* due, double* partial);
    RunPhase respond;  // phased: the material's part of a step (kernels/respond.hpp)
    RunPhase rest;     // phased: what resting particles deposit
    RunPhase project;  // phased: F-bar in its split form
    void (*phase_energies)(const Phase<X, T, D>&, const std::int32_t* due, double* partial);
    int state_columns;
    int channels;  // transfer channels
    Observe<D> observe;
    // Gives a state, as readers see it, another volume loss; only where F-bar keeps two.
    void (*adopt)(double* state, double loss);
};

/// What the solver may know of a material without instantiating anything.
struct MaterialInfo {
    const char* name;
    const char* summary;
    const char* source;
    const char* needs;
    const char* limits;
    bool volumetric;
    bool smoothable;    // F-bar may smooth its volume
    bool fused;         // has the fused and two-pass forms
    bool fuses_memory;  // has the fused form of schemes that store velocities
    bool plastic;       // stores a plastic strain
    bool yields;        // says whether it yields
    const Parameter* parameters;
    int parameter_count;
    const Column* columns;
    int column_count;
    double (*density)(const double*);
    double (*wave_speed)(const double*);
    double (*viscosity)(const double*);  // the largest, Pa s; null where there is none
    double (*volume_from_pressure)(double pressure, const double*);  // null unless volumetric
    int (*reals)(int dimension);
    bool stores_strain;                      // the total small strain alone
    bool stores_gradient;                    // F - I, as the first of its numbers
    double (*shear_modulus)(const double*);  // Pa; null where there is none
};

template <class Material>
MaterialInfo describe_material() {
    MaterialInfo m{};
    m.name = Material::name;
    m.summary = Material::summary;
    m.source = Material::source;
    m.needs = Material::needs;
    m.limits = Material::limits;
    m.volumetric = Material::volumetric;
    m.smoothable = smoothable<Material, 3>;
    m.fused = has_fused_form<Material>;
    m.fuses_memory = fuses_memory<Material>;
    for (const Column& c : Material::columns)
        m.plastic = m.plastic || std::string(c.name) == "plastic_strain";
    m.yields = m.plastic || requires { Material::yields; };
    m.parameters = Material::parameters;
    m.parameter_count = int(sizeof(Material::parameters) / sizeof(Parameter));
    m.columns = Material::columns;
    m.column_count = int(sizeof(Material::columns) / sizeof(Column));
    m.density = &Material::density;
    m.wave_speed = &Material::wave_speed;
    if constexpr (requires { &Material::viscosity; }) m.viscosity = &Material::viscosity;
    if constexpr (Material::volumetric) m.volume_from_pressure = &Material::volume_from_pressure;
    m.reals = [](int d) {
        return d == 2 ? Material::template reals<2> : Material::template reals<3>;
    };
    m.stores_strain = requires { Material::stores_strain; };
    m.stores_gradient = requires { Material::stores_gradient; };
    if constexpr (requires { &Material::shear_modulus; })
        m.shear_modulus = &Material::shear_modulus;
    static_assert(sizeof(Material::parameters) / sizeof(Parameter) <= max_parameters);
    return m;
}

/// Defined by the generated unit of each material and backend.
template <class X, class T, int D, class Material>
BodyOps<X, T, D> body_ops(Smoothing);

}  // namespace mpm
