// Bodies whose stress lives in linear elements and whose vertices move with the grid as particles
// do (design/elements.md). Here is what happens to one vertex and to one element; drivers own the
// loops. In a step, after the vertices have been collected and moved:
//
//   locate    by vertex in storage order: how far it stands from its place at rest, by number
//   volumes   (with volumes of vertices) by element V (J - 1)/(D + 1), then by vertex its pressure
//   forces    by element, D + 1 forces of D numbers; that on vertex 0 is minus the others' sum
//   spread    by vertex: its elements' forces in the order of elements, mass and momentum; on
//             devices the forces in a pass of their own
//
// Nobody adds to what another writes: each vertex has the list of its elements, ascending, so that
// no schedule changes a bit.
#pragma once

#include <string>

#include "mpm/kernels/respond.hpp"
#include "mpm/kernels/transfers.hpp"
#include "mpm/physics/element.hpp"

namespace mpm {

/// What a vertex stores as a particle of the phased step: its mass over the mean of its body's. It
/// has no stress of its own.
struct VertexCarrier {
    static constexpr bool volumetric = false;
    template <class T>
    struct Constants {};
    template <class T>
    MPM_HD static Constants<T> constants(const double*) {
        return {};
    }
    template <int D>
    static constexpr int reals = 1;

    template <class V, int D, class T>
    MPM_INLINE static void advance(V (&)[1], const Mat<V, D>&, const Constants<T>&) {}
    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> kirchhoff(const V (&)[1], const Mat<V, D>&, const Constants<T>&) {
        Mat<V, D> none;
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) none.e[a][b] =
            V(ScalarOf<V>(0));
        return none;
    }
    template <class V, int D>
    MPM_INLINE static MaskOf<V> admissible(const V (&state)[1]) {
        return V(ScalarOf<V>(0)) < state[0];
    }
    template <int D>
    MPM_HD static Observation<D> observe(const double*, const double (&)[D][D], const double*) {
        Observation<D> o{};
        o.volume_ratio = 1;
        for (int a = 0; a < D; ++a) o.deformation[a][a] = 1;
        return o;
    }
};

/// What a loop goes over: all of so many, or those of a list.
struct Chosen {
    std::int64_t count = 0;
    const std::int32_t* number = nullptr;  // null: all
    MPM_INLINE std::int64_t operator[](std::int64_t k) const { return number ? number[k] : k; }
};

/// What an element pushes its vertices by, times a cell; in pieces that a device writes at once.
template <class T, int D>
struct alignas(D == 2 ? 2 * sizeof(T) : 16) ElementForces {
    T on[D + 1][D];
};

/// The mesh of one body, as kernels see it. Lengths of elements and displacements are in cells.
template <class T, int D>
struct ElementsView {
    static constexpr int corners = D + 1;
    std::int64_t elements, vertices;
    // All, or of several ranks what this one works on: elements whose forces it finds, elements
    // whose volumes it asks for, vertices whose pressures it does.
    Chosen pushed, measured, pressed;
    // By element, in the mesh's order.
    const std::int32_t* vertex;  // (elements, D + 1), numbers
    const T* inverse;            // (elements, D, D): D_m^-1, 1/cells
    const T* volume;             // (elements,) at rest, m^D
    ElementForces<T, D>* force;  // (elements,)
    T* grown;                    // (elements,): V (J - 1)/(D + 1); null without volumes of vertices
    T* kept;                     // (elements, kept_reals): of laws that flow, else null
    const T* start_stress;       // (elements, 4 or 6): Cauchy at rest, Pa; in 2D zz last; or null
    // By number of vertex.
    std::int32_t* rest_cell;      // (vertices, D)
    T* rest_offset;               // (vertices, D)
    std::int32_t* cells;          // (vertices, D): whole cells from its place at rest
    T* beyond;                    // (vertices, D): and the rest of its displacement
    T* moved;                     // (vertices, D): how far it was moved, cells; null undamped
    const std::uint32_t* start;   // (vertices + 1)
    const std::uint32_t* corner;  // element * (D + 1) + which of its vertices, ascending
    const T* vertex_volume;       // (vertices,): sum V/(D + 1), m^D
    T* vertex_change;             // (vertices,): J_a - 1
    T* pressure;                  // (vertices,): U'(J_a), Pa
    T* load;                      // (vertices, D): of tractions, times a cell; null without any
    T* push;                   // devices, (D, vertices) in storage order: `push_of_step`; else null
    const std::uint8_t* held;  // (vertices,): bit of each axis along which a pin has it, or null
    std::uint64_t* inverted;   // the first element that is, else no_fault
    ElementDamping<T> damping;

