// What a wall does to a node: closed forms, friction limits, and the sign of the work.
#include "mpm/physics/boundary/response.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "mpm/core/number.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

using V3 = Vec<double, 3>;
constexpr Response kinds[] = {Response::sticky, Response::slip, Response::separable};

void expect_same(const V3& a, const V3& b) {
    for (int k = 0; k < 3; ++k) EXPECT_DOUBLE_EQ(a[k], b[k]) << "component " << k;
}

TEST(ResponseLaw, without_friction) {
    const V3 wall = {{0.5, -1, 2}}, toward = {{-2, 3, 4}}, away = {{2, 3, 4}};
    const auto at = [&](Response r, const V3& v) {
        return respond<double, 3>({r, 0, 0}, 0, 1.0, v, wall);
    };
    expect_same(at(Response::sticky, toward), wall);
    expect_same(at(Response::sticky, away), wall);
    expect_same(at(Response::slip, toward), {{0.5, 3, 4}});
    expect_same(at(Response::slip, away), {{0.5, 3, 4}});
    expect_same(at(Response::separable, toward), {{0.5, 3, 4}});
    expect_same(at(Response::separable, away), away);
    // Moves with the wall: neither approaches nor leaves.
    expect_same(at(Response::separable, {{0.5, 3, 4}}), {{0.5, 3, 4}});
    // Positive velocity, but the wall is faster.
    expect_same(at(Response::separable, {{0.25, 3, 4}}), {{0.5, 3, 4}});
}

TEST(ResponseLaw, normal_may_point_down_any_axis) {
    const V3 still = {{0, 0, 0}};
    for (int axis = 0; axis < 3; ++axis) {
        for (double sign : {1.0, -1.0}) {
            V3 v = {{1, 1, 1}};
            v[axis] = -3 * sign;  // against the normal
            V3 expected = v;
            expected[axis] = 0;
            expect_same(respond<double, 3>({Response::separable, 0, 0}, axis, sign, v, still),
                        expected);
            v[axis] = 3 * sign;
            expect_same(respond<double, 3>({Response::separable, 0, 0}, axis, sign, v, still), v);
        }
    }
}

TEST(ResponseLaw, dynamic_friction_takes_its_share_of_the_removed_speed) {
    const V3 wall = {{0, 0, 0}}, v = {{-2, 3, 4}};  // tangential speed 5
    const auto out = respond<double, 3>({Response::slip, 0.3, 0.25}, 0, 1.0, v, wall);
    expect_same(out, {{0, 3 * 0.9, 4 * 0.9}});  // 5 - 0.25 * 2 = 4.5
}

TEST(ResponseLaw, static_friction_holds_below_its_limit) {
    const V3 wall = {{1, 2, 3}};
    const SurfaceLaw law = {Response::separable, 0.5, 0.2};
    expect_same(respond<double, 3>(law, 0, 1.0, {{-9, 2 + 3, 3 + 3.9}}, wall), wall);   // 4.92 <= 5
    const auto slides = respond<double, 3>(law, 0, 1.0, {{-9, 2 + 3, 3 + 4.1}}, wall);  // 5.08 > 5
    EXPECT_GT(slides[1], 2);
    const double speed = std::hypot(3, 4.1);
    EXPECT_DOUBLE_EQ(std::hypot(slides[1] - 2, slides[2] - 3), speed - 0.2 * 10);
}

TEST(ResponseLaw, huge_friction_stops_without_turning_back) {
    const V3 wall = {{0, 1, 0}};
    for (double mu : {1e3, 1e30, 1e300}) {
        for (bool is_static : {true, false}) {
            const SurfaceLaw law = {Response::slip, is_static ? mu : 0, is_static ? 0 : mu};
            expect_same(respond<double, 3>(law, 0, 1.0, {{-1, 5, -7}}, wall), wall);
        }
    }
}

TEST(ResponseLaw, no_pressure_no_friction) {
    const V3 wall = {{0, 0, 0}};
    const SurfaceLaw rough = {Response::slip, 2, 1};
    expect_same(respond<double, 3>(rough, 0, 1.0, {{3, 5, -7}}, wall),
                {{0, 5, -7}});  // pulled back
    expect_same(respond<double, 3>(rough, 0, 1.0, {{0, 5, -7}}, wall), {{0, 5, -7}});
    expect_same(respond<double, 3>({Response::separable, 2, 1}, 0, 1.0, {{3, 5, -7}}, wall),
                {{3, 5, -7}});
    expect_same(respond<double, 3>(rough, 0, 1.0, {{-1, 0, 0}}, wall), wall);  // nothing to brake
}

template <class T, int D>
void check_work() {
    test::Random random(17);
    const double slack = sizeof(T) == 4 ? 1e-4 : 1e-12;
    for (int round = 0; round < 50000; ++round) {
        Vec<T, D> v, wall;
        for (int a = 0; a < D; ++a) {
            v[a] = T(random.between(-3, 3));
            wall[a] = round % 2 ? T(random.between(-3, 3)) : T(0);
        }
        const double dynamic = round % 5 ? random.between(0, 2) : 0;
        const SurfaceLaw law = {kinds[round % 3], round % 7 ? dynamic + random.between(0, 1) : 0,
                                dynamic};
        const int axis = round % D;
        const T sign = random.between(-1, 1) < 0 ? T(-1) : T(1);
        const auto out = respond<T, D>(law, axis, sign, v, wall);
        double before = 0, after = 0, along = 0;
        for (int a = 0; a < D; ++a) {
            before += double(v[a] - wall[a]) * (v[a] - wall[a]);
            after += double(out[a] - wall[a]) * (out[a] - wall[a]);
            if (a != axis) along += double(out[a] - wall[a]) * (v[a] - wall[a]);
        }
        ASSERT_LE(after, before * (1 + slack) + slack) << "energy in the wall's frame grew";
        ASSERT_GE(along, -slack) << "friction turned the tangential velocity round";
        ASSERT_GE((out[axis] - wall[axis]) * sign, T(0)) << "still moving into the wall";
        // The same in a frame that moves along.
        Vec<T, D> shifted, rest;
        for (int a = 0; a < D; ++a) {
            shifted[a] = v[a] - wall[a];
            rest[a] = 0;
        }
        const auto relative = respond<T, D>(law, axis, sign, shifted, rest);
        for (int a = 0; a < D; ++a) ASSERT_NEAR(out[a], relative[a] + wall[a], slack);
    }
}

TEST(ResponseLaw, never_adds_energy) {
    check_work<float, 2>();
    check_work<float, 3>();
    check_work<double, 2>();
    check_work<double, 3>();
}

}  // namespace
}  // namespace mpm
