// Smoothing over cells on devices: sums of cells, or nodes, as integers, so that the order in which
// particles add to them changes no bit. Bodies of loops; drivers own the loops and what is summed
// in memory of their own first.
//
//   add_to_cells, add_to_nodes   for every particle
//   CellPeers::complete          of several ranks: adds what others have in cells that both hold
//   FinishSums                   for every cell: integers to what `CellColumns` names, in place
//   ExchangeCells                for every cell, where the form asks for it
//   value_of_cells, _of_nodes    for every particle: its state; what is left of the energy is
//                                summed in a fixed order, as numbers
//   TakeSmoothing                once: what the call did, and whether it may have done it
//
// Scales are fixed by the body alone. A cell holds at most all N particles of the body, on all
// ranks; what one of them adds is at most 1 (its weight, its place in cells and their products) or
// `most_smoothed` (a volume loss or a strain; times a place, half of it). So integers on the scale
// of 2^(61 - ceil(log2 N)), and that over `most_smoothed`, sum up to 2^61 and half a quantum a
// particle more: no sum of 64 bits overflows, whatever meets where. Of 8e6 particles the quantum of
// a place is 2^-38, that of a strain 2^-33: what rounding puts into a mean is at most half of it.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "mpm/kernels/cell_phases.hpp"
#include "mpm/kernels/phase_ops.hpp"
#include "mpm/kernels/rank_told.hpp"
#include "mpm/kernels/transfers.hpp"

namespace mpm {

/// No volume loss is larger: laws keep volume ratios between 0.05 and 20. A shear strain may be; it
/// is a fault.
inline constexpr double most_smoothed = 32;
/// What is summed over the particles of a call: m q^2 before and after it, then q of each
/// component.
inline constexpr int smoothing_sums = 2 + most_components;

/// integer = number * scale
struct CellScale {
    double one = 1;    // weights, places, their products
    double field = 1;  // the field, and it times a place

    MPM_HD static CellScale of(std::uint64_t particles) {
        int bits = 0;
        while ((std::uint64_t(1) << bits) < particles) ++bits;
        CellScale s;
        s.one = std::ldexp(1.0, 61 - bits);
        s.field = s.one / most_smoothed;
        return s;
    }
};

/// One body, one call.
template <int D>
struct CellTask {
    SmoothingChoice choice;
    CellColumns<D> cells;  // or nodes
    std::int64_t count;    // of them, in all blocks
    int summed;            // numbers of each that begin at 0
    CellScale scale;
    bool between;           // spans lie between nodes
    double* energies;       // (homes, smoothing_sums)
    std::uint64_t* beyond;  // the first particle whose field is larger than sums can take