    MPM_INLINE int number(std::int64_t element, int k) const {
        return vertex[element * corners + k];
    }
};

/// A component of a vertex' displacement is now this; `entry`: of `cells`.
template <class T, int D>
MPM_INLINE void place_vertex(const ElementsView<T, D>& mesh, std::int64_t entry, std::int32_t cells,
                             T beyond) {
    if (mesh.moved)
        mesh.moved[entry] = T(cells - mesh.cells[entry]) + (beyond - mesh.beyond[entry]);
    mesh.cells[entry] = cells;
    mesh.beyond[entry] = beyond;
}

/// Where vertex q stands, whose home cell in the domain is `cell`.
template <class T, int D>
MPM_INLINE void locate_vertex(const ElementsView<T, D>& mesh, const BodyView<T, D>& body,
                              const std::int32_t (&cell)[D], std::uint32_t q) {
    const std::int64_t at = std::int64_t(body.id[q]) * D;
    MPM_UNROLL for (int a = 0; a < D; ++a)
        place_vertex(mesh, at + a, cell[a] - mesh.rest_cell[at + a],
                     body.offset[a][q] - mesh.rest_offset[at + a]);
}
/// The same, for its place at rest.
template <class T, int D>
MPM_INLINE void rest_vertex(const ElementsView<T, D>& mesh, const BodyView<T, D>& body,
                            const std::int32_t (&cell)[D], std::uint32_t q) {
    const std::int64_t at = std::int64_t(body.id[q]) * D;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        mesh.rest_cell[at + a] = cell[a];
        mesh.rest_offset[at + a] = body.offset[a][q];
    }
}

template <class V, class T, int D>
MPM_INLINE Mat<V, D> element_inverse(const ElementsView<T, D>& mesh, std::int64_t e) {
    Mat<V, D> out;
    MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) out.e[a][b] =
        V(mesh.inverse[(e * D + a) * D + b]);
    return out;
}

/// H of an element. Whole cells are subtracted first: a body may be a thousand of them from where
/// it began, or turned by any angle.
template <class V, class T, int D>
MPM_INLINE Mat<V, D> element_state(const ElementsView<T, D>& mesh, const Mat<V, D>& inverse,
                                   std::int64_t e) {
    const std::int64_t from = std::int64_t(mesh.number(e, 0)) * D;
    Mat<V, D> moved;
    MPM_UNROLL for (int k = 0; k < D; ++k) {
        const std::int64_t to = std::int64_t(mesh.number(e, k + 1)) * D;
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            moved.e[a][k] = V(mesh.cells[to + a] - mesh.cells[from + a]) +
                            (V(mesh.beyond[to + a]) - V(mesh.beyond[from + a]));
        }
    }
    return element_gradient(moved, inverse);
}

template <class T, int D>
MPM_INLINE void grow_element(const ElementsView<T, D>& mesh, std::int64_t e) {
    const Mat<T, D> h = element_state<T>(mesh, element_inverse<T>(mesh, e), e);
    mesh.grown[e] = mesh.volume[e] * volume_change(h) * T(1.0 / (D + 1));
}
template <class Material, class T, int D, class Constants>
MPM_INLINE void press_vertex(const ElementsView<T, D>& mesh, const Constants& k,
                             std::int64_t number) {
    T sum = T(0);
    for (std::uint32_t c = mesh.start[number]; c < mesh.start[number + 1]; ++c)
        sum = sum + mesh.grown[mesh.corner[c] / (D + 1)];
    const T change = sum / mesh.vertex_volume[number];
    mesh.vertex_change[number] = change;
    mesh.pressure[number] = volume_pressure_of<Material>(change, k);
}
template <class V, class T, int D>
MPM_INLINE V element_pressure(const ElementsView<T, D>& mesh, std::int64_t e) {
    V sum = V(mesh.pressure[mesh.number(e, 0)]);
    MPM_UNROLL for (int k = 1; k <= D; ++k) sum = sum + V(mesh.pressure[mesh.number(e, k)]);
    return V(1.0 / (D + 1)) * sum;
}

