// Bodies of elements in the engine: what flight and spin keep, bits, states, energies, what readers
// see, faults and refusals. The guide's figures of accuracy: benchmarks/elements.py.
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "mpm/core/error.hpp"
#include "mpm/solver/plan.hpp"
#include "support/meshes_of_elements.hpp"

namespace mpm {
namespace {

using test::forever;

RunResult go(Engine& e, std::int64_t steps) { return e.run(steps, forever, forever); }

/// Of a body: mass, momentum, angular momentum about the origin of what particles have left at the
/// nodes, whatever its dimension (2: about z alone).
struct Motion {
    double mass = 0, momentum[3] = {}, turn[3] = {};
};
Motion motion_of(Engine& e, int D, double dx) {
    const NodalSums s = e.sums();
    const char* names[] = {"momentum_x", "momentum_y", "momentum_z"};
    Motion m;
    for (std::size_t k = 0; k < s.value.at("mass").size(); ++k) {
        m.mass += s.value.at("mass")[k];
        double x[3] = {}, p[3] = {};
        for (int a = 0; a < D; ++a) {
            x[a] = (double(s.cell[k * std::size_t(D) + std::size_t(a)]) + 0.5) * dx;
            p[a] = s.value.at(names[a])[k];
            m.momentum[a] += p[a];
        }
        for (int a = 0; a < 3; ++a)
            m.turn[a] += x[(a + 1) % 3] * p[(a + 2) % 3] - x[(a + 2) % 3] * p[(a + 1) % 3];
    }
    return m;
}

/// A block that flies and turns, h = dx/2.
Spec spinning(int D, bool single, bool vertex_volumes = false, double rate = 2) {
    const double dx = 1.0 / 8;
    Spec s = test::empty_scene(
        D, single,
        D == 2 ? std::vector<std::int64_t>{30, 30} : std::vector<std::int64_t>{22, 22, 18}, dx);
    const std::vector<double> lower =
        D == 2 ? std::vector<double>{1.3, 1.1} : std::vector<double>{0.91, 0.83, 0.77};
    const auto mesh = test::box_of_elements(lower, std::vector<double>(std::size_t(D), 0.5),
                                            std::vector<int>(std::size_t(D), 8));
    s.bodies.push_back(test::body_of_elements(s, "block", "FixedCorotated", {1000, 1e6, 0.3}, mesh,
                                              std::pow(0.5, D), vertex_volumes));
    BodySpec& b = s.bodies[0];
    b.velocity.clear();
    for (std::size_t v = 0; v < mesh.vertices(); ++v) {
        const double* x = mesh.vertex.data() + v * std::size_t(D);
        double u[3] = {-rate * (x[1] - lower[1] - 0.25), rate * (x[0] - lower[0] - 0.25), 0.1};
        for (int a = 0; a < D; ++a) b.velocity.push_back(u[a]);
    }
    b.velocity_gradient.assign(std::size_t(D * D), 0.0);
    b.velocity_gradient[1] = -rate;
    b.velocity_gradient[std::size_t(D)] = rate;
    return s;
}

struct Kind {
    int dimension;
    bool single, vertex_volumes;
};
class Elements : public ::testing::TestWithParam<Kind> {
protected:
    Spec scene(int threads = 2) {
        Spec s = spinning(GetParam().dimension, GetParam().single, GetParam().vertex_volumes);
        s.threads = threads;
        test::add_energy(s, 0.003);
        return s;
    }
    int D() const { return GetParam().dimension; }
};

TEST_P(Elements, flight_and_spin_keep_mass_and_momentum) {
    const auto e = make_cpu_engine(scene());
    const double tolerance = GetParam().single ? 2e-5 : 1e-12;
    const Motion before = motion_of(*e, D(), 1.0 / 8);
    EXPECT_NEAR(before.mass, 1000 * std::pow(0.5, D()), 1e-6 * before.mass);
    EXPECT_GT(before.turn[2], 1);
    go(*e, 200);
    ASSERT_GT(e->statistics().at("sorts"), 1);
    const Motion after = motion_of(*e, D(), 1.0 / 8);
    const double size = before.turn[2] + before.mass;
    EXPECT_NEAR(after.mass, before.mass, tolerance * before.mass);
    for (int a = 0; a < D(); ++a)
        EXPECT_NEAR(after.momentum[a], before.momentum[a], tolerance * size);
    for (int a = 0; a < 3; ++a) EXPECT_NEAR(after.turn[a], before.turn[a], tolerance * size);
}

TEST_P(Elements, bits_do_not_depend_on_threads) {
    const auto one = make_cpu_engine(scene(1)), many = make_cpu_engine(scene(3));
    go(*one, 60);
    go(*many, 60);
    EXPECT_EQ(test::state_bytes(*many), test::state_bytes(*one));
    EXPECT_EQ(many->drain()[0].values.data, one->drain()[0].values.data);
    EXPECT_EQ(many->attributes(0, {"element_stress"}).values.at("element_stress").data,
              one->attributes(0, {"element_stress"}).values.at("element_stress").data);
}

TEST_P(Elements, bits_survive_looking_saving_and_loading) {
    const auto straight = make_cpu_engine(scene()), before = make_cpu_engine(scene());
    go(*straight, 90);
    ASSERT_GT(straight->statistics().at("sorts"), 1);
    go(*before, 37);
    before->attributes(0, before->attribute_names(0));
    before->condition(100);
    const auto state = before->save();
    const auto resumed = make_cpu_engine(scene());
    go(*resumed, 7);
    resumed->load(state);
    go(*before, 53);
    go(*resumed, 53);
    EXPECT_EQ(test::state_bytes(*before), test::state_bytes(*straight));
    EXPECT_EQ(test::state_bytes(*resumed), test::state_bytes(*straight));
    EXPECT_EQ(resumed->attributes(0, {"stress"}).values.at("stress").data,
              straight->attributes(0, {"stress"}).values.at("stress").data);
}

TEST_P(Elements, readers_agree_with_each_other) {
    const auto e = make_cpu_engine(scene());
    go(*e, 40);
    const auto a = e->attributes(0, e->attribute_names(0));
    const auto sum = [&](const char* name) {
        const auto& v = a.values.at(name).data;
        return std::accumulate(v.begin(), v.end(), 0.0);
    };
    const double tolerance = GetParam().single ? 1e-5 : 1e-12;
    EXPECT_NEAR(sum("mass"), 1000 * std::pow(0.5, D()), 1e-5);
    EXPECT_NEAR(sum("elastic_energy"), sum("element_energy"), tolerance * sum("element_energy"));
    EXPECT_GT(sum("element_energy"), 0);
    const Condition c = e->condition(1000);
    EXPECT_NEAR(c.elastic, sum("element_energy"), tolerance * sum("element_energy"));
    EXPECT_NEAR(c.kinetic, sum("kinetic_energy"), tolerance * sum("kinetic_energy"));
    const std::size_t elements =
        spinning(D(), false).bodies[0].elements.size() / std::size_t(D() + 1);
    EXPECT_EQ(a.values.at("element_stress").shape,
              (std::vector<std::size_t>{elements, std::size_t(D()), std::size_t(D())}));
    EXPECT_NEAR(c.volume_ratio[0], sum("volume") / std::pow(0.5, D()), 1e-5);
    for (const double x : a.values.at("element_volume_ratio").data) EXPECT_NEAR(x, 1, 0.1);
}

INSTANTIATE_TEST_SUITE_P(Kinds, Elements,
                         ::testing::Values(Kind{2, false, false}, Kind{2, false, true},
                                           Kind{2, true, true}, Kind{3, true, false},
                                           Kind{3, false, true}));

TEST(Elements, whole_turns_lose_a_thousandth_of_the_energy) {
    Spec s = spinning(2, false);
    test::add_energy(s, 0.01);
    const auto e = make_cpu_engine(s);
    e->run(-1, 3 * 2 * M_PI / 2, forever);
    const auto rows = e->drain()[0].values;
    const std::size_t width = rows.shape[1], last = rows.shape[0] - 1;
    const double before = rows.data[0] + rows.data[1],
                 after = rows.data[last * width] + rows.data[last * width + 1];
    EXPECT_GT(after, 0.999 * before);
    EXPECT_LT(after, 1.0005 * before);
}

/// Transfers that store a velocity, the other kernel, and a body of particles beside: momentum
/// stays, and the other body's bits are those of a scene in which the same particles fly alone.
TEST(Elements, every_transfer_of_the_family_keeps_momentum) {
    for (const char* scheme : {"PIC", "FLIP", "AFLIP", "ASFLIP", "SFLIP", "APIC"})
        for (const Kernel kernel : {Kernel::quadratic, Kernel::cubic}) {
            Spec s = spinning(2, false, true);
            s.transfer.scheme = scheme;
            s.kernel.kernel = kernel;
            s.bodies[0].keep = 0.99;
            const auto e = make_cpu_engine(s);
            const Motion before = motion_of(*e, 2, 1.0 / 8);
            const auto r = go(*e, 100);
            EXPECT_EQ(r.reason, "steps") << scheme << r.fault.message;
            const Motion after = motion_of(*e, 2, 1.0 / 8);
            for (int a = 0; a < 2; ++a)
                EXPECT_NEAR(after.momentum[a], before.momentum[a], 1e-10) << scheme;
        }
}

/// A linear displacement from the first step on: uniform stress of the law, whatever the mesh.
TEST(Elements, uniform_strain_rate_strains_all_elements_alike) {
    const double dx = 0.1;
    Spec s = test::empty_scene(2, false, {30, 30}, dx);
    auto mesh = test::box_of_elements({1, 1}, {0.8, 0.8}, {12, 12});
    test::Random random(3);
    for (std::size_t v = 0; v < mesh.vertices(); ++v) {
        double* x = mesh.vertex.data() + 2 * v;
        if (x[0] < 1.01 || x[0] > 1.79 || x[1] < 1.01 || x[1] > 1.79) continue;
        for (int a = 0; a < 2; ++a) x[a] += random.between(-0.015, 0.015);
    }
    s.bodies.push_back(
        test::body_of_elements(s, "patch", "FixedCorotated", {1000, 1e3, 0.3}, mesh, 0.64));
    s.bodies[0].velocity.clear();
    for (std::size_t v = 0; v < mesh.vertices(); ++v) {
        const double x = mesh.vertex[2 * v] - 1.4, y = mesh.vertex[2 * v + 1] - 1.4;
        s.bodies[0].velocity.push_back(0.3 * x + 0.2 * y);
        s.bodies[0].velocity.push_back(-0.1 * x + 0.1 * y);
    }
    s.bodies[0].velocity_gradient = {0.3, 0.2, -0.1, 0.1};
    const auto e = make_cpu_engine(s);
    go(*e, 1);  // affine: APIC moves every vertex by its own velocity exactly
    const auto a = e->attributes(0, {"element_stress", "element_volume_ratio"});
    const auto& stress = a.values.at("element_stress").data;
    double size = 0;
    for (const double x : stress) size = std::max(size, std::abs(x));
    EXPECT_GT(size, 1);
    for (std::size_t k = 0; k < stress.size(); ++k)
        EXPECT_NEAR(stress[k], stress[k % 4], 1e-11 * size) << k / 4;
}

TEST(Elements, an_inverted_element_is_named) {
    Spec s = spinning(2, false, false, 0);
    // One vertex is thrown through the others.
    s.bodies[0].velocity[std::size_t(2 * (4 * 9 + 4))] = 400;
    s.bodies[0].parameters[1] = 100;
    s.bodies[0].first_id = 1000;
    const auto e = make_cpu_engine(s);
    const auto r = go(*e, 4000);
    ASSERT_EQ(r.reason, "fault") << r.steps;
    EXPECT_EQ(r.fault.code, "inverted-element");
    EXPECT_EQ(r.fault.body, "block");
    ASSERT_EQ(r.fault.ids.size(), 3u);
    for (const auto id : r.fault.ids) EXPECT_GE(id, 1000u);
    EXPECT_LE(r.fault.value, 0.05);
    EXPECT_NE(r.fault.message.find("element "), std::string::npos);
    EXPECT_THROW(e->save(), NumericalError);
}

TEST(Elements, that_leave_the_domain_stop_the_run_whatever_the_policy) {
    Spec s = spinning(2, false, false, 0);
    s.leaving = Leaving::remove;
    for (std::size_t v = 0; v < s.bodies[0].velocity.size(); v += 2) s.bodies[0].velocity[v] = 10;
    const auto e = make_cpu_engine(s);
    const auto r = go(*e, 4000);
    ASSERT_EQ(r.reason, "fault");
    EXPECT_EQ(r.fault.code, "left-domain");
    EXPECT_NE(r.fault.message.find("stays whole"), std::string::npos);
}

TEST(Elements, take_changes_of_velocity_and_no_states) {
    const auto e = make_cpu_engine(spinning(2, false));
    go(*e, 10);
    const Motion before = motion_of(*e, 2, 1.0 / 8);
    Assignment given;
    given.id = {3};
    given.change = {0.5, 0};
    e->assign(given);
    const Motion after = motion_of(*e, 2, 1.0 / 8);
    const auto a = e->attributes(0, {"mass"});
    double mass = 0;
    for (std::size_t k = 0; k < a.id.size(); ++k)
        if (a.id[k] == 3) mass = a.values.at("mass").data[k];
    EXPECT_NEAR(after.momentum[0] - before.momentum[0], 0.5 * mass, 1e-10);
    EXPECT_NEAR(after.momentum[1], before.momentum[1], 1e-10);
    given.change.clear();
    given.state = {0};
    given.width = 1;
    EXPECT_THROW(e->assign(given), SceneError);
}

/// A block that moves towards a slab at rest: how far apart they are, in cells, when the first
/// hundredth of its momentum has gone over. `edge`: of elements, cells.
double first_push(double edge) {
    const double dx = 0.05, gap = 0.4 * dx, speed = 0.1, half = 4 * dx;
    Spec s = test::empty_scene(2, false, {30, 30}, dx);
    const auto box = [&](const char* name, double x, double y, double width, double height) {
        const auto edges = [&](double size) { return int(std::lround(size / (edge * dx))); };
        s.bodies.push_back(test::body_of_elements(
            s, name, "FixedCorotated", {1000, 1e6, 0.3},
            test::box_of_elements({x, y}, {width, height}, {edges(width), edges(height)}),
            width * height));
    };
    const double floor = 8.3 * dx;
    box("slab", 6.2 * dx, floor, 16 * dx, half);
    box("block", 10.2 * dx, floor + half + gap, 8 * dx, 8 * dx);
    s.bodies[1].velocity = {0, -speed};
    s.contact.fields = 2;
    s.contact.kind = {0, 1};
    s.contact.density = {1000, 1000};
    s.contact.laws.push_back({ContactKind::friction, 0, 0, 0.7});
    s.contact.law_of = {-1, 0, 0, -1};
    s.bodies[0].fields = {{0, 0}};
    s.bodies[1].fields = {{0, 1}};
    const auto e = make_cpu_engine(s);
    const auto block_speed = [&] {
        const auto a = e->attributes(1, {"velocity", "mass"});
        double p = 0, m = 0;
        for (std::size_t k = 0; k < a.id.size(); ++k) {
            p += a.values.at("mass").data[k] * a.values.at("velocity").data[2 * k + 1];
            m += a.values.at("mass").data[k];
        }
        return -p / m;
    };
    while (block_speed() > 0.99 * speed && e->time() < 2 * gap / speed) go(*e, 2);
    return (gap - speed * e->time()) / dx;
}

/// By masses at vertices alone elements of a cell would push from 0.25 on; those of half a cell
/// where these do, for a lattice that weighs half at its faces integrates well.
TEST(Elements, touch_where_their_faces_are) {
    const double half = first_push(0.5), whole = first_push(1);
    RecordProperty("first_push", std::to_string(half) + " " + std::to_string(whole));
    EXPECT_NEAR(half, 0, 0.05);
    EXPECT_NEAR(whole, 0, 0.05);
}

TEST(Elements, without_contact_have_no_sum_of_their_own) {
    const Spec s = spinning(2, false);
    EXPECT_LT(make_plan(s, cpu_traits(s.precision)).filled, 0);
}

/// Two copies of a mesh, the second one thrown; with a sensor that keeps them apart or without.
Spec copies(bool apart, double thrown = 0) {
    Spec s = test::empty_scene(2, false, {60, 30}, 0.1);
    for (int k = 0; k < 2; ++k) {
        const auto mesh = test::box_of_elements({1.03 + 2.5 * k, 1.21}, {0.6, 0.4}, {12, 8});
        s.bodies.push_back(test::body_of_elements(s, k == 0 ? "still" : "thrown", "FixedCorotated",
                                                  {1000, 1e4, 0.3}, mesh, 0.24));
        s.bodies.back().velocity.assign(mesh.vertices() * 2, 0.0);
        for (std::size_t v = 0; v < mesh.vertices(); ++v)
            s.bodies.back().velocity[2 * v] = k * (0.2 + mesh.vertex[2 * v + 1]);
    }
    if (thrown > 0) s.bodies[1].velocity[2 * (4 * 13 + 6)] = thrown;
    if (!apart) return s;
    test::add_energy(s, 0.01);
    s.sensors.back().body = 0;
    return s;
}

TEST(Elements, copies_of_a_mesh_are_stepped_as_one) {
    const auto together = make_cpu_engine(copies(false)), apart = make_cpu_engine(copies(true));
    go(*together, 50);
    go(*apart, 50);
    const std::vector<std::string> names = {"element_stress", "element_energy", "position",
                                            "stress"};
    for (int b = 0; b < 2; ++b) {
        const auto one = together->attributes(b, names), two = apart->attributes(b, names);
        ASSERT_EQ(one.id, two.id);
        for (const auto& name : names) {
            EXPECT_EQ(one.values.at(name).shape, two.values.at(name).shape) << name;
            EXPECT_EQ(one.values.at(name).data, two.values.at(name).data) << name;
        }
        const auto columns = together->gather(b, {"element_energy", "mass"}, {});
        const auto& column = columns.columns.at("element_energy");
        ASSERT_EQ(column.shape, std::vector<std::size_t>{192});
        const auto* energy = static_cast<const double*>(column.data.get());
        for (std::size_t k = 0; k < 192; ++k)
            EXPECT_EQ(energy[k], one.values.at("element_energy").data[k]);
    }
    EXPECT_GT(together->attributes(1, names).values.at("element_energy").data[5], 0);
    EXPECT_EQ(together->attributes(0, names).values.at("element_energy").data[5], 0);
}

TEST(Elements, faults_of_copies_name_the_body_and_its_own_element) {
    const auto e = make_cpu_engine(copies(false, 400));
    const auto r = go(*e, 4000);
    ASSERT_EQ(r.fault.code, "inverted-element");
    EXPECT_EQ(r.fault.body, "thrown");
    EXPECT_LT(r.fault.element, 192);
    EXPECT_NE(r.fault.message.find("element " + std::to_string(r.fault.element) + " of vertices"),
              std::string::npos);
    Spec s = copies(false);
    std::swap(s.bodies[1].elements[3], s.bodies[1].elements[4]);
    try {
        make_cpu_engine(s);
        FAIL();
    } catch (const SceneError& error) {
        EXPECT_NE(std::string(error.what()).find("body 'thrown': element 1 has the volume -"),
                  std::string::npos)
            << error.what();
    }
}

template <class F>
std::string refusal(const F& f) {
    try {
        f();
    } catch (const Error& e) {
        return e.what();
    }
    return "";
}

TEST(Elements, refuse_by_name_what_is_not_built) {
    const auto with = [](const auto& change) {
        Spec s = spinning(2, false);
        change(s);
        return refusal([&] { make_plan(s, cpu_traits(s.precision)); });
    };
    const auto names = [](const std::string& text, const char* what) {
        return text.find("body 'block' of elements is not built for") == 0 &&
               text.find(what) != std::string::npos;
    };
    EXPECT_EQ(with([](Spec&) {}), "");
    EXPECT_EQ(with([](Spec& s) { s.ranks.count = 2; }), "");
    EXPECT_TRUE(names(with([](Spec& s) { s.transfer.scheme = "XPIC"; }), "XPIC"));
    EXPECT_TRUE(names(with([](Spec& s) { s.kernel.kernel = Kernel::cpdi; }), "cpdi"));
    EXPECT_TRUE(names(with([](Spec& s) { s.kernel.clamped = true; }), "boundary splines"));
    EXPECT_TRUE(names(with([](Spec& s) { s.bodies[0].restored = true; }), "continued"));
    EXPECT_TRUE(
        names(with([](Spec& s) { s.bodies[0].smoothing = SmoothingForm::two_volume; }), "F-bar"));
    EXPECT_EQ(with([](Spec& s) { s.bodies[0].damping = 0.1; }), "");
    EXPECT_NE(with([](Spec& s) { s.pipeline = "fused"; }).find("elements work between"),
              std::string::npos);
}

/// What elements add to a plan, and that others pay nothing.
TEST(Elements, plan_counts_them) {
    Spec s = spinning(3, true, true);
    const Plan with = make_plan(s, cpu_traits(s.precision));
    EXPECT_EQ(with.bodies[0].elements, 6u * 512);
    EXPECT_EQ(with.bodies[0].state_columns, 1);
    EXPECT_EQ(with.sum_channels, 4);
    EXPECT_EQ(with.velocity_channels, 3);
    const auto e = make_cpu_engine(s);
    EXPECT_LT(e->statistics().at("bytes"),
              1.2 * (with.memory_particles + with.memory_grid + with.memory_tables));
    s.bodies[0].elements.clear();
    s.bodies[0].vertex_volumes = false;
    const Plan without = make_plan(s, cpu_traits(s.precision));
    EXPECT_EQ(without.bodies[0].pipeline, Pipeline::fused);
    for (const auto& k : without.kernels) EXPECT_EQ(k.find("elements"), std::string::npos) << k;
    for (const auto& c : without.bodies[0].columns) EXPECT_NE(c.name, "mass_share");
    EXPECT_EQ(without.bodies[0].bytes_per_particle, 4 * (3 + 9) + 4);
}

}  // namespace
}  // namespace mpm
