// Contact over all nodes of the blocks where bodies meet, against what each node would find by
// itself: the pass begins with what the grid update has left, and leaves nodes out.
#include "mpm/kernels/contact_pass.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "support/met_fields.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

using test::MetFields;
using test::Walls;

struct Host {
    static void raise(std::uint32_t* flag) { *flag = 1; }
};

/// What the pass leaves of a scene, by velocities and all that lies beside them.
template <class T, class Sum, int D>
struct Passed {
    MetFields<T, Sum, D>& scene;
    double maxima[maxima_count] = {};
    std::uint32_t crowded = 0;

    ContactPass<Host, T, Sum, D> pass() {
        return {
            {scene.nodes(), scene.contact(), scene.known()}, &scene.group, 1, scene.kept, &crowded};
    }
    std::int64_t nodes() const { return std::int64_t(scene.first.size()) * block_cells; }
    void over_all() {
        for (std::int64_t i = 0; i < nodes(); ++i) pass()(i, maxima);
    }
    /// As devices do: what it asks for, in any order, and one by one after all others.
    void over_wanted() {
        for (const bool single : {false, true})
            for (std::int64_t i = nodes() - 1; i >= 0; --i)
                if (pass().one_by_one(i) == single && pass().wanted(i)) pass()(i, maxima);
    }
    /// With those of the grid update.
    std::vector<double> joined() {
        std::vector<double> out;
        const auto decided = [&](const double* all) { out.assign(all, all + maxima_count); };
        AfterContact<decltype(decided)>{decided, scene.maxima, &crowded, &scene.clock}(maxima);
        return out;
    }
};

/// A node from its sums alone.
template <class T, class Sum, int D>
struct Alone {
    typename NodeContact<T, Sum, D>::Fields f;
    int impulses = 0;
    bool heard = false;  // of a boundary

    Alone(MetFields<T, Sum, D>& scene, std::size_t block, int n) {
        NodeContact<T, Sum, D> of{scene.nodes(), scene.contact(), scene.known()};
        of.node.grid.velocity = nullptr;
        of.find(scene.first[block], scene.count[block], n, f);
        if (f.count < 2 || f.too_many) return;
        of.solve(
            n, f, [&](auto&&...) { heard = true; }, [&](auto&&...) { ++impulses; });
    }
};

/// Of nodes where bodies meet.
struct Counts {
    int left_out = 0, held_and_left_out = 0, pushed = 0, pushed_beside_walls = 0, stuck = 0;
};

/// Averages of what is stuck, from sums that are read as double here, and the same for all of it.
template <class T, class Sum, int D>
void expect_averages(MetFields<T, Sum, D>& scene, const Alone<T, Sum, D>& alone, int n, int i,
                     const T* is, const T* of_first) {
    using Scene = MetFields<T, Sum, D>;
    const auto& f = alone.f;
    double mass = 0, sum = 0, weight = 0, plain[D] = {}, size = 0;
    for (int k = 0; k < f.count; ++k) {
        if (f.of[k] != f.of[i]) continue;
        const auto value = [&](int channel) { return scene.value(f.slot[k], channel, n); };
        mass += value(0);
        sum += value(Scene::group_sum_at);
        weight += value(Scene::group_mass_at);
        for (int a = 0; a < D; ++a) {
            plain[a] += value(Scene::plain_at + a);
            size += std::abs(value(Scene::plain_at + a));
        }
    }
    const double rounding = 8 * double(std::numeric_limits<T>::epsilon());
    for (int a = 0; a < D; ++a)
        ASSERT_NEAR(is[Scene::before_at + a], plain[a] / mass, rounding * size / mass);
    ASSERT_NEAR(is[Scene::average_at], weight > 0 ? sum / weight : 0, rounding);
    for (int c = D; c < Scene::guard_at; ++c) ASSERT_EQ(is[c], of_first[c]);
}

