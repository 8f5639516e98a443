// Sums of exact numbers: the same in any order and by any parts, rounded once, and back from
// pieces.
#include "mpm/core/exact.hpp"

#include <gtest/gtest.h>

#include <algorithm>
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

}  // namespace
}  // namespace mpm
