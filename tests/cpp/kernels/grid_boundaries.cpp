// Which nodes a boundary holds, and by which of its faces.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <vector>

#include "mpm/core/number.hpp"
#include "mpm/kernels/grid.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

template <int D>
BoundaryRecord<D> walls(const int (&cells)[D], Response response) {
    BoundaryRecord<D> r{};
    r.active = 1;
    for (int a = 0; a < D; ++a) r.upper[a] = cells[a];
    for (int f = 0; f < 2 * D; ++f) {
        r.present[f] = 1;
        r.law[f].response = response;
    }
    return r;
}

template <int D>
BoundaryRecord<D> box(const int (&lower)[D], const int (&upper)[D], Response response) {
    BoundaryRecord<D> r = walls<D>(upper, response);
    r.is_box = 1;
    for (int a = 0; a < D; ++a) r.lower[a] = lower[a];
    return r;
}

template <int D>
struct Seen {
    std::vector<int> boundary, face;
    Vec<double, D> momentum{};
};

template <int D>
Vec<double, D> apply(const std::vector<BoundaryRecord<D>>& all, const std::int64_t (&cell)[D],
                     Vec<double, D> v, Seen<D>* seen = nullptr) {
    apply_boundaries<false>(
        BoundaryView<D>{all.data(), int(all.size()), nullptr, 1.0, 1}, cell, v,
        [&](int b, int f, const Vec<double, D>& before, const Vec<double, D>& after) {
            if (!seen) return;
            seen->boundary.push_back(b);
            seen->face.push_back(f);
            for (int a = 0; a < D; ++a) seen->momentum[a] += before[a] - after[a];
        });
    return v;
}

TEST(DomainWalls, slip_on_every_face_and_corner) {
    const int cells[3] = {5, 4, 3};
    const std::vector<BoundaryRecord<3>> all = {walls<3>(cells, Response::slip)};
    // Rim nodes outside the domain included: particles at the wall reach them.
    for (std::int64_t x = -2; x < 7; ++x)
        for (std::int64_t y = -2; y < 6; ++y)
            for (std::int64_t z = -2; z < 5; ++z) {
                const std::int64_t at[3] = {x, y, z};
                const Vec<double, 3> v = apply<3>(all, at, {{1, 2, 3}});
                for (int a = 0; a < 3; ++a) {
                    const bool held = at[a] <= 0 || at[a] >= cells[a] - 1;
                    EXPECT_EQ(v[a], held ? 0 : a + 1) << x << ' ' << y << ' ' << z << " axis " << a;
                }
            }
}

/// A bed below, a wall at the upper end of x, both smooth, and of some bodies alone friction in the
/// bed's place, one that sticks there, a box that stops all or the wall once more (v), in the order
/// of `order`, by first letters; of a node of cell (x, 2, 0) that would go as `free`.
Vec<double, 3> beside_others(const std::vector<char>& order, std::int64_t x,
                             const Vec<double, 3>& free, double part,
                             std::map<char, Vec<double, 3>>* loads = nullptr) {
    const double mu = 0.4;
    const int cells[3] = {6, 5, 5};
    std::vector<BoundaryRecord<3>> all;
    for (const char kind : order) {
        BoundaryRecord<3> r = walls<3>(cells, Response::separable);
        for (int f = 0; f < 6; ++f) r.present[f] = f == (kind == 'w' || kind == 'v' ? 1 : 4);
        r.share = kind == 'w' || kind == 'b' ? 0 : 1;
        if (kind == 'f') r.law[4].static_friction = r.law[4].dynamic_friction = mu;
        if (kind == 's') r.law[4].response = Response::sticky;
        if (kind == 'p') {
            r.is_box = 1;
            for (int f = 0; f < 6; ++f) {
                r.present[f] = 1;
                r.law[f].response = Response::prescribed;
                r.law[f].axes = 7;
            }
        }
        all.push_back(r);
    }
    Vec<double, 3> v = free;
    const std::int64_t cell[3] = {x, 2, 0};
    BoundaryView<3> view{all.data(), int(all.size()), nullptr, 1.0, 1};
    view.restricted = true;
    apply_boundaries<true>(
        view, cell, v,
        [&](int b, int, const Vec<double, 3>& before, const Vec<double, 3>& after) {
            for (int a = 0; a < 3 && loads; ++a)
                (*loads)[order[std::size_t(b)]][a] += before[a] - after[a];
        },
        [part](std::uint64_t) { return part; });
    return v;
}

