// CPU driver of what works over cells within the phased step: loops and partial sums. Sums of cells
// and nodes go by colours of blocks that share none, and a cell gets one number of each block of
// particles: neither threads nor ranks change a bit.
#include "mpm/kernels/cell_phases.hpp"

#include "mpm/kernels/cpu/spreading.hpp"
#include "mpm/kernels/phase_ops.hpp"
#include "mpm/kernels/transfers.hpp"

namespace mpm {

namespace cpu {

namespace {

/// What is smoothed, of each particle: a call apart, so that the loops below are compiled once for
/// all fields.
struct Field {
    const void* of;
    /// The components of particle q.
    void (*read)(const void* of, std::uint32_t q, double* value);
    /// Their means at particle q of home block h.
    void (*write)(const void* of, std::int32_t h, std::uint32_t q, const double* mean);
};

/// Calls f with the field that `read(q, value)` and `write(h, q, mean)` make.
template <class Read, class Write, class F>
void with_field(const Read& read, const Write& write, const F& f) {
    struct Both {
        const Read& read;
        const Write& write;
    };
    const Both both{read, write};
    f(Field{&both,
            [](const void* of, std::uint32_t q, double* value) {
                static_cast<const Both*>(of)->read(q, value);
            },
            [](const void* of, std::int32_t h, std::uint32_t q, const double* mean) {
                static_cast<const Both*>(of)->write(h, q, mean);
            }});
}

/// Sums of one block's particles in cells or nodes up to `margin` beyond it; all are 0 between
/// blocks.
template <int D, int margin>
struct SumArena : AroundBlock<D, margin> {
    int summed;  // numbers a cell
    std::vector<double> sums;

    explicit SumArena(int n)
        : summed(n), sums(std::size_t(SumArena::nodes) * std::size_t(n), 0.0) {}
    static int place(const int (&cell)[D]) {
        int at = 0;
        for (int a = 0; a < D; ++a) at += (cell[a] + margin) * SumArena::stride(a);
        return at;
    }
    /// Adds them to the first of the `width` numbers that cells have. Where the first `telling`
    /// sums are 0 nothing has been added.
    void flush(const std::int32_t* destinations, double* cells, int width, int telling) {
        for_each_run<D, margin>(destinations, [&](int at, std::int32_t slot, int cell, int length) {
            double* from = sums.data() + std::size_t(at) * std::size_t(summed);
            double* to = cells + (std::int64_t(slot) * block_cells + cell) * width;
            for (int k = 0; k < length; ++k, from += summed, to += width) {
                if (std::all_of(from, from + telling, [](double x) { return x == 0; })) continue;
                for (int c = 0; c < summed; ++c) to[c] += from[c];
                std::fill_n(from, summed, 0.0);
            }
        });
    }
};

/// Calls add(arena, slot, home cell, particle) for all particles, and makes sums that are complete
/// of what these add: `summed` of the `width` numbers of each cell, of which the first `telling`
/// say whether there are any.
template <int margin, class T, int D, class Add>
void sum_up(const Phase<Cpu, T, D>& phase, const CellRoom& room, int summed, int width, int telling,
            const Add& add) {
    const auto& pass = phase.pass;
    using A = SumArena<D, margin>;
    const auto block = [&](A& arena, std::int32_t slot) {
        for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
            add(arena, slot, home, q);
        });
        arena.flush(pass.destinations + std::int64_t(slot) * Block<D>::neighbours, room.cells,
                    width, telling);
    };
    for_each_colour<A>(phase, block, summed);
    if (room.peers) room.peers->complete(room.cells, std::size_t(width));
}

/// Mass, then one sum a component, of every node: lumped means by the grid's functions, or by those
/// of the deposit where they are modified.
template <class S, class T, int D>
void smooth_by_nodes(const Phase<Cpu, T, D>& phase, const CellRoom& room, int components,
                     bool modified, const Field& field) {
    constexpr int W = S::width, margin = W / 2 + 1;
    using A = SumArena<D, margin>;
    const auto& pass = phase.pass;
    const std::int32_t* neighbours = pass.grid.table.neighbours;
    const double m = pass.body.particle_mass;
    const int width = 1 + components;
    const auto of = [&](std::int32_t slot, int place) {
        const std::int64_t there =
            neighbours[std::int64_t(slot) * Block<D>::neighbours + (place >> 8)];
        return room.cells + (there * block_cells + (place & 255)) * width;
    };
    const auto add = [&](A& arena, std::int32_t slot, const int(&home)[D], std::uint32_t q) {
        Reached<W, Cpu, T, D, S> reached(phase, slot, home, q);
        if constexpr (std::is_same_v<S, Stencil<T, D, 3>>) {
            if (modified) modify_for_deposit(reached.stencil, reached.at.xi);
        }
        double value[most_components];
        field.read(field.of, q, value);
        for_each_node(reached.stencil, places_in_arena<A, W, D, margin>(reached.at.cell),
                      [&](const auto&, int place, T w) {
                          double* to = arena.sums.data() + place * width;
                          to[0] += m * double(w);
                          for (int k = 0; k < components; ++k)
                              to[1 + k] += m * double(w) * value[k];
                      });
    };
    // Modified functions may be negative, and so may sums of mass.
    sum_up<margin>(phase, room, width, width, width, add);
#pragma omp parallel for schedule(dynamic, 4) \
    num_threads(phase_threads(*pass.exec, pass.body.count))
    for (std::int32_t h = 0; h < pass.body.homes; ++h) {
        const std::int32_t slot = pass.body.home[h];
        for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
            const Reached<W, Cpu, T, D, S> reached(phase, slot, home, q);
            double value[most_components] = {};
            for_each_node(reached.stencil, places_in_grid<W>(reached.at.cell),
                          [&](const auto&, int place, T w) {
                              const double* from = of(slot, place);
                              if (!(from[0] > 0)) return;
                              for (int k = 0; k < components; ++k)
                                  value[k] += double(w) * from[1 + k] / from[0];
                          });
            field.write(field.of, h, q, value);
        });
    }
}

