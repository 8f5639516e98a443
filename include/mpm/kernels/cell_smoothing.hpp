// Smoothing over cells (physics/smoothing.hpp): what a particle adds to its cell, what a cell makes
// of its sums, what it exchanges with its neighbours. Memory is given; whoever drives it says which
// number a cell has and which its neighbours have.
//
//   add_to_cell      for every particle, into sums that begin at 0
//   FinishCell       for every cell: sums to means, centres, inertias, slopes
//   ExchangeCells    for every cell: the smoothed values, from its neighbours' means
//   value_in_cell    for every particle
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "mpm/physics/smoothing.hpp"

namespace mpm {

/// A force by mass that changes along an axis, linear between places; what it is at its ends holds
/// beyond them.
struct PlacedForce {
    int axis = -1;              // -1: there is none
    std::vector<double> place;  // (n,) m from the domain's lower corner, increasing
    std::vector<double> value;  // (n, dimension) m/s2

    double at(double x, int a, int dimension) const {
        const auto row = [&](std::size_t k) {
            return value[k * std::size_t(dimension) + std::size_t(a)];
        };
        const std::size_t k =
            std::size_t(std::upper_bound(place.begin(), place.end(), x) - place.begin());
        if (k == 0) return row(0);
        if (k == place.size()) return row(k - 1);
        const double share = (x - place[k - 1]) / (place[k] - place[k - 1]);
        return row(k - 1) + share * (row(k) - row(k - 1));
    }
};

/// What is done between the parts of a body's phased step (cell_phases.hpp).
struct CellNumbers {
    SmoothingChoice smoothing;           // of the state
    int components = 0;                  // of it, the first columns
    SmoothingChoice assumed;             // rate and stress as means: `constant` or `nodal`
    TensorPart part = TensorPart::none;  // of them
    double normal = 0, shear = 0;        // numerical damping, Pa s: l xi sqrt(M rho) and of G
    bool deformed = false;               // gradients by the moved nodes
    bool rate = true;                    // assumed too, not the stress alone
    PlacedForce force;                   // beside gravity

    bool smooths() const { return smoothing.form != CellForm::none; }
    /// Whether cells or nodes sum up anything of a body.
    bool sums_over_cells(bool stores_velocity) const {
        return smooths() || part != TensorPart::none || (force.axis >= 0 && stores_velocity);
    }
    bool assumes_rates() const { return rate && part != TensorPart::none; }
    bool changes_rates() const { return deformed || assumes_rates(); }
    bool changes_deposits() const {
        return normal > 0 || part != TensorPart::none || force.axis >= 0;
    }
};

/// What is kept of a cell: sums first, of which `FinishCell` makes what the names say, then what
/// cells make of each other. Numbers that a form has no use for are not kept.
template <int D>
struct CellColumns {
    double* data;
    int components;
    CellPlaces places;
    bool tilts, exchanges;
    std::int64_t to_column, to_cell;  // distances in `data`

    static constexpr int products(CellPlaces p) {
        return p == CellPlaces::none ? 0 : p == CellPlaces::along_axes ? D : D * (D + 1) / 2;
    }
    static int sums(const SmoothingChoice& k, int components) {
        const CellPlaces p = k.places();
        return 1 + (p == CellPlaces::none ? 0 : D) + products(p) +
               components * (1 + (k.tilts() ? D : 0));
    }
    static int columns(const SmoothingChoice& k, int components) {
        return sums(k, components) + components * ((k.exchanges() ? 1 : 0) + (k.tilts() ? D : 0));
    }
    /// All of a cell in one piece.
    static CellColumns by_cell(double* data, const SmoothingChoice& k, int components) {
        return {data, components, k.places(), k.tilts(), k.exchanges(), 1, columns(k, components)};
    }
    /// A number of all cells in one piece.
    static CellColumns by_column(double* data, const SmoothingChoice& k, int components,
                                 std::int64_t cells) {
        return {data, components, k.places(), k.tilts(), k.exchanges(), cells, 1};
    }

    MPM_INLINE double& at(int column, std::int64_t c) const {
        return data[column * to_column + c * to_cell];
    }
    MPM_INLINE int product(int a, int b) const {
        if (places == CellPlaces::along_axes) return a;
        if (a > b) {
            const int c = a;
            a = b;
            b = c;
        }
        return a * D - a * (a - 1) / 2 + (b - a);
    }
    MPM_INLINE int first(int q) const {
        return 1 + (places == CellPlaces::none ? 0 : D) + products(places) +
               q * (1 + (tilts ? D : 0));
    }
    MPM_INLINE int first_made(int q) const {
        return first(components) + q * ((exchanges ? 1 : 0) + (tilts ? D : 0));
    }

