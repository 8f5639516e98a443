// Boundaries of any shape: their motion, their distances, their hold on a node, and mirrored
// planes.
#include "mpm/kernels/surface.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "mpm/kernels/boundaries.hpp"
#include "mpm/kernels/sorting.hpp"

namespace mpm {
namespace {

/// Whatever a surface holds touches it.
constexpr auto touches = [](int, int, double, const double (&)[3]) { return 0.0; };

TimeTableView table_of(const std::vector<double>& time, const std::vector<double>& value,
                       TableEnd end) {
    return {time.data(), value.data(), std::int32_t(time.size()),
            std::int32_t(value.size() / time.size()), end};
}

TEST(Motion, speeds_travel_their_integral) {
    const std::vector<double> time = {0.5, 1.5, 2.0}, speed = {1.0, 3.0, -1.0};
    // 0.5 by the first value, then the trapezia.
    const std::vector<double> travelled = {0.5, 2.5, 3.0};
    struct Row {
        TableEnd end;
        double at, place, speed;
    };
    for (const Row& row :
         {Row{TableEnd::hold, 0.25, 0.25, 1.0}, Row{TableEnd::hold, 1.0, 1.25, 2.0},
          Row{TableEnd::hold, 1.75, 2.5 + 0.25 * 2.0, 1.0}, Row{TableEnd::hold, 3.0, 2.0, -1.0},
          Row{TableEnd::zero, 3.0, 3.0, 0.0}, Row{TableEnd::repeat, 2.5, 3.0 + 0.75, 2.0}}) {
        const MotionView motion{table_of(time, speed, row.end), travelled.data()};
        double place, now;
        motion.at(row.at, &place, &now);
        EXPECT_NEAR(place, row.place, 1e-14) << row.at;
        EXPECT_NEAR(now, row.speed, 1e-14) << row.at;
    }
}

TEST(Motion, places_have_the_slope_as_speed) {
    const std::vector<double> time = {0, 2}, place = {1, 0, 5, -2};
    const MotionView motion{table_of(time, place, TableEnd::hold), nullptr};
    double x[2], v[2];
    motion.at(1, x, v);
    EXPECT_DOUBLE_EQ(x[0], 3);
    EXPECT_DOUBLE_EQ(v[1], -1);
    motion.at(5, x, v);
    EXPECT_DOUBLE_EQ(x[0], 5);
    EXPECT_DOUBLE_EQ(v[0], 0);
}

TEST(Decay, is_one_on_the_surface_and_falls_to_zero) {
    for (Decay d : {Decay::linear, Decay::quadratic, Decay::flipped, Decay::cosine}) {
        EXPECT_DOUBLE_EQ(decayed(d, -1), 1);
        EXPECT_DOUBLE_EQ(decayed(d, 0), 1);
        EXPECT_DOUBLE_EQ(decayed(d, 1), 0);
        for (double r = 0; r < 0.95; r += 0.1) EXPECT_GT(decayed(d, r), decayed(d, r + 0.1));
    }
    EXPECT_DOUBLE_EQ(decayed(Decay::cosine, 0.5), 0.5);
    EXPECT_DOUBLE_EQ(decayed(Decay::quadratic, 0.25), 0.5625);
    EXPECT_DOUBLE_EQ(decayed(Decay::constrained, 1), 1);
    EXPECT_DOUBLE_EQ(decayed(Decay::constrained, 1.01), 0);
    EXPECT_DOUBLE_EQ(decayed(Decay::free, 0.5), 0);
}

/// The half-space below a plane through `point`, distances of one block.
struct Plane {
    std::vector<std::uint64_t> keys = {0};
    std::vector<std::int32_t> place = {0};
    std::vector<float> value = std::vector<float>(DistanceField<3>::corners);
    SurfaceRecord<3> record{};