template <class T, int D>
void smooth_by_cells(const Phase<Cpu, T, D>& phase, const CellRoom& room,
                     const SmoothingChoice& choice, int components, const Field& field) {
    constexpr int margin = 2;  // a particle beside its home, of spans that begin half a cell below
    using A = SumArena<D, margin>;
    const auto& pass = phase.pass;
    const auto& table = pass.grid.table;
    const auto cells = CellColumns<D>::by_cell(room.cells, choice, components);
    const int summed = cells.sums(choice, components), width = cells.columns(choice, components);
    const bool between = spans_lie_between_nodes(phase.n.kernel.kernel);
    const auto number = [&](std::int32_t slot, int place) {
        const std::int64_t there =
            table.neighbours[std::int64_t(slot) * Block<D>::neighbours + (place >> 8)];
        return there * block_cells + (place & 255);
    };
    const auto add = [&](A& arena, std::int32_t, const int(&home)[D], std::uint32_t q) {
        const InSpan<D> at = span_of<T, D>(pass.body, home, q, between);
        double value[most_components];
        field.read(field.of, q, value);
        auto sums = cells;
        sums.data = arena.sums.data();
        sums.to_cell = summed;
        add_to_cell(sums, A::place(at.cell), pass.body.particle_mass, at.x,
                    [&](int k) { return value[k]; });
    };
    sum_up<margin>(phase, room, summed, width, 1, add);
    const std::int64_t all = std::int64_t(table.slots) * block_cells;
    const int threads = phase_threads(*pass.exec, pass.body.count);
    const FinishCell<D> finish{cells};
    const ExchangeCells<D, NextInBlocks<D>> exchange{cells, choice, {table.neighbours}};
#pragma omp parallel for schedule(static) num_threads(threads)
    for (std::int64_t c = 0; c < all; ++c) finish(c);
    if (choice.exchanges()) {
#pragma omp parallel for schedule(static) num_threads(threads)
        for (std::int64_t c = 0; c < all; ++c) exchange(c);
    }
#pragma omp parallel for schedule(dynamic, 4) num_threads(threads)
    for (std::int32_t h = 0; h < pass.body.homes; ++h) {
        const std::int32_t slot = pass.body.home[h];
        for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
            const InSpan<D> at = span_of<T, D>(pass.body, home, q, between);
            const std::int64_t c = number(slot, at.place);
            double value[most_components];
            for (int k = 0; k < components; ++k) value[k] = value_in_cell(cells, c, at.x, k);
            field.write(field.of, h, q, value);
        });
    }
}