/// Numbers of a stress at rest.
template <int D>
inline constexpr int start_reals = D == 2 ? 4 : 6;

/// What a stress at rest S adds to Kirchhoff's: F S F^T, so that with the energy V S:(F^T F - I)/2
/// forces stay the derivative of one. With S alone at F = I it is the stress itself.
template <class V, class T, int D>
MPM_INLINE Mat<V, D> start_kirchhoff(const ElementsView<T, D>& mesh, std::int64_t e,
                                     const Mat<V, D>& h) {
    V own[start_reals<D>];
    MPM_UNROLL for (int r = 0; r < start_reals<D>; ++r) own[r] =
        V(mesh.start_stress[e * start_reals<D> + r]);
    Mat<V, D> f = h;
    MPM_UNROLL for (int a = 0; a < D; ++a) f.e[a][a] = f.e[a][a] + ScalarOf<V>(1);
    return product_transposed(product(f, load_symmetric<D>(own)), f);
}

/// By how much H of an element has changed as its vertices were moved.
template <class T, int D>
MPM_INLINE Mat<T, D> element_change(const ElementsView<T, D>& mesh, const Mat<T, D>& inverse,
                                    std::int64_t e) {
    const std::int64_t from = std::int64_t(mesh.number(e, 0)) * D;
    Mat<T, D> moved;
    MPM_UNROLL for (int k = 0; k < D; ++k) {
        const std::int64_t to = std::int64_t(mesh.number(e, k + 1)) * D;
        MPM_UNROLL for (int a = 0; a < D; ++a) moved.e[a][k] =
            mesh.moved[to + a] - mesh.moved[from + a];
    }
    return element_gradient(moved, inverse);
}

/// Leaves an element's forces, and what it keeps; whether it may go on so. `dt`: of the step that
/// has moved its vertices, s.
template <class Material, class T, int D, class Constants>
MPM_INLINE bool push_element(const ElementsView<T, D>& mesh, const Constants& k, std::int64_t e,
                             double dt) {
    const Mat<T, D> inverse = element_inverse<T>(mesh, e), h = element_state<T>(mesh, inverse, e);
    const T change = volume_change(h);
    bool fine = true;
    Mat<T, D> tau;
    if constexpr (flows<Material>) {
        constexpr int n = kept_reals<Material, D>;
        T kept[n];
        MPM_UNROLL for (int r = 0; r < n; ++r) kept[r] = mesh.kept[e * n + r];
        tau = flow_to<Material>(kept, h, k, fine);
        MPM_UNROLL for (int r = 0; r < n; ++r) mesh.kept[e * n + r] = kept[r];
    } else {
        tau = kirchhoff_at<Material>(h, k);
    }
    if (mesh.grown) take_vertex_pressure<Material>(tau, change, element_pressure<T>(mesh, e), k);
    if (mesh.start_stress) {
        const Mat<T, D> more = start_kirchhoff(mesh, e, h);
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) tau.e[a][b] =
            tau.e[a][b] + more.e[a][b];
    }
    if (mesh.moved)
        add_damping(tau, h, element_change(mesh, inverse, e), change, mesh.damping, T(dt));
    const Mat<T, D> pull = element_pull(tau, h, inverse);
    const T volume = mesh.volume[e];
    ElementForces<T, D> force;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        MPM_UNROLL for (int n = 0; n < D; ++n) force.on[n + 1][a] = -(volume * pull.e[a][n]);
        T all = force.on[1][a];
        MPM_UNROLL for (int n = 2; n <= D; ++n) all = all + force.on[n][a];
        force.on[0][a] = -all;
    }
    mesh.force[e] = force;
    // Not-a-number is no volume either.
    return fine && change > T(least_element_ratio - 1);
}

/// What its elements push a vertex by, in the order of its list, and tractions.
template <class T, int D>
MPM_INLINE Vec<T, D> force_on_vertex(const ElementsView<T, D>& mesh, std::int64_t number) {
    Vec<T, D> sum;
    MPM_UNROLL for (int a = 0; a < D; ++a) sum[a] = T(0);
    for (std::uint32_t c = mesh.start[number]; c < mesh.start[number + 1]; ++c) {
        const std::uint32_t e = mesh.corner[c] / (D + 1);
        const T(&force)[D] = mesh.force[e].on[mesh.corner[c] % (D + 1)];
        MPM_UNROLL for (int a = 0; a < D; ++a) sum[a] = sum[a] + force[a];
    }
    if (mesh.load)
        MPM_UNROLL for (int a = 0; a < D; ++a) sum[a] = sum[a] + mesh.load[number * D + a];
    return sum;
}

