// Bodies of elements against closed forms, plane strain: a bar that hits a wall (one-dimensional
// waves at nu = 0), and the first mode of a clamped beam by Timoshenko.
#include <gtest/gtest.h>

#include <cmath>

#include "support/meshes_of_elements.hpp"

namespace mpm {
namespace {

using test::forever;

/// `edge` of elements in cells. A bar of 0.5 x 0.1 m at 1 m/s against a wall: the plateau of the
/// force over v A sqrt(rho E), and the speed after it over that before.
struct Impact {
    double force = 0, rebound = 0;
};
Impact impact(double edge, double cfl, const char* scheme = "APIC", double keep = 1) {
    const double dx = 0.01, L = 0.5, H = 0.1, E = 1e6, rho = 1000, v = 1;
    Spec s = test::empty_scene(2, false, {75, 26}, dx);
    s.cfl = cfl;
    s.transfer.scheme = scheme;
    const auto mesh = test::box_of_elements(
        {2 * dx, 8 * dx}, {L, H},
        {int(std::lround(L / (edge * dx))), int(std::lround(H / (edge * dx)))});
    s.bodies.push_back(
        test::body_of_elements(s, "bar", "FixedCorotated", {rho, E, 0}, mesh, L * H));
    s.bodies[0].velocity = {-v, 0};
    s.bodies[0].keep = keep;
    BoundarySpec wall;
    wall.name = "wall";
    wall.present = {1, 0, 0, 0};
    wall.law.assign(4, {Response::separable, 0, 0});
    wall.end = forever;
    s.boundaries.push_back(wall);
    const auto e = make_cpu_engine(s);
    const auto momentum = [&] {
        const auto sums = e->sums();
        double p = 0;
        for (double x : sums.value.at("momentum_x")) p += x;
        return p;
    };
    const double f = v * H * std::sqrt(rho * E), lasts = 2 * L / std::sqrt(E / rho);
    std::vector<std::array<double, 2>> force;
    double before = momentum(), since = 0;
    while (e->time() < 2 * dx / v + 1.6 * lasts) {
        EXPECT_EQ(e->run(8, forever, forever).reason, "steps");
        const double now = momentum();
        force.push_back({e->time(), (now - before) / (e->time() - since)});
        before = now;
        since = e->time();
    }
    Impact out;
    double began = -1;
    int count = 0;
    for (const auto& [t, x] : force) {
        if (began < 0 && x > f / 2) began = t;
        if (began < 0 || t <= began + 0.25 * lasts || t >= began + 0.75 * lasts) continue;
        out.force += x / f;
        ++count;
    }
    out.force /= count;
    out.rebound = before / (rho * L * H * v);
    return out;
}

TEST(ElementAccuracy, bar_against_a_wall) {
    if (test::sanitized) GTEST_SKIP() << "long runs; elements.cpp has what is in a step";
    const Impact half = impact(0.5, 0.3), whole = impact(1, 0.3);
    RecordProperty("half", std::to_string(half.force) + " " + std::to_string(half.rebound));
    RecordProperty("whole", std::to_string(whole.force) + " " + std::to_string(whole.rebound));
    EXPECT_NEAR(half.force, 1, 0.02);
    EXPECT_GT(half.rebound, 0.93);
    EXPECT_LT(half.rebound, 1);
    EXPECT_NEAR(whole.force, 1, 0.04);
    EXPECT_GT(whole.rebound, 0.87);
}

/// First frequency over Timoshenko's of a beam of 1 x 0.1 m, `cells` high, and what is left of its
/// amplitude after a cycle.
struct Beam {
    double frequency = 0, left = 0;
};
Beam beam(int cells, double edge, double nu, bool vertex_volumes, double offset) {
    const double L = 1, H = 0.1, dx = H / cells, E = 1e6, rho = 1000, tip_speed = 0.05;
    const int wide = int(1.4 * L / dx) + 14, high = int(0.6 * L / dx) + 16;
    Spec s = test::empty_scene(2, false, {wide, high}, dx);
    s.cfl = 0.3;
    const double clamp = (8 + offset) * dx, held = 2 * dx, middle = (high / 2 + 0.2) * dx;
    const auto mesh = test::box_of_elements(
        {clamp - held, middle - H / 2}, {L + held, H},
        {int(std::lround((L + held) / (edge * dx))), int(std::lround(cells / edge))});
    s.bodies.push_back(test::body_of_elements(s, "beam", "FixedCorotated", {rho, E, nu}, mesh,
                                              (L + held) * H, vertex_volumes));
    BodySpec& b = s.bodies[0];
    b.velocity.clear();
    std::vector<std::uint64_t> tip;
    for (std::size_t v = 0; v < mesh.vertices(); ++v) {
        const double q = std::max(0.0, (mesh.vertex[2 * v] - clamp) / L);
        b.velocity.push_back(0);
        b.velocity.push_back(tip_speed * q * q * (3 - q) / 2);
        for (double g : {0.0, 0.0, tip_speed * (3 * q - 1.5 * q * q) / L, 0.0})
            b.velocity_gradient.push_back(g);
        if (q > 1 - 1.01 * dx / L) tip.push_back(v);
    }
    BoundarySpec box;  // the nodes, centres of cells, left of the clamp: a box holds one layer more
    box.name = "clamp";
    box.is_box = true;
    box.lower = {0, 0};
    box.upper = {int(std::floor(clamp / dx - 0.5 + 1e-9)), high};
    box.present.assign(4, 1);
    box.law.assign(4, {Response::sticky, 0, 0});
    box.end = forever;
    s.boundaries.push_back(box);
    const auto e = make_cpu_engine(s);
    const double plane = E / (1 - nu * nu), G = E / (2 * (1 + nu)), r2 = H * H / 12,
                 slender = 1.8751041 * 1.8751041 / (2 * M_PI) * std::sqrt(plane * r2 / rho),
                 f = slender / std::sqrt(1 + 4.65 * r2 * (1 + plane / (5.0 / 6 * G)));
    const auto height = [&] {
        const auto a = e->attributes(0, {"position"});
        double y = 0;
        for (std::size_t k = 0; k < a.id.size(); ++k)
            if (std::binary_search(tip.begin(), tip.end(), a.id[k]))
                y += a.values.at("position").data[2 * k + 1];
        return y / double(tip.size());
    };
    const double rest = height();
    std::vector<double> zero, peak;
    double before = 0, since = 0, most = 0;
    while (e->time() < 3.3 / slender) {
        EXPECT_EQ(e->run(16, forever, forever).reason, "steps");
        const double y = height() - rest, t = e->time();
        if (before < 0 && y >= 0) {
            zero.push_back(t - (t - since) * y / (y - before));
            peak.push_back(most);
            most = 0;
        }
        most = std::max(most, std::abs(y));
        before = y;
        since = t;
    }
    Beam out;
    if (zero.size() < 3) return out;
    out.frequency = double(zero.size() - 1) / (zero.back() - zero[0]) / f;
    out.left = std::pow(peak.back() / peak[1], 1.0 / double(peak.size() - 2));
    return out;
}

/// Of two places in a cell: the spectrum of the grid depends on it by one percent.
Beam mean_beam(int cells, double edge, double nu, bool vertex_volumes) {
    Beam out;
    for (double offset : {0.0, 0.5}) {
        const Beam b = beam(cells, edge, nu, vertex_volumes, offset);
        out.frequency += b.frequency / 2;
        out.left += b.left / 2;
    }
    return out;
}

TEST(ElementAccuracy, clamped_beam) {
    if (test::sanitized) GTEST_SKIP() << "long runs; elements.cpp has what is in a step";
    const Beam half = mean_beam(4, 0.5, 0.3, false), whole = mean_beam(4, 1, 0.3, false);
    RecordProperty("half", std::to_string(half.frequency) + " " + std::to_string(half.left));
    RecordProperty("whole", std::to_string(whole.frequency) + " " + std::to_string(whole.left));
    EXPECT_NEAR(half.frequency, 1, 0.02);
    EXPECT_GT(half.left, 0.99);
    EXPECT_NEAR(whole.frequency, 1, 0.08);
    EXPECT_GT(whole.left, 0.95);
}

}  // namespace
}  // namespace mpm
