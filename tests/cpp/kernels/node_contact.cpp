// Contact at one node beside boundaries: of nodal sums written by hand, what velocities become.
#include "mpm/kernels/contact.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "support/random.hpp"

namespace mpm {
namespace {

template <int D>
double dot(const Vec<double, D>& u, const Vec<double, D>& v) {
    double sum = 0;
    for (int a = 0; a < D; ++a) sum += u[a] * v[a];
    return sum;
}
template <int D>
double length(const Vec<double, D>& u) {
    return std::sqrt(dot<D>(u, u));
}
template <int D>
Vec<double, D> minus(const Vec<double, D>& u, const Vec<double, D>& v) {
    Vec<double, D> out;
    for (int a = 0; a < D; ++a) out[a] = u[a] - v[a];
    return out;
}
template <int D>
Vec<double, D> anywhere(test::Random& random, double size = 1) {
    Vec<double, D> out;
    for (int a = 0; a < D; ++a) out[a] = size * random.between(-1, 1);
    return out;
}

/// A node of one block with several fields, each of a kind of its own: the second along each axis,
/// so that all around it lie in the block. Walls are put where they hold it.
template <int D>
struct Node {
    struct Outcome {
        std::vector<Vec<double, D>> before, after;  // boundaries have been obeyed before
        std::vector<Vec<double, D>> impulse, normal;
        double energy_before = 0, energy_after = 0;
        Vec<double, D> momentum{};  // gained
    };
    static constexpr int place = 1, most = 4, channels = 1 + D + most, blocks = D == 2 ? 9 : 27;
    int fields, number;  // of the node
    BlockKeys<D> keys_of{};
    std::uint64_t keys[most];
    std::int32_t corners[most * D] = {}, law_of[most * most] = {};
    std::int32_t neighbours[most * blocks], kinds[most];
    std::uint32_t touched[most] = {1, 1, 1, 1};
    double sums[most * channels * block_cells] = {}, full[most] = {}, masses[most] = {};
    ContactLaw law;
    std::vector<BoundaryRecord<D>> records;
    Clock clock{};