/// `scene` as it is before the pass, which leaves `passed`.
template <class T, class Sum, int D>
void expect_what_solve_gives(MetFields<T, Sum, D>& scene, const std::vector<T>& passed,
                             Counts& counts) {
    using Scene = MetFields<T, Sum, D>;
    std::vector<T> expected = scene.velocity;
    Passed<T, Sum, D> asked{scene};
    for (std::size_t block = 0; block < scene.first.size(); ++block)
        for (int n = 0; n < block_cells; ++n) {
            SCOPED_TRACE(testing::Message() << "block " << block << " node " << n);
            const Alone<T, Sum, D> alone(scene, block, n);
            const auto& f = alone.f;
            const bool wanted = asked.pass().wanted(std::int64_t(block) * block_cells + n);
            if (f.count < 2) {
                ASSERT_FALSE(wanted);
                continue;
            }
            double momentum[D] = {}, size = 0;
            bool moved = false;
            for (int k = 0; k < f.count; ++k) {
                const int from = f.of[k];
                const std::size_t place = scene.place(f.slot[k], n);
                for (int a = 0; a < D; ++a) {
                    T& v = expected[place + std::size_t(a)];
                    const double was = double(v), is = double(f.velocity[from][a]);
                    momentum[a] += double(f.mass[k]) * (is - was);
                    size += double(f.mass[k]) * (std::abs(is) + std::abs(was));
                    moved = moved || is != was;
                    v = f.velocity[from][a];
                }
                expected[place + Scene::guard_at] = T(f.pushed[from] || f.held[from]);
                if (!f.several) continue;
                const T* const is = passed.data() + place;
                expect_averages(scene, alone, n, k, is,
                                passed.data() + scene.place(f.slot[from], n));
                for (int c = D; c < Scene::guard_at; ++c) expected[place + std::size_t(c)] = is[c];
            }
            // What is left out would not change; where no boundary acts, that is all which would
            // not.
            ASSERT_TRUE(wanted || (!moved && alone.impulses == 0 && !f.several));
            if (!alone.heard) {
                ASSERT_EQ(wanted, alone.impulses > 0 || f.several);
                const double rounding = 4 * double(std::numeric_limits<T>::epsilon());
                for (int a = 0; a < D; ++a) ASSERT_NEAR(momentum[a], 0, rounding * size);
            }
            counts.left_out += !wanted;
            counts.held_and_left_out += !wanted && alone.heard;
            counts.pushed += alone.impulses > 0;
            counts.pushed_beside_walls += alone.impulses > 0 && alone.heard;
            counts.stuck += f.several;
        }
    // To the bit, and nothing else has changed: no other node, and no other number of these.
    for (std::size_t k = 0; k < expected.size(); ++k) ASSERT_EQ(passed[k], expected[k]) << k;
}

/// The largest speed before and after the pass, as the clock is to hear of it.
template <class T, class Sum, int D>
double fastest(MetFields<T, Sum, D>& scene, const std::vector<T>& passed) {
    double most = 0;
    const auto node = scene.nodes();
    const auto count = [&](const std::vector<T>& all, int slot, int n, T mass) {
        for (int a = 0; a < D; ++a)
            most = std::max(most, node.counts(all[scene.place(slot, n) + std::size_t(a)], mass));
    };
    for (int slot = 0; slot < scene.slots; ++slot)
        for (int n = 0; n < block_cells; ++n)
            if (const T m = node.mass(slot, n); m > T(0)) count(scene.velocity, slot, n, m);
    for (std::size_t block = 0; block < scene.first.size(); ++block)
        for (int n = 0; n < block_cells; ++n) {
            const Alone<T, Sum, D> alone(scene, block, n);
            for (int k = 0; k < alone.f.count && alone.f.count > 1; ++k)
                count(passed, alone.f.slot[k], n, alone.f.together[alone.f.of[k]]);
        }
    return most;
}