/// The same of what goes to the grid: what pulls at a pinned vertex pulls at its pin.
template <class T, int D>
MPM_INLINE Vec<T, D> push_on_vertex(const ElementsView<T, D>& mesh, std::int64_t number) {
    Vec<T, D> push = force_on_vertex(mesh, number);
    if (mesh.held)
        MPM_UNROLL for (int a = 0; a < D; ++a) if (mesh.held[number] >> a & 1) push[a] = T(0);
    return push;
}

/// The same of vertex q, as what a deposit of unit mass takes of it in the coming step, m/s.
template <class X, class T, int D>
MPM_INLINE Vec<T, D> push_of_step(const Pass<X, T, D>& pass, const ElementsView<T, D>& mesh,
                                  std::uint32_t q) {
    // Forces are kept times a cell: dt_next / dx.
    const T scale =
        T(0.25 * pass.numbers->impulse * (pass.body.particle_mass / pass.body.particle_volume));
    const T m = T(pass.body.particle_mass) * pass.body.state[0][q];
    Vec<T, D> push = push_on_vertex(mesh, pass.body.id[q]);
    MPM_UNROLL for (int a = 0; a < D; ++a) push[a] = scale * push[a] / m;
    return push;
}

/// `spread_particle` of a vertex: no stress goes with slopes, `push` (m/s) is the whole of it.
template <class Nodes = ByPlanes, int W, class X, class T, int D, class S, class G, class Add>
MPM_INLINE void spread_vertex(const Phase<X, T, D>& phase, const Reached<W, X, T, D, S>& reached,
                              const Places<D, W>& places, std::uint32_t q, const Vec<G, D>& push,
                              const Add& add) {
    const auto& pass = phase.pass;
    const PhaseNumbers& n = phase.n;
    const auto& s = reached.stencil;
    const std::size_t count = pass.body.count;
    const Scratch<D> column{n.channels};
    const auto get = [&](int c) { return pass.scratch[std::size_t(c) * count + q]; };
    const bool plain = n.plain >= 0;
    const int mass = n.channels + (plain ? D : 0);
    G value[D], slope[D][D] = {};
    MPM_UNROLL for (int c = 0; c < D; ++c) {
        value[c] = get(column.value(c));
        MPM_UNROLL for (int a = 0; a < D; ++a) if (n.scheme.affine) slope[a][c] =
            get(column.slope(a, c));
    }
    Nodes::visit(s, places, [&](const auto& k, int place, G w) {
        MPM_UNROLL for (int c = 0; c < D; ++c) {
            G at = value[c];
            MPM_UNROLL for (int a = 0; a < D; ++a) at = at + slope[a][c] * s.distance[a][k[a]];
            add(c, place, w * at + w * push[c]);
            if (plain) add(n.channels + c, place, w * at);
        }
        add(mass, place, w);
    });
}

/// Where contact looks for faces, masses at vertices are too coarse a picture: a point near each
/// vertex of an element stands for its part of the volume. Here their shares of the vertices.
template <int D>
inline constexpr double own_share = D == 2 ? 2.0 / 3 : 0.5854101966249685;

/// Calls f(offset from the home cell of vertex q, mass) for the points near it of its elements.
template <class T, int D, class F>
MPM_INLINE void for_each_point(const ElementsView<T, D>& mesh, const BodyView<T, D>& body,
                               std::uint32_t q, T density, const F& f) {
    constexpr T others = T((1 - own_share<D>) / D);
    const std::int64_t number = body.id[q], from = number * D;
    for (std::uint32_t c = mesh.start[number]; c < mesh.start[number + 1]; ++c) {
        const std::int64_t e = mesh.corner[c] / (D + 1);
        Vec<T, D> at;
        MPM_UNROLL for (int a = 0; a < D; ++a) at[a] = body.offset[a][q];
        MPM_UNROLL for (int k = 0; k <= D; ++k) {
            const std::int64_t to = std::int64_t(mesh.number(e, k)) * D;
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                const std::int32_t cells = (mesh.rest_cell[to + a] + mesh.cells[to + a]) -
                                           (mesh.rest_cell[from + a] + mesh.cells[from + a]);
                const T beyond = (mesh.rest_offset[to + a] + mesh.beyond[to + a]) -
                                 (mesh.rest_offset[from + a] + mesh.beyond[from + a]);
                at[a] = at[a] + others * (T(cells) + beyond);
            }
        }
        f(at, density * mesh.volume[e] * T(1.0 / (D + 1)));
    }
}