    explicit Node(int count) : fields(count) {
        clock.dt = 1;
        int at[D];
        std::fill(at, at + D, place);
        number = Block<D>::cell(at);
        std::fill(keys_of.counts, keys_of.counts + D, 8);
        keys_of.fields = most;
        for (int i = 0; i < most; ++i) {
            keys[i] = keys_of.key({}, i);
            kinds[i] = i;
            for (int k = 0; k < blocks; ++k) neighbours[i * blocks + k] = k == blocks / 2 ? i : -1;
        }
    }
    /// A body that fills a part of the node, and by `outwards` less of one beside it.
    void put(int field, double mass, const Vec<double, D>& v, double part = 1,
             const Vec<double, D>& outwards = {}) {
        double* const of = sums + field * channels * block_cells;
        for (int n = 0; n < block_cells; ++n) {
            int at[D];
            Block<D>::coordinates(n, at);
            of[n] = mass;
            for (int a = 0; a < D; ++a) of[n] -= mass * outwards[a] * (at[a] - place);
        }
        for (int a = 0; a < D; ++a) of[(1 + a) * block_cells + number] = mass * v[a];
        // What boundaries for this body alone act on.
        of[(1 + D + field) * block_cells + number] = mass;
        masses[field] = mass;
        full[field] = mass / part;
    }
    /// Two bodies that overlap, the second that way from the first.
    void put_two(double of_a, const Vec<double, D>& a, double of_b, const Vec<double, D>& b,
                 Vec<double, D> way) {
        for (int x = 0; x < D; ++x) way[x] *= 0.3;
        put(0, of_a, a, 1, way);
        put(1, of_b, b);
    }
    /// A wall below the node across an axis; `bodies`: bits of those that it is for, 0 for all.
    BoundaryRecord<D>& wall(int axis, Response response, unsigned bodies = 0, double friction = 0) {
        BoundaryRecord<D> r{};
        r.active = r.present[2 * axis] = 1;
        std::fill(r.lower, r.lower + D, place);
        std::fill(r.upper, r.upper + D, 100);
        r.law[2 * axis].response = response;
        r.law[2 * axis].static_friction = r.law[2 * axis].dynamic_friction = friction;
        r.share = std::uint64_t(bodies) << (1 + D);
        records.push_back(r);
        return records.back();
    }
    /// A box that stands beside the node, across the first axis.
    void column(Response response) {
        BoundaryRecord<D>& r = wall(0, response);
        r.is_box = 1;
        std::fill(r.lower, r.lower + D, -10);
        r.upper[0] = place;
        for (int f = 0; f < 2 * D; ++f) r.law[f].response = response;
    }
    template <class T = double>
    Outcome solve() {
        NodeContact<T, double, D> of{};
        of.node.grid.table = {keys_of, fields, keys, corners, neighbours};
        of.node.grid.sums = sums;
        of.node.grid.sum_channels = channels;
        of.node.clock = &clock;
        of.node.boundaries = {records.data(), int(records.size()), nullptr, 1.0, 1};
        for (const auto& r : records) of.node.boundaries.restricted |= r.share != 0;
        of.node.touched = touched;
        of.contact = {&law, law_of, kinds, full, most, nullptr, nullptr, 0, -1, most};
        Outcome out;
        typename NodeContact<T, double, D>::Fields f;
        of.find(0, fields, number, f);
        for (int i = 0; i < fields; ++i) {
            if (f.of[i] == i) of.begin(number, f, i, NothingSeen{});
            out.before.push_back(as<double>(f.velocity[f.of[i]]));
        }
        of.solve(number, f, NothingSeen{}, [&](int, int, auto& impulse, auto& normal, auto&, T) {
            out.impulse.push_back(as<double>(impulse));
            out.normal.push_back(as<double>(normal));
        });
        for (int i = 0; i < fields; ++i) {
            const Vec<double, D> was = out.before[i], is = as<double>(f.velocity[f.of[i]]);
            out.after.push_back(is);
            out.energy_before += masses[i] * dot<D>(was, was) / 2;
            out.energy_after += masses[i] * dot<D>(is, is) / 2;
            for (int a = 0; a < D; ++a) out.momentum[a] += masses[i] * (is[a] - was[a]);
        }
        return out;
    }
};

template <int D>
void free_pairs() {
    test::Random random(5);
    int slid = 0;
    for (int k = 0; k < 2000; ++k) {
        Node<D> node(2);
        const double of_a = std::pow(10, random.between(-6, 0)), of_b = random.between(0, 1);
        const double mu = node.law.static_friction = random.between(0, 1);
        node.law.dynamic_friction = mu * random.between(0, 1);
        const Vec<double, D> a = anywhere<D>(random), b = anywhere<D>(random);
        node.put_two(of_a, a, of_b, b, anywhere<D>(random));
        // A wall that the node is not at: nothing is other than without boundaries.
        node.wall(0, Response::sticky).lower[0] = 0;
        const auto out = node.solve();
        node.touched[0] = node.touched[1] = 0;
        const auto free = node.solve();
        for (int x = 0; x < D; ++x) ASSERT_EQ(out.after[0][x], free.after[0][x]);
        ASSERT_LE(length<D>(out.momentum), 1e-15);
        ASSERT_LE(out.energy_after, out.energy_before * (1 + 1e-14));
        if (out.normal.empty()) continue;
        const Vec<double, D> w = minus<D>(out.after[0], out.after[1]), n = out.normal[0];
        ASSERT_NEAR(dot<D>(w, n), 0, 1e-14);
        const double push = dot<D>(out.impulse[0], n);
        Vec<double, D> rubs = out.impulse[0];
        for (int x = 0; x < D; ++x) rubs[x] -= push * n[x];
        ASSERT_GT(push, 0);
        ASSERT_LE(length<D>(rubs), (mu + 1e-13) * push);
        if (length<D>(w) > 1e-13) {  // they slide
            ASSERT_NEAR(length<D>(rubs), node.law.dynamic_friction * push, 1e-13 * push);
            ++slid;
        }
    }
    EXPECT_GT(slid, 200);
}
TEST(NodeContact, free_bodies_keep_momentum_and_the_cone_of_friction) {
    free_pairs<2>();
    free_pairs<3>();
}

TEST(NodeContact, stuck_and_kept_apart_fields_keep_momentum) {
    test::Random random(9);
    std::size_t met = 0;
    for (int k = 0; k < 1000; ++k) {
        Node<3> node(4);
        node.law.static_friction = node.law.dynamic_friction = random.between(0, 1);
        const bool stick = k % 2 == 0;  // the first and the third
        if (stick) node.law_of[2] = node.law_of[8] = -1;
        for (int i = 0; i < 4; ++i) {
            const Vec<double, 3> v = anywhere<3>(random), outwards = anywhere<3>(random, 0.3);
            node.put(i, std::pow(10, random.between(-3, 0)), v, 1, outwards);
        }
        const auto out = node.solve();
        ASSERT_LE(length<3>(out.momentum), 1e-14);
        ASSERT_LE(out.energy_after, out.energy_before * (1 + 1e-14));
        for (int a = 0; a < 3 && stick; ++a) ASSERT_EQ(out.after[0][a], out.after[2][a]);
        met += out.normal.size();
    }
    EXPECT_GT(met, 1000u);
}

/// The second body is on a bed, the first comes along the normal. The held one is infinite across
/// the bed, so the impulse meets 1/m_a + n_x^2/m_b; both move by it along the bed, and w changes by
/// (n_x (1/m_a + 1/m_b), n_z / m_a) of it: its own size at most.
void one_on_a_bed(double heavier, double leans, Response response) {
    const Vec<double, 3> normal = {{leans, 0, -std::sqrt(1 - leans * leans)}};
    const double of_b = 0.1, of_a = heavier * of_b, c = leans * leans;
    Node<3> node(2);
    node.put_two(of_a, normal, of_b, {}, normal);
    node.wall(2, response, 2);
    const auto out = node.solve();
    const bool sticky = response == Response::sticky;
    const double whole = 1 / (1 / of_a + (sticky ? 0 : c / of_b)),
                 most = (1 + heavier * c) / std::sqrt(1 + heavier * (2 + heavier) * c),
                 push = sticky || most > 1 ? whole : most * whole;
    ASSERT_EQ(out.normal.size(), 1u);
    EXPECT_NEAR(dot<3>(out.impulse[0], normal), push, 1e-12 * push);
    const double rounding = 1e-12 + 1e-15 * push / of_b;  // of the normal
    for (int x = 0; x < 3; ++x) {
        const bool held = sticky || x == 2;
        EXPECT_NEAR(out.after[0][x], normal[x] * (1 - push / of_a), rounding);
        EXPECT_NEAR(out.after[1][x], held ? 0 : normal[x] * push / of_b, rounding);
    }
}
TEST(NodeContact, a_bed_makes_a_body_infinite_across_itself) {
    for (const double heavier : {1e-3, 0.3, 1.0, 10.0, 1e3, 1e6})
        for (const double leans : {0.0, 1e-3, 0.1, 0.29, 0.58, 0.9, 1.0})
            for (const auto response : {Response::slip, Response::separable, Response::sticky})
                one_on_a_bed(heavier, leans, response);
    Node<2> lifted(2);
    lifted.put_two(0.2, {{0, 1}}, 0.6, {{0, 0}}, {{0, 1}});
    lifted.wall(1, Response::separable);
    for (const auto& v : lifted.solve().after) EXPECT_NEAR(v[1], 0.25, 1e-15);
}

TEST(NodeContact, friction_on_a_held_body_is_up_to_what_slides) {
    for (const double mu : {0.3, 2.0}) {
        Node<3> node(2);
        node.law.static_friction = node.law.dynamic_friction = mu;
        node.put_two(0.2, {{0.6, 0.8, -2}}, 1e-6, {{0, 0, 0}}, {{0, 0, -1}});
        node.wall(2, Response::sticky, 2);
        const auto out = node.solve();
        const double left = std::max(0.0, 1 - mu * 2), expected[3] = {0.6 * left, 0.8 * left, 0};
        for (int a = 0; a < 3; ++a) EXPECT_NEAR(out.after[0][a], expected[a], 1e-14);
        EXPECT_EQ(length<3>(out.after[1]), 0);
    }
}

/// One slides on a rough bed, and one that slides with it comes down on it: the bed brakes the
/// lower one by what presses, however much that is, and stops the upper one for good.
TEST(NodeContact, a_rough_bed_carries_what_lies_on_a_body) {
    const double down = 1e-3;
    for (const double mu : {0.3, 0.4, 1.0})
        for (const double heavier : {0.01, 1.0, 10.0, 100.0}) {
            Node<2> node(2);
            node.put_two(heavier, {{1, -down}}, 1, {{1, 0}}, {{0, -1}});
            node.wall(1, Response::separable, 2, mu);
            const auto out = node.solve();
            EXPECT_NEAR(out.after[0][0], 1, 1e-14);
            EXPECT_NEAR(out.after[0][1], 0, 1e-14);
            EXPECT_NEAR(out.after[1][0], 1 - mu * heavier * down, 1e-14);
            EXPECT_EQ(out.after[1][1], 0);
        }
}

/// One is driven across the node by a wall of its own and one held, so that no impulse changes what
/// they approach by there, however the normal leans: it takes what they have along the walls.
TEST(NodeContact, what_walls_keep_of_an_approach_throws_nobody_sideways) {
    for (const double leans : {0.3, 1e-2, 1e-4})
        for (const double along : {0.0, -0.25, 0.25}) {
            Node<2> node(2);
            node.put_two(0.3, {{9, along}}, 0.7, {{9, 0}}, {{std::sqrt(1 - leans * leans), leans}});
            node.wall(0, Response::slip, 1).velocity[0] = 2;
            node.wall(0, Response::slip, 2);
            const auto out = node.solve();
            EXPECT_EQ(out.after[0][0], 2);
            EXPECT_EQ(out.after[1][0], 0);
            const double taken = std::max(along, 0.0);
            EXPECT_NEAR(out.after[0][1], along - 0.7 * taken, 1e-12);
            EXPECT_NEAR(out.after[1][1], 0.3 * taken, 1e-12);
        }
}

/// Of two on a bed the push takes all that they slide with, as the normal leans along it: nothing
/// is left for friction, which would turn them round.
TEST(NodeContact, friction_has_what_the_push_leaves) {
    Node<2> node(2);
    node.law.static_friction = node.law.dynamic_friction = 1;
    node.put_two(0.3, {{1, 0}}, 0.7, {{0, 0}}, {{1, -1}});
    node.wall(1, Response::slip);
    const auto out = node.solve();
    for (const auto& v : out.after) EXPECT_NEAR(v[0], 0.3, 1e-14);
    ASSERT_EQ(out.impulse.size(), 1u);
    EXPECT_NEAR(out.impulse[0][0], 0.21, 1e-14);
    EXPECT_NEAR(out.impulse[0][1], -0.21, 1e-14);
}

/// What hardly weighs is on a bed, and heavy water comes down on it. Pressed out along the bed to
/// w . n = 0 it would have w n_z / n_x. It gets w, of which friction takes w n_x / n_z: what of w
/// is along the face, by a mass that is m_b / n_z^2 along it.
TEST(NodeContact, nothing_light_is_squeezed_out_along_a_bed) {
    const double w = 0.5, of_b = 1e-9;
    for (const double mu : {0.0, 1.0})
        for (const double leans : {1e-3, 1e-2, 0.1, 0.3}) {
            const double steep = std::sqrt(1 - leans * leans);
            Node<2> node(2);
            node.law.static_friction = node.law.dynamic_friction = mu;
            node.put_two(1, {{0, -w}}, of_b, {{0, 0}}, {{leans, -steep}});
            node.wall(1, Response::separable, 2);
            const auto out = node.solve();
            // The light one weighs of_b / leans^2 where it is pushed along the bed.
            const double off = 4 * of_b / (leans * leans);
            EXPECT_NEAR(out.after[1][0], w * (1 - (mu > 0 ? leans / steep : 0)), off);
            EXPECT_NEAR(out.after[0][1], -w, off);
        }
}

/// What a bed leaves of a push is a difference of velocities, which rounding takes where the normal
/// hardly leans along the bed. The light one still leaves no faster than it came.
template <class T>
void nearly_across() {
    const double least = 1 - 8 * std::numeric_limits<T>::epsilon();
    for (double leans = 0.5; leans > 1e-12; leans *= 0.7) {
        Node<2> node(2);
        node.put_two(1e-3, {{0.3, 0}}, 1, {{0, 0}}, {{leans, -std::sqrt(1 - leans * leans)}});
        node.wall(1, Response::slip);
        const auto out = node.template solve<T>();
        EXPECT_LE(out.energy_after * least, out.energy_before) << leans;
        EXPECT_LE(std::abs(out.after[0][0]) * least, 0.3) << leans;
    }
}
TEST(NodeContact, rounding_of_what_a_bed_leaves_throws_nobody) {
    nearly_across<float>();
    nearly_across<double>();
}

/// Of an approach that is a few roundings of the velocities no boundary can say what it leaves.
TEST(NodeContact, an_approach_that_is_rounding_is_none_beside_a_bed) {
    for (const int roundings : {4, 128}) {
        Node<2> node(2);
        const double w = roundings * double(std::numeric_limits<float>::epsilon());
        node.put_two(1e-9, {{1, 0}}, 1, {{1 - w, 0}}, {{1, 0}});
        node.wall(1, Response::slip);
        const auto moved = [](const auto& out) { return out.after[0][0] != out.before[0][0]; };
        EXPECT_EQ(moved(node.solve<float>()), roundings > 64);
        EXPECT_TRUE(moved(node.solve()));
    }
}

/// Bodies of any mass on a bed, of all or of some, in a corner with a column or not. `rubs`: the
/// bed of some has friction, beside a smooth one for all or by itself.
template <int D>
void beside_walls(int bodies, bool rubs, unsigned seed) {
    test::Random random(seed);
    int met = 0;
    for (int k = 0; k < 4000; ++k) {
        Node<D> node(bodies);
        node.clock.gravity[D - 1] = -0.1;
        node.law.static_friction = random.integer(0, 1) * random.between(0, 2);
        node.law.dynamic_friction = node.law.static_friction * random.between(0, 1);
        const Vec<double, D> like = anywhere<D>(random);
        for (int i = 0; i < bodies; ++i) {
            Vec<double, D> v = anywhere<D>(random, std::pow(10, -4 * random.between(0, 1)));
            for (int a = 0; a < D && k % 3 == 0; ++a) v[a] += like[a];
            // Along some axes the normal leans little, but not so that rounding counts.
            Vec<double, D> outwards;
            for (int a = 0; a < D; ++a)
                outwards[a] = (random.integer(0, 1) ? 0.3 : -0.3) *
                              std::pow(10, -3 * random.between(0, 1) - (i == 0 ? 0 : 3));
            // They overlap, or leave a gap that they may close.
            const double mass = std::pow(10, -6 * random.between(0, 1));
            node.put(i, mass, v, random.between(0.4, 1), outwards);
        }
        const auto any = [&] { return Response(random.integer(1, 2)); };  // slip or separable
        const Response bed = rubs ? Response::separable : any(), beside = any();
        const unsigned some = unsigned(random.integer(1, (1 << bodies) - 1));  // by bits
        const double friction = rubs ? random.between(0, 1) : 0;
        const bool corner = random.integer(0, 1), alone = random.integer(0, 1);
        if (corner) node.column(beside);
        node.wall(D - 1, bed, some, friction);
        if (!alone) node.wall(D - 1, bed);
        std::shuffle(node.records.begin(), node.records.end(), random.engine());
        const auto out = node.solve();
        // Differences of velocities are off by eps / (1e-3)^2 of a push that leans as little.
        ASSERT_LE(out.energy_after, out.energy_before * (1 + 1e-9)) << "node " << k;
        const auto ok = [](Response r, double v) { return r == Response::slip ? v == 0 : v >= 0; };
        for (int i = 0; i < bodies; ++i) {
            ASSERT_TRUE((alone && !(some >> i & 1)) || ok(bed, out.after[i][D - 1])) << k;
            ASSERT_TRUE(!corner || ok(beside, out.after[i][0])) << k;
        }
        met += !out.normal.empty();
        if (bodies > 2) continue;
        const double w = length<D>(minus<D>(out.before[0], out.before[1])) * (1 + 1e-6);
        for (int i = 0; i < 2; ++i) {
            // The push changes w by its size at most, friction by what is left of it then, 2 |w|.
            // Smooth walls let each body have a part of that along each axis.
            const double by = length<D>(minus<D>(out.after[i], out.before[i]));
            ASSERT_TRUE(rubs || by <= 3 * w) << "node " << k;
            // Friction of the bed stops, and only that: a body gains no more than by both impulses,
            // along the bed and off it, and mu of that where one lifts what the other had pressed.
            const double gained = length<D>(out.after[i]) - length<D>(out.before[i]);
            ASSERT_LE(gained, (1 + std::sqrt(8.0) * (1 + friction)) * w) << "node " << k;
        }
    }
    EXPECT_GT(met, 800);
}
TEST(NodeContact, smooth_walls_throw_nobody_and_add_no_energy) {
    beside_walls<2>(2, false, 1);
    beside_walls<3>(2, false, 2);
}
TEST(NodeContact, friction_of_a_bed_for_some_throws_nobody_and_adds_no_energy) {
    beside_walls<2>(2, true, 3);
    beside_walls<3>(2, true, 4);
}
TEST(NodeContact, three_bodies_beside_smooth_walls_add_no_energy) {
    beside_walls<2>(3, false, 5);
    beside_walls<3>(3, false, 6);
}

}  // namespace
}  // namespace mpm
