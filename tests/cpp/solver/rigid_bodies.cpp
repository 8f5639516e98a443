// Rigid bodies alone: inertia, free turns, impulses at points.
#include "mpm/solver/rigid_bodies.hpp"

#include <gtest/gtest.h>

#include "mpm/core/error.hpp"

namespace mpm {
namespace {

/// A box of particles about a middle, `n` a side, of density 500.
template <int D>
BodySpec box_of(const double (&size)[D], int n, std::vector<double>& position,
                std::vector<double> velocity = std::vector<double>(D, 0.0)) {
    std::size_t count = 1;
    double volume = 1;
    for (int a = 0; a < D; ++a) {
        count *= std::size_t(n);
        volume *= size[a];
    }
    for (std::size_t k = 0; k < count; ++k) {
        std::size_t rest = k;
        for (int a = 0; a < D; ++a) {
            position.push_back(1 + size[a] * ((double(rest % std::size_t(n)) + 0.5) / n - 0.5));
            rest /= std::size_t(n);
        }
    }
    BodySpec s;
    s.name = "box";
    s.count = count;
    s.particle_mass = 500 * volume / double(count);
    s.velocity = std::move(velocity);
    s.rigid.given = true;
    return s;
}

TEST(RigidBodies, inertia_of_a_box_is_exact) {
    // Of cubes: all sides in the ratio of the particles.
    std::vector<double> position;
    RigidBodies<2> flat;
    flat.add(box_of<2>({0.4, 0.4}, 5, position), position, 500);
    EXPECT_NEAR(flat.at(0).shape.mass, 80, 1e-12);
    EXPECT_NEAR(flat.at(0).shape.inertia[0], 80 * (0.16 + 0.16) / 12, 1e-12);
    position.clear();
    RigidBodies<3> whole;
    whole.add(box_of<3>({0.3, 0.3, 0.3}, 4, position), position, 500);
    for (int k = 0; k < 3; ++k)
        EXPECT_NEAR(whole.at(0).shape.inertia[k], 500 * 0.027 * 0.18 / 12, 1e-12);
}

TEST(RigidBodies, free_turn_keeps_momentum_and_nearly_energy) {
    std::vector<double> position;
    RigidBodies<3> bodies;
    auto s = box_of<3>({0.3, 0.2, 0.1}, 4, position);
    // About no principal axis: v = w x r.
    const double w[3] = {0.3, 4, -1};
    s.velocity.clear();
    for (std::size_t k = 0; k < position.size(); k += 3) {
        const Vec<double, 3> r{position[k] - 1, position[k + 1] - 1, position[k + 2] - 1};
        const auto v = velocity_at<3>({}, w, r);
        s.velocity.insert(s.velocity.end(), v.e, v.e + 3);
    }
    bodies.add(s, position, 500);
    for (int a = 0; a < 3; ++a) EXPECT_NEAR(bodies.at(0).spin[a], w[a], 1e-12);
    const auto start = bodies.at(0).state;
    const double energy = kinetic_energy<3>(bodies.at(0).shape, start);
    double most = 0;
    for (int step = 0; step < 4000; ++step) {
        const double none[3] = {};
        bodies.begin(none, 2e-3);
        bodies.advance(0, 2e-3);
        for (int a = 0; a < 3; ++a) EXPECT_EQ(bodies.at(0).state.momentum[a], start.momentum[a]);
        most = std::max(
            most, std::abs(kinetic_energy<3>(bodies.at(0).shape, bodies.at(0).state) / energy - 1));
    }
    EXPECT_LT(most, 1e-5);
    EXPECT_GT(most, 0.0);
}

TEST(RigidBodies, wall_stops_a_corner_and_lets_the_body_turn) {
    // A rod that falls flat meets a wall at one end: v of the end is 0, J = M v / 4 (1/(1 + 3)).
    std::vector<double> position;
    RigidBodies<2> bodies;
    auto s = box_of<2>({1.0, 1.0}, 20, position, {0, -2});
    s.rigid.inertia = {500.0 / 12};
    bodies.add(s, position, 500);
    const double none[2] = {};
    bodies.begin(none, 1e-3);
    std::vector<RigidPoint<2>> points(1);
    points[0].place = {1.5, 1.0};
    points[0].normal = {0, -1};
    std::vector<FreeNode<2>> nodes;
    const auto sweeps = bodies.solve(points, nodes);
    EXPECT_LE(sweeps.sweeps, 2);
    EXPECT_NEAR(points[0].impulse[1], -500 * 2 / 4.0, 1e-9);
    EXPECT_NEAR(bodies.next_velocity(0, points[0].place)[1], 0, 1e-12);
    EXPECT_NEAR(bodies.at(0).spin[0], 3.0, 1e-9);
}

TEST(RigidBodies, friction_stays_in_its_cone_and_nothing_pulls) {
    std::vector<double> position;
    RigidBodies<2> bodies;
    bodies.add(box_of<2>({0.4, 0.4}, 5, position, {1, -0.1}), position, 500);
    const double none[2] = {};
    std::vector<FreeNode<2>> nodes;
    for (const double friction : {0.3, 1e30}) {
        bodies.begin(none, 1e-3);
        std::vector<RigidPoint<2>> points(5);
        for (int k = 0; k < 5; ++k) {
            auto& p = points[std::size_t(k)];
            p.place = {0.8 + 0.1 * k, 0.8};
            p.normal = {0, -1};
            p.static_friction = p.dynamic_friction = friction;
        }
        bodies.solve(points, nodes);
        double along = 0, across = 0;
        for (const auto& p : points) {
            EXPECT_LE(p.impulse[1], 0);
            EXPECT_LE(std::abs(p.impulse[0]), friction * std::abs(p.impulse[1]) * (1 + 1e-9));
            along += std::abs(p.impulse[1]);
            across += p.impulse[0];
        }
        if (friction < 1) {
            EXPECT_NEAR(across, friction * along, 1e-9 * along);
        }
        for (const auto& p : points) EXPECT_GT(bodies.next_velocity(0, p.place)[1], -1e-8);
    }
    // What leaves is let go.
    bodies.begin(none, 1e-3);
    std::vector<RigidPoint<2>> points(1);
    points[0].place = {1, 1.2};
    points[0].normal = {0, 1};
    bodies.solve(points, nodes);
    EXPECT_EQ(points[0].impulse[1], 0);
}

TEST(RigidBodies, impulses_are_exchanged_with_nodes) {
    // Stuck to nodes of a fluid: momentum and angular momentum of all.
    std::vector<double> position;
    RigidBodies<3> bodies;
    bodies.add(box_of<3>({0.3, 0.2, 0.1}, 4, position, {1, -2, 0.5}), position, 500);
    const double none[3] = {};
    bodies.begin(none, 1e-3);
    std::vector<RigidPoint<3>> points(6);
    std::vector<FreeNode<3>> nodes(6);
    Vec<double, 3> before{}, after{};
    double turn_before[3] = {}, turn_after[3] = {};
    const auto add = [&](Vec<double, 3>& p, double(&l)[3]) {
        const auto& b = bodies.at(0);
        for (int a = 0; a < 3; ++a) p[a] += b.shape.mass * b.next.velocity[a];
        Vec<double, 3> own;
        for (int a = 0; a < 3; ++a) {
            own[a] = b.shape.mass * b.next.velocity[a];
            l[a] += b.next.momentum[a];
        }
        add_moment<3>(b.state.centre, own, 1, l);
        for (std::size_t k = 0; k < nodes.size(); ++k) {
            Vec<double, 3> of;
            for (int a = 0; a < 3; ++a) {
                of[a] = nodes[k].mass * nodes[k].velocity[a];
                p[a] += of[a];
            }
            add_moment<3>(points[k].place, of, 1, l);
        }
    };
    for (std::size_t k = 0; k < points.size(); ++k) {
        auto& p = points[k];
        p.hold = RigidHold::stick;
        p.free = std::int32_t(k);
        p.place = {0.85 + 0.06 * double(k), 1.1 - 0.03 * double(k * k), 0.95 + 0.02 * double(k)};
        nodes[k].mass = 0.1 * double(k + 1);
        nodes[k].velocity = {0.1 * double(k), 0, -0.2};
        p.along = p.across = 1 / nodes[k].mass;
    }
    add(before, turn_before);
    bodies.solve(points, nodes);
    add(after, turn_after);
    for (int a = 0; a < 3; ++a) {
        EXPECT_NEAR(after[a], before[a], 1e-13);
        EXPECT_NEAR(turn_after[a], turn_before[a], 1e-13);
        for (std::size_t k = 0; k < points.size(); ++k)
            EXPECT_NEAR(nodes[k].velocity[a], bodies.next_velocity(0, points[k].place)[a], 1e-6);
    }
}

TEST(RigidBodies, what_is_held_is_not_moved) {
    std::vector<double> position;
    RigidBodies<2> bodies;
    auto s = box_of<2>({0.4, 0.4}, 5, position, {0.5, 0});
    s.rigid.held = {0};
    s.rigid.held_turn = true;
    bodies.add(s, position, 500);
    const double gravity[2] = {3, -10};
    bodies.begin(gravity, 0.1);
    EXPECT_EQ(bodies.at(0).next.velocity[0], 0.5);
    EXPECT_NEAR(bodies.at(0).next.velocity[1], -1, 1e-15);
    std::vector<RigidPoint<2>> points(1);
    std::vector<FreeNode<2>> nodes;
    points[0].place = {1.2, 0.8};
    points[0].normal = {0.6, -0.8};
    points[0].static_friction = points[0].dynamic_friction = 1;
    bodies.solve(points, nodes);
    EXPECT_EQ(bodies.at(0).next.velocity[0], 0.5);
    EXPECT_EQ(bodies.at(0).spin[0], 0);
    EXPECT_NE(points[0].impulse[1], 0);
}

TEST(RigidBodies, a_velocity_that_shears_is_refused) {
    std::vector<double> position;
    auto s = box_of<2>({0.4, 0.4}, 5, position);
    s.velocity.clear();
    for (std::size_t k = 0; k < position.size(); k += 2) {
        s.velocity.push_back(position[k + 1]);
        s.velocity.push_back(0);
    }
    RigidBodies<2> bodies;
    EXPECT_THROW(bodies.add(s, position, 500), SceneError);
}

}  // namespace
}  // namespace mpm