/// Two and three bodies at a node, with friction and without, apart or some of them stuck.
template <class T, class Sum, int D>
void any_scenes(Walls walls, Counts& counts) {
    test::Random random(11 + unsigned(walls));
    for (int k = 0; k < 12; ++k) {
        MetFields<T, Sum, D> scene(3, {{0, 1}, {1}, {0, 1, 2}});
        scene.laws[0].kind = k % 2 ? ContactKind::fluid : ContactKind::friction;
        for (ContactLaw& law : scene.laws) {
            law.static_friction = random.integer(0, 1) * random.between(0, 1);
            law.dynamic_friction = law.static_friction * random.between(0, 1);
        }
        if (k % 6 == 0 || k % 6 == 2) scene.stick(0, 1);
        if (k % 6 == 0 || k % 6 == 3) scene.stick(1, 2);
        scene.build(walls, random);
        scene.put_any(random);
        const std::vector<Sum> sums = scene.sums;
        for (const bool device : {false, true}) {
            SCOPED_TRACE(testing::Message() << D << "D, reals of " << sizeof(T) << " bytes, walls "
                                            << int(walls) << ", scene " << k);
            scene.update(device);
            const std::vector<T> updated = scene.velocity;
            Passed<T, Sum, D> all{scene}, wanted{scene};
            all.over_all();
            const std::vector<T> passed = std::exchange(scene.velocity, updated);
            wanted.over_wanted();
            ASSERT_EQ(std::exchange(scene.velocity, updated), passed);
            expect_what_solve_gives(scene, passed, counts);
            ASSERT_EQ(all.joined(), wanted.joined());
            ASSERT_EQ(all.joined()[max_speed], fastest(scene, passed));
            ASSERT_EQ(scene.clock.halt, Halt::none);
            ASSERT_EQ(scene.sums, sums);
            if (testing::Test::HasFatalFailure()) return;
        }
    }
}
Counts any_numbers(Walls walls) {
    Counts counts;
    any_scenes<double, double, 2>(walls, counts);
    any_scenes<double, double, 3>(walls, counts);
    any_scenes<float, float, 3>(walls, counts);
    any_scenes<float, std::int32_t, 2>(walls, counts);
    any_scenes<float, std::int32_t, 3>(walls, counts);
    any_scenes<double, std::int64_t, 3>(walls, counts);
    EXPECT_GT(counts.left_out, 2000);
    EXPECT_GT(counts.pushed, 2000);
    EXPECT_GT(counts.stuck, 2000);
    return counts;
}
void any_beside(Walls walls) {
    const Counts counts = any_numbers(walls);
    EXPECT_GT(counts.held_and_left_out, 200);
    EXPECT_GT(counts.pushed_beside_walls, 200);
}

TEST(ContactPass, gives_what_solve_does_of_free_bodies) {
    const Counts counts = any_numbers(Walls::none);
    EXPECT_EQ(counts.held_and_left_out + counts.pushed_beside_walls, 0);
}
TEST(ContactPass, gives_what_solve_does_on_a_bed_that_holds) { any_beside(Walls::holds); }
TEST(ContactPass, gives_what_solve_does_on_a_bed_along_which_they_slip) {
    any_beside(Walls::slips);
}
TEST(ContactPass, gives_what_solve_does_on_a_bed_that_lets_go) { any_beside(Walls::lets_go); }
TEST(ContactPass, gives_what_solve_does_in_corners) { any_beside(Walls::corner); }
TEST(ContactPass, gives_what_solve_does_beside_walls_of_some_bodies) { any_beside(Walls::of_some); }
TEST(ContactPass, gives_what_solve_does_where_velocities_are_prescribed) {
    any_beside(Walls::inside);
}
TEST(ContactPass, gives_what_solve_does_on_lines_towards_walls) { any_beside(Walls::linear); }

/// Water and a body that is half as heavy, at one node with the body above: where the water comes
/// up at it both have one velocity across the face, where it sinks both keep their own.
template <class T, class Sum, int D>
void two_that_meet(bool bed) {
    constexpr int up = D - 1;
    int in[D];
    std::fill(in, in + D, 2);
    in[up] = bed ? 0 : 2;
    const int n = Block<D>::cell(in);
    for (const double speed : {1.0, -1.0}) {
        MetFields<T, Sum, D> scene(2, {{0, 1}});
        std::fill(scene.clock.gravity, scene.clock.gravity + 3, 0);
        Vec<double, D> rises{}, rests{};
        rises[up] = speed;
        rises[0] = rests[0] = 0.25;
        scene.put(0, n, 1, rises);
        scene.put(1, n, 0.5, rests);
        in[up] += 1;
        scene.put(1, Block<D>::cell(in), 0.5, rests);
        if (bed) scene.bed(Response::separable);
        scene.list();
        scene.update(true);
        Passed<T, Sum, D> passed{scene};
        const bool falls = speed < 0;
        EXPECT_EQ(passed.pass().wanted(n), !falls);
        passed.over_wanted();
        const double both = 2.0 / 3, rounding = 4 * double(std::numeric_limits<T>::epsilon());
        const T* const water = scene.at(0, n);
        const T* const body = scene.at(1, n);
        EXPECT_NEAR(water[up], falls ? (bed ? 0 : -1) : both, rounding);
        EXPECT_NEAR(body[up], falls ? 0 : both, rounding);
        EXPECT_EQ(water[0], T(0.25));
        EXPECT_EQ(body[0], T(0.25));
        using Scene = MetFields<T, Sum, D>;
        EXPECT_EQ(water[Scene::guard_at], falls && !bed ? 0 : 1);  // pushed, or held by the bed
        EXPECT_EQ(body[Scene::guard_at], falls ? 0 : 1);
    }
}
TEST(ContactPass, stops_what_approaches_and_leaves_what_parts) {
    for (const bool bed : {false, true}) {
        two_that_meet<double, double, 2>(bed);
        two_that_meet<float, std::int32_t, 3>(bed);
    }
}

