// What a caller asks for, as plain values. Python validates and explains; here only what would
// corrupt a run is checked again. See design/engine-contract.md for the meaning of every entry.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "mpm/data/time_table.hpp"
#include "mpm/kernels/cell_smoothing.hpp"
#include "mpm/physics/boundary/decay.hpp"
#include "mpm/physics/boundary/response.hpp"
#include "mpm/physics/contact.hpp"
#include "mpm/physics/shape/kernel.hpp"
#include "mpm/physics/transfer/scheme.hpp"
#include "mpm/solver/rows.hpp"

namespace mpm {

class Communicator;

struct TableSpec {
    std::vector<double> time;   // (n,)
    std::vector<double> value;  // (n, dimension)
    TableEnd end = TableEnd::hold;
};

enum class SmoothingForm {
    none,
    one_volume,
    one_volume_gradient,
    two_volume,
    stress_only,
    split,
    literal
};

/// A force on chosen particles of a body's surface, or vertices of elements.
struct TractionSpec {
    std::vector<std::uint64_t> particles;  // rows of the body
    double length = 0;                     // of the boundary that each stands for, m
    std::vector<double> area;              // of elements: that of each vertex, m^2 (2D: m)
    TableSpec value;                       // Pa
};

/// Vertices of a body of elements that are held, or driven.
struct PinSpec {
    std::vector<std::uint64_t> vertices;  // numbers, of no other pin
    std::vector<int> axes;                // along which
    TableSpec displacement;               // from their places at rest, m; without rows: none
};

/// Particles of a body from an id on, until the next of these, that are to begin on one rank.
struct GroupOfIds {
    std::uint64_t first;  // above the body's first id
    int group;
};

/// Particles of a body from an id on, until the next of these, that have a field of velocities.
struct FieldOfIds {
    std::uint64_t first;  // above the body's first id
    int field;
};

/// Fields of velocities and what bodies of different ones do to each other (design/contact.md).
struct ContactSpec {
    int fields = 1;
    std::vector<int> kind;        // (fields,): fields of one kind have the same laws
    std::vector<double> density;  // (kinds,) at rest, kg/m^3
    std::vector<ContactLaw> laws;
    std::vector<int> law_of;  // (kinds, kinds): which of the laws; -1: they move as one
    int rigid = 0;            // the last so many fields are those of rigid bodies
    int bending() const { return fields - rigid; }
    bool any() const { return fields > 1; }
};

/// Of bodies of the material Rigid (design/rigid.md).
struct RigidSpec {
    bool given = false;
    std::vector<double> inertia;  // kg m^2 about the centre at the start, (1,) or (9,); or empty
    std::vector<int> held;        // axes along which it moves on as it began
    bool held_turn = false;
};

struct BodySpec {
    std::string name;
    std::string material;
    std::vector<double> parameters;  // in the order of the material's table
    std::uint64_t count = 0;
    std::vector<double> bounds;  // lower then upper, m
    double particle_mass = 0;
    std::uint64_t first_id = 0;
    Rows position;                 // (count, dimension), m from the lower corner; empty for a plan
    std::vector<double> velocity;  // (dimension,) or (count, dimension)
    // dv_c / dx_a in 1/s at [c][a], which affine transfers deposit with the velocity: empty for
    // none, (dimension^2,) or (count, dimension^2).
    std::vector<double> velocity_gradient;
    Rows pressure;  // (count,) or empty
    // Of a body that goes on from another run (StartSpec):
    bool restored = false;
    std::vector<std::uint32_t> ids;  // (count,) above first_id, below id_count; empty: the rows
    std::uint64_t id_count = 0;      // ids kept for the body; 0: as many as particles
    Rows state;  // (count, state_width): what its particles store; of one that begins here, what
    int state_width = 0;  // its material stores, or empty: all zero
    // Of bodies of elements, whose rows are vertices (design/elements.md): (m, dimension + 1) rows,
    // of positive orientation; volumes of vertices in place of the elements' own.
    std::vector<std::int32_t> elements;
    bool vertex_volumes = false;
    std::vector<double> element_stress;  // (m, 4 or 6) Pa: xx, yy, xy, zz or as LinearElastic's
    Rows all_vertices;  // of a rank of several: of the whole mesh, by id; else empty
    RigidSpec rigid;
    std::vector<TractionSpec> tractions;  // of elements, and on functions over cells
    std::vector<PinSpec> pins;            // of elements
    // On functions over cells only:
    Rows volume;  // (count,) m^2, or empty: all alike, from the mass
    Rows stress;  // (count, 4) Pa: xx, yy, xy, zz of materials that store it, or empty
    SmoothingForm smoothing = SmoothingForm::none;
    double smoothing_time = 0;
    double smoothing_ratio = 0;
    bool shifts = false;   // particles from overfull nodes (kernels/shifting.hpp)
    bool density = false;  // leads volumes (kernels/density.hpp)
    // Over cells (kernels/cell_smoothing.hpp), and numerical damping.
    SmoothingChoice cell_smoothing;
    std::string smoothed_field;  // "volume" or "strain"
    SmoothingChoice assumed;     // `constant` or `nodal` where `assumed_part` is any
    TensorPart assumed_part = TensorPart::none;
    bool assumed_rate = true;  // of the rate too, not of the stress alone
    double damping = 0;        // ratio xi
    PlacedForce force;
    // What it keeps of the velocity that it stores, where the transfer makes it store one.
    double keep = 1;            // alpha
    SchemeNumbers shift{};      // the rule of beta alone
    bool guard = true;          // beta is 0 where a boundary changed a node's velocity
    std::uint64_t held_by = 0;  // bit mask of the boundaries that are for some bodies alone
    // Where ranks begin with groups of bodies: by ascending id, the first of 0.
    std::vector<GroupOfIds> groups;
    // Where contact is declared, by ascending id, the first of 0.
    std::vector<FieldOfIds> fields;
};

/// Elements have a damping of their own (physics/element.hpp).
inline bool damped_particles(const BodySpec& b) { return b.damping > 0 && b.elements.empty(); }
/// Does a body ask for what only the phased step has between its parts?
inline bool works_between_parts(const BodySpec& b) {
    return b.cell_smoothing.form != CellForm::none || b.assumed_part != TensorPart::none ||
           damped_particles(b) || b.force.axis >= 0;
}

inline std::uint64_t ids_of(const BodySpec& b) { return b.id_count ? b.id_count : b.count; }

/// The group of a particle by its id above the body's first; of a body without groups 0.
inline int group_of(const BodySpec& b, std::uint64_t id) {
    int group = 0;
    for (const GroupOfIds& g : b.groups) {
        if (g.first > id) break;
        group = g.group;
    }
    return group;
}

/// Where a run begins that goes on from another with other bodies: the nodal velocities and
/// averages of that run, which its particles' bodies (`restored`) take with them.
struct StartSpec {
    bool given = false;
    double time = 0;
    double time_step = 0;  // for which the nodal velocities hold the particles' stress
    std::int64_t step = 0;
    std::vector<std::int64_t> cell;  // (n, dimension): cells that the nodes are centres of
    std::vector<double> velocity;    // (n, dimension)
    std::map<std::string, std::vector<double>> averages;  // by the channel of their sum, (n,)
    // Of the first sensors of the scene, which that run had; flat as in a saved state.
    std::vector<std::int64_t> sensor_next;
    std::vector<double> sensor_last, sensor_first, load_impulse;
};

/// A prescribed motion of a rigid body: places (m or rad), or speeds from time 0 on.
struct MotionSpec {
    TableSpec table;  // without rows: at rest
    bool of_places = false;