TEST(ForSomeBodies, friction_is_of_all_that_presses_in_any_order) {
    const Vec<double, 3> free{{1, 0, -1e-3}};
    for (const std::vector<char>& order :
         {std::vector<char>{'b', 'f'}, {'f', 'b'}, {'f'}, {'w', 'b', 'f'}, {'f', 'w', 'b'}}) {
        const Vec<double, 3> v = beside_others(order, 2, free, 1);
        EXPECT_NEAR(v[0], 1 - 0.4e-3, 1e-15);
        EXPECT_NEAR(v[2], 0, 1e-15);
        // In the corner with the wall everything is at rest, and nothing is lifted off the bed.
        const Vec<double, 3> corner = beside_others(order, 5, free, 1);
        if (order.size() == 3) {
            EXPECT_NEAR(corner[0], 0, 1e-15);
        }
        EXPECT_NEAR(corner[2], 0, 1e-15);
    }
}

TEST(ForSomeBodies, two_take_what_comes_across_them_once) {
    // Friction brakes what the wall has to stop, before it or not at all; nothing is pushed off.
    for (const std::vector<char>& order : {std::vector<char>{'b', 'f', 'v'},
                                           {'b', 'v', 'f'},
                                           {'f', 'v'},
                                           {'v', 'f'},
                                           {'w', 'f', 'v'}}) {
        const Vec<double, 3> v = beside_others(order, 5, {{0.5, 0, -0.866}}, 1);
        EXPECT_NEAR(v[0], 0, 1e-15);
        EXPECT_NEAR(v[2], 0, 1e-15);
    }
}

TEST(ForSomeBodies, friction_is_against_the_way_that_others_leave) {
    // The wall takes all along x, whatever the node would do there: friction is along y alone, and
    // pushes nothing off the wall.
    for (const std::vector<char>& order : {std::vector<char>{'w', 'b', 'f'}, {'f', 'w', 'b'}}) {
        const Vec<double, 3> v = beside_others(order, 5, {{3e4, -1e4, -3.2e4}}, 1);
        for (int a = 0; a < 3; ++a) EXPECT_NEAR(v[a], 0, 1e-9);
        const Vec<double, 3> slides = beside_others(order, 5, {{30, -100, -32}}, 1);
        EXPECT_NEAR(slides[0], 0, 1e-12);
        EXPECT_NEAR(slides[1], -100 + 0.4 * 32, 1e-12);
        EXPECT_NEAR(slides[2], 0, 1e-12);
        const Vec<double, 3> half = beside_others(order, 5, {{30, -100, -32}}, 0.5);
        EXPECT_NEAR(half[0], 0, 1e-12);
        EXPECT_NEAR(half[1], -100 + 0.2 * 32, 1e-12);
    }
}

TEST(ForSomeBodies, what_stops_all_stops_it_beside_others) {
    const Vec<double, 3> free{{1, 0.5, -1e-3}};
    for (const char stops : {'s', 'p'})
        for (const double part : {1.0, 0.25})
            for (const std::vector<char>& order :
                 {std::vector<char>{'b', stops}, {stops, 'b'}, {'b', stops, 'f'}}) {
                const Vec<double, 3> v = beside_others(order, 2, free, part);
                const bool rubs = order.size() > 2 && part < 1;
                EXPECT_NEAR(v[0], 1 - part, rubs ? 1e-3 : 1e-15) << stops << part;
                EXPECT_NEAR(v[1], 0.5 * (1 - part), rubs ? 1e-3 : 1e-15);
                EXPECT_NEAR(v[2], 0, 1e-15);
            }
}

TEST(ForSomeBodies, loads_do_not_depend_on_the_order) {
    const Vec<double, 3> free{{1, 0, -1e-3}};
    for (const std::int64_t x : {2, 5}) {
        std::map<char, Vec<double, 3>> first;
        beside_others({'w', 'b', 'f'}, x, free, 0.5, &first);
        EXPECT_EQ(first['b'][2], -1e-3);  // what presses is the bed's
        EXPECT_EQ(first['f'][2], 0);
        for (const std::vector<char>& order :
             {std::vector<char>{'f', 'w', 'b'}, {'w', 'f', 'b'}, {'f', 'b', 'w'}}) {
            std::map<char, Vec<double, 3>> loads;
            beside_others(order, x, free, 0.5, &loads);
            for (const char of : order)
                for (int a = 0; a < 3; ++a) EXPECT_EQ(loads[of][a], first[of][a]) << of << a;
        }
    }
}

