// Sums of exact numbers: the same in any order and by any parts, rounded once, and back from
// pieces.
#include "mpm/core/exact.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace mpm {
namespace {

TEST(Exact, NumbersKeepAllTheirBitsWithinTheRange) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> mantissa(-1, 1);
    for (const double size : {1e-9, 0.3, 1.0, 5e6}) {
        const double scale = exact_scale(size);
        int exponent = 0;
        EXPECT_EQ(std::frexp(scale, &exponent), 0.5);  // a power of two
        for (int k = 0; k < 1000; ++k) {
            // From 2^-19 of the size, of which 53 bits reach 2^-72, to 2^20 of it.
            const double x = std::ldexp(mantissa(random) * size, k % 40 - 19);
            if (std::abs(x) < std::ldexp(size, -18)) continue;
            EXPECT_EQ(to_double(exact(x, scale), scale), x);
        }
        EXPECT_EQ(exact(0.0, scale), 0);
    }
}

TEST(Exact, SumsDoNotDependOnTheirOrder) {
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    std::vector<double> all(10000);
    for (double& x : all) x = normal(random) * std::exp(3 * normal(random));
    const double scale = exact_scale(1.0);
    const auto sum = [&] {
        Int128 total = 0;
        for (double x : all) total += exact(x, scale);
        return total;
    };
    const Int128 first = sum();
    for (int k = 0; k < 5; ++k) {
        std::shuffle(all.begin(), all.end(), random);
        EXPECT_TRUE(sum() == first);
    }
    // Cancellation leaves what is left: each number is rounded once, by less than a unit.
    Int128 rest = first;
    for (std::size_t k = 1; k < all.size(); ++k) rest -= exact(all[k], scale);
    EXPECT_NEAR(to_double(rest, scale), all[0], 1.5 / scale);
}

TEST(Exact, PiecesOfPartsAddUpToThoseOfTheSum) {
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    const double scale = exact_scale(1.0);
    for (int k = 0; k < 200; ++k) {
        Int128 total = 0;
        double pieces[exact_pieces] = {};
        for (int rank = 0; rank < 128; ++rank) {
            const Int128 part = exact(normal(random) * std::ldexp(1.0, k % 30), scale);
            total += part;
            double own[exact_pieces];
            to_pieces(part, own);
            EXPECT_TRUE(from_pieces(own) == part);
            for (int j = 0; j < exact_pieces; ++j) pieces[j] += own[j];
        }
        EXPECT_TRUE(from_pieces(pieces) == total);
    }
}

TEST(Exact, WhatHasNoPlaceIsZero) {
    const double scale = exact_scale(1.0), nan = std::nan("");
    for (const double x : {nan, double(INFINITY), -double(INFINITY), 1e30})
        EXPECT_EQ(exact(x, scale), 0);
    const double pieces[exact_pieces] = {0, nan, 1};
    EXPECT_EQ(from_pieces(pieces), 0);
}

/// As the lanes of a warp add: limb by limb, in 32 bits.
template <class Integer>
Integer sum_by_limbs(const std::vector<Integer>& lanes) {
    return from_limbs<Integer>([&](int k) {
        std::uint64_t all = 0;
        for (Integer x : lanes) all += limb(x, k);
        EXPECT_LE(all, 0xffffffffu);
        return std::uint32_t(all);
    });
}

TEST(Exact, LimbsOfAWarpAddUpToTheSum) {
    __extension__ typedef unsigned __int128 Unsigned;
    std::mt19937_64 random(11);
    std::normal_distribution<double> normal;
    const double scale = exact_scale(1.0);
    for (int k = 0; k < 300; ++k) {
        std::vector<Unsigned> wide(32);
        std::vector<std::uint64_t> narrow(32);
        Unsigned of_wide = 0;
        std::uint64_t of_narrow = 0;
        for (int lane = 0; lane < 32; ++lane) {
            // Of either sign, and any bits at all, which go over the end.
            const Int128 number = exact(normal(random) * std::ldexp(1.0, k % 90 - 40), scale);
            wide[lane] = k % 3 == 0   ? Unsigned(number)
                         : k % 3 == 1 ? Unsigned(random()) << 64 | random()
                                      : ~Unsigned(0) - Unsigned(k / 3 * lane);
            narrow[lane] = k % 2 ? random() : ~std::uint64_t(0);
            of_wide += wide[lane];
            of_narrow += narrow[lane];
        }
        EXPECT_TRUE(sum_by_limbs(wide) == of_wide);
        EXPECT_EQ(sum_by_limbs(narrow), of_narrow);
    }
}

TEST(Exact, KeysOrderAsNumbersDo) {
    const double inf = std::numeric_limits<double>::infinity();
    const double ascending[] = {-inf,   -1e300, -1.5, -1.0,  -5e-324, 0.0,
                                5e-324, 1.0,    1.5,  1e300, inf};
    std::uint64_t before = 0;
    for (const double x : ascending) {
        const std::uint64_t key = order_key(x);
        EXPECT_GT(key, before);
        EXPECT_EQ(from_order_key(key), x);
        before = key;
    }
    EXPECT_LT(order_key(-0.0), order_key(0.0));
    for (const double none : {std::nan(""), -std::nan("")}) {
        EXPECT_GT(order_key(none), before);
        EXPECT_TRUE(std::isnan(from_order_key(order_key(none))));
    }
    // What is low is found as the largest of the negatives.
    EXPECT_EQ(-from_order_key(std::max(order_key(-3.0), order_key(2.0))), -2.0);
}

}  // namespace
}  // namespace mpm
