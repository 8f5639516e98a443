// Smoothing of a field that particles carry, cell by cell: Yang (2016), 3.3 to 3.5. What two cells
// on both sides of a face exchange, and what a cell's own particles say of it; no memory, no loop
// over cells (kernels/cell_smoothing.hpp).
//
//   C0     q^ = q0, the mean by mass                                            (3.64), (3.65)
//   C1     q^ = q0 + q1 . (x - x_o) about the centre of mass x_o                (3.60), (3.61)
//   F0     C0, then every pair of cells with a face between them exchanges
//          F = gamma M_r (q0- - q0+),  M_r = m- m+ / (m- + m+)                  (3.139), (3.143)
//          gamma given, or by a limiter: L1, L2 let only that part of the jump flow which the
//          slopes (L1) or parabolas (L2) of the cells do not explain            (3.146) - (3.159)
//          A opens a face only where one of its cells is an extremum            (3.160)
//   F1     C1, then F = B J / 2 with the jump J of the lines at the face        (3.175), (3.176)
//
// Each of the 2 d faces of a cell works on its share 1 / (2 d) of the field before the call
// (Jacobi), so that no pair can raise the energy E = sum m q^2. All lengths in cells.
#pragma once

#include "mpm/core/linalg.hpp"

namespace mpm {

enum class CellForm : int { none, constant, linear, nodal, flux, linear_flux };
enum class FluxLimiter : int { none, linear, quadratic };
/// What of the places of a cell's particles a form asks for: nothing; centre and second moments
/// along the axes; also products of inertia.
enum class CellPlaces : int { none, along_axes, all };

/// What a body's smoothing is, uniform over it.
struct SmoothingChoice {
    CellForm form = CellForm::none;
    FluxLimiter limiter = FluxLimiter::none;
    bool extrema = false;     // limiter A
    double gamma = 1;         // share of F0's flux, where no limiter sets it
    bool by_inertia = false;  // F1: L = sqrt(I / m) instead of the way to the face
    MPM_HD bool tilts() const { return form == CellForm::linear || form == CellForm::linear_flux; }
    /// Does a cell work with those beside it?
    MPM_HD bool exchanges() const {
        return form == CellForm::flux || form == CellForm::linear_flux;
    }
    /// Also with those behind them?
    MPM_HD bool looks_beyond() const { return extrema || limiter != FluxLimiter::none; }
    MPM_HD CellPlaces places() const {
        return tilts()                        ? CellPlaces::all
               : limiter != FluxLimiter::none ? CellPlaces::along_axes
                                              : CellPlaces::none;
    }
    bool operator==(const SmoothingChoice&) const = default;
};

/// Which part of a tensor a mean stands for (M6 to M9 of three fields: Hu and Washizu).
enum class TensorPart : int { none, full, volumetric, deviatoric };

/// A cell as a face normal to one axis sees it.
template <class T>
struct CellAlong {
    T mass = T(0);     // 0: there is none
    T centre = T(0);   // of mass
    T inertia = T(0);  // second moment of mass about it
    T mean = T(0);
    T slope = T(0);  // first moment of the field over the inertia; F1 alone
    MPM_INLINE bool there() const { return mass > T(0); }
};

/// M_r
template <class T>
MPM_INLINE T reduced_mass(T m_minus, T m_plus) {
    return m_minus * m_plus / (m_minus + m_plus);
}

/// Change of sum m q^2 where a flux F goes from minus to plus: 2 F (q+ - q-) + F^2 / M_r.
template <class T>
MPM_INLINE T pair_energy(const CellAlong<T>& minus, const CellAlong<T>& plus, T flux) {
    return T(2) * flux * (plus.mean - minus.mean) +
           flux * flux / reduced_mass(minus.mass, plus.mass);
}

/// A parabola about a cell's centre of mass whose mean is the cell's.
template <class T>
struct Parabola {
    T slope, curvature;
};

/// (3.151) to (3.156), of a cell between two others.
template <class T>
MPM_INLINE Parabola<T> parabola_between(const CellAlong<T>& l, const CellAlong<T>& c,
                                        const CellAlong<T>& r) {
    const T right = (r.mean - c.mean) / (r.centre - c.centre),
            left = (c.mean - l.mean) / (c.centre - l.centre);
    const T own = c.inertia / c.mass;
    const T shift_right = (r.inertia / r.mass - own) / (r.centre - c.centre),
            shift_left = (l.inertia / l.mass - own) / (l.centre - c.centre);
    const T curvature = (right - left) / ((r.centre + shift_right) - (l.centre + shift_left));
    const T slope =
        T(0.5) * (right + left) + curvature * ((c.centre - T(0.5) * (r.centre + l.centre)) -
                                               T(0.5) * (shift_right + shift_left));
    return {slope, curvature};
}
/// (3.157), (3.158): of a cell with one neighbour, with that one's curvature.
template <class T>
MPM_INLINE T slope_beside(const CellAlong<T>& c, const CellAlong<T>& other, T curvature) {
    const T away = other.centre - c.centre,
            shift = (other.inertia / other.mass - c.inertia / c.mass) / away;
    return (other.mean - c.mean) / away - curvature * (away + shift);
}

/// q of a cell at the interface `x_m` less its mean, by the slope between its neighbours.
template <class T>
MPM_INLINE T explained_linear(const CellAlong<T>& l, const CellAlong<T>& c, const CellAlong<T>& r,
                              T x_m) {
    const CellAlong<T>&low = l.there() ? l : c, &high = r.there() ? r : c;
    return (high.mean - low.mean) / (high.centre - low.centre) * (x_m - c.centre);
}

/// Where the interface of a pair is taken to be (3.148).
template <class T>
MPM_INLINE T interface_between(const CellAlong<T>& minus, const CellAlong<T>& plus) {
    return (minus.mass * plus.centre + plus.mass * minus.centre) / (minus.mass + plus.mass);
}

/// What of the jump q- - q+ the cells' own slopes say at the interface, e+ - e- (3.147), (3.159).
/// `before` and `behind` are the neighbours beyond the pair, which may be missing.
template <class T>
MPM_INLINE T explained_jump(FluxLimiter limiter, const CellAlong<T>& before,
                            const CellAlong<T>& minus, const CellAlong<T>& plus,
                            const CellAlong<T>& behind) {
    const T x_m = interface_between(minus, plus);
    if (limiter == FluxLimiter::linear)
        return explained_linear(minus, plus, behind, x_m) -
               explained_linear(before, minus, plus, x_m);
    // A cell with one neighbour takes that one's curvature; two cells alone have none.
    Parabola<T> low{T(0), T(0)}, high{T(0), T(0)};
    if (before.there()) low = parabola_between(before, minus, plus);
    if (behind.there()) high = parabola_between(minus, plus, behind);
    if (!before.there()) {
        low.curvature = high.curvature;
        low.slope = slope_beside(minus, plus, low.curvature);
    }
    if (!behind.there()) {
        high.curvature = low.curvature;
        high.slope = slope_beside(plus, minus, high.curvature);
    }
    const auto at = [&](const CellAlong<T>& c, const Parabola<T>& p) {
        const T way = x_m - c.centre;
        return p.slope * way + p.curvature * (way * way - c.inertia / c.mass);
    };
    return at(plus, high) - at(minus, low);
}

/// (3.160): is a cell, both of whose neighbours are there, no step of a monotone row?
template <class T>
MPM_INLINE bool is_extremum(const CellAlong<T>& l, const CellAlong<T>& c, const CellAlong<T>& r) {
    return l.there() && r.there() && (r.mean - c.mean) * (c.mean - l.mean) <= T(0);
}

/// F of the F0 family, from minus to plus, for the whole field (not its share).
template <class T>
MPM_INLINE T constant_flux(const SmoothingChoice& k, const CellAlong<T>& before,
                           const CellAlong<T>& minus, const CellAlong<T>& plus,
                           const CellAlong<T>& behind) {
    if (k.extrema && !is_extremum(before, minus, plus) && !is_extremum(minus, plus, behind))
        return T(0);
    const T jump = minus.mean - plus.mean;
    T flows = T(k.gamma) * jump;
    if (k.limiter != FluxLimiter::none) {  // (3.150)
        const T sign = jump < T(0) ? T(-1) : T(1);
        const T rest = sign * (jump - explained_jump(k.limiter, before, minus, plus, behind));
        flows = sign * smaller(larger(rest, T(0)), sign * jump);
    }
    return reduced_mass(minus.mass, plus.mass) * flows;
}

/// F1: what goes from minus to plus, and by how much the slopes of both change.
template <class T>
struct LinearFlux {
    T flux;
    T slope_minus, slope_plus;
    T energy;  // change of the pair's, (3.177)
};
/// `way_minus`, `way_plus`: from the centres of mass to the face. A cell whose particles stand in
/// one place along the axis has no slope to change.
template <class T>
MPM_INLINE LinearFlux<T> linear_flux(const CellAlong<T>& minus, const CellAlong<T>& plus,
                                     T way_minus, T way_plus, T least_inertia) {
    const bool tilts_minus = minus.inertia > least_inertia * minus.mass,
               tilts_plus = plus.inertia > least_inertia * plus.mass;
    const T a = tilts_minus ? way_minus / minus.inertia : T(0),
            b = tilts_plus ? way_plus / plus.inertia : T(0);
    const T jump = (minus.mean + (tilts_minus ? way_minus * minus.slope : T(0))) -
                   (plus.mean - (tilts_plus ? way_plus * plus.slope : T(0)));
    const T B =
        T(1) / (way_plus * b + way_minus * a + (minus.mass + plus.mass) / (minus.mass * plus.mass));
    const T flux = T(0.5) * B * jump;
    return {flux, -a * flux, -b * flux, T(-0.75) * B * jump * jump};
}

/// Below this share of mass times (a cell)^2 an inertia is none: its particles stand in one place.
inline constexpr double least_inertia = 1e-8;

/// Slopes q1 of the least squares J q1 = g. `inertia` is symmetric; directions in which the
/// particles do not spread get none, which leaves a projection all the same.
template <class T, int D>
MPM_INLINE Vec<T, D> least_squares_slopes(Mat<T, D> inertia, Vec<T, D> moment, T mass) {
    int order[D];
    bool found[D] = {};
    Vec<T, D> slope;
    for (int a = 0; a < D; ++a) slope[a] = T(0);
    int rank = 0;
    for (; rank < D; ++rank) {  // the largest diagonal that is left is the pivot
        int pivot = -1;
        for (int a = 0; a < D; ++a)
            if (!found[a] && (pivot < 0 || inertia.e[a][a] > inertia.e[pivot][pivot])) pivot = a;
        if (!(inertia.e[pivot][pivot] > T(least_inertia) * mass)) break;
        found[pivot] = true;
        order[rank] = pivot;
        for (int a = 0; a < D; ++a) {
            if (found[a]) continue;
            const T share = inertia.e[a][pivot] / inertia.e[pivot][pivot];
            for (int b = 0; b < D; ++b) {
                if (!found[b]) inertia.e[a][b] = inertia.e[a][b] - share * inertia.e[pivot][b];
            }
            moment[a] = moment[a] - share * moment[pivot];
        }
    }
    for (int k = rank - 1; k >= 0; --k) {
        const int a = order[k];
        T rest = moment[a];
        for (int j = k + 1; j < rank; ++j) rest = rest - inertia.e[a][order[j]] * slope[order[j]];
        slope[a] = rest / inertia.e[a][a];
    }
    return slope;
}

}  // namespace mpm
