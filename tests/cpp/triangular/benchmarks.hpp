// The bar and the column of de Koster (2018), chapters 4 and 5, on rectangles of blocks.
#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <numbers>

#include "mpm/physics/material/hypoelastic.hpp"
#include "mpm/triangular/lagrange.hpp"
#include "mpm/triangular/method.hpp"
#include "mpm/triangular/powell_sabin.hpp"
#include "triangular/meshes.hpp"

namespace mpm::triangular {

struct Case {
    bool splines = true;
    int columns = 1, rows = 1;      // blocks
    int across = 1, up = 1;         // particles a block
    double width = 25, height = 2;  // of the blocks that hold material
    double density = 1, young = 100, poisson = 0;
    MassOptions mass;
    int empty_rows = 0;  // blocks above the material
};

/// Regular particles over the blocks, at rest and without stress.
inline std::unique_ptr<Method> rectangle(const Case& c) {
    const double all = c.height * (c.rows + c.empty_rows) / c.rows;
    const auto mesh = blocks(c.columns, c.rows + c.empty_rows, c.width, all);
    std::unique_ptr<Basis> basis;
    if (c.splines)
        basis = std::make_unique<PowellSabin>(mesh);
    else
        basis = std::make_unique<Lagrange>(mesh, 1);
    auto method = std::make_unique<Method>(std::move(basis), c.mass, 2);
    Particles body;
    body.name = "body";
    const double parameters[] = {c.density, c.young, c.poisson};
    body.law = std::make_unique<LawOf<Hypoelastic>>(parameters);
    const int nx = c.columns * c.across, ny = c.rows * c.up;
    for (int j = 0; j < ny; ++j)
        for (int i = 0; i < nx; ++i) {
            body.id.push_back(body.id.size());
            body.position.emplace_back((i + 0.5) * c.width / nx, (j + 0.5) * c.height / ny);
        }
    const std::size_t n = body.count();
    body.velocity.assign(n, Point(0, 0));
    body.displacement.assign(n, Point(0, 0));
    body.volume.assign(n, c.width * c.height / double(n));
    body.mass.assign(n, c.density * c.width * c.height / double(n));
    body.state.assign(n * std::size_t(body.law->reals()), 0.0);
    method->bodies().push_back(std::move(body));
    method->start();
    return method;
}

/// Outer edges with a normal in this direction.
inline std::vector<int> side(const Basis& basis, const Point& normal) {
    std::vector<int> out;
    for (int e = 0; e < int(basis.outline().size()); ++e)
        if ((basis.outline()[std::size_t(e)].normal - normal).norm() < 1e-9) out.push_back(e);
    return out;
}

/// Ends held, sides slip: the bar of section 4.1.
inline std::unique_ptr<Method> bar(Case c, double speed) {
    auto method = rectangle(c);
    const Basis& b = method->basis();
    method->hold({{side(b, {-1, 0}), false},
                  {side(b, {1, 0}), false},
                  {side(b, {0, -1}), true},
                  {side(b, {0, 1}), true}});
    Particles& p = method->bodies()[0];
    for (std::size_t k = 0; k < p.count(); ++k)
        p.velocity[k][0] = speed * std::sin(std::numbers::pi * p.position[k][0] / c.width);
    return method;
}

/// Foot held, sides slip: the column of section 4.3.
inline std::unique_ptr<Method> column(const Case& c) {
    auto method = rectangle(c);
    const Basis& b = method->basis();
    method->hold({{side(b, {0, -1}), false}, {side(b, {-1, 0}), true}, {side(b, {1, 0}), true}});
    return method;
}

/// Steps to `until`; `look` is called after each. False with the time where it ended early.
struct Course {
    double time = 0;
    std::string trouble;
};
inline Course run(Method& method, double dt, double until, const Point& gravity,
                  const std::function<void(double)>& look = nullptr) {
    Course course;
    const auto holds = method.impulses().size();
    const Surroundings around{gravity, std::vector<Point>(holds, Point(0, 0)),
                              std::vector<Point>(holds, Point(0, 0))};
    const long steps = std::lround(until / dt);
    for (long n = 0; n < steps; ++n) {
        for (const auto& gone : method.relocate())
            if (!gone.empty()) course.trouble = "left-domain";
        if (!course.trouble.empty()) return course;
        auto trouble = method.prepare(course.time, gravity);
        if (!trouble && n % 4 == 0 && method.stable_step(n == 0) < dt)
            trouble = Trouble{"unstable-step", 0, {}, 0, 0, ""};
        if (!trouble) trouble = method.step(dt, around);
        if (trouble) {
            course.trouble = trouble->code;
            return course;
        }
        course.time = double(n + 1) * dt;
        if (look) look(course.time);
    }
    return course;
}

}  // namespace mpm::triangular