    bool nodal() const { return choice.form == CellForm::nodal; }
};

/// Of a place where integers were summed.
MPM_INLINE std::int64_t as_integer(const double& place) {
    std::int64_t x;
    memcpy(&x, &place, sizeof x);
    return x;
}
MPM_INLINE std::int64_t nearest_integer(double x) {
#if defined(__CUDA_ARCH__)
    return __double2ll_rn(x);
#else
    return std::llrint(x);
#endif
}

template <int D>
MPM_INLINE std::int64_t cell_number(const std::int32_t* neighbours, std::int32_t slot, int place) {
    const std::int64_t there = neighbours[std::int64_t(slot) * Block<D>::neighbours + (place >> 8)];
    return there * block_cells + (place & 255);
}

/// A particle's field as sums can take it.
template <class X, class T, int D>
MPM_INLINE void field_of(const Phase<X, T, D>& phase, const CellTask<D>& task, std::uint32_t q,
                         double (&value)[most_components]) {
    MPM_UNROLL for (int k = 0; k < most_components; ++k) {
        value[k] = 0;
        if (k >= task.cells.components) continue;
        const double v = double(phase.pass.body.state[k][q]);
        if (absolute(v) <= most_smoothed)
            value[k] = v;
        else
            X::keep_smallest(task.beyond, fault_number(phase.pass.body_number, q));
    }
}

/// Calls add(column, cell, integer).
template <class X, class T, int D, class Add>
MPM_INLINE void add_to_cells(const Phase<X, T, D>& phase, const CellTask<D>& task,
                             std::int32_t slot, const int (&home)[D], std::uint32_t q,
                             const Add& add) {
    const CellColumns<D>& cells = task.cells;
    const InSpan<D> at = span_of<T, D>(phase.pass.body, home, q, task.between);
    const std::int64_t c = cell_number<D>(phase.pass.grid.table.neighbours, slot, at.place);
    double value[most_components];
    field_of(phase, task, q, value);
    add(0, c, std::int64_t(1));
    const int fields = cells.first(0);
    MPM_UNROLL for (int k = 0; k < most_components; ++k) {
        if (k >= cells.components) continue;
        add(cells.first(k), c, nearest_integer(value[k] * task.scale.field));
        if (cells.tilts) {
            MPM_UNROLL for (int a = 0; a < D; ++a) add(
                cells.first(k) + 1 + a, c, nearest_integer(at.x[a] * value[k] * task.scale.field));
        }
    }
    if (fields == 1) return;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        add(1 + a, c, nearest_integer(at.x[a] * task.scale.one));
        MPM_UNROLL for (int b = a; b < D; ++b) {
            if (a == b || cells.places == CellPlaces::all)
                add(1 + D + cells.product(a, b), c,
                    nearest_integer(at.x[a] * at.x[b] * task.scale.one));
        }
    }
}

/// Calls add(column, place of the node, integer).
template <int W, class X, class T, int D, class Add>
MPM_INLINE void add_to_nodes(const Phase<X, T, D>& phase, const CellTask<D>& task,
                             const Reached<W, X, T, D>& reached, const Places<D, W>& places,
                             std::uint32_t q, const Add& add) {
    double value[most_components];
    field_of(phase, task, q, value);
    for_each_node(reached.stencil, places, [&](const int(&)[D], int place, auto w) {
        const double weight = double(w);
        add(0, place, nearest_integer(weight * task.scale.one));
        MPM_UNROLL for (int k = 0; k < most_components; ++k) {
            if (k < task.cells.components)
                add(1 + k, place, nearest_integer(weight * value[k] * task.scale.field));
        }
    });
}

/// Integers to means and what else forms ask for, in the same place.
template <int D>
struct FinishSums {
    CellColumns<D> cells;
    double mass;   // of a particle, over the scale of the first column
    double one;    // the same over that of places
    double field;  // and of the field

    static FinishSums of(const CellTask<D>& task, double particle_mass) {
        return {task.cells, task.nodal() ? particle_mass / task.scale.one : particle_mass,
                particle_mass / task.scale.one, particle_mass / task.scale.field};
    }
    MPM_INLINE void operator()(std::int64_t c) const {
        const std::int64_t n = as_integer(cells.mass(c));
        if (n == 0) return;  // which reads as a mass of 0
        const auto set = [&](int column, double unit) {
            double& x = cells.at(column, c);
            x = double(as_integer(x)) * unit;
        };
        set(0, mass);
        const int fields = cells.first(0), sums = cells.first(cells.components);
        for (int k = 1; k < fields; ++k) set(k, one);
        for (int k = fields; k < sums; ++k) set(k, field);
        FinishCell<D>{cells}(c);
    }
};

/// Gives a particle what has become of its field, and adds to the sums of the energy.
template <class T, int D>
MPM_INLINE void take_value(const BodyView<T, D>& body, std::uint32_t q, int k, double value,
                           double (&sum)[smoothing_sums]) {
    T& own = body.state[k][q];
    sum[0] += double(own) * double(own);
    sum[2 + k] += double(own);
    own = T(value);
    sum[1] += double(own) * double(own);
}

