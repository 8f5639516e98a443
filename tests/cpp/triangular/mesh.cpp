// Triangulations: neighbours, location of points, and what is refused.
#include "mpm/triangular/mesh.hpp"

#include <gtest/gtest.h>

#include "mpm/core/error.hpp"
#include "triangular/meshes.hpp"

namespace mpm::triangular {
namespace {

std::string refusal(std::vector<Point> vertices, std::vector<std::array<int, 3>> triangles) {
    try {
        Mesh mesh(std::move(vertices), std::move(triangles));
    } catch (const SceneError& e) {
        return e.what();
    }
    return "";
}

TEST(Mesh, edges_and_corners_fit_together) {
    const auto mesh = perturbed(7, 3);
    int outer = 0;
    double area = 0;
    for (int t = 0; t < int(mesh->triangles().size()); ++t) area += mesh->area(t);
    for (const auto& e : mesh->edges()) {
        outer += e.outer();
        for (const auto& s : e.sides) {
            if (s.triangle < 0) continue;
            const auto& v = mesh->triangles()[std::size_t(s.triangle)];
            const int a = v[std::size_t(s.side)], b = v[std::size_t((s.side + 1) % 3)];
            EXPECT_EQ(std::min(a, b), e.vertex[0]);
            EXPECT_EQ(std::max(a, b), e.vertex[1]);
        }
    }
    EXPECT_NEAR(area, 1, 1e-12);
    EXPECT_EQ(outer, 24);
    // Euler: vertices - edges + triangles = 1.
    EXPECT_EQ(
        int(mesh->vertices().size()) - int(mesh->edges().size()) + int(mesh->triangles().size()),
        1);
}

TEST(Mesh, finds_points_from_any_guess) {
    const auto mesh = turned(*perturbed(9, 2), 0.7);
    test::Random random(1);
    for (int n = 0; n < 2000; ++n) {
        const int t = random.integer(0, int(mesh->triangles().size()) - 1);
        const auto c = mesh->corners(t);
        double a = random.between(0.01, 0.49), b = random.between(0.01, 0.49);
        const Point x = a * c[0] + b * c[1] + (1 - a - b) * c[2];
        EXPECT_EQ(mesh->locate(x, random.integer(-2, 200)), t);
    }
    EXPECT_EQ(mesh->locate(Point(-5, 3), 0), -1);
    EXPECT_EQ(mesh->locate(Point(std::nan(""), 0), 0), -1);
}

TEST(Mesh, walks_around_a_corner_that_sticks_in) {
    // An L: the straight way between its ends leads outside.
    const Mesh mesh({{0, 0}, {1, 0}, {2, 0}, {0, 1}, {1, 1}, {2, 1}, {0, 2}, {1, 2}},
                    {{0, 1, 4}, {0, 4, 3}, {1, 2, 5}, {1, 5, 4}, {3, 4, 7}, {3, 7, 6}});
    EXPECT_EQ(mesh.locate(Point(0.2, 1.9), 2), 5);
    EXPECT_EQ(mesh.locate(Point(1.5, 1.5), 2), -1);
}

TEST(Mesh, turns_and_refuses) {
    const std::vector<Point> square = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    const Mesh clockwise(square, {{0, 2, 1}, {0, 2, 3}});
    EXPECT_GT(clockwise.area(0), 0);
    EXPECT_NE(refusal(square, {}).find("no triangle"), std::string::npos);
    EXPECT_NE(refusal(square, {{0, 1, 7}}).find("no vertex 7; expected 0 to 3"), std::string::npos);
    EXPECT_NE(refusal(square, {{0, 1, 2}}).find("no triangle uses vertex 3"), std::string::npos);
    EXPECT_NE(refusal({{0, 0}, {1, 0}, {2, 0}}, {{0, 1, 2}}).find("no area"), std::string::npos);
    EXPECT_NE(refusal({{0, 0}, {1, 0}, {0, 1}, {1, 1}, {1, 2}}, {{0, 1, 2}, {1, 2, 3}, {1, 2, 4}})
                  .find("already has two triangles"),
              std::string::npos);
    EXPECT_NE(refusal({{0, 0}, {1, std::nan("")}, {0, 1}}, {{0, 1, 2}}).find("vertex 1 is not"),
              std::string::npos);
}

}  // namespace
}  // namespace mpm::triangular