TEST(ForSomeBodies, shares_add_up_and_stop_at_most) {
    const Vec<double, 3> free{{1, 0, -1e-3}};
    const Vec<double, 3> v = beside_others({'b', 'f', 'f'}, 2, free, 0.5);
    EXPECT_NEAR(v[0], 1 - 0.4e-3, 1e-15);  // two halves of one friction
    EXPECT_NEAR(v[2], 0, 1e-15);
    const Vec<double, 3> stopped = beside_others({'b', 'f'}, 2, {{1e-4, 0, -1e-3}}, 1);
    EXPECT_NEAR(stopped[0], 0, 1e-15);
    EXPECT_NEAR(stopped[2], 0, 1e-15);
    // Next to nothing pressed: nothing is divided by it.
    const Vec<double, 3> calm = beside_others({'b', 'f'}, 2, {{1e-200, 0, -1e-200}}, 1);
    EXPECT_TRUE(std::isfinite(calm[0]) && std::isfinite(calm[2]));
    EXPECT_EQ(beside_others({'b', 'f'}, 2, {{1, 0, 1e-3}}, 1)[2], 1e-3);  // it may leave
}

TEST(DomainWalls, separable_lets_go) {
    const int cells[2] = {8, 8};
    const std::vector<BoundaryRecord<2>> all = {walls<2>(cells, Response::separable)};
    EXPECT_EQ(apply<2>(all, {0, 4}, {{1, 2}})[0], 1);
    EXPECT_EQ(apply<2>(all, {0, 4}, {{-1, 2}})[0], 0);
    EXPECT_EQ(apply<2>(all, {7, 4}, {{-1, 2}})[0], -1);
    EXPECT_EQ(apply<2>(all, {7, 4}, {{1, 2}})[0], 0);
    const auto corner = apply<2>(all, {0, 0}, {{-1, -2}});
    EXPECT_EQ(corner[0], 0);
    EXPECT_EQ(corner[1], 0);
}

TEST(DomainWalls, absent_faces_and_inactive_walls_do_nothing) {
    const int cells[2] = {8, 8};
    auto wall = walls<2>(cells, Response::sticky);
    wall.present[1] = wall.present[3] = 0;
    EXPECT_EQ(apply<2>({wall}, {7, 4}, {{1, 2}})[0], 1);
    EXPECT_EQ(apply<2>({wall}, {4, 7}, {{1, 2}})[1], 2);
    EXPECT_EQ(apply<2>({wall}, {0, 4}, {{1, 2}})[1], 0);
    wall.active = 0;
    EXPECT_EQ(apply<2>({wall}, {0, 4}, {{1, 2}})[1], 2);
}

TEST(DomainWalls, moving_wall_carries_its_nodes) {
    const int cells[2] = {8, 8};
    auto wall = walls<2>(cells, Response::sticky);
    wall.velocity[0] = 0.5;
    wall.velocity[1] = -0.25;
    const auto v = apply<2>({wall}, {0, 4}, {{-1, 2}});
    EXPECT_EQ(v[0], 0.5);
    EXPECT_EQ(v[1], -0.25);
}

/// Which faces act on a cell, from distances alone: inside, the nearest faces; one layer outside,
/// the face that the cell shares with the box; none where it shares an edge or a corner only.
template <int D>
std::vector<int> expected_faces(const int (&lower)[D], const int (&upper)[D],
                                const std::int64_t (&cell)[D]) {
    std::vector<int> faces;
    int outside[D], farthest = 0, sides = 0;
    for (int a = 0; a < D; ++a) {
        outside[a] = cell[a] < lower[a] ? int(lower[a] - cell[a])
                                        : (cell[a] >= upper[a] ? int(cell[a] - upper[a] + 1) : 0);
        farthest = std::max(farthest, outside[a]);
        sides += outside[a] > 0;
    }
    if (farthest > 1 || sides > 1) return faces;
    int nearest = 1000;
    for (int a = 0; a < D; ++a) {
        nearest = std::min({nearest, int(cell[a]) - lower[a], upper[a] - 1 - int(cell[a])});
    }
    for (int f = 0; f < 2 * D; ++f) {
        const int a = f / 2;
        const int depth = f % 2 == 0 ? int(cell[a]) - lower[a] : upper[a] - 1 - int(cell[a]);
        if (farthest == 0 ? depth == nearest : depth == -1) faces.push_back(f);
    }
    return faces;
}

