// Shape functions on a grid whose node i is the centre of cell i, for methods that take the
// particle's nodes one by one (the fused step has quadratic ones of its own, quadratic.hpp).
// r = (x_p - x_i) / dx, all lengths in cells.
//
//   linear      1 - |r|; its slope jumps at nodes: on one it is that of the upper side
//   quadratic   3/4 - r^2, (3/2 - |r|)^2 / 2                  (Bonus 2023, eq. 2.28)
//   cubic       2/3 - r^2 + |r|^3 / 2, (2 - |r|)^3 / 6
//   GIMP        (H(r + l) - H(r - l)) / (2 l), H the integral of the linear one: the mean of the
//               linear function over a particle of half-edge l (Bardenhagen and Kober 2004). l
//               stays in uGIMP and follows the particle's stretch along each axis in cpGIMP.
//   CPDI        parallelepiped.hpp
//   DDMP        linear weights, gradients of dual_domain.hpp
//
// Clamped splines are those of the same degree on the knots that lie inside the domain and on its
// ends as often as needed: nothing is left outside, and the outermost function is 1 at the wall
// (modified boundary splines: Steffen, Kirby and Berzins 2008). Quadratic knots are cell faces,
// linear and cubic ones cell centres.
#pragma once

#include "mpm/core/linalg.hpp"

namespace mpm {

enum class Kernel : int { linear, quadratic, cubic, ugimp, cpgimp, cpdi, ddmp };
/// Where velocity gradients and internal forces come from: first moments (MLS-MPM) or gradients of
/// the shape functions.
enum class GradientForm : int { moments, shapes };

/// Nodes along an axis that a particle may reach from the centre of its cell.
inline int kernel_width(Kernel k) {
    return k == Kernel::linear || k == Kernel::quadratic || k == Kernel::ugimp ? 3 : 5;
}
/// Weights are those of the linear functions.
MPM_INLINE bool is_linear(Kernel k) { return k == Kernel::linear || k == Kernel::ddmp; }

/// Largest half-edge of a particle that five nodes along an axis can hold.
inline constexpr double largest_half_edge = 1.5;

template <class V>
struct ShapeValue {
    V value;
    V slope;  // d/dr
};

namespace detail {

template <class V>
MPM_INLINE V hat(V r) {
    return larger(V(1) - absolute(r), V(0));
}
/// Integral of the hat from minus infinity.
template <class V>
MPM_INLINE V hat_integral(V r) {
    const V below = V(0.5) * (V(1) + r) * (V(1) + r),
            above = V(1) - V(0.5) * (V(1) - r) * (V(1) - r);
    return select(r <= V(-1), V(0), select(V(1) <= r, V(1), select(r < V(0), below, above)));
}

/// B-spline of degree 1 to 3 on its degree + 2 knots, which may coincide (Cox and de Boor), at x.
/// `last` is the end of the domain, which belongs to the last span.
template <class V>
MPM_CALL ShapeValue<V> spline_on_knots(int degree, const V (&knot)[5], V x, V last) {
    const Reconverge at_return;
    V n[4] = {}, below[4] = {};
    for (int i = 0; i <= degree; ++i) {
        const bool in =
            x >= knot[i] &&
            (x < knot[i + 1] || (x >= last && knot[i + 1] >= last && knot[i] < knot[i + 1]));
        n[i] = V(in ? 1 : 0);
    }
    const auto part = [](V up, V down) { return down > V(0) ? up / down : V(0); };
    for (int p = 1; p <= degree; ++p) {
        for (int i = 0; i < 4; ++i) below[i] = n[i];
        for (int i = 0; i + p <= degree; ++i) {
            n[i] = part((x - knot[i]) * below[i], knot[i + p] - knot[i]) +
                   part((knot[i + p + 1] - x) * below[i + 1], knot[i + p + 1] - knot[i + 1]);
        }
    }
    return {n[0], V(degree) * (part(below[0], knot[degree] - knot[0]) -
                               part(below[1], knot[degree + 1] - knot[1]))};
}

}  // namespace detail

/// `half` is the particle's half-edge, for GIMP.
template <class V>
MPM_INLINE ShapeValue<V> shape_value(Kernel kernel, V r, V half) {
    const V d = absolute(r), sign = select(r < V(0), V(-1), V(1)), none = V(0);
    switch (kernel) {
        case Kernel::linear:  // its slopes are `linear_slope`
        case Kernel::ddmp:
            return {detail::hat(r), select(d < V(1), -sign, none)};
        case Kernel::quadratic: {
            const V rest = larger(V(1.5) - d, none);
            const auto inner = d <= V(0.5);
            return {select(inner, V(0.75) - r * r, V(0.5) * rest * rest),
                    select(inner, V(-2) * r, -sign * rest)};
        }
        case Kernel::cubic: {
            const V rest = larger(V(2) - d, none);
            const auto inner = d <= V(1);
            return {select(inner, V(2.0 / 3) - r * r + V(0.5) * d * d * d,
                           rest * rest * rest * V(1.0 / 6)),
                    select(inner, r * (V(1.5) * d - V(2)), -sign * V(0.5) * rest * rest)};
        }
        default: {
            const V inverse = V(0.5) / half;
            return {inverse * (detail::hat_integral(r + half) - detail::hat_integral(r - half)),
                    inverse * (detail::hat(r + half) - detail::hat(r - half))};
        }
    }
}

/// Slope of the linear function of node `node` (0: the centre of the cell) for a particle at offset
/// `xi`. One side is chosen for all nodes, the lower one if the node there has any weight:
/// distances from nodes round, so that by these alone a particle a rounding below a node would
/// stand on it for one function and beside it for another, and slopes would not sum to zero.
template <class V>
MPM_INLINE V linear_slope(int node, V xi) {
    const auto of = [&](int low) { return V(node == low ? -1 : (node == low + 1 ? 1 : 0)); };
    return select(V(1) + xi < V(1), of(-1), of(0));
}

/// What a scene's kernel is, uniform over its particles.
struct KernelChoice {
    Kernel kernel = Kernel::quadratic;
    GradientForm gradient = GradientForm::moments;
    bool clamped = false;
    double half_edge = 0;   // of a particle at rest, for GIMP
    int cells[3] = {};      // of the domain
    bool modified = false;  // linear functions: what a deposit takes for them (modify_for_deposit)