/// Calls f(cell counted from the home block's first, functions there, mass) for what vertex q takes
/// from nodes, its own mass, and for what the points near it give them.
template <class X, class T, int D, class F>
MPM_INLINE void for_each_filling(const Pass<X, T, D>& pass, const ElementsView<T, D>& mesh,
                                 std::int32_t slot, const int (&home)[D], std::uint32_t q,
                                 const F& f) {
    const std::int32_t* corner = pass.grid.table.corners + std::int64_t(slot) * D;
    const auto add = [&](const Vec<T, D>& offset, T mass) {
        int cell[D];
        Vec<T, D> xi, half{};
        std::int64_t in_domain[D];
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            // A vertex is 1.5 cells from its home cell at most, a point of it further.
            const T x = offset[a];
            const int shift = x < T(-1.5) ? -2 : (x > T(1.5) ? 2 : cell_shift(x));
            cell[a] = home[a] + shift;
            xi[a] = x - T(shift);
            in_domain[a] = corner[a] + cell[a];
        }
        f(cell, stencil_of<3>(KernelChoice{}, xi, half, in_domain), mass);
    };
    Vec<T, D> own;
    MPM_UNROLL for (int a = 0; a < D; ++a) own[a] = pass.body.offset[a][q];
    add(own, -T(pass.body.particle_mass) * pass.body.state[0][q]);
    for_each_point(mesh, pass.body, q, T(pass.body.particle_mass / pass.body.particle_volume), add);
}

/// What readers see of an element, in double.
template <int D>
struct ElementSeen {
    double volume_ratio, pressure;  // J; Pa, positive in compression, of all three axes
    double stress[D][D];            // Cauchy, Pa
    double energy;                  // J (2D: J/m), of vertices its share
    double own_energy;              // the same without what is vertices'
    double plastic_strain;          // accumulated and equivalent; of laws that flow
};
/// Stress, pressure and energy of a stress at rest. Its zz in two dimensions stays as it is, over
/// J.
template <class T, int D>
MPM_HD void add_start_stress(const ElementsView<T, D>& mesh, std::int64_t e,
                             const Mat<double, D>& h, ElementSeen<D>& seen) {
    const Mat<double, D> tau = start_kirchhoff(mesh, e, h);
    double own[start_reals<D>], work = 0, sum = trace(tau);
    for (int r = 0; r < start_reals<D>; ++r)
        own[r] = double(mesh.start_stress[e * start_reals<D> + r]);
    if (D == 2) sum += own[start_reals<D> - 1];
    const Mat<double, D> s = load_symmetric<D>(own);
    for (int a = 0; a < D; ++a)
        for (int b = 0; b < D; ++b) {
            seen.stress[a][b] += tau.e[a][b] / seen.volume_ratio;
            double green = 0.5 * (h.e[a][b] + h.e[b][a]);
            for (int i = 0; i < D; ++i) green += 0.5 * h.e[i][a] * h.e[i][b];
            work += s.e[a][b] * green;
        }
    seen.pressure -= sum / (3 * seen.volume_ratio);
    seen.energy += double(mesh.volume[e]) * work;
    seen.own_energy += double(mesh.volume[e]) * work;
}
template <class Material, class T, int D, class Constants>
MPM_HD ElementSeen<D> see_element(const ElementsView<T, D>& mesh, std::int64_t e,
                                  const double* parameters, const Constants& k) {
    const Mat<double, D> inverse = element_inverse<double>(mesh, e),
                         h = element_state<double>(mesh, inverse, e);
    double state[Material::template reals<D>];
    if constexpr (flows<Material>) {
        constexpr int n = kept_reals<Material, D>;
        for (int r = 0; r < n; ++r) state[r] = double(mesh.kept[e * n + r]);
        Material::template respond<double, D, double>(state, h, k);
    } else {
        state_at<Material>(state, h, k);
    }
    const double still[D][D] = {};
    const Observation<D> o = Material::template observe<D>(state, still, parameters);
    const double change = volume_change(h), volume = double(mesh.volume[e]);
    ElementSeen<D> seen{};
    seen.volume_ratio = 1 + change;
    seen.pressure = o.pressure;
    seen.plastic_strain = o.plastic_strain;
    seen.energy = seen.own_energy = volume * o.elastic_energy;
    double more = 0;  // of the mean stress
    if (mesh.grown) {
        const double part = 1 - own_volume_share;
        more = part * (element_pressure<double>(mesh, e) - volume_pressure_of<Material>(change, k));
        seen.own_energy -= part * volume * volume_energy_of<Material>(change, k);
        double shared = 0;
        for (int c = 0; c <= D; ++c)
            shared += volume_energy_of<Material>(double(mesh.vertex_change[mesh.number(e, c)]), k);
        seen.energy = seen.own_energy + part * volume * shared / (D + 1);
    }
    seen.pressure -= more;
    for (int a = 0; a < D; ++a)
        for (int b = 0; b < D; ++b) seen.stress[a][b] = o.stress[a][b] + (a == b ? more : 0.0);
    if (mesh.start_stress) add_start_stress(mesh, e, h, seen);
    return seen;
}