template <int D>
void check_box(const int (&lower)[D], const int (&upper)[D]) {
    const std::vector<BoundaryRecord<D>> all = {box<D>(lower, upper, Response::slip)};
    std::int64_t at[D];
    int total = 1;
    for (int a = 0; a < D; ++a) total *= upper[a] - lower[a] + 6;
    for (int n = 0; n < total; ++n) {
        int rest = n;
        for (int a = 0; a < D; ++a) {
            at[a] = lower[a] - 3 + rest % (upper[a] - lower[a] + 6);
            rest /= upper[a] - lower[a] + 6;
        }
        Seen<D> seen;
        Vec<double, D> v;
        for (int a = 0; a < D; ++a) v[a] = a + 1;
        const auto out = apply<D>(all, at, v, &seen);
        const auto faces = expected_faces<D>(lower, upper, at);
        ASSERT_EQ(seen.face, faces) << "cell " << n;
        for (int a = 0; a < D; ++a) {
            bool held = false;
            for (int f : faces) held = held || f / 2 == a;
            ASSERT_EQ(out[a], held ? 0 : a + 1);
            ASSERT_EQ(seen.momentum[a], held ? a + 1 : 0) << "what the load cell hears";
        }
    }
}
TEST(Box, faces_edges_and_corners) {
    check_box<2>({3, 5}, {7, 8});
    check_box<2>({0, 0}, {1, 1});
    check_box<2>({2, 2}, {4, 9});
    check_box<3>({3, 5, 2}, {7, 8, 4});
    check_box<3>({1, 1, 1}, {4, 4, 4});
}

TEST(Box, separable_pushes_out_only) {
    const int lower[2] = {4, 4}, upper[2] = {8, 8};
    const std::vector<BoundaryRecord<2>> all = {box<2>(lower, upper, Response::separable)};
    // Left of the box: towards it means +x.
    EXPECT_EQ(apply<2>(all, {3, 5}, {{1, 2}})[0], 0);
    EXPECT_EQ(apply<2>(all, {3, 5}, {{-1, 2}})[0], -1);
    EXPECT_EQ(apply<2>(all, {8, 5}, {{-1, 2}})[0], 0);
    EXPECT_EQ(apply<2>(all, {8, 5}, {{1, 2}})[0], 1);
    EXPECT_EQ(apply<2>(all, {5, 3}, {{1, 2}})[1], 0);
    EXPECT_EQ(apply<2>(all, {5, 8}, {{1, -2}})[1], 0);
    // Nothing holds a cell that touches the box by a corner alone.
    const auto corner = apply<2>(all, {3, 3}, {{1, 2}});
    EXPECT_EQ(corner[0], 1);
    EXPECT_EQ(corner[1], 2);
    // Two cells away nothing happens.
    EXPECT_EQ(apply<2>(all, {2, 5}, {{1, 2}})[0], 1);
}

TEST(Box, laws_differ_by_face) {
    const int lower[2] = {4, 4}, upper[2] = {10, 10};
    auto r = box<2>(lower, upper, Response::slip);
    r.law[3].response = Response::sticky;  // y+
    const auto top = apply<2>({r}, {6, 10}, {{1, 2}});
    EXPECT_EQ(top[0], 0);
    EXPECT_EQ(top[1], 0);
    const auto bottom = apply<2>({r}, {6, 3}, {{1, 2}});
    EXPECT_EQ(bottom[0], 1);
    EXPECT_EQ(bottom[1], 0);
}

TEST(Boundaries, act_one_after_the_other) {
    const int cells[2] = {8, 8}, lower[2] = {0, 3}, upper[2] = {2, 5};
    auto floor = walls<2>(cells, Response::slip);
    auto block = box<2>(lower, upper, Response::sticky);
    block.velocity[0] = 1;
    Seen<2> seen;
    const auto v = apply<2>({floor, block}, {0, 4}, {{5, 5}}, &seen);
    EXPECT_EQ(v[0], 1);
    EXPECT_EQ(v[1], 0);
    ASSERT_GE(seen.boundary.size(), 2u);
    EXPECT_EQ(seen.boundary.front(), 0);
    EXPECT_EQ(seen.boundary.back(), 1);
    // The order of the list decides who speaks last.
    EXPECT_EQ(apply<2>({block, floor}, {0, 4}, {{5, 5}})[0], 0);
}

}  // namespace
}  // namespace mpm
