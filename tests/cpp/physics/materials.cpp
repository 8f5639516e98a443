// Properties that every material must have. The list of models is the build's own, so a new
// material is covered without a line here.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "mpm/core/number.hpp"
#include "mpm/kernels/model_headers.inc"
#include "mpm/physics/material/hypoelastic.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

template <class, class... M>
struct List {
    using Types = ::testing::Types<M...>;
};
#define MPM_MODEL(Model) , Model
using Models = List<void
#include "mpm/kernels/models.inc"
                    >::Types;
#undef MPM_MODEL

/// Defaults, and usual numbers for what has none.
template <class M>
std::vector<double> usual_parameters() {
    std::vector<double> out;
    for (const Parameter& p : M::parameters) {
        // No flow below this: what all materials share is elastic.
        const std::string name = p.name;
        if (name == "log_plastic_volume")
            out.push_back(-20);  // p0 far above any pressure
        else if (name == "yield_stress" || name == "cohesion" || name == "tension_cutoff")
            out.push_back(1e9);
        else if (!std::isnan(p.default_value))
            out.push_back(p.default_value);
        else if (std::strcmp(p.unit, "Pa") == 0)
            out.push_back(1e6);
        else if (std::strcmp(p.unit, "kg/m³") == 0)
            out.push_back(1000);
        else if (std::isinf(p.upper))
            out.push_back(std::isinf(p.lower) ? 1 : p.lower + 1);
        else
            out.push_back(0.5 * (p.lower + p.upper));
    }
    return out;
}

/// A law in rates stores no energy and knows turns in small steps only; its own tests hold it to
/// what it promises instead (hypoelastic.cpp).
template <class M>
inline constexpr bool in_rates = std::is_same_v<M, Hypoelastic>;

template <class M>
class Materials : public ::testing::Test {
protected:
    std::vector<double> parameters = usual_parameters<M>();
    test::Random random{23};
    const double* q() const { return parameters.data(); }
    double stiffness() const { return M::density(q()) * M::wave_speed(q()) * M::wave_speed(q()); }

    template <class T, int D>
    struct State {
        T r[M::template reals<D>] = {};
    };
    template <int D>
    [[gnu::noinline]] State<double, D> advanced(State<double, D> s, const Mat<double, D>& strain,
                                                double by = 1) {
        Mat<double, D> e = strain;
        for (auto& row : e.e)
            for (double& x : row) x *= by;
        M::template advance<double, D, double>(s.r, e, M::template constants<double>(q()));
        return s;
    }
    template <int D>
    [[gnu::noinline]] Mat<double, D> stress(const State<double, D>& s,
                                            const Mat<double, D>& rate = {}) {
        return M::template kirchhoff<double, D, double>(s.r, rate,
                                                        M::template constants<double>(q()));
    }
    /// Compiled once for all properties that ask for it, as those of double precision are.
    template <int D>
    [[gnu::noinline]] static Mat<float, D> stress_in_single(
        const State<float, D>& s, const typename M::template Constants<float>& constants) {
        return M::template kirchhoff<float, D, float>(s.r, Mat<float, D>{}, constants);
    }
    template <int D>
    [[gnu::noinline]] Observation<D> observe(const State<double, D>& s,
                                             const Mat<double, D>& rate = {}) {
        return M::template observe<D>(s.r, rate.e, q());
    }
    template <int D>
    static double contract(const Mat<double, D>& a, const Mat<double, D>& b) {
        double s = 0;
        for (int i = 0; i < D; ++i)
            for (int j = 0; j < D; ++j) s += a(i, j) * b(i, j);
        return s;
    }

    template <int D>
    void stress_is_the_derivative_of_the_energy() {
        if (in_rates<M>) return;
        for (double size : {1e-6, 1e-4, 1e-2, 0.2}) {
            for (int round = 0; round < 200; ++round) {
                const auto s = advanced<D>({}, random.template matrix<D>(size));
                const auto direction = random.template matrix<D>(1);
                const double h = 1e-3 * size;
                const double slope = (observe<D>(advanced<D>(s, direction, h)).elastic_energy -
                                      observe<D>(advanced<D>(s, direction, -h)).elastic_energy) /
                                     (2 * h);
                const auto tau = stress<D>(s);
                ASSERT_NEAR(contract<D>(tau, direction), slope, 5e-4 * D * test::largest<D>(tau))
                    << "strain " << size;
            }
        }
    }

