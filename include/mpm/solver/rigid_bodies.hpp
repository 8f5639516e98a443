// The rigid bodies of a scene: what they are, where they are, and what becomes of their motion in a
// step (design/rigid.md). Knows no precision and no grid: who steps hands it points where bodies
// are held, and takes their velocities.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "mpm/physics/rigid.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

/// A node of bodies that are not rigid, which rigid ones meet.
template <int D>
struct FreeNode {
    Vec<double, D> velocity;
    double mass;  // kg
    bool pushed = false;
    Vec<double, D> taken = {};  // what boundaries that hold it take of the impulses, N s
};

enum class RigidHold : int {
    push,   // what is behind the normal is not entered faster than `allowed`; with friction
    stick,  // both move as one
    guide   // along the normal both move as one
};

/// Where a rigid body meets something: a wall, a node of another body, or a rigid body.
template <int D>
struct RigidPoint {
    RigidHold hold = RigidHold::push;
    std::int32_t body = 0;    // rigid, by its number among them
    std::int32_t other = -1;  // another rigid body; -1: none
    std::int32_t free = -1;   // among the free nodes; with neither: a wall
    Vec<double, D> place;     // m
    Vec<double, D> normal;    // from the body outwards
    double allowed = 0;       // m/s that they may approach with
    double static_friction = 0, dynamic_friction = 0;
    Vec<double, D> wall = {};  // velocity of a wall, m/s
    // Velocity of a free node by an impulse, 1/kg: less than 1 / mass where a boundary holds it.
    double along = 0, across = 0;
    // Of whom: a boundary and its face, or a field of velocities and its kind.
    std::int32_t boundary = -1, face = 0, fields[2] = {}, kinds[2] = {};

    Vec<double, D> impulse = {};  // on what is met, minus that on the body, N s
};

/// The slots of a block in which a rigid body may have mass: those of bodies that bend first.
struct RigidBlock {
    std::int32_t first, bending, all;
};
/// Which free node a field's node is.
struct RigidMeeting {
    std::int32_t free, slot;
    int node;
};
/// What a boundary was given at a node, N s.
template <int D>
struct RigidWall {
    std::int32_t boundary, face;
    Vec<double, D> place, impulse;
};

/// How a solution went.
struct RigidSweeps {
    int sweeps = 0;
    double left = 0;  // m/s, the largest change of the last one
};

template <int D>
class RigidBodies {
public:
    struct Body {
        std::string name;
        RigidShape<D> shape;
        RigidState<D> state, next;
        double begun[turns<D>];                     // its orientation at the start
        std::vector<std::array<double, D>> places;  // of particles, by number, from the centre, m
        std::vector<std::uint32_t> outer;           // particles on its surface, by number
        double half = 0;      // of a particle's edge, m: how far its surface is from these
        double furthest = 0;  // of its particles from its centre, m
        std::int32_t field = 0;
        // Of `next`, while points are solved:
        Mat<double, D> axes;
        double spin[spins<D>];
    };

    std::size_t count() const { return bodies_.size(); }
    bool any() const { return !bodies_.empty(); }
    Body& at(std::size_t k) { return bodies_[k]; }
    const Body& at(std::size_t k) const { return bodies_[k]; }

    /// From a body's particles; raises `SceneError` where they cannot be that of a rigid body.
    int add(const BodySpec& spec, const std::vector<double>& position, double density);

    /// `next` of all bodies: the present motion with gravity.
    void begin(const double* gravity, double dt);
    /// Adds what points take and give to `next` and to the free nodes.
    RigidSweeps solve(std::vector<RigidPoint<D>>& points, std::vector<FreeNode<D>>& nodes);
    /// `next` becomes the present, which then moves for a step.
    void advance(std::size_t k, double dt);

    Vec<double, D> next_velocity(std::size_t k, const Vec<double, D>& place) const {
        const Body& b = bodies_[k];
        Vec<double, D> r;
        for (int a = 0; a < D; ++a) r[a] = place[a] - b.state.centre[a];
        return velocity_at<D>(b.next.velocity, b.spin, r);
    }
    /// Orientation since the start: an angle, or a quaternion w, x, y, z with w >= 0.
    std::array<double, turns<D>> orientation(std::size_t k) const;

    static constexpr std::size_t numbers = 2 * D + spins<D> + turns<D> + D + spins<D>;
    std::vector<double> saved(std::size_t k) const;
    void restore(std::size_t k, const std::vector<double>& saved);

private:
    struct Row;
    std::vector<Body> bodies_;
};

}  // namespace mpm