    /// Has a particle in that cell of an axis clamped functions?
    MPM_INLINE bool near_end(std::int64_t cell, int axis) const {
        return clamped && (cell < 3 || cell >= cells[axis] - 3);
    }
};

namespace detail {

/// The clamped spline of a node for a particle in a cell near an end of the domain; `away` becomes
/// the distance of what the node stands for.
template <class V>
MPM_INLINE ShapeValue<V> clamped_value(const KernelChoice& k, int node, int axis, std::int64_t cell,
                                       V xi, V& away) {
    const int degree = is_linear(k.kernel) ? 1 : (k.kernel == Kernel::quadratic ? 2 : 3);
    // In cells from the lower end of the domain.
    const V last = V(k.cells[axis]);
    const V at = smaller(larger(V(double(cell) + 0.5) + xi, V(0)), last);
    V knot[5];
    MPM_UNROLL for (int m = 0; m < 5; ++m) {
        const double uniform = double(cell) + node + 0.5 - 0.5 * (degree + 1) + m;
        knot[m] = smaller(larger(V(uniform), V(0)), last);
    }
    // Linear fields are reproduced from the means of a function's inner knots.
    away = V(0) - at;
    for (int m = 1; m <= degree; ++m) away = away + knot[m] / V(degree);
    return spline_on_knots(degree, knot, at, last);
}

}  // namespace detail

/// A particle's nodes along each axis: number W / 2 is the centre of its cell.
template <class V, int D, int W>
struct Stencil {
    static constexpr int width = W;
    V weight[D][W];
    V slope[D][W];     // d weight / d x_p
    V distance[D][W];  // of the node from the particle
    V inverse[D];      // 1 / sum of weight distance^2: what turns a first moment into a slope
};

/// `xi` is the offset from the centre of cell `cell` of the domain, in [-1/2, 1/2]. Lanes have no
/// clamped splines.
template <int W, class V, int D>
MPM_INLINE Stencil<V, D, W> stencil_within(const KernelChoice& k, const Vec<V, D>& xi,
                                           const Vec<V, D>& half, const std::int64_t (&cell)[D]) {
    Stencil<V, D, W> s;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        V moment = V(0);
        MPM_UNROLL for (int n = 0; n < W; ++n) {
            V away = V(n - W / 2) - xi[a];
            ShapeValue<V> f;
            if (k.near_end(cell[a], a)) {
                if constexpr (NumberTraits<V>::lanes == 1)
                    f = detail::clamped_value(k, n - W / 2, a, cell[a], xi[a], away);
            } else {
                f = shape_value(k.kernel, -away, half[a]);
                if (is_linear(k.kernel)) f.slope = linear_slope(n - W / 2, xi[a]);
            }
            s.weight[a][n] = f.value;
            s.slope[a][n] = f.slope;
            s.distance[a][n] = away;
            moment = moment + f.value * away * away;
        }
        s.inverse[a] = select(moment > V(0), V(1) / moment, V(0));
    }
    return s;
}
template <int W, class V, int D>
MPM_HOST_CALL Stencil<V, D, W> stencil_of(const KernelChoice& k, const Vec<V, D>& xi,
                                          const Vec<V, D>& half, const std::int64_t (&cell)[D]) {
    return stencil_within<W>(k, xi, half, cell);
}

/// Linear functions as a deposit may take them (Yang 2016, A.4 and A.5, the clamp corrected): no
/// weight below 0.001 or above 0.999, and slopes that go to zero towards the nodes within 0.5 % of
/// the span between them. Both still add up to 1 and to 0, and no node is almost massless.
template <class V, int D, int W>
MPM_INLINE void modify_for_deposit(Stencil<V, D, W>& s, const Vec<V, D>& xi) {
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        const int low = V(1) + xi[a] < V(1) ? W / 2 - 1 : W / 2;         // as of `linear_slope`
        const V away = smaller(s.weight[a][low], s.weight[a][low + 1]);  // from the nearer node
        const V part = smaller(V(2) * away / V(0.01), V(1));
        MPM_UNROLL for (int n = 0; n < W; ++n) {
            if (n < low || n > low + 1) continue;
            s.weight[a][n] = smaller(larger(s.weight[a][n], V(0.001)), V(0.999));
            s.slope[a][n] = s.slope[a][n] * part;
        }
    }
}

}  // namespace mpm