    template <int D>
    void objectivity() {
        if (std::is_same_v<M, LinearElastic>) return;  // knows no rotations, and says so
        if (in_rates<M>) return;
        for (double size : {1e-4, 0.2}) {
            for (int round = 0; round < 200; ++round) {
                const auto s = advanced<D>({}, random.template matrix<D>(size));
                const auto rate = random.template matrix<D>(10);
                const auto turn = random.template rotation<D>();
                State<double, D> turned = s;
                if (!M::volumetric) {  // F <- Q F
                    Mat<double, D> increment = turn;
                    for (int a = 0; a < D; ++a) increment(a, a) -= 1;
                    turned = advanced<D>(s, increment);
                }
                const auto rotate = [&](const Mat<double, D>& m) {
                    return product_transposed(product(turn, m), turn);
                };
                const auto expected = rotate(stress<D>(s, rate));
                const auto found = stress<D>(turned, rotate(rate));
                const auto before = observe<D>(s, rate), after = observe<D>(turned, rotate(rate));
                const double bound = 1e-12 * stiffness();
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) {
                        ASSERT_NEAR(found(a, b), expected(a, b), bound);
                        // Cauchy's stress of the reader is the same law.
                        ASSERT_NEAR(after.volume_ratio * after.stress[a][b], expected(a, b), bound);
                        ASSERT_NEAR(found(a, b), found(b, a), bound);
                    }
                ASSERT_NEAR(after.volume_ratio, before.volume_ratio, 1e-13);
                ASSERT_NEAR(after.pressure, before.pressure, 2 * bound);
                ASSERT_NEAR(after.elastic_energy, before.elastic_energy, bound * size);
            }
        }
    }

    template <int D>
    void rest() {
        const State<double, D> s;
        const auto o = observe<D>(s);
        const auto tau = stress<D>(s);
        const State<float, D> single;
        const auto rough = stress_in_single<D>(single, M::template constants<float>(q()));
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) {
                EXPECT_EQ(tau(a, b), 0);
                EXPECT_EQ(rough(a, b), 0);
                EXPECT_EQ(o.stress[a][b], 0);
            }
        EXPECT_EQ(o.elastic_energy, 0);
        EXPECT_EQ(o.pressure, 0);
        EXPECT_EQ(o.volume_ratio, 1);
        EXPECT_TRUE((M::template admissible<double, D>(s.r)));
    }

    /// rho c^2 is the slope of the normal stress under a strain along one axis only.
    template <int D>
    void wave_speed() {
        for (int axis = 0; axis < D; ++axis) {
            Mat<double, D> e{};
            e(axis, axis) = 1e-6;
            const double up = stress<D>(advanced<D>({}, e))(axis, axis);
            const double down = stress<D>(advanced<D>({}, e, -1))(axis, axis);
            EXPECT_NEAR((up - down) / 2e-6, stiffness(), 1e-6 * stiffness());
        }
    }

    template <int D>
    void admissible_range() {
        const auto at = [&](double ratio) {
            Mat<double, D> e{};
            e(0, 0) = ratio - 1;
            const auto s = advanced<D>({}, e);
            // B = b - I is known to the rounding of one, b itself to that over J^2; and B of what
            // is turned inside out is not a number.
            const bool squared = std::strcmp(M::columns[0].name, "B") == 0;
            if (ratio > 0 || !squared) {
                const double bound = squared ? std::max(1e-12, 2e-16 / (ratio * ratio)) : 1e-12;
                EXPECT_NEAR(observe<D>(s).volume_ratio, ratio, bound * std::fabs(ratio));
            }
            return M::template admissible<double, D>(s.r);
        };
        EXPECT_TRUE(at(0.9));
        EXPECT_TRUE(at(1.1));
        EXPECT_FALSE(at(1e-3));
        EXPECT_FALSE(at(-0.5));
        EXPECT_FALSE(at(1e3));
        for (int r = 0; r < M::template reals<D>; ++r) {
            for (double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
                State<double, D> s;
                s.r[r] = bad;
                EXPECT_FALSE((M::template admissible<double, D>(s.r))) << bad << " at " << r;
                // In a pack, as the loops have it, one lane among others.
                using V = Pack<double, 4>;
                V packed[M::template reals<D>];
                for (int k = 0; k < M::template reals<D>; ++k) {
                    const double lane[] = {0, 0, s.r[k], 0};
                    packed[k] = V::load(lane);
                }
                const auto judged = M::template admissible<V, D>(packed);
                EXPECT_FALSE(judged[2]) << bad << " at " << r << " in a pack";
                EXPECT_TRUE(judged[0] && judged[1] && judged[3]);
            }
        }
    }

    /// Same state in both precisions: relative to the largest stress, a few units of single.
    template <int D>
    void single_precision() {
        for (double size : {1e-7, 1e-5, 1e-3, 0.1}) {
            for (int round = 0; round < 100; ++round) {
                const auto drawn = advanced<D>({}, random.template matrix<D>(size));
                State<float, D> single;
                State<double, D> wide;
                for (int r = 0; r < M::template reals<D>; ++r) {
                    wide.r[r] = single.r[r] = float(drawn.r[r]);
                }
                const auto found = stress_in_single<D>(single, M::template constants<float>(q()));
                const auto exact = stress<D>(wide);
                const double scale = M::volumetric ? test::largest<D>(exact) : stiffness() * size;
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) {
                        ASSERT_NEAR(found(a, b), exact(a, b), 4e-6 * scale) << "strain " << size;
                    }
            }
        }
    }

    /// A lane computes what a scalar computes, whatever its neighbours are.
    template <int D>
    void lanes() {
        using V = Pack<float, 8>;
        constexpr int R = M::template reals<D>;
        const auto constants = M::template constants<float>(q());
        for (int round = 0; round < 100; ++round) {
            float column[R][8];
            State<float, D> alone[8];
            for (int l = 0; l < 8; ++l) {
                const auto s =
                    advanced<D>({}, random.template matrix<D>(l < 2 ? 0 : std::pow(10.0, -l)));
                for (int r = 0; r < R; ++r) alone[l].r[r] = column[r][l] = float(s.r[r]);
            }
            V packed[R];
            for (int r = 0; r < R; ++r) packed[r] = V::load(column[r]);
            Mat<V, D> still;
            for (auto& row : still.e)
                for (V& x : row) x = V(0.0f);
            const auto together = M::template kirchhoff<V, D, float>(packed, still, constants);
            const auto good = M::template admissible<V, D>(packed);
            for (int l = 0; l < 8; ++l) {
                EXPECT_TRUE(good[l]);
                const auto one = stress_in_single<D>(alone[l], constants);
                double scale = 0;
                for (auto& row : one.e)
                    for (float x : row) scale = std::fmax(scale, std::fabs(x));
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) {
                        ASSERT_NEAR(together(a, b)[l], one(a, b), 1e-5 * scale) << "lane " << l;
                    }
            }
        }
    }

    /// What a law answers at rest to a strain that comes twice.
    template <class V, int D>
    struct Answer {
        Mat<V, D> stress, rated;
        MaskOf<V> admissible;
    };
    template <class V, int D, class T>
    MPM_INLINE static Answer<V, D> answer(const Mat<V, D>& strain,
                                          const typename M::template Constants<T>& constants) {
        V state[M::template reals<D>];
        for (V& r : state) r = V(T(0));
        Mat<V, D> still;
        for (auto& row : still.e)
            for (V& x : row) x = V(T(0));
        // What is inlined into the functions below is long: once each.
        MPM_NO_UNROLL for (int step = 0; step < 2; ++step)
            M::template advance<V, D, T>(state, strain, constants);
        Answer<V, D> out;
        MPM_NO_UNROLL for (int k = 0; k < 2; ++k) {
            Mat<V, D>& to = k == 0 ? out.stress : out.rated;
            to = M::template kirchhoff<V, D, T>(state, k == 0 ? still : strain, constants);
        }
        out.admissible = M::template admissible<V, D>(state);
        return out;
    }
    // Packs of single precision as the passes over particles are compiled: for any processor, and
    // for those that have more.
    template <class V, int D, class T>
    struct Clones {
        using Constants = typename M::template Constants<T>;
        using Function = void (*)(const Mat<V, D>&, const Constants&, Answer<V, D>&);
        static void plain(const Mat<V, D>& e, const Constants& k, Answer<V, D>& out) {
            out = answer<V, D, T>(e, k);
        }
        static std::vector<Function> all() {
            std::vector<Function> out = {plain};
#if defined(__x86_64__) && !defined(__clang__)
            if constexpr (std::is_same_v<V, Pack<float, 8>>) {
                if (__builtin_cpu_supports("x86-64-v3")) out.push_back(third);
                if (__builtin_cpu_supports("x86-64-v4")) out.push_back(fourth);
            }
#endif
            return out;
        }
#if defined(__x86_64__) && !defined(__clang__)
        __attribute__((target("arch=x86-64-v3"), flatten, noinline)) static void third(
            const Mat<V, D>& e, const Constants& k, Answer<V, D>& out) {
            out = answer<V, D, T>(e, k);
        }
        __attribute__((target("arch=x86-64-v4"), flatten, noinline)) static void fourth(
            const Mat<V, D>& e, const Constants& k, Answer<V, D>& out) {
            out = answer<V, D, T>(e, k);
        }
#endif
    };

    /// What a lane gets does not depend on its neighbours, to the bit: which particles share a pack
    /// depends on how ranks store them.
    template <int D>
    void neighbours_of_lanes() {
        using V = Pack<float, 8>;
        const auto constants = M::template constants<float>(q());
        for (const auto f : Clones<V, D, float>::all())
            for (int round = 0; round < 30; ++round) {
                Mat<V, D> mixed;
                for (int l = 0; l < 8; ++l) {
                    const auto strain = random.template matrix<D>(0.2 * std::pow(10.0, -l));
                    for (int a = 0; a < D; ++a)
                        for (int b = 0; b < D; ++b) mixed.e[a][b].raw[l] = float(strain.e[a][b]);
                }
                Answer<V, D> together, alike;
                f(mixed, constants, together);
                for (int l = 0; l < 8; ++l) {
                    Mat<V, D> same;
                    for (int a = 0; a < D; ++a)
                        for (int b = 0; b < D; ++b) same.e[a][b] = V(mixed.e[a][b][l]);
                    f(same, constants, alike);
                    ASSERT_EQ(together.admissible[l], alike.admissible[l]) << "lane " << l;
                    if (!alike.admissible[l]) continue;
                    for (int a = 0; a < D; ++a)
                        for (int b = 0; b < D; ++b) {
                            ASSERT_EQ(together.stress(a, b)[l], alike.stress(a, b)[l]) << l;
                            ASSERT_EQ(together.rated(a, b)[l], alike.rated(a, b)[l]) << l;
                        }
                }
            }
    }

    /// Strains down to the smallest numbers there are: a wave's forerunner decays through them.
    /// Nothing becomes NaN, and the stress is that of a strain where nothing can vanish, scaled.
    template <class T, int D, class V = T>
    void faint_strains() {
        const auto constants = M::template constants<T>(q());
        const double least = std::numeric_limits<T>::denorm_min();
        constexpr int lanes = NumberTraits<V>::lanes;
        for (int exponent = std::ilogb(least); exponent < -60;
             exponent += sizeof(T) == 4 ? 3 : 29) {
            for (int round = 0; round < 16; ++round) {
                T entry[D][D][lanes];
                Mat<double, D> exact[lanes];
                for (int l = 0; l < lanes; ++l)
                    for (int a = 0; a < D; ++a)
                        for (int b = 0; b < D; ++b) {
                            // Entries may differ by many orders, vanish, and stand beside a lane
                            // in which the material is busy.
                            double x = random.between(-1, 1);
                            if (round % 2) x = std::ldexp(x, -random.integer(0, 80));
                            if (round % 4 == 3 && random.integer(0, 1)) x = 0;
                            x = std::ldexp(x, l % 2 ? -10 : exponent);
                            exact[l](a, b) = entry[a][b][l] = T(x);
                        }
                Mat<V, D> strain;
                for (int a = 0; a < D; ++a)
                    for (int b = 0; b < D; ++b) {
                        if constexpr (lanes == 1)
                            strain(a, b) = entry[a][b][0];
                        else
                            strain(a, b) = V::load(entry[a][b]);
                    }
                for (const auto function : Clones<V, D, T>::all()) {
                    Answer<V, D> found;
                    function(strain, constants, found);
                    for (int l = 0; l < lanes; l += 2) {
                        const auto lane = [&](const auto& x) {
                            if constexpr (lanes == 1)
                                return x;
                            else
                                return x[l];
                        };
                        ASSERT_TRUE(lane(found.admissible)) << "2^" << exponent;
                        const int up = -30 - exponent;
                        Mat<double, D> lifted = exact[l];
                        for (auto& row : lifted.e)
                            for (double& x : row) x = std::ldexp(x, up);
                        const auto expected =
                            stress<D>(advanced<D>(advanced<D>({}, lifted), lifted));
                        const double bound =
                            stiffness() * (1e-5 * test::largest<D>(exact[l]) + 8 * least);
                        for (int a = 0; a < D; ++a)
                            for (int b = 0; b < D; ++b) {
                                ASSERT_TRUE(std::isfinite(double(lane(found.rated(a, b)))));
                                ASSERT_NEAR(double(lane(found.stress(a, b))),
                                            std::ldexp(expected(a, b), -up), bound)
                                    << "2^" << exponent;
                            }
                    }
                }
            }
        }
    }
    template <int D>
    void faint_strains_in_single() {
        this->template faint_strains<float, D>();
    }
    template <int D>
    void faint_strains_in_double() {
        this->template faint_strains<double, D>();
    }
    template <int D>
    void faint_strains_in_lanes() {
        this->template faint_strains<float, D, Pack<float, 8>>();
        this->template faint_strains<double, D, Pack<double, 4>>();
    }
};
TYPED_TEST_SUITE(Materials, Models);

