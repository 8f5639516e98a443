// One step of the method: identities between its sums, momentum, stability limits, reactions.
#include "mpm/triangular/method.hpp"

#include <gtest/gtest.h>

#include "support/random.hpp"
#include "triangular/benchmarks.hpp"

namespace mpm::triangular {
namespace {

using Eigen::VectorXd;

/// Random particles with random velocities and stresses on a random mesh, nothing held.
std::unique_ptr<Method> cloud(bool splines, const MassOptions& mass, int rows_filled = 6) {
    const auto mesh = perturbed(7, 2);
    std::unique_ptr<Basis> basis;
    if (splines)
        basis = std::make_unique<PowellSabin>(mesh);
    else
        basis = std::make_unique<Lagrange>(mesh, 1);
    auto method = std::make_unique<Method>(std::move(basis), mass, 2);
    Particles body;
    const double parameters[] = {1000, 1e6, 0.3};
    body.law = std::make_unique<LawOf<Hypoelastic>>(parameters);
    test::Random random(11);
    for (int n = 0; n < 4000; ++n) {
        body.id.push_back(std::uint64_t(n));
        body.position.emplace_back(random.between(0, 1), random.between(0, rows_filled / 6.0));
        body.velocity.emplace_back(random.between(-1, 1), random.between(-1, 1));
        body.mass.push_back(random.between(0.5, 1.5));
        body.volume.push_back(body.mass.back() / 1000);
        for (int r = 0; r < 5; ++r) body.state.push_back(r < 3 ? random.between(-1e4, 1e4) : 0);
    }
    body.displacement.assign(4000, Point(0, 0));
    method->bodies().push_back(std::move(body));
    method->start();
    method->relocate();
    return method;
}

Point momentum(const Method& m) {
    Point sum(0, 0);
    const Particles& b = m.bodies()[0];
    for (std::size_t p = 0; p < b.count(); ++p) sum += b.mass[p] * b.velocity[p];
    return sum;
}

// With the consistent matrix the projected new velocity is the old projection plus dt times the
// acceleration: "modified update" and "update stress last" coincide. With a lumped one they differ.
TEST(TriangularMethod, modified_update_is_update_stress_last_when_consistent) {
    for (bool splines : {false, true}) {
        for (MassForm form : {MassForm::consistent, MassForm::lumped}) {
            MassOptions mass;
            mass.form = form;
            const auto m = cloud(splines, mass);
            ASSERT_FALSE(m->prepare(0, Point(0, -9.81)));
            const VectorXd before = m->velocity_field({});
            const double dt = 1e-5;
            ASSERT_FALSE(m->step(dt, {Point(0, -9.81), {}, {}}));
            const VectorXd expected = before + dt * m->last_acceleration();
            const double off = (m->last_velocity() - expected).cwiseAbs().maxCoeff() /
                               m->last_velocity().cwiseAbs().maxCoeff();
            if (form == MassForm::consistent)
                EXPECT_LT(off, 1e-11);
            else
                EXPECT_GT(off, 1e-4);
        }
    }
}

TEST(TriangularMethod, momentum_gained_is_the_impulse) {
    for (bool splines : {false, true}) {
        for (MassForm form : {MassForm::consistent, MassForm::lumped, MassForm::partial_symmetric,
                              MassForm::partial_rows}) {
            MassOptions mass;
            mass.form = form;
            // Particles that fill no more than a part of a triangle leave nothing to solve for.
            const bool partial = form != MassForm::consistent && form != MassForm::lumped;
            const auto m = cloud(splines, mass, partial ? 4 : 6);
            ASSERT_FALSE(m->prepare(0, Point(3, -9.81)));
            const Point before = momentum(*m);
            double weight = 0;
            for (double x : m->bodies()[0].mass) weight += x;
            const double dt = 1e-6;
            ASSERT_FALSE(m->step(dt, {Point(3, -9.81), {}, {}}));
            const Point impulse = dt * weight * Point(3, -9.81);
            const double off = (momentum(*m) - before - impulse).norm() / impulse.norm();
            if (form == MassForm::partial_rows)
                EXPECT_GT(off, 1e-6);  // rows alone do not keep it
            else
                EXPECT_LT(off, 1e-9);
        }
    }
}

TEST(TriangularMethod, row_sums_are_the_functions_masses) {
    const auto m = cloud(true, {});
    ASSERT_FALSE(m->prepare(0, Point(0, 0)));
    const VectorXd ones = VectorXd::Ones(2 * m->basis().functions());
    const VectorXd sums = m->mass().times(ones), masses = m->function_masses();
    double all = 0;
    for (Eigen::Index f = 0; f < masses.size(); ++f) {
        EXPECT_NEAR(sums[2 * f], masses[f], 1e-12 * masses.maxCoeff());
        all += masses[f];
    }
    double weight = 0;
    for (double x : m->bodies()[0].mass) weight += x;
    EXPECT_NEAR(all, weight, 1e-10 * weight);
}

TEST(TriangularMethod, solvers_agree) {
    VectorXd direct;
    for (Solver solver : {Solver::direct, Solver::conjugate_gradients, Solver::richardson}) {
        MassOptions mass;
        mass.solver = solver;
        mass.tolerance = 1e-11;
        mass.iterations = 20000;
        const auto m = cloud(false, mass);
        ASSERT_FALSE(m->prepare(0, Point(0, -9.81)));
        const VectorXd field = m->velocity_field({});
        if (solver == Solver::direct)
            direct = field;
        else
            EXPECT_LT((field - direct).cwiseAbs().maxCoeff(), 1e-8) << int(solver);
        EXPECT_EQ(m->mass().iterations() > 0, solver != Solver::direct);
    }
}

// 2 / omega_max of the cases of the digest's section 3.6.
TEST(TriangularMethod, stable_steps_are_those_of_the_systems) {
    struct Row {
        bool splines, column;
        int columns, rows;
        MassForm form;
        double expected;  // s, three digits
    };
    const Row table[] = {{false, false, 12, 1, MassForm::consistent, 5.57e-2},
                         {false, false, 12, 1, MassForm::lumped, 1.12e-1},
                         {true, false, 4, 1, MassForm::consistent, 4.59e-2},
                         {true, false, 12, 1, MassForm::consistent, 3.81e-2},
                         {true, false, 12, 1, MassForm::lumped, 1.05e-1},
                         {false, true, 2, 16, MassForm::consistent, 1.49e-3},
                         {true, true, 1, 8, MassForm::consistent, 1.83e-3},
                         {true, true, 2, 16, MassForm::consistent, 9.94e-4},
                         {true, true, 2, 16, MassForm::lumped, 2.62e-3}};
    for (const Row& r : table) {
        Case c;
        c.splines = r.splines;
        c.columns = r.columns;
        c.rows = r.rows;
        c.across = r.column ? 6 : 16;
        c.up = r.column ? 8 : 14;
        c.mass.form = r.form;
        if (r.column) {
            c.width = 2;
            c.height = 25;
            c.young = 5e4;
        }
        const auto m = r.column ? column(c) : bar(c, 0.1);
        m->relocate();
        ASSERT_FALSE(m->prepare(0, Point(0, 0)));
        EXPECT_NEAR(m->stable_step(true) / r.expected, 1, 5e-3)
            << r.columns << " x " << r.rows << (r.splines ? " splines" : " linear");
        EXPECT_NEAR(m->stable_step(false) / r.expected, 1, 5e-3);  // goes on from where it was
    }
}

TEST(TriangularMethod, a_held_foot_feels_the_weight) {
    Case c;
    c.columns = 1;
    c.rows = 2;
    c.across = c.up = 8;
    c.width = 2;
    c.height = 4;
    c.density = 1000;
    c.young = 1e6;
    c.poisson = 0.3;
    auto m = column(c);
    m->measure_loads(true);
    // The stress that carries the weight, with the sides held as they are.
    Particles& body = m->bodies()[0];
    const double side = 0.3 / 0.7;
    for (std::size_t p = 0; p < body.count(); ++p) {
        const double vertical = -1000 * 10 * (4 - body.position[p][1]);
        const double state[] = {side * vertical, vertical, 0, side * vertical, 0};
        std::copy(state, state + 5, body.state_of(p));
    }
    m->start();
    m->relocate();
    ASSERT_FALSE(m->prepare(0, Point(0, -10)));
    const std::vector<Point> still(3, Point(0, 0));
    ASSERT_FALSE(m->step(1e-4, {Point(0, -10), still, still}));
    const double weight = 2 * 4 * 1000 * 10;
    const auto& foot = m->impulses()[0];
    // Particles are its quadrature: the stress varies over half a spacing to the edges of blocks.
    EXPECT_NEAR(foot[1] / 1e-4, -weight, 0.02 * weight);
    EXPECT_NEAR(foot[0] / 1e-4, 0, 1e-9 * weight);
    EXPECT_NEAR(foot[2] / 1e-4, -weight * 1.0, 0.02 * weight);  // about the lower corner
    // The two sides push inwards with the same force, side * weight / 2 * height.
    const double wall = side * 1000 * 10 * 4 * 4 / 2;
    EXPECT_NEAR(m->impulses()[1][0] / 1e-4, -wall, 0.02 * wall);
    EXPECT_NEAR(m->impulses()[2][0] / 1e-4, wall, 0.02 * wall);
}

TEST(TriangularMethod, a_moving_side_carries_all_along) {
    // Without stiffness worth mentioning and with all sides moving alike, a body moves as one.
    Case c;
    c.columns = c.rows = 2;
    c.across = c.up = 4;
    c.height = c.width = 1;
    const auto m = rectangle(c);
    const Basis& b = m->basis();
    m->hold({{side(b, {-1, 0}), false}, {side(b, {1, 0}), true}});
    const Point velocity(0.3, -0.2), acceleration(5, 2);
    for (Point& v : m->bodies()[0].velocity) v = velocity;
    m->relocate();
    ASSERT_FALSE(m->prepare(0, acceleration));
    const double dt = 1e-3;
    const Point after = velocity + dt * acceleration;
    ASSERT_FALSE(m->step(dt, {acceleration, {after, after}, {acceleration, acceleration}}));
    for (const Point& v : m->bodies()[0].velocity) EXPECT_LT((v - after).norm(), 1e-12);
    for (const auto& r : m->bodies()[0].rate)
        for (const auto& row : r.e)
            for (double x : row) EXPECT_LT(std::abs(x), 1e-9);
}

TEST(TriangularMethod, particles_that_go_take_all_they_have) {
    auto m = cloud(true, {});
    Particles& b = m->bodies()[0];
    b.tractions.push_back({{0, 5, 17}, 1.0, [](double) { return Point(0, 0); }});
    const Particles& body = m->bodies()[0];
    const auto sixth = body.position[6];
    const double state = body.state[6 * 5 + 2];
    b.erase({1, 5});
    EXPECT_EQ(b.count(), 3998u);
    EXPECT_EQ(b.id[4], 6u);
    EXPECT_EQ(b.position[4], sixth);
    EXPECT_EQ(b.state[4 * 5 + 2], state);
    EXPECT_EQ(b.tractions[0].particles, (std::vector<std::size_t>{0, 15}));
    EXPECT_EQ(b.place_of(5), b.count());

    m->sort_by_cell();
    EXPECT_TRUE(std::is_sorted(b.cell.begin(), b.cell.end()));
    const std::size_t place = b.place_of(6);
    EXPECT_EQ(b.id[place], 6u);
    EXPECT_EQ(b.position[place], sixth);
    EXPECT_EQ(b.state[place * 5 + 2], state);
    EXPECT_EQ(b.id[b.tractions[0].particles[1]], 17u);
}

}  // namespace
}  // namespace mpm::triangular