template <class X, class T, int D>
MPM_INLINE void value_of_cells(const Phase<X, T, D>& phase, const CellTask<D>& task,
                               std::int32_t slot, const int (&home)[D], std::uint32_t q,
                               double (&sum)[smoothing_sums]) {
    const InSpan<D> at = span_of<T, D>(phase.pass.body, home, q, task.between);
    const std::int64_t c = cell_number<D>(phase.pass.grid.table.neighbours, slot, at.place);
    MPM_UNROLL for (int k = 0; k < most_components; ++k) {
        if (k < task.cells.components)
            take_value(phase.pass.body, q, k, value_in_cell(task.cells, c, at.x, k), sum);
    }
}

template <int W, class X, class T, int D>
MPM_INLINE void value_of_nodes(const Phase<X, T, D>& phase, const CellTask<D>& task,
                               const Reached<W, X, T, D>& reached, std::int32_t slot,
                               std::uint32_t q, double (&sum)[smoothing_sums]) {
    const CellColumns<D>& nodes = task.cells;
    double value[most_components] = {};
    for_each_node(reached.stencil, places_in_grid<W>(reached.at.cell),
                  [&](const int(&)[D], int place, auto w) {
                      const std::int64_t c =
                          cell_number<D>(phase.pass.grid.table.neighbours, slot, place);
                      if (!(nodes.mass(c) > 0)) return;
                      MPM_UNROLL for (int k = 0; k < most_components; ++k) {
                          if (k < nodes.components) value[k] += double(w) * nodes.mean(k, c);
                      }
                  });
    MPM_UNROLL for (int k = 0; k < most_components; ++k) {
        if (k < nodes.components) take_value(phase.pass.body, q, k, value[k], sum);
    }
}

/// What a driver does between and around its two loops over particles.
template <class X, class T, int D, class Add, class Value>
void smooth_with_sums(const Phase<X, T, D>& phase, const CellTask<D>& task, CellPeers* peers,
                      const Add& add, const Value& value) {
    X& exec = *phase.pass.exec;
    exec.zero(task.cells.data, std::size_t(task.summed * task.count) * sizeof(double));
    add();
    if (peers) peers->complete(task.cells.data, std::size_t(task.summed));
    exec.for_each(task.count, FinishSums<D>::of(task, phase.pass.body.particle_mass));
    if (task.choice.exchanges())
        exec.for_each(task.count, ExchangeCells<D, NextInBlocks<D>>{
                                      task.cells, task.choice, {phase.pass.grid.table.neighbours}});
    value();
}

/// What calls did since the host last looked, the oldest overwritten by the newest.
struct SmoothingLog {
    struct Call {
        double time, before, change, index;
    };
    static constexpr int size = 64;  // steps that are handed over at once, or more
    std::int64_t calls = 0;          // in all
    std::uint64_t beyond = no_fault;
    Call call[size] = {};
};

struct AddSmoothing {
    const double* energies;  // (homes, smoothing_sums)
    MPM_INLINE void operator()(std::int64_t h, int, double* sum) const {
        for (int k = 0; k < smoothing_sums; ++k) sum[k] += energies[h * smoothing_sums + k];
    }
};

/// Numbers of blocks that another rank holds too, into one piece, block after block.
struct PackCells {
    const std::int64_t* cells;  // by column
    std::int64_t count;         // cells of a column
    int columns;
    const std::int32_t* slot;
    std::int64_t* out;
    MPM_INLINE static std::int64_t place(std::int64_t i, std::int64_t count, int columns,
                                         const std::int32_t* slot) {
        const std::int64_t row = i / block_cells;
        return row % columns * count + std::int64_t(slot[row / columns]) * block_cells +
               i % block_cells;
    }
    MPM_INLINE void operator()(std::int64_t i) const {
        out[i] = cells[place(i, count, columns, slot)];
    }
};
/// Adds what another rank has added to such blocks. Integers: the order of ranks changes no bit.
struct AddCells {
    std::int64_t* cells;
    std::int64_t count;
    int columns;
    const std::int32_t* slot;
    const std::int64_t* in;
    MPM_INLINE void operator()(std::int64_t i) const {
        if (in[i] != 0) cells[PackCells::place(i, count, columns, slot)] += in[i];
    }
};