#define MPM_IN_BOTH_DIMENSIONS(property) \
    TYPED_TEST(Materials, property) {    \
        this->template property<2>();    \
        this->template property<3>();    \
    }
MPM_IN_BOTH_DIMENSIONS(stress_is_the_derivative_of_the_energy)
MPM_IN_BOTH_DIMENSIONS(objectivity)
MPM_IN_BOTH_DIMENSIONS(rest)
MPM_IN_BOTH_DIMENSIONS(wave_speed)
MPM_IN_BOTH_DIMENSIONS(admissible_range)
MPM_IN_BOTH_DIMENSIONS(single_precision)
MPM_IN_BOTH_DIMENSIONS(lanes)
MPM_IN_BOTH_DIMENSIONS(neighbours_of_lanes)
MPM_IN_BOTH_DIMENSIONS(faint_strains_in_single)
MPM_IN_BOTH_DIMENSIONS(faint_strains_in_double)
MPM_IN_BOTH_DIMENSIONS(faint_strains_in_lanes)

TYPED_TEST(Materials, table) {
    using M = TypeParam;
    std::set<std::string> names;
    for (const Parameter& p : M::parameters) {
        EXPECT_TRUE(names.insert(p.name).second) << p.name;
        EXPECT_LT(p.lower, p.upper) << p.name;
        EXPECT_NE(std::string(p.meaning), "") << p.name;
        if (std::isnan(p.default_value)) continue;
        EXPECT_TRUE(p.lower_open ? p.default_value > p.lower : p.default_value >= p.lower)
            << p.name;
        EXPECT_TRUE(p.upper_open ? p.default_value < p.upper : p.default_value <= p.upper)
            << p.name;
    }
    int reals[2] = {};
    for (const Column& c : M::columns)
        for (int d = 0; d < 2; ++d) reals[d] += c.components[d];
    EXPECT_EQ(reals[0], M::template reals<2>);
    EXPECT_EQ(reals[1], M::template reals<3>);
    EXPECT_GT(M::density(this->q()), 0);
    EXPECT_GT(M::wave_speed(this->q()), 0);
}

}  // namespace
}  // namespace mpm
