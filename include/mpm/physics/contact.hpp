// Contact of two bodies at a node, each with a field of velocities of its own (design/contact.md).
//
// The volume fraction c = m / (rho dx^d) of a body is its indicator smoothed by the quadratic
// spline. For a flat face at signed distance s of the node (cells; positive: node inside)
//
//   c = Phi(s) = (s + 3/2)^3 / 6 for s <= -1/2,  1/2 + 3 s / 4 - s^3 / 3 between,
//                1 - (3/2 - s)^3 / 6 for s >= 1/2,         Phi(s) + Phi(-s) = 1,
//
// so faces that touch fill every node to one, and the gap between two bodies is, in cells,
//
//   g = -(s_a + s_b),  s = Phi^-1(c);  where c_a + c_b > 1:  g = min(g, 1 - c_a - c_b).
//
// With w = v_a - v_b, its part w_n along the normal n from a to b, and the reduced mass m:
//
//   J_n = m (w_n - max(g, 0) dx / dt), none where that is negative: bodies may close a gap
//   J_t = m |w_t| up to mu_s J_n, else mu_d J_n, against the sliding w_t
//
// It pushes only, and takes energy whatever it does.
#pragma once

#include <cmath>
#include <limits>

#include "mpm/core/linalg.hpp"

namespace mpm {

enum class ContactKind : int {
    friction = 0,  // of solids: by the gap
    fluid = 1      // of a solid with a fluid: where they fill a node, for water keeps no lattice
};

struct ContactLaw {
    ContactKind kind = ContactKind::friction;
    double static_friction = 0, dynamic_friction = 0;
    double fill = 0.7;  // fluid: of c_a + c_b
};

/// Phi: volume fraction of a node whose signed distance from a flat face is s cells.
template <class T>
MPM_INLINE T filled_at(T s) {
    if (s <= T(-1.5)) return 0;
    if (s >= T(1.5)) return 1;
    if (s <= T(-0.5)) return (s + T(1.5)) * (s + T(1.5)) * (s + T(1.5)) / T(6);
    if (s >= T(0.5)) return T(1) - (T(1.5) - s) * (T(1.5) - s) * (T(1.5) - s) / T(6);
    return T(0.5) + T(0.75) * s - s * s * s / T(3);
}

/// Phi^-1 of a fraction up to one half; fractions below 0 count as 0.
template <class T>
MPM_INLINE T shallow_depth(T c) {
    if (!(c > T(0))) return T(-1.5);
    if (c <= T(1) / T(6)) return T(cbrt(T(6) * c)) - T(1.5);
    const T rest = T(0.5) - c;
    T t = rest / T(0.75);
    for (int k = 0; k < 3; ++k) t -= (T(0.75) * t - t * t * t / T(3) - rest) / (T(0.75) - t * t);
    return -t;
}

/// Phi^-1, cells; 3/2 for a fraction of one and more.
template <class T>
MPM_INLINE T depth_of(T c) {
    return c <= T(0.5) ? shallow_depth(c) : -shallow_depth(T(1) - c);
}

/// Gap between two bodies at a node, cells; negative where they overlap.
template <class T>
MPM_INLINE T contact_gap(T a, T b) {
    const T gap = -(depth_of(a) + depth_of(b)), room = T(1) - a - b;
    return room < T(0) && room < gap ? room : gap;
}

/// -grad f, normed, of a function of the 3^D nodes around one: `f(k)` at the offsets k in
/// {0, 1, 2}^D. Differences along each axis, averaged across with the weights 1/6, 2/3, 1/6, which
/// make the error of the direction isotropic to fourth order. False where it has no slope.
template <class T, int D, class F>
MPM_INLINE bool descent(const F& f, Vec<T, D>& n) {
    const T across[3] = {T(1) / T(6), T(2) / T(3), T(1) / T(6)};
    constexpr int nodes = D == 2 ? 9 : 27;
    T g[D] = {}, size = 0;
    for (int node = 0; node < nodes; ++node) {
        int k[D], rest = node;
        for (int a = D - 1; a >= 0; --a) {
            k[a] = rest % 3;
            rest /= 3;
        }
        const T value = f(k);
        size += absolute(value);
        for (int a = 0; a < D; ++a) {
            if (k[a] == 1) continue;
            T weight = k[a] == 2 ? T(-0.5) : T(0.5);
            for (int b = 0; b < D; ++b)
                if (b != a) weight *= across[k[b]];
            g[a] += weight * value;
        }
    }
    T square = 0;
    for (int a = 0; a < D; ++a) square += g[a] * g[a];
    // Less is rounding of the values.
    const T least = T(8) * std::numeric_limits<T>::epsilon() * size;
    if (!(square > least * least)) return false;
    const T inverse = T(1) / square_root(square);
    for (int a = 0; a < D; ++a) n[a] = g[a] * inverse;
    return true;
}

/// Normal speed that two bodies may approach each other with, m/s; false where they do not meet.
/// `cell_per_step` is dx / dt.
template <class T>
MPM_INLINE bool approach_allowed(const ContactLaw& law, T a, T b, double cell_per_step,
                                 T& allowed) {
    if (law.kind == ContactKind::fluid) {
        allowed = 0;
        return a + b >= T(law.fill);
    }
    const T gap = contact_gap(a, b);
    allowed = gap > T(0) ? gap * T(cell_per_step) : T(0);
    return true;
}

/// Impulse on b (kg m/s), minus that on a; false where there is none. `w` = v_a - v_b, `mass` the
/// reduced mass along the normal, `mass_across` along the faces: another one only where a boundary
/// holds one of them.
template <class T, int D>
MPM_INLINE bool contact_impulse(const ContactLaw& law, const Vec<T, D>& n, const Vec<T, D>& w,
                                T mass, T mass_across, T allowed, Vec<T, D>& impulse) {
    T along = 0;
    for (int a = 0; a < D; ++a) along += w[a] * n[a];
    const T speed = along - allowed;
    if (!(speed > T(0))) return false;
    const T normal = mass * speed;
    if (!(normal > T(0))) return false;
    Vec<T, D> slide;
    T square = 0;
    for (int a = 0; a < D; ++a) {
        slide[a] = w[a] - along * n[a];
        square += slide[a] * slide[a];
    }
    const T sliding = square_root(square), stop = mass_across * sliding;
    const bool holds = stop <= T(law.static_friction) * normal;
    const T limit = T(law.dynamic_friction) * normal;
    const T tangential = holds || stop < limit ? stop : limit;
    const T share = sliding > T(0) ? tangential / sliding : T(0);
    for (int a = 0; a < D; ++a) impulse[a] = normal * n[a] + share * slide[a];
    return true;
}

/// The mass that the impulse between two bodies meets along n where boundaries turn its push: the
/// relative velocity w = v_a - v_b then changes by the impulse times -`mobility`. `inverse`:
/// n · mobility > 0, `speed`: w · n - allowed > 0.
///
/// Where boundaries limit both, what of w is not along the mobility no impulse changes: of two
/// bodies at a wall, of which one is held and the other is moved across the wall by its neighbours,
/// what they have across it. An impulse that took all of w · n by the little of n that lies along
/// the wall would throw both out sideways, the further the less that is. So it takes no more of w
/// than there is along the mobility. Where w has nothing else, the two are one.
///
/// Where `one_is_free` all of w may change. But a light body that a wall holds would be squeezed
/// out along it by a heavy one: w changes by no more than its own size.
template <class T, int D>
MPM_INLINE T mass_beside_walls(const Vec<T, D>& mobility, const Vec<T, D>& w, T inverse, T speed,
                               T allowed, bool one_is_free) {
    T square = 0, along = 0, size = 0;
    for (int a = 0; a < D; ++a) {
        const T d = mobility[a] / inverse;  // of the order of one
        square += d * d;
        along += d * w[a];
        size += w[a] * w[a];
    }
    const T most = one_is_free ? square_root(size / square) : along / square - allowed;
    if (!(most > T(0))) return T(0);
    return most < speed ? most / (speed * inverse) : T(1) / inverse;
}

}  // namespace mpm