template <class Material, class T, int D>
ElementSeen<D> see_element(const ElementsView<T, D>& mesh, std::int64_t e,
                           const double* parameters) {
    return see_element<Material>(mesh, e, parameters,
                                 Material::template constants<double>(parameters));
}

/// What vertex q adds to its body's kinetic, elastic and potential energy; `energy`: what elements
/// have of their own, by vertex.
template <class Material, class X, class T, int D, class Constants>
MPM_HD void add_vertex_energies(const Phase<X, T, D>& phase, const ElementsView<T, D>& mesh,
                                const Constants& k, std::int32_t slot, const int (&home)[D],
                                std::uint32_t q, const double* energy, double (&sum)[3]) {
    const auto& pass = phase.pass;
    const std::int32_t* corner = pass.grid.table.corners + std::int64_t(slot) * D;
    const double m = pass.body.particle_mass * double(pass.body.state[0][q]),
                 dx = 1 / pass.numbers->rate;
    double height = 0;
    for (int a = 0; a < D; ++a)
        height += pass.clock->gravity[a] *
                  (double(corner[a] + home[a]) + 0.5 + double(pass.body.offset[a][q])) * dx;
    sum[0] += 0.5 * m * speed_squared(phase, q);
    sum[2] -= m * height;
    const std::uint32_t number = pass.body.id[q];
    for (std::uint32_t c = mesh.start[number]; c < mesh.start[number + 1]; ++c)
        sum[1] += energy[mesh.corner[c] / (D + 1)];
    if (mesh.grown)
        sum[1] += (1 - own_volume_share) * double(mesh.vertex_volume[number]) *
                  volume_energy_of<Material>(double(mesh.vertex_change[number]), k);
}

/// The elements' part of a step, as the solver calls it: compiled once for each law that they are
/// built for, precision and dimension (src/kernels/cpu/elements.cpp).
template <class X, class T, int D>
struct ElementOps {
    using Mesh = ElementsView<T, D>;
    int kept;  // numbers that an element keeps
    void (*locate)(const Pass<X, T, D>&, const Mesh&, bool at_rest);
    void (*volumes)(const Pass<X, T, D>&, const Mesh&);  // of vertices
    void (*forces)(const Pass<X, T, D>&, const Mesh&);
    void (*spread)(const Phase<X, T, D>&, const Mesh&);
    /// The sum `channel` of the blocks that are flagged: what points of elements weigh less what
    /// their vertices do.
    void (*fill)(const Phase<X, T, D>&, const Mesh&, const std::uint8_t* near, int channel);
    /// Where *due is set, per home block: kinetic, elastic, potential energy; `energy`: room for a
    /// number an element.
    void (*energies)(const Phase<X, T, D>&, const Mesh&, const std::int32_t* due, double* energy,
                     double* partial);
    ElementSeen<D> (*see)(const Mesh&, std::int64_t element, const double* parameters);
};

/// Of a law by its name.
template <class X, class T, int D>
ElementOps<X, T, D> element_ops(const std::string& material);
/// What moves vertices as particles.
template <class X, class T, int D>
BodyOps<X, T, D> vertex_ops();

}  // namespace mpm