/// `as_deposited`: nodes' means by the functions of the deposit.
template <class T, int D>
void smooth_field(const Phase<Cpu, T, D>& phase, const CellRoom& room,
                  const SmoothingChoice& choice, int components, const Field& field,
                  bool as_deposited = false) {
    const bool nodal = choice.form == CellForm::nodal;
    const int width = CellColumns<D>::columns(choice, components);
    const std::size_t piece = std::size_t(block_cells) * std::size_t(width);
    const bool modified = as_deposited && phase.n.kernel.modified;
#pragma omp parallel for schedule(static) \
    num_threads(phase_threads(*phase.pass.exec, phase.pass.body.count))
    for (std::int32_t slot = 0; slot < phase.pass.grid.table.slots; ++slot)
        std::fill_n(room.cells + std::size_t(slot) * piece, piece, 0.0);
    std::fill(room.cells + std::size_t(room.first_staged) * piece,
              room.cells + std::size_t(room.last_staged) * piece, 0.0);
    if (!nodal)
        smooth_by_cells(phase, room, choice, components, field);
    else if (kernel_width(phase.n.kernel.kernel) == 3)
        smooth_by_nodes<Stencil<T, D, 3>>(phase, room, components, modified, field);
    else if (phase.n.kernel.kernel == Kernel::cpdi)
        smooth_by_nodes<CornerStencil<T, D>>(phase, room, components, modified, field);
    else
        smooth_by_nodes<Stencil<T, D, 5>>(phase, room, components, modified, field);
}

/// Numbers of scratch, a tensor a particle.
template <class T, int D, class Column>
void assume(const Phase<Cpu, T, D>& phase, const CellNumbers& n, const CellRoom& room,
            const Column& column) {
    const AssumedTensor<D> tensor{n.part};
    if (tensor.part == TensorPart::none) return;
    const std::size_t count = phase.pass.body.count;
    const auto read = [&](std::uint32_t q) {
        Mat<T, D> m;
        for (int c = 0; c < D; ++c)
            for (int a = 0; a < D; ++a)
                m.e[c][a] = phase.pass.scratch[std::size_t(column(a, c)) * count + q];
        return m;
    };
    const int components = tensor.components();
    with_field(
        [&](std::uint32_t q, double* value) {
            const Mat<T, D> m = read(q);
            for (int k = 0; k < components; ++k) value[k] = tensor.component(m, k);
        },
        [&](std::int32_t, std::uint32_t q, const double* means) {
            Mat<T, D> m = read(q);
            tensor.replace(m, means);
            for (int c = 0; c < D; ++c)
                for (int a = 0; a < D; ++a)
                    phase.pass.scratch[std::size_t(column(a, c)) * count + q] = m.e[c][a];
        },
        [&](const Field& field) { smooth_field(phase, room, n.assumed, components, field); });
}

template <class T, int D>
void collected(const Phase<Cpu, T, D>& phase, const CellNumbers& n, const CellRoom& room) {
    const auto& pass = phase.pass;
    const Scratch<D> column{phase.n.channels};
    const std::size_t count = pass.body.count;
    if (n.deformed) {
        const T move = T(pass.numbers->move);
#pragma omp parallel for schedule(static) num_threads(phase_threads(*pass.exec, pass.body.count))
        for (std::uint32_t q = 0; q < pass.body.count; ++q) {
            const auto at = [&](int a, int c) -> T& {
                return pass.scratch[std::size_t(column.slope(a, c)) * count + q];
            };
            Mat<T, D> strain;
            for (int c = 0; c < D; ++c)
                for (int a = 0; a < D; ++a) strain.e[c][a] = move * at(a, c);
            const Mat<T, D> moved = by_moved_nodes(strain);
            for (int c = 0; c < D; ++c)
                for (int a = 0; a < D; ++a) at(a, c) = moved.e[c][a] / move;
        }
    }
    if (n.assumes_rates()) assume(phase, n, room, [&](int a, int c) { return column.slope(a, c); });
}