/// Where transfers keep nothing, velocities alone are written.
TEST(ContactPass, writes_nothing_that_is_not_kept) {
    test::Random random(3);
    MetFields<double, double, 2> scene(3, {{0, 1, 2}});
    scene.put_any(random);
    scene.list();
    scene.update(true);
    const std::vector<double> updated = scene.velocity;
    Passed<double, double, 2> kept{scene}, bare{scene};
    kept.over_all();
    const std::vector<double> passed = std::exchange(scene.velocity, updated);
    EXPECT_NE(passed, updated);
    scene.kept = {};
    bare.over_all();
    constexpr int channels = MetFields<double, double, 2>::velocity_channels;
    for (std::size_t k = 0; k < passed.size(); ++k)
        ASSERT_EQ(scene.velocity[k], (k % channels < 2 ? passed : updated)[k]);
}

TEST(ContactPass, more_bodies_than_are_kept_apart_are_a_fault) {
    for (const int bodies : {most_fields_at_node, most_fields_at_node + 1}) {
        std::vector<int> here;
        for (int k = 0; k < bodies; ++k) here.push_back(k);
        MetFields<double, double, 2> scene(bodies, {here});
        for (int k = 0; k < bodies; ++k) {
            scene.put(k, 9, 0.5, {{0.1 * k, -0.1 * k}});
            scene.put(k, 10, 0.1 * k, {});
        }
        scene.list();
        scene.update(true);
        const std::vector<double> updated = scene.velocity;
        Passed<double, double, 2> passed{scene};
        EXPECT_TRUE(passed.pass().wanted(9));
        passed.over_wanted();
        const bool crowded = bodies > most_fields_at_node;
        EXPECT_EQ(scene.velocity == updated, crowded);
        passed.joined();
        EXPECT_EQ(scene.clock.halt, crowded ? Halt::fault : Halt::none);
        EXPECT_EQ(scene.clock.fault, crowded ? FaultKind::crowded : FaultKind::none);
    }
}

/// Light nodes count by a part of their speed, but those that are stuck weigh as one.
TEST(ContactPass, what_is_stuck_counts_by_its_mass_together) {
    MetFields<double, double, 2> scene(2, {{0, 1}});
    std::fill(scene.clock.gravity, scene.clock.gravity + 3, 0);
    scene.stick(0, 1);
    for (const int slot : {0, 1}) scene.put(slot, 9, 0.6 * scene.nodes().light_mass, {{0, 1}});
    scene.list();
    scene.update(true);
    EXPECT_NEAR(scene.maxima[max_speed], 0.6, 1e-15);
    Passed<double, double, 2> passed{scene};
    passed.over_wanted();
    EXPECT_NEAR(passed.joined()[max_speed], 1, 1e-15);
}

TEST(ContactPass, does_nothing_once_the_clock_has_halted) {
    test::Random random(4);
    MetFields<double, double, 3> scene(2, {{0, 1}});
    scene.put_any(random);
    scene.list();
    scene.update(true);
    const std::vector<double> updated = scene.velocity;
    scene.clock.halt = Halt::sort;
    Passed<double, double, 3> passed{scene};
    passed.over_all();
    EXPECT_EQ(scene.velocity, updated);
    EXPECT_EQ(passed.maxima[max_speed], 0);
}

}  // namespace
}  // namespace mpm
