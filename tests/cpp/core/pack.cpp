// Packs and masks, lane by lane against plain arrays.
#include "mpm/core/pack.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "mpm/core/number.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

template <class V>
class Packs : public ::testing::Test {
protected:
    using T = typename V::value_type;
    static constexpr int W = V::lanes;
    test::Random random{7};
    V some() {
        T x[W];
        for (T& v : x) v = T(random.integer(-9, 9));
        return V::load(x);
    }
};
using Types = ::testing::Types<Pack<float, 8>, Pack<double, 4>>;
TYPED_TEST_SUITE(Packs, Types);

TYPED_TEST(Packs, arithmetic) {
    using V = TypeParam;
    using T = typename V::value_type;
    for (int round = 0; round < 100; ++round) {
        const V a = this->some(), b = this->some() + T(20);
        const T s = T(3);
        V added = a, taken = a, scaled = a;
        added += b;
        taken -= b;
        scaled *= b;
        for (int l = 0; l < V::lanes; ++l) {
            EXPECT_EQ((a + b)[l], a[l] + b[l]);
            EXPECT_EQ((a - b)[l], a[l] - b[l]);
            EXPECT_EQ((a * b)[l], a[l] * b[l]);
            EXPECT_EQ((a / b)[l], a[l] / b[l]);
            EXPECT_EQ((-a)[l], -a[l]);
            EXPECT_EQ((a * s)[l], a[l] * s);
            EXPECT_EQ((s * a)[l], a[l] * s);
            EXPECT_EQ((a + s)[l], a[l] + s);
            EXPECT_EQ((s + a)[l], a[l] + s);
            EXPECT_EQ((a - s)[l], a[l] - s);
            EXPECT_EQ((s - a)[l], s - a[l]);
            EXPECT_EQ(added[l], a[l] + b[l]);
            EXPECT_EQ(taken[l], a[l] - b[l]);
            EXPECT_EQ(scaled[l], a[l] * b[l]);
            EXPECT_EQ(square_root(b)[l], std::sqrt(b[l]));
            EXPECT_EQ(absolute(a)[l], std::fabs(a[l]));
            EXPECT_EQ(larger(a, b)[l], std::fmax(a[l], b[l]));
            EXPECT_EQ(smaller(a, b)[l], std::fmin(a[l], b[l]));
        }
    }
}

TYPED_TEST(Packs, load_and_store_need_no_alignment) {
    using V = TypeParam;
    using T = typename V::value_type;
    T memory[2 * V::lanes + 1], back[2 * V::lanes + 1] = {};
    for (int i = 0; i <= 2 * V::lanes; ++i) memory[i] = T(i);
    V::load(memory + 1).store(back + 1);
    EXPECT_EQ(back[0], T(0));
    EXPECT_EQ(back[V::lanes + 1], T(0));
    for (int l = 0; l < V::lanes; ++l) EXPECT_EQ(back[l + 1], T(l + 1));
}

TYPED_TEST(Packs, every_mask) {
    using V = TypeParam;
    using T = typename V::value_type;
    constexpr int W = V::lanes;
    const V yes = this->some(), no = this->some() + T(100);
    for (unsigned bits = 0; bits < (1u << W); ++bits) {
        T sign[W];
        for (int l = 0; l < W; ++l) sign[l] = bits >> l & 1 ? T(-1) : T(1);
        const auto mask = V::load(sign) < V(T(0));
        EXPECT_EQ(any(mask), bits != 0);
        EXPECT_EQ(all(mask), bits == (1u << W) - 1);
        const V chosen = select(mask, yes, no);
        for (int l = 0; l < W; ++l) {
            const bool set = bits >> l & 1;
            EXPECT_EQ(mask[l], set);
            EXPECT_EQ((!mask)[l], !set);
            EXPECT_EQ(chosen[l], set ? yes[l] : no[l]);
        }
    }
}

TYPED_TEST(Packs, masks_combine) {
    using V = TypeParam;
    using T = typename V::value_type;
    constexpr int W = V::lanes;
    using Mask = PackMask<T, W>;
    for (int a = 0; a <= W; ++a) {
        for (int b = 0; b <= W; ++b) {
            const Mask x = Mask::first(a), y = Mask::first(b);
            for (int l = 0; l < W; ++l) {
                EXPECT_EQ(x[l], l < a);
                EXPECT_EQ((x & y)[l], l < std::min(a, b));
                EXPECT_EQ((x | y)[l], l < std::max(a, b));
            }
        }
    }
}

TYPED_TEST(Packs, comparisons) {
    using V = TypeParam;
    using T = typename V::value_type;
    for (int round = 0; round < 50; ++round) {
        V a = this->some(), b = this->some();
        a.raw[1] = std::numeric_limits<T>::quiet_NaN();
        b.raw[0] = a[0];
        for (int l = 0; l < V::lanes; ++l) {
            EXPECT_EQ((a < b)[l], a[l] < b[l]);
            EXPECT_EQ((a <= b)[l], a[l] <= b[l]);
            EXPECT_EQ((a > b)[l], a[l] > b[l]);
            EXPECT_EQ((a == b)[l], a[l] == b[l]);
        }
    }
}

TYPED_TEST(Packs, sums_of_lanes) {
    using V = TypeParam;
    using T = typename V::value_type;
    constexpr int W = V::lanes;
    for (int round = 0; round < 50; ++round) {
        V a[W];
        T expected[W] = {};
        for (int k = 0; k < W; ++k) {
            a[k] = this->some();
            for (int l = 0; l < W; ++l) expected[k] += a[k][l];  // small integers: exact
        }
        const V found = sums_of_lanes(a);
        for (int k = 0; k < W; ++k) EXPECT_EQ(found[k], expected[k]) << "sum " << k;
    }
    // Every lane of every pack arrives, and only where it belongs.
    for (int k = 0; k < W; ++k) {
        for (int l = 0; l < W; ++l) {
            V a[W];
            for (V& v : a) v = V(T(0));
            a[k].raw[l] = T(1);
            const V found = sums_of_lanes(a);
            for (int o = 0; o < W; ++o) EXPECT_EQ(found[o], o == k ? T(1) : T(0));
        }
    }
}

}  // namespace
}  // namespace mpm
