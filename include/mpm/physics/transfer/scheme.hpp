// What a particle keeps of the velocity that it stores, beside what the grid gives it (Bonus 2023,
// sections 2.4 and 5.6; Hammerquist and Nairn 2017; Nairn and Hammerquist 2021).
//
//   seen   = sum N v_i*        the grid's velocity after forces and boundaries
//   before = sum N v_i^n       the same before them: of momentum alone
//   r      = own - before      what of the stored velocity the grid cannot see
//
//   FLIP family   v <- seen + alpha r,      x += dt (seen + beta alpha r)
//   XPIC(k)       v <- filtered + seen - before,
//                 x += dt (seen - (seen - before) / 2 - (own - filtered) / 2)
//
// beta is 0 in FLIP, PIC-FLIP and AFLIP, 1 in NFLIP, and a rule of the volume ratio J in SFLIP and
// ASFLIP. FMPM(k) changes the grid's velocity before the particles see it (kernels/sweep.hpp).
#pragma once

#include "mpm/core/linalg.hpp"

namespace mpm {

/// What a stored velocity is for.
enum class Memory : int { none, flip, xpic };
/// How beta is found.
enum class ShiftRule : int { none, full, binary, smooth };

/// Of one body.
struct SchemeNumbers {
    Memory memory = Memory::none;
    bool affine = true;  // the affine part goes back to the grid (APIC)
    double keep = 0;     // alpha
    ShiftRule rule = ShiftRule::none;
    double shift_max = 0, shift_min = 0;  // beta
    double critical_loss = 0;             // 1 - J_c
    double width = 0;                     // delta_c
    double power = 2;                     // b
    bool zero_below = false;              // smooth rule: beta is 0 below J_c, not beta_min
    bool operator==(const SchemeNumbers&) const = default;
};

/// beta for a volume loss j = 1 - J: binary, or the corrected polynomial form of eq. 5.34,
///   beta_min + (beta_max - beta_min) min(((J - J_c) / delta_c)^b, 1) from J_c on.
template <class T>
MPM_INLINE T shift_share(const SchemeNumbers& s, T loss) {
    if (s.rule == ShiftRule::none) return T(0);
    if (s.rule == ShiftRule::full) return T(1);
    const T beyond = T(s.critical_loss) - loss;  // J - J_c
    if (s.rule == ShiftRule::binary) return T(beyond > T(0) ? s.shift_max : s.shift_min);
    if (!(beyond >= T(0))) return T(s.zero_below ? 0.0 : s.shift_min);
    const T part = beyond / T(s.width);
    const T grown = part >= T(1) ? T(1) : (part > T(0) ? T(pow(double(part), s.power)) : T(0));
    return T(s.shift_min) + T(s.shift_max - s.shift_min) * grown;
}

}  // namespace mpm