    MPM_INLINE double& mass(std::int64_t c) const { return at(0, c); }
    MPM_INLINE double& centre(int a, std::int64_t c) const { return at(1 + a, c); }
    /// Second moments along one axis alone where `places` says so.
    MPM_INLINE double& inertia(int a, int b, std::int64_t c) const {
        return at(1 + D + product(a, b), c);
    }
    MPM_INLINE double& mean(int q, std::int64_t c) const { return at(first(q), c); }
    MPM_INLINE double& smoothed(int q, std::int64_t c) const {
        return at(exchanges ? first_made(q) : first(q), c);
    }
    /// First moments of the field, and the slopes of what is smoothed.
    MPM_INLINE double& moment(int q, int a, std::int64_t c) const {
        return at(first(q) + 1 + a, c);
    }
    MPM_INLINE double& tilt(int q, int a, std::int64_t c) const {
        return at(first_made(q) + (exchanges ? 1 : 0) + a, c);
    }
};

/// What a particle of unit mass at `x` from the centre of its cell, in cells, adds to it: calls
/// add(column, number) for all that is summed but the mass.
template <int D, class Q, class Add>
MPM_INLINE void for_each_sum(const CellColumns<D>& cells, const Vec<double, D>& x, const Q& value,
                             const Add& add) {
    if (cells.places != CellPlaces::none) {
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            add(1 + a, x[a]);
            MPM_UNROLL for (int b = a; b < D; ++b) {
                if (a == b || cells.places == CellPlaces::all)
                    add(1 + D + cells.product(a, b), x[a] * x[b]);
            }
        }
    }
    for (int q = 0; q < cells.components; ++q) {
        const double v = value(q);
        add(cells.first(q), v);
        if (cells.tilts) {
            MPM_UNROLL for (int a = 0; a < D; ++a) add(cells.first(q) + 1 + a, x[a] * v);
        }
    }
}
template <int D, class Q>
MPM_INLINE void add_to_cell(const CellColumns<D>& to, std::int64_t c, double m,
                            const Vec<double, D>& x, const Q& value) {
    to.mass(c) += m;
    for_each_sum(to, x, value, [&](int column, double v) { to.at(column, c) += m * v; });
}

/// Sums to what `CellColumns` names.
template <int D>
struct FinishCell {
    CellColumns<D> cells;
    MPM_INLINE void operator()(std::int64_t c) const {
        const double m = cells.mass(c);
        if (!(m > 0)) return;
        Mat<double, D> inertia{};
        if (cells.places != CellPlaces::none) {
            MPM_UNROLL for (int a = 0; a < D; ++a) cells.centre(a, c) /= m;
            MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = a; b < D; ++b) {
                if (a != b && cells.places == CellPlaces::along_axes) continue;
                const double rest =
                    cells.inertia(a, b, c) - m * cells.centre(a, c) * cells.centre(b, c);
                cells.inertia(a, b, c) = a == b ? larger(rest, 0.0) : rest;
                inertia.e[a][b] = inertia.e[b][a] = cells.inertia(a, b, c);
            }
        }
        for (int q = 0; q < cells.components; ++q) {
            const double sum = cells.mean(q, c);
            cells.mean(q, c) = sum / m;
            if (!cells.tilts) continue;
            Vec<double, D> moment;
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                moment[a] = cells.moment(q, a, c) - sum * cells.centre(a, c);
                cells.moment(q, a, c) = moment[a];
            }
            const Vec<double, D> slope = least_squares_slopes<double, D>(inertia, moment, m);
            MPM_UNROLL for (int a = 0; a < D; ++a) cells.tilt(q, a, c) = slope[a];
        }
    }
};

/// What cells make of their own means and their neighbours': `next(c, axis, side)` is the number of
/// the cell beside c, or -1. Every face is worked out by both of its cells, alike.
template <int D, class Next>
struct ExchangeCells {
    CellColumns<D> cells;
    SmoothingChoice choice;
    Next next;