/// Records a call, and halts the clock where it added energy or could not hold a number; of one
/// rank of several, tells what it has of the sums.
struct TakeSmoothing {
    Clock* clock;
    SmoothingLog* log;
    double mass, particles;  // of a particle, and how many there are
    double rounding;         // of the particles' numbers: a share of the energy
    double quantum;          // of a mean
    std::uint64_t body;
    TellRanks tell;

    /// A mean of rounded numbers is off by at most half a quantum. Lumped means are by more where
    /// many particles touch a node that none weighs upon: together by no more than if all were by
    /// one for each node that a particle reaches.
    static TakeSmoothing of(Clock* clock, SmoothingLog* log, double mass, std::uint64_t particles,
                            bool single, const SmoothingChoice& choice, std::uint64_t body,
                            const TellRanks& tell) {
        const CellScale scale = CellScale::of(particles);
        double rounding = single ? 1e-6 : 1e-12,
               quantum = (choice.form == CellForm::nodal ? 64 : 0.5) / scale.field;
        if (choice.tilts()) {
            // A moment of inertia is at least least_inertia, its rounding a share of that; a moment
            // of the field counts as one at that radius.
            rounding += 4 / (scale.one * least_inertia);
            quantum /= std::sqrt(least_inertia);
        }
        return {clock, log, mass, double(particles), rounding, quantum, body, tell};
    }
    MPM_HD void operator()(int, const double* sum) const {
        if (clock->halt != Halt::none) return;
        if (!tell.any()) return take(sum, log->beyond);
        RankTold mine{};
        static_assert(smoothing_sums <= RankTold::most);
        for (int k = 0; k < smoothing_sums; ++k) mine.number[k] = sum[k];
        mine.beyond = log->beyond != no_fault;
        tell(mine);
    }
    /// `beyond`: a particle whose field is larger than sums can take, or `no_fault`.
    MPM_HD void take(const double* sum, std::uint64_t beyond) const {
        SmoothingEnergy e{mass * sum[0], mass * sum[1], 0};
        for (int k = 0; k < most_components; ++k)
            e.uniform += mass * sum[2 + k] * sum[2 + k] / particles;
        log->call[log->calls % SmoothingLog::size] = {clock->time, e.before, e.change(), e.index()};
        ++log->calls;
        // Of q + d: sum m (q + d)^2, with sums m q d by Cauchy's inequality.
        const double off = mass * particles * quantum * quantum;
        const double allowed = rounding * e.before + 2 * std::sqrt(e.before * off) + off;
        if (beyond != no_fault)
            stop(FaultKind::smoothing_range, beyond, most_smoothed);
        else if (!(e.change() <= allowed))
            stop(FaultKind::smoothing, fault_number(body, 0), e.change() / e.before);
    }
    MPM_HD void stop(FaultKind kind, std::uint64_t who, double value) const {
        clock->halt = Halt::fault;
        clock->fault = kind;
        clock->fault_particle = who;
        clock->fault_value = value;
    }
};
/// Devices of several: when all have told.
struct TakeSmoothingOfAll {
    TakeSmoothing take;
    const RankTold* told;
    int ranks;
    std::uint64_t elsewhere;  // a particle that another rank has
    MPM_HD void operator()() const {
        if (take.clock->halt != Halt::none) return;
        double sum[smoothing_sums] = {};
        std::uint64_t beyond = take.log->beyond;
        for (int r = 0; r < ranks; ++r) {
            for (int k = 0; k < smoothing_sums; ++k) sum[k] += told[r].number[k];
            if (told[r].beyond && beyond == no_fault) beyond = elsewhere;
        }
        take.take(sum, beyond);
    }
};

}  // namespace mpm
