// What acts on single vertices of a body of elements: tractions, and pins that hold or drive them
// (design/elements.md). One vertex each, on every backend.
#pragma once

#include "mpm/core/exact.hpp"
#include "mpm/data/time_table.hpp"
#include "mpm/kernels/elements.hpp"
#include "mpm/kernels/sampling.hpp"

namespace mpm {

/// Adds what a traction pushes each of its vertices by, times a cell: a dead load, by the area at
/// rest. One after the other in the order of the scene, so that equal bits follow.
template <class T, int D>
struct AddTraction {
    TimeTableView value;  // Pa
    const std::uint32_t* vertex;
    const double* area;
    double cell_size;
    const Clock* clock;
    bool ahead;  // at the end of the step
    T* load;
    MPM_INLINE void operator()(std::int64_t k) const {
        double now[D];
        value.at(clock->time + (ahead ? clock->dt : 0.0), now);
        T* to = load + std::int64_t(vertex[k]) * D;
        MPM_UNROLL for (int a = 0; a < D; ++a) to[a] += T(area[k] * now[a] * cell_size);
    }
};

/// The pins of a body. Pinned vertices count in the order of their pins.
struct PinsView {
    std::int64_t count;          // of pinned vertices
    const std::int32_t* pinned;  // by number of vertex: which of them it is, or -1
    const std::uint32_t* vertex;
    const std::int32_t* pin;    // of which pin each is
    const double* mass;         // kg
    const TimeTableView* goal;  // of each pin, its displacement in m; without rows: none
    double* push;               // (count, D): momentum that its pin gives it, kg m/s
    const std::uint8_t* mine;   // of several ranks: whether it is this one's; null: all are
};

/// Before the first step: pinned vertices begin at rest, whatever velocity their body has.
template <class G, class T, int D>
struct RestPinned {
    BodyView<T, D> body;
    const std::uint8_t* held;
    G* scratch;
    MPM_INLINE void operator()(std::int64_t q) const {
        const std::uint8_t axes = held[body.id[q]];
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            if (axes >> a & 1) scratch[std::int64_t(a) * body.count + q] = G(0);
        }
    }
};

/// What pinned vertices have gathered makes way for the velocity that brings them where their pins
/// are at the end of the step. That is what they deposit, and what they store where a transfer
/// makes them: nothing is left that the grid cannot see. A pin gives the momentum by which its
/// vertices differ from what they would have kept, and bears what their elements pull.
template <class X, class T, int D>
struct PinVertices {
    Phase<X, T, D> phase;
    ElementsView<T, D> mesh;
    PinsView pins;
    double cell_size;
    MPM_INLINE void operator()(std::int64_t q) const {
        using G = typename Pass<X, T, D>::Grid;
        const auto& pass = phase.pass;
        const Clock& clock = *pass.clock;
        if (clock.halt != Halt::none) return;
        const std::uint32_t id = pass.body.id[q];
        const std::int32_t k = pins.pinned[id];
        if (k < 0) return;
        double goal[D] = {};
        const TimeTableView& table = pins.goal[pins.pin[k]];
        if (table.count > 0) table.at(clock.time + clock.dt, goal);
        const PhaseNumbers& n = phase.n;
        const Scratch<D> column{n.channels};
        const auto at = [&](int c) -> G& {
            return pass.scratch[std::size_t(c) * pass.body.count + std::size_t(q)];
        };
        for (int a = 0; a < D; ++a) {
            double& push = pins.push[std::int64_t(k) * D + a];
            push = 0;
            if (!(mesh.held[id] >> a & 1)) continue;
            const std::int64_t entry = std::int64_t(id) * D + a;
            const double gone = double(mesh.cells[entry]) + double(mesh.beyond[entry]);
            const T must = T((goal[a] / cell_size - gone) / pass.numbers->move);
            T would = T(at(column.value(a)));
            if (n.velocity >= 0) {  // bodies of elements have no sweeps
                T& own = pass.body.state[n.velocity + a][q];
                G& before = at(column.before(a));
                would += T(n.scheme.keep) * (own - T(before));
                own = must;
                before = G(must);
            }
            at(column.value(a)) = G(must);
            push = pins.mass[k] * (double(must) - double(would));
        }
    }
};

/// What elements and tractions pull at pinned vertices in the coming step, which the grid is not
/// given.
template <class X, class T, int D>
struct BearPull {
    Pass<X, T, D> pass;
    ElementsView<T, D> mesh;
    PinsView pins;
    MPM_INLINE void operator()(std::int64_t k) const {
        if (pass.clock->halt != Halt::none) return;
        const double density = pass.body.particle_mass / pass.body.particle_volume,
                     time = 0.25 * pass.numbers->impulse * density;  // dt_next / dx
        const std::uint32_t number = pins.vertex[k];
        const Vec<T, D> pull = force_on_vertex(mesh, number);
        MPM_UNROLL for (int a = 0; a < D; ++a) pins.push[k * D + a] =
            mesh.held[number] >> a & 1 ? -time * double(pull[a]) : 0.0;
    }
};

/// Adds what one pin has pushed, along an axis: exactly, so that ranks may share its vertices.
template <int D>
struct TellPin {
    const Clock* clock;
    PinsView pins;
    std::int64_t first, count;  // its vertices
    double scale;               // of exact sums
    Int128* told;               // (D,)
    MPM_INLINE void operator()(std::int64_t a) const {
        if (clock->halt != Halt::none) return;
        Int128 sum = told[a];
        for (std::int64_t k = first; k < first + count; ++k)
            if (!pins.mine || pins.mine[k]) sum += exact(pins.push[k * D + a], scale);
        told[a] = sum;
    }
};

/// The mean force of a body on its pin since the sample before, as a `MeanRow`.
template <int D>
struct SamplePin {
    const Clock* clock;
    SensorRecord* record;
    double scale;
    Int128* told;
    MPM_INLINE void operator()() const {
        SensorRecord& r = *record;
        if (!r.due) return;
        const double elapsed = clock->time - r.last_time;
        const bool known = r.last_time >= 0 && elapsed > 0;
        double* row = open_row(r, clock->time);
        for (int a = 0; a < D; ++a) {
            to_pieces(-told[a], row + a * exact_pieces);
            row[MeanRow<D>::scales + a] = scale;
            told[a] = 0;
        }
        row[MeanRow<D>::elapsed] = known ? elapsed : nan("");
        r.last_time = clock->time;
    }
};

}  // namespace mpm