/// A force by mass acts by the deposit, on the velocity that a particle brings. One that stores its
/// velocity keeps of that gain what the grid gives back, v <- v + dt sum N_i b_i (Yang 2016, 2.7):
/// with dt b(x_p) instead, b - sum N_i b_i would add up without end in a body at rest.
template <class T, int D>
void push(const Phase<Cpu, T, D>& phase, const PlacedForce& force, const CellRoom& room) {
    const auto& pass = phase.pass;
    const Scratch<D> column{phase.n.channels};
    const std::size_t count = pass.body.count;
    const double dx = 1 / pass.numbers->rate, dt = pass.numbers->move * dx;
    const bool stores = phase.n.velocity >= 0;
    // Nobody needs the velocity before forces any more.
    const auto own = [&](int c, std::uint32_t q) -> T& {
        return pass.scratch[std::size_t(column.before(c)) * count + q];
    };
#pragma omp parallel for schedule(dynamic, 4) num_threads(phase_threads(*pass.exec, count))
    for (std::int32_t h = 0; h < pass.body.homes; ++h) {
        const std::int32_t slot = pass.body.home[h];
        const double corner = pass.grid.table.corners[std::int64_t(slot) * D + force.axis];
        for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
            const double x =
                (corner + home[force.axis] + 0.5 + double(pass.body.offset[force.axis][q])) * dx;
            for (int c = 0; c < D; ++c) {
                const T gain = T(dt * force.at(x, c, D));
                pass.scratch[std::size_t(column.value(c)) * count + q] += gain;
                if (stores) own(c, q) = gain;
            }
        });
    }
    if (!stores) return;
    SmoothingChoice nodal;
    nodal.form = CellForm::nodal;
    with_field(
        [&](std::uint32_t q, double* value) {
            for (int c = 0; c < D; ++c) value[c] = double(own(c, q));
        },
        [&](std::int32_t, std::uint32_t q, const double* back) {
            for (int c = 0; c < D; ++c) pass.body.state[phase.n.velocity + c][q] += T(back[c]);
        },
        [&](const Field& field) { smooth_field(phase, room, nodal, D, field, true); });
}

template <class T, int D>
void responded(const Phase<Cpu, T, D>& phase, const CellNumbers& n, const CellRoom& room) {
    const auto& pass = phase.pass;
    const Scratch<D> column{phase.n.channels};
    const std::size_t count = pass.body.count;
    if (n.normal > 0) {
        // dt / (rho0 dx), as of the stress that stands there.
        const double force = 0.25 * pass.numbers->impulse, rate = pass.numbers->rate;
#pragma omp parallel for schedule(static) num_threads(phase_threads(*pass.exec, pass.body.count))
        for (std::uint32_t q = 0; q < pass.body.count; ++q) {
            const auto at = [&](int k) -> T& { return pass.scratch[std::size_t(k) * count + q]; };
            for (int c = 0; c < D; ++c) {
                for (int a = 0; a < D; ++a) {
                    const double twice =
                        rate * double(at(column.slope(a, c)) + at(column.slope(c, a)));
                    T& stress = at(column.stress(a, c));
                    stress += T(force * (a == c ? n.normal : n.shear) * twice);
                }
            }
        }
    }
    assume(phase, n, room, [&](int a, int c) { return column.stress(a, c); });
    if (n.force.axis >= 0) push(phase, n.force, room);
}

template <class T, int D>
SmoothingEnergy smooth(const Phase<Cpu, T, D>& phase, const CellNumbers& n, const CellRoom& room) {
    const auto& pass = phase.pass;
    const int components = n.components;
    std::vector<SmoothingTotals> partial(std::size_t(pass.body.homes));
    with_field(
        [&](std::uint32_t q, double* value) {
            for (int k = 0; k < components; ++k) value[k] = double(pass.body.state[k][q]);
        },
        [&](std::int32_t h, std::uint32_t q, const double* value) {
            SmoothingTotals& sum = partial[std::size_t(h)];
            for (int k = 0; k < components; ++k) {
                T& own = pass.body.state[k][q];
                sum.before += double(own) * double(own);
                sum.field[k] += double(own);
                own = T(value[k]);
                sum.after += double(own) * double(own);
            }
        },
        [&](const Field& field) { smooth_field(phase, room, n.smoothing, components, field); });
    SmoothingTotals total;
    for (const SmoothingTotals& home : partial) total.add(home);
    total.particles = pass.body.count;
    if (room.peers) room.peers->add_up(total);
    return SmoothingEnergy::of(total, pass.body.particle_mass, components);
}

}  // namespace

}  // namespace cpu

template <class T, int D>
CellOps<Cpu, T, D> cpu_cell_ops() {
    return {&cpu::collected<T, D>, &cpu::smooth<T, D>, &cpu::responded<T, D>};
}
template <>
CellOps<Cpu, float, 2> cell_ops<Cpu, float, 2>() {
    return cpu_cell_ops<float, 2>();
}
template <>
CellOps<Cpu, float, 3> cell_ops<Cpu, float, 3>() {
    return cpu_cell_ops<float, 3>();
}
template <>
CellOps<Cpu, double, 2> cell_ops<Cpu, double, 2>() {
    return cpu_cell_ops<double, 2>();
}
template <>
CellOps<Cpu, double, 3> cell_ops<Cpu, double, 3>() {
    return cpu_cell_ops<double, 3>();
}

}  // namespace mpm
