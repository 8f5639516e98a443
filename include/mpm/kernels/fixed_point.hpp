// How integers stand for nodal sums on devices: by which factors, and why they cannot overflow.
//
// Every particle adds share * (value + slope . distance) to a node, with shares that sum to the
// node's mass M. So no partial or whole sum of momentum exceeds M q, where q is the largest deposit
// of any particle (`deposit_size`), whatever cancels in it and however many particles meet there.
//
//   M   The largest nodal mass of this step is known. While particles move by at most delta cells
//       along each axis, the spline of a moved particle is dominated by splines around where it
//       was: w(x + delta) <= sum_n c_n w(x - n) with sum c_n <= 1 + 2.8 delta for delta <= 1 (a
//       test finds the least such sums). So the next largest mass is at most (1 + 2.8 delta)^D M.
//   q   is measured while it is deposited and compared with the limit that the factor was chosen
//       for: growth beyond it is an error of its own name, not a wrapped sum.
//
// The limit follows from the larger of the last two largest deposits. One alone does not do: what
// motion and stress put into a deposit cancels for a step where an oscillation turns (a fluid
// particle alone breathes at omega dt = 2 sqrt(d) C, C its Courant number). But an explicit step
// takes an oscillation on by u(n+1) = (2 - omega^2 dt^2) u(n) - u(n-1), and where it is stable
// omega dt < 2, so |u(n+1)| < 3 max(|u(n)|, |u(n-1)|): never two small ones in a row, and growth by
// 16 leaves room. What it costs: the step after deposits have fallen keeps their scale for one step
// more, so its sums have log2 of that fall fewer bits, and none where deposits last or grow.
//
// Factors are powers of two, so that conversion rounds once.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "mpm/core/config.hpp"

namespace mpm {

/// What a nodal sum is of, and with it which factor it has.
enum Quantity : int { mass_sum = 0, momentum_sum = 1, group_sum = 2, quantities = 3 };

struct FixedPoint {
    double scale[quantities];  // integer = number * scale
    double limit[quantities];  // largest deposit that may be added; 0 for the mass
};

/// By how much a deposit may outgrow the last two, beyond what the speed of the nodes explains.
inline constexpr double deposit_growth = 16;

/// What nodes that reach the speed 1 in one blow can put into a deposit, with the Courant number of
/// the step: a particle moves with a mean of nodal speeds, its slope is at most twice the largest a
/// cell along each axis, and the pressure that this makes within the step is rho c^2 times its
/// trace.
MPM_HD inline double deposit_of_blow(double courant) { return 8 + 45 * courant * courant; }

/// Cells a step that sums of `bits` bits can take of a deposit and still tell speeds of 2^-16 cells
/// a step from rest. An explicit step that is stable deposits less by far: 8 + 45 C^2 a cell for
/// motion and some 20 C^2 for stress, C its Courant number. Beyond, stress would round away what
/// moves, and with it the growth that shows that the step is too long.
MPM_HD inline double coarsest_deposit(int bits) { return ldexp(1.0, bits - 23); }

/// Largest power of two that is no larger than a positive normal number: its exponent alone.
MPM_HD inline double power_of_two_below(double x) {
    std::uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    bits &= std::uint64_t(0x7ff) << 52;
    memcpy(&x, &bits, sizeof bits);
    return x;
}

/// Bound on the growth of the largest nodal mass while particles move by `moved` cells.
MPM_HD inline double mass_growth(double moved, int dimension) {
    const double axis = 1 + 2.8 * moved;
    return dimension == 2 ? axis * axis : axis * axis * axis;
}

/// Factors for sums of `bits` bits. `mass` is the largest nodal mass to come, `limit` the largest
/// deposits.
MPM_HD inline FixedPoint fixed_point(int bits, double mass, double momentum_limit,
                                     double group_limit) {
    const double room = ldexp(1.0, bits - 1);  // one bit for the roundings of many deposits
    FixedPoint f{};
    f.limit[momentum_sum] = momentum_limit;
    f.limit[group_sum] = group_limit;
    f.scale[mass_sum] = power_of_two_below(room / mass);
    f.scale[momentum_sum] = power_of_two_below(room / (mass * momentum_limit));
    f.scale[group_sum] = power_of_two_below(room / (mass * group_limit));
    return f;
}

}  // namespace mpm