    Plane(const Vec<double, 3>& normal, double offset, double spacing) {
        constexpr int n = DistanceField<3>::edge + 1;
        for (int i = 0; i < n; ++i)
            for (int j = 0; j < n; ++j)
                for (int k = 0; k < n; ++k)
                    value[std::size_t((i * n + j) * n + k)] =
                        float((normal[0] * i + normal[1] * j + normal[2] * k) - offset / spacing);
        record.field = {keys.data(), place.data(), value.data(), 1,
                        {0, 0, 0},   {1, 1, 1},    {0, 0, 0},    1 / spacing};
        record.decay = Decay::quadratic;
        record.thickness = spacing;
        record.axis[2] = 1;
        record.set(0);
    }
};

TEST(DistanceField, a_plane_is_exact_everywhere) {
    const Vec<double, 3> n = {{0.6, 0.0, 0.8}};
    const Plane plane(n, 0.5, 0.25);
    for (double x = 0.01; x < 2; x += 0.37) {
        const double at[3] = {x, 1.9 - x / 2, 0.3 + x / 3};
        double distance, normal[3];
        ASSERT_TRUE(plane.record.field.at(at, distance, normal));
        EXPECT_NEAR(distance, n[0] * at[0] + n[2] * at[2] - 0.5, 1e-6);
        for (int a = 0; a < 3; ++a) EXPECT_NEAR(normal[a], n[a], 1e-6);
    }
    const double outside[3] = {-0.01, 0, 0};
    double distance, normal[3];
    EXPECT_FALSE(plane.record.field.at(outside, distance, normal));
}

TEST(Surface, slip_takes_the_share_of_the_normal_part) {
    const Vec<double, 3> n = {{0.6, 0.0, 0.8}};
    const Plane plane(n, 0.5, 0.25);
    SurfaceLaw law;
    law.response = Response::slip;
    // Half a layer off: (1 - 1/2)^2 of the normal velocity goes.
    const double x[3] = {0.6 * 0.625, 1.0, 0.8 * 0.625};
    Vec<double, 3> v = {{1.0, 2.0, -3.0}};
    const double along = 0.6 - 2.4;
    ASSERT_TRUE((respond_to_surface<double, 3>(plane.record, law, x, {}, {}, 1.0, v, touches)));
    EXPECT_NEAR(v[0], 1.0 - 0.25 * along * 0.6, 1e-6);
    EXPECT_NEAR(v[1], 2.0, 1e-12);
    EXPECT_NEAR(v[2], -3.0 - 0.25 * along * 0.8, 1e-6);
}

TEST(Surface, turns_and_carries_its_face_along) {
    const Vec<double, 3> n = {{0.0, 0.0, 1.0}};
    Plane plane(n, 1.0, 0.25);  // below z = 1
    const std::vector<double> time = {0, 1}, angle = {0, std::acos(-1.0) / 2};
    plane.record.turn = {table_of(time, angle, TableEnd::hold), nullptr};
    plane.record.axis[0] = 1;  // about x: z goes to -y
    plane.record.axis[2] = 0;
    for (double& a : plane.record.about) a = 1;
    plane.record.set(1.0 - 1e-12);
    // What was the plane z = 1 through the fulcrum is y = 1, its normal -y; inside is y > 1.
    const double x[3] = {1.2, 1.25, 1.3};
    double own[3], wall[3];
    plane.record.to_body(x, own);
    EXPECT_NEAR(own[2], 0.75, 1e-9);
    plane.record.velocity_at(x, wall);
    const double rate = std::acos(-1.0) / 2;
    EXPECT_NEAR(wall[0], 0, 1e-12);
    EXPECT_NEAR(wall[1], -rate * 0.3, 1e-9);
    EXPECT_NEAR(wall[2], rate * 0.25, 1e-9);
    SurfaceLaw sticky;
    sticky.response = Response::sticky;
    Vec<double, 3> v = {{5.0, 5.0, 5.0}};
    ASSERT_TRUE((respond_to_surface<double, 3>(plane.record, sticky, x, {}, {}, 1.0, v, touches)));
    EXPECT_NEAR(v[1], wall[1], 1e-9);
}

TEST(Response, along_an_axis_both_forms_agree) {
    SurfaceLaw law;
    for (Response r : {Response::sticky, Response::slip, Response::separable}) {
        law.response = r;
        for (double mu : {0.0, 0.3, 2.0}) {
            law.static_friction = law.dynamic_friction = mu;
            for (double into : {-1.0, 0.5}) {
                const Vec<double, 3> v = {{0.3, into, -0.7}}, wall = {{0.1, 0.2, 0.0}};
                const Vec<double, 3> a = respond(law, 1, 1.0, v, wall);
                const Vec<double, 3> b = respond_along(law, Vec<double, 3>{{0, 1, 0}}, v, wall);
                for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[c], b[c], 1e-15);
            }
        }
    }
}

TEST(Surface, every_block_with_nodes_near_it_is_touched) {
    // Blocks of grid and lattice coincide, so rounding decides on which side their edges lie.
    for (double h : {0.1, 0.02, 0.01, 0.003}) {
        for (std::int64_t block = 0; block < 130; ++block) {
            const std::uint64_t field_key = 0;
            const std::int32_t place = 0;
            const std::vector<float> value(DistanceField<2>::corners, 0.0f);
            SurfaceRecord<2> record{};
            record.field = {&field_key, &place, value.data(), 1, {block, 0}, {1, 1}, {0, 0}, 1 / h};
            BlockTableView<2> table{};
            for (auto& n : table.keys_of.counts) n = 140;
            const std::int64_t at[2] = {block, 0};
            const std::uint64_t key = table.keys_of.key(at);
            table.keys = &key;
            table.slots = 1;
            BoundaryRecord<2> r{};
            r.surface = 1;
            r.upper[0] = r.upper[1] = 8 * 140;
            std::uint32_t touched = 0;
            TouchBoundaries<2>{table, &r, 1, &record, h, &touched}(0);
            EXPECT_EQ(touched, 1u) << h << " " << block;
        }
    }
}

/// Mirrored walls of a domain of 8 x 8 cells.
BoundaryRecord<2> mirrors_all_round() {
    BoundaryRecord<2> walls{};
    walls.active = 1;
    for (int a = 0; a < 2; ++a) walls.upper[a] = 8;
    for (int f = 0; f < 4; ++f) {
        walls.present[f] = 1;
        walls.law[f].response = Response::mirror;
    }
    return walls;
}

TEST(Images, of_a_corner_are_four_and_reflect) {
    const BoundaryRecord<2> walls = mirrors_all_round();
    const BoundaryView<2> view{&walls, 1, nullptr, 1.0, 1};
    const std::int64_t corner[2] = {-1, 8};
    const Images<2> images(view, corner);
    ASSERT_TRUE(images.mirrored);
    EXPECT_EQ(images.inside[0], 0);
    EXPECT_EQ(images.inside[1], 7);
    EXPECT_EQ(images.sign[0], -1);
    EXPECT_EQ(images.sign[1], -1);
    int seen = 0;
    images.each([&](const std::int64_t(&cell)[2], const double(&sign)[2]) {
        ++seen;
        EXPECT_EQ(sign[0], cell[0] < 0 ? -1 : 1);
        EXPECT_EQ(sign[1], cell[1] > 7 ? -1 : 1);
    });
    EXPECT_EQ(seen, 4);
    const std::int64_t middle[2] = {3, 4};
    EXPECT_FALSE(Images<2>(view, middle).mirrored);
}

TEST(Images, apart_across_an_axis_share_along_the_other) {
    const BoundaryRecord<2> walls = mirrors_all_round();
    const BoundaryView<2> view{&walls, 1, nullptr, 1.0, 1};
    for (const std::int64_t y : {-1, 0}) {
        const std::int64_t cell[2] = {7, y};
        Images<2> images(view, cell);
        images.part(1, y);
        std::vector<std::int64_t> seen;
        images.each([&](const std::int64_t(&at)[2], const double(&)[2]) {
            EXPECT_EQ(at[1], y);
            seen.push_back(at[0]);
        });
        EXPECT_EQ(seen, (std::vector<std::int64_t>{7, 8}));
    }
}

}  // namespace
}  // namespace mpm