    MPM_INLINE CellAlong<double> along(std::int64_t c, int axis, int q, int shift) const {
        CellAlong<double> out;
        if (c < 0 || !(cells.mass(c) > 0)) return out;
        out.mass = cells.mass(c);
        out.mean = cells.mean(q, c);
        if (cells.places == CellPlaces::none) return out;
        out.centre = cells.centre(axis, c) + shift;
        out.inertia = cells.inertia(axis, axis, c);
        if (cells.tilts && out.inertia > least_inertia * out.mass)
            out.slope = cells.moment(q, axis, c) / out.inertia;
        return out;
    }
    MPM_INLINE double way(const CellAlong<double>& c, double face) const {
        if (choice.by_inertia) return std::sqrt(c.inertia / c.mass);
        return absolute(face - c.centre);
    }
    MPM_INLINE void operator()(std::int64_t c) const {
        const double m = cells.mass(c);
        if (!(m > 0)) return;
        constexpr double share = 1.0 / (2 * D);
        for (int q = 0; q < cells.components; ++q) {
            double value = cells.mean(q, c);
            if (choice.exchanges()) {
                for (int axis = 0; axis < D; ++axis) {
                    std::int64_t row[5];  // the cell in the middle
                    row[2] = c;
                    row[1] = next(c, axis, 0);
                    row[3] = next(c, axis, 1);
                    row[0] = row[1] < 0 || !choice.looks_beyond() ? -1 : next(row[1], axis, 0);
                    row[4] = row[3] < 0 || !choice.looks_beyond() ? -1 : next(row[3], axis, 1);
                    CellAlong<double> cell[5];
                    for (int k = 0; k < 5; ++k) cell[k] = along(row[k], axis, q, k - 2);
                    // A cell beyond an empty one is no neighbour of the pair.
                    if (!cell[1].there()) cell[0] = CellAlong<double>{};
                    if (!cell[3].there()) cell[4] = CellAlong<double>{};
                    for (int side = 0; side < 2; ++side) {
                        const CellAlong<double>&minus = cell[1 + side], &plus = cell[2 + side];
                        if (!minus.there() || !plus.there()) continue;
                        const double gains = side == 0 ? 1 : -1;
                        if (choice.form == CellForm::flux) {
                            const double flux =
                                constant_flux(choice, cell[side], minus, plus, cell[3 + side]);
                            value += gains * share * flux / m;
                        } else {
                            const double face = side == 0 ? -0.5 : 0.5;
                            const auto f = linear_flux(minus, plus, way(minus, face),
                                                       way(plus, face), least_inertia);
                            value += gains * share * f.flux / m;
                            cells.tilt(q, axis, c) +=
                                share * (side == 0 ? f.slope_plus : f.slope_minus);
                        }
                    }
                }
            }
            cells.smoothed(q, c) = value;
        }
    }
};

/// The smoothed field at `x` from the centre of cell c.
template <int D>
MPM_INLINE double value_in_cell(const CellColumns<D>& cells, std::int64_t c,
                                const Vec<double, D>& x, int q) {
    double v = cells.smoothed(q, c);
    if (cells.tilts) {
        MPM_UNROLL for (int a = 0; a < D; ++a) v +=
            cells.tilt(q, a, c) * (x[a] - cells.centre(a, c));
    }
    return v;
}

/// Components of a field: a tensor in three dimensions.
inline constexpr int most_components = 6;

/// What is summed over the particles of a call: q^2 before and after it, q of each component, and
/// how many they are.
struct SmoothingTotals {
    double before = 0, after = 0, field[most_components] = {}, particles = 0;

    void add(const SmoothingTotals& other) {
        before += other.before;
        after += other.after;
        particles += other.particles;
        for (int k = 0; k < most_components; ++k) field[k] += other.field[k];
    }
};

/// What a call did to a field: sum m q^2 over its particles and components before and after it, and
/// what that is of the field's mean everywhere.
struct SmoothingEnergy {
    double before = 0, after = 0, uniform = 0;
    bool any = true;  // particles, on any rank

    static SmoothingEnergy of(const SmoothingTotals& sum, double mass, int components) {
        SmoothingEnergy e{mass * sum.before, mass * sum.after, 0, sum.particles > 0};
        if (!e.any) return e;
        for (int k = 0; k < components; ++k)
            e.uniform += mass * sum.field[k] * sum.field[k] / sum.particles;
        return e;
    }
    MPM_HD double change() const { return after - before; }
    /// I_E of (3.185): the change over what the field had about its mean; 0 of a uniform one.
    MPM_HD double index() const {
        const double about = before - uniform;
        return about > 1e-14 * before ? change() / about : 0;
    }
    /// Smoothing never adds energy; beyond rounding this is a fault. Not-a-number is one too.
    bool sound(double rounding) const { return change() <= rounding * before; }
};

}  // namespace mpm