    bool given() const { return !table.time.empty(); }
    /// What speeds have travelled by each row.
    std::vector<double> travelled() const {
        const std::size_t rows = table.time.size(), n = table.value.size() / rows;
        std::vector<double> way(table.value.size());
        for (std::size_t k = 0; k < rows; ++k) {
            for (std::size_t c = 0; c < n; ++c) {
                way[k * n + c] =
                    k == 0 ? table.value[c] * table.time[0]
                           : way[(k - 1) * n + c] +
                                 0.5 * (table.value[(k - 1) * n + c] + table.value[k * n + c]) *
                                     (table.time[k] - table.time[k - 1]);
            }
        }
        return way;
    }
};

/// A rigid body of any shape, by its signed distance on a lattice of its own
/// (data/distance_field.hpp).
struct SurfaceSpec {
    std::vector<std::int64_t> keys;   // (blocks, dimension); none: no surface
    std::vector<std::int32_t> place;  // (blocks,): which block of values; -1: deep inside
    std::vector<float> values;        // lattice cells
    std::vector<double> origin;       // of the lattice, m
    double spacing = 0;               // of the lattice, m
    Decay decay = Decay::quadratic;
    double thickness = 0;  // of the layer, m
    MotionSpec path, turn;
    std::vector<double> about, axis;
};

struct BoundarySpec {
    std::string name;
    bool is_box = false;
    SurfaceSpec surface;
    int restricted = -1;           // its bit in `held_by` of the bodies that it is for; -1: for all
    bool uplift = false;           // water in the gap below these bodies presses on them
    std::vector<double> within;    // lower then upper corner, m, where it acts alone; or empty
    std::vector<double> segments;  // (n, 4) m: parts of the outline of a grid of functions, its law
                                   // that of face 0
    std::vector<int> lower, upper;  // box, cells; surface: the cells that it may ever reach
    std::vector<int> present;       // per face x-, x+, y-, ...
    std::vector<SurfaceLaw> law;    // per face
    double start = 0, end = 0;
    bool moves = false;
    TableSpec motion;
};

/// Water that comes in through a face of the domain, layer by layer. The nodes that lead it are
/// those of a boundary of its own.
struct InletSpec {
    std::string name;
    int body = -1;
    int face = 0;                  // x-, x+, y-, ...
    double spacing = 0;            // of layers, m
    std::vector<double> points;    // (n, dimension) m: a layer that is due now
    std::vector<double> pressure;  // (n,) Pa or empty
    std::uint64_t next_id = 0;     // of the first particle to come, above the body's first
    TableSpec velocity;            // m/s into the domain, one component
};

/// A face through which particles leave and are counted, whatever `Leaving` says of the others.
struct OutletSpec {
    std::string name;
    int face = 0;
};

inline bool mirrors(const BoundarySpec& b) {
    return std::any_of(b.law.begin(), b.law.end(),
                       [](const SurfaceLaw& law) { return mirrors(law.response); });
}
/// Whether a boundary is one that only some scenes have (kernels/boundaries.hpp).
inline bool special(const BoundarySpec& b) {
    return mirrors(b) || !b.surface.keys.empty() || !b.within.empty() || b.restricted >= 0 ||
           std::any_of(b.law.begin(), b.law.end(), [](const SurfaceLaw& law) {
               return law.response == Response::prescribed || law.linear;
           });
}
/// A surface of any shape beside which lines of nodes lead (kernels/surface_lines.hpp).
inline bool linear_surface(const BoundarySpec& b) {
    return !b.surface.keys.empty() && b.law[0].linear;
}
/// Whether nodes beside boundaries are moved apart from all others (kernels/wall_nodes.hpp).
inline bool lists_wall_nodes(const std::vector<BoundarySpec>& all) {
    return std::any_of(all.begin(), all.end(), special) &&
           std::none_of(all.begin(), all.end(), [](const BoundarySpec& b) { return mirrors(b); });
}

enum class SensorKind {
    load_cell,
    wave_gauge,
    velocity_probe,
    tracker,
    energy,
    contact_load,
    rigid_motion,
    pin_force,
    tally
};

/// Sums over particles of one body (kernels/tally.hpp).
struct TallySpec {
    int body = -1;
    std::uint64_t first = 0, count = 0;  // ids of the scene
    int of = 0;                          // a `TallyOf`
    int part = 0, axis = -1, sign = 0;
    std::vector<double> lower, upper;  // of a box, m from the lower corner; empty: everywhere
    std::vector<double> origin;        // of the lower corner in the world, m
    std::vector<double> up, reference;
    std::vector<double> places;  // (count, D) m from the lower corner, at first; or none
};

struct SensorSpec {
    std::string name;
    SensorKind kind = SensorKind::energy;
    double interval = 0;
    int boundary = -1;
    int faces = 0;  // bit mask
    std::vector<double> reference, position;
    int axis = -1;
    int body = -1;
    int pin = -1;  // of the body
    std::vector<std::uint64_t> ids;
    // Of a contact: of two fields by their kinds, the lower field first, whether the force on the
    // second counts (1), that on the first (-1), or none (0); and the only two that count, if any.
    std::vector<std::int32_t> sides;
    std::vector<std::int32_t> fields;
    std::vector<TallySpec> tallies;
};

/// Of particles and grid; mixed: particles double, grid single.
enum class Precision { single, mixed, double_ };

enum class Leaving { stop, freeze, remove };

/// Functions over cells of the user's choosing in place of the regular grid: de Koster (2018).
struct FunctionsSpec {
    std::string kind;              // "" (none), "triangular" or "splines"
    std::vector<double> vertices;  // (n, 2) m from the lower corner
    std::vector<int> triangles;    // (m, 3)
    std::string basis;             // "linear", "lagrange", "powell-sabin", "cubic-powell-sabin"
    int degree = 2;
    std::vector<double> split;     // (m, 2) m, or empty
    std::vector<double> knots[2];  // m
    int degrees[2] = {2, 2};
    std::string mass = "consistent";  // "lumped", "partial-rows", "partial-symmetric"
    std::string solver = "direct";    // "cg", "richardson"
    double tolerance = 1e-10;
    int iterations = 200;
    double deactivate_below = 0;
};

/// How numbers go between particles and grid (physics/transfer/scheme.hpp).
struct TransferSpec {
    std::string scheme = "APIC";
    int order = 1;           // k of XPIC and FMPM
    std::int64_t every = 1;  // of their steps one filters
};

struct KernelSpec {
    Kernel kernel = Kernel::quadratic;
    GradientForm gradient = GradientForm::moments;
    bool clamped = false;   // modified splines where the domain ends
    bool modified = false;  // linear: deposits by modified functions
};

/// Ranks that share the scene, each with its own blocks of cells and their particles.
struct RanksSpec {
    int count = 1;
    std::vector<int> devices;  // CUDA: of each rank
    static constexpr int curve = -1, chosen = -2;
    // Blocks are dealt by planes across it, along a space-filling curve, or as `choose_partition`
    // has it.
    int axis = chosen;
    // Planes across `axis` to begin with, by the first block behind each, counted from the domain's
    // first; empty: where loads are even.
    std::vector<std::int64_t> planes;
    // Each rank begins with one group of bodies (BodySpec::groups), as far as pieces of the row can
    // have it so.
    bool grouped = false;
    // The load of a block is by the time that its rank's steps have taken; else by particles.
    bool measured = false;
    // Then: the time of a rank, s, where it is not that which its thread has worked.
    std::function<double(int rank)> seconds;
    // The largest load over the mean one at which a sort deals blocks anew, where that helps; 0: at
    // every sort.
    double rebalance_above = 1.05;
    // Ranks that are processes: this one's link to the others. `count` is then theirs, and
    // `threads` those of this rank.
    std::shared_ptr<Communicator> processes;
};

struct Spec {
    int dimension = 3;
    Precision precision = Precision::single;
    int device = 0;
    bool shared_device = false;  // other simulations run on it at the same time
    std::string pipeline = "auto";
    int threads = 0;  // of all ranks together
    RanksSpec ranks;
    double cell_size = 0;
    std::vector<std::int64_t> cells;
    FunctionsSpec functions;
    TransferSpec transfer;
    KernelSpec kernel;
    bool deformed_nodes = false;  // velocity gradients by nodes that have moved with the step
    TableSpec gravity;
    double cfl = 0.4;
    double time_step = 0;  // 0: from the wave speeds
    Leaving leaving = Leaving::stop;
    std::vector<BodySpec> bodies;
    std::vector<BoundarySpec> boundaries;
    std::vector<SensorSpec> sensors;
    std::vector<InletSpec> inlets;
    std::vector<OutletSpec> outlets;
    ContactSpec contact;
    StartSpec start;
    std::vector<int>
        stored_as;  // per body, of a state to load: which of its bodies; empty: by rule
};

/// The axis along which gravity is largest, summed over its table; -1 where there is none.
inline int axis_of_gravity(const Spec& spec, int dimension) {
    int axis = -1;
    double most = 0;
    for (int a = 0; a < dimension; ++a) {
        double pull = 0;
        for (std::size_t k = std::size_t(a); k < spec.gravity.value.size();
             k += std::size_t(dimension))
            pull += std::abs(spec.gravity.value[k]);
        if (pull > most) axis = a;
        most = std::max(most, pull);
    }
    return axis;
}

}  // namespace mpm
