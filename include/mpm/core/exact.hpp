// Sums that do not depend on their order: numbers as whole multiples of a power of two, in 128
// bits. So threads, ranks and devices may add what they have in whatever order, and find the same.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "mpm/core/config.hpp"

namespace mpm {

__extension__ typedef __int128 Int128;

/// Bits between the size that numbers are expected to have and the unit in which they are added:
/// more than a double has, so that numbers a millionth of it keep all of theirs. Behind them are 54
/// bits for numbers that are larger, and for many of them.
inline constexpr int exact_bits = 72;

/// 1 over the unit of sums of numbers of about `size` > 0: a power of two.
inline double exact_scale(double size) {
    int exponent = 0;
    std::frexp(size, &exponent);
    return std::ldexp(1.0, exact_bits - exponent);
}

/// x times `scale`, a power of two, rounded towards zero. What has no place in 128 bits is taken
/// for zero: such a number is no velocity or stress of a run that goes on.
MPM_INLINE Int128 exact(double x, double scale) {
    constexpr double word = 18446744073709551616.0;  // 2^64
    const double y = x * scale, size = y < 0 ? -y : y, high = floor(size * (1 / word));
    if (!(high < word / 4)) return 0;
    // Of a number of 53 bits both parts are exact, and the lower one is less than a word.
    const Int128 whole =
        Int128(std::int64_t(high)) * (Int128(1) << 64) + std::uint64_t(size - high * word);
    return y < 0 ? -whole : whole;
}

/// A sum in pieces that are doubles: those of several sums may be added piece by piece.
inline constexpr int exact_pieces = 3;
inline constexpr int piece_bits = 43;
MPM_INLINE void to_pieces(Int128 sum, double* pieces) {
    constexpr Int128 piece = Int128(1) << piece_bits;
    for (int k = 0; k < exact_pieces - 1; ++k) {
        const Int128 rest = sum & (piece - 1);
        pieces[k] = double(std::int64_t(rest));
        sum = (sum - rest) >> piece_bits;
    }
    pieces[exact_pieces - 1] = double(std::int64_t(sum));
}
/// Zero of pieces that no sum has: they may come from another process.
inline Int128 from_pieces(const double* pieces) {
    Int128 sum = 0;
    for (int k = exact_pieces - 1; k >= 0; --k) {
        if (!(std::fabs(pieces[k]) < (k == exact_pieces - 1 ? 0x1p40 : 0x1p60))) return 0;
        sum = sum * (Int128(1) << piece_bits) + std::int64_t(pieces[k]);
    }
    return sum;
}

/// An unsigned number in limbs of so few bits that those of all lanes of a warp add up in 32 bits:
/// so lanes add numbers of any size by the sums that a device has.
inline constexpr int limb_bits = 27;
template <class Integer>
inline constexpr int limbs_of = (int(sizeof(Integer)) * 8 + limb_bits - 1) / limb_bits;
template <class Integer>
MPM_INLINE std::uint32_t limb(Integer number, int k) {
    return std::uint32_t(number >> (k * limb_bits)) & ((1u << limb_bits) - 1);
}
/// What sums of limbs, sum(k) that of limb k, are together: modulo the size of the number.
template <class Integer, class F>
MPM_INLINE Integer from_limbs(const F& sum) {
    Integer all = 0;
    MPM_UNROLL for (int k = limbs_of<Integer> - 1; k >= 0; --k) all =
        (all << limb_bits) + Integer(std::uint32_t(sum(k)));
    return all;
}

/// Of numbers the largest has the largest key. None is 0, which is left for where there is no
/// number; NaN is larger than all.
MPM_INLINE std::uint64_t order_key(double x) {
    constexpr std::uint64_t sign = std::uint64_t(1) << 63;
    if (x != x) return ~std::uint64_t(0);
    const auto bits = std::bit_cast<std::uint64_t>(x);
    return bits & sign ? ~bits : bits | sign;
}
MPM_INLINE double from_order_key(std::uint64_t key) {
    constexpr std::uint64_t sign = std::uint64_t(1) << 63;
    if (key == ~std::uint64_t(0)) return std::numeric_limits<double>::quiet_NaN();
    return std::bit_cast<double>(key & sign ? key ^ sign : ~key);
}

/// The sum itself, rounded once.
inline double to_double(Int128 sum, double scale) { return double(sum) / scale; }

}  // namespace mpm
