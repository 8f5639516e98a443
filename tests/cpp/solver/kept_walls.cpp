// What is known of nodes beside boundaries goes from one table of blocks to the next, and is what a
// search from the beginning would find: beside boundaries at rest, and where some of them move or
// act for a time.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <iterator>

#include "mpm/exec/cpu.hpp"
#include "mpm/kernels/sorting.hpp"
#include "mpm/solver/boundaries.hpp"
#include "support/random.hpp"
#include "support/scene.hpp"

namespace mpm {
namespace {

constexpr double cell = 0.5;
template <int D>
using Distance = std::function<double(const double (&)[D])>;

template <int D>
std::vector<std::int64_t> cells_of_domain() {
    return D == 2 ? std::vector<std::int64_t>{96, 64} : std::vector<std::int64_t>{80, 12, 12};
}

/// f(place) for all places of a lattice first <= place < last.
template <int D, class F>
void each_place(const std::int64_t (&first)[D], const std::int64_t (&last)[D], const F& f) {
    std::int64_t at[D], count = 1;
    for (int a = 0; a < D; ++a) count *= last[a] - first[a];
    for (std::int64_t k = 0; k < count; ++k) {
        std::int64_t rest = k;
        for (int a = D - 1; a >= 0; --a) {
            at[a] = first[a] + rest % (last[a] - first[a]);
            rest /= last[a] - first[a];
        }
        f(at);
    }
}

/// A linear surface from its distance in m, sampled as the frontend does.
template <int D>
BoundarySpec surface(const Distance<D>& distance, bool cautious) {
    constexpr int edge = DistanceField<D>::edge;
    BoundarySpec b;
    b.name = "surface";
    b.present.assign(2 * D, 1);
    b.law.assign(2 * D, {Response::slip, 0, 0, 0, true, cautious});
    b.end = test::forever;
    SurfaceSpec& s = b.surface;
    s.origin.assign(D, 0.0);
    s.spacing = cell;
    s.thickness = cell;
    std::int64_t first[D], last[D];
    for (int a = 0; a < D; ++a) {
        first[a] = -1;
        last[a] = (cells_of_domain<D>()[std::size_t(a)] + edge - 1) / edge + 1;
    }
    each_place<D>(first, last, [&](const std::int64_t(&key)[D]) {
        std::vector<float> values;
        std::int64_t low[D], high[D];
        for (int a = 0; a < D; ++a) {
            low[a] = key[a] * edge;
            high[a] = low[a] + edge + 1;
        }
        each_place<D>(low, high, [&](const std::int64_t(&corner)[D]) {
            double x[D];
            for (int a = 0; a < D; ++a) x[a] = double(corner[a]) * cell;
            values.push_back(float(distance(x) / cell));
        });
        const auto [least, most] = std::minmax_element(values.begin(), values.end());
        if (*least > 5) return;
        s.keys.insert(s.keys.end(), std::begin(key), std::end(key));
        const bool deep = *most < -4;
        const auto blocks = std::int32_t(s.values.size() / DistanceField<D>::corners);
        s.place.push_back(deep ? DistanceField<D>::deep : blocks);
        if (!deep) s.values.insert(s.values.end(), values.begin(), values.end());
    });
    const SurfaceBlocks<D> blocks(s);
    for (int a = 0; a < D; ++a) {
        b.lower.push_back(int(blocks.low[a] * edge));
        b.upper.push_back(int((blocks.low[a] + blocks.counts[a]) * edge));
    }
    return b;
}
template <int D>
Distance<D> ball(double x, double y, double radius) {
    return [=](const double(&at)[D]) {
        double square = 0;
        for (int a = 0; a < D; ++a) {
            const double off = at[a] - (a == 0 ? x : a == D - 1 ? y : 3.0);
            square += off * off;
        }
        return std::sqrt(square) - radius;
    };
}

BoundarySpec box(std::vector<int> lower, std::vector<int> upper) {
    BoundarySpec b;
    b.name = "box";
    b.is_box = true;
    b.present.assign(2 * lower.size(), 1);
    b.law.assign(2 * lower.size(), {Response::slip, 0, 0, 0, true, false});
    b.lower = std::move(lower);
    b.upper = std::move(upper);
    b.end = test::forever;
    return b;
}

/// Linear walls, a post on the floor, a slope and a ball upon it, all at rest. With `contacts` a
/// solid in a field of its own.
template <int D>
Spec scene(bool contacts) {
    Spec s = test::empty_scene(D, false, cells_of_domain<D>(), cell);
    s.gravity.value[D - 1] = -9.81;
    for (int b = 0; b < 1 + contacts; ++b) {
        s.bodies.push_back(b == 0 ? test::body(s, "water", "TaitFluid", test::fluid(), {}, 4)
                                  : test::body(s, "solid", "FixedCorotated", test::solid(), {}, 4));
        s.bodies.back().fields = {{0, b}};
    }
    s.contact.fields = 1 + contacts;
    if (contacts) {
        s.contact.kind = {0, 1};
        s.contact.density = {1000, 1000};
        s.contact.laws = {ContactLaw{}};
        s.contact.law_of = {-1, 0, 0, -1};
    }
    test::add_walls(s, Response::slip);
    for (SurfaceLaw& law : s.boundaries[0].law) law.linear = law.cautious = true;
    s.boundaries[0].law[0].response = Response::separable;
    s.boundaries.push_back(D == 2 ? box({20, 0}, {26, 9}) : box({20, 4, 0}, {24, 8, 4}));
    const double tilt = 0.21, right = 60 * cell;
    s.boundaries.push_back(surface<D>(
        [=](const double(&x)[D]) {
            return std::cos(tilt) * x[D - 1] - std::sin(tilt) * (x[0] - right);
        },
        true));
    s.boundaries.push_back(surface<D>(ball<D>(right + 2, 4.5, 1.5), false));
    return s;
}
Plan plan_of(const Spec& s) {
    Plan plan;
    plan.bodies.resize(s.bodies.size());
    plan.bodies[0].group.average = int(s.cells.size());
    plan.bodies[0].group.sum = 1 + int(s.cells.size());
    return plan;
}

/// A table of some blocks and fields, linked.
template <int D>
struct Table {
    std::vector<std::uint64_t> keys;
    std::vector<std::int32_t> corners, neighbours;
    BlockTableView<D> view{};

    Table(const BlockKeys<D>& keys_of, std::vector<std::uint64_t> of)
        : keys(std::move(of)),
          corners(keys.size() * D),
          neighbours(keys.size() * Block<D>::neighbours) {
        view = {keys_of, std::int32_t(keys.size()), keys.data(), corners.data(), neighbours.data()};
        const LinkBlocks<D> link{view, neighbours.data(), corners.data()};
        for (std::size_t i = 0; i < neighbours.size(); ++i) link(std::int64_t(i));
    }
};
template <int D>
BlockKeys<D> keys_of_scene(const Spec& s) {
    BlockKeys<D> keys_of{};
    keys_of.fields = s.contact.fields;
    for (int a = 0; a < D; ++a)
        keys_of.counts[a] = s.cells[std::size_t(a)] / Block<D>::edge + 2 * BlockKeys<D>::rim;
    return keys_of;
}
/// Of the last table's blocks some go, of the others some come.
template <int D>
std::vector<std::uint64_t> next_keys(const BlockKeys<D>& keys_of,
                                     const std::vector<std::uint64_t>& before,
                                     test::Random& random) {
    std::vector<std::uint64_t> keys;
    std::int64_t first[D], last[D];
    for (int a = 0; a < D; ++a) {
        first[a] = -1;
        last[a] = keys_of.counts[a] - 2 * BlockKeys<D>::rim + 1;
    }
    each_place<D>(first, last, [&](const std::int64_t(&block)[D]) {
        for (std::int64_t f = 0; f < keys_of.fields; ++f) {
            const std::uint64_t key = keys_of.key(block, f);
            const bool there = std::binary_search(before.begin(), before.end(), key);
            if (random.between(0, 1) < (there ? 0.85 : 0.3)) keys.push_back(key);
        }
    });
    return keys;
}

/// Numbers of a node's surface that mean something.
template <int D>
std::vector<double> numbers(const SurfaceNode<D>& n) {
    std::vector<double> all{n.place.distance,
                            double(n.place.axis),
                            double(n.place.away),
                            double(n.place.deep),
                            double(n.state),
                            double(n.line_axis),
                            double(n.sign),
                            double(n.leader),
                            double(n.slides),
                            double(n.boundary),
                            n.lead,
                            n.share,
                            n.cut.before};
    for (int a = 0; a < D; ++a) {
        all.push_back(n.cut.area[a]);
        if (n.boundary >= 0) all.push_back(n.normal[a]);
    }
    return all;
}
template <int D>
std::vector<std::vector<double>> numbers_of_all(const Boundaries<Cpu, D>& of) {
    std::vector<std::vector<double>> all;
    for (std::size_t i = 0; i < of.asks().size(); ++i)
        all.push_back(numbers<D>(of.known().surfaces[i]));
    return all;
}
template <int D>
std::vector<std::uint32_t> numbers_of(const LinedNode<D>& n) {
    std::vector<std::uint32_t> all{n.node};
    for (int a = 0; a < D; ++a) {
        all.push_back(n.lines[a]);
        all.push_back(std::uint32_t(n.beside[a]));
    }
    return all;
}

template <int D>
void expect_same(const Boundaries<Cpu, D>& is, const Boundaries<Cpu, D>& wanted) {
    EXPECT_EQ(is.touched().host(), wanted.touched().host());
    EXPECT_EQ(is.blocks().host(), wanted.blocks().host());
    EXPECT_EQ(is.asks().host(), wanted.asks().host());
    EXPECT_EQ(is.lines().host(), wanted.lines().host());
    EXPECT_EQ(numbers_of_all(is), numbers_of_all(wanted));
    for (const WallPass pass : {WallPass::held, WallPass::all})
        EXPECT_EQ(is.nodes_of(pass).host(), wanted.nodes_of(pass).host());
    const auto lined = is.lined().host(), as = wanted.lined().host();
    ASSERT_EQ(lined.size(), as.size());
    for (std::size_t k = 0; k < lined.size(); ++k)
        EXPECT_EQ(numbers_of<D>(lined[k]), numbers_of<D>(as[k]));
}

/// What each listed block's nodes ask for.
template <int D>
std::map<std::uint64_t, std::vector<WallAsks>> asks_by_key(const Boundaries<Cpu, D>& of,
                                                           const Table<D>& table) {
    std::map<std::uint64_t, std::vector<WallAsks>> found;
    const auto blocks = of.blocks().host();
    const auto asks = of.asks().host();
    for (std::size_t k = 0; k < blocks.size(); ++k) {
        const auto first = asks.begin() + std::ptrdiff_t(k * block_cells);
        found[table.keys[std::size_t(blocks[k])]] = {first, first + block_cells};
    }
    return found;
}

/// Over several tables, the first before the first step.
struct Seen {
    std::size_t kept = 0;     // blocks
    std::size_t again = 0;    // that the last list had, classified anew
    std::size_t changed = 0;  // of them, those that ask for something else
    bool asked[64] = {};      // for what any node does
};
template <int D>
Seen run(const Spec& s) {
    Cpu exec(1);
    const Plan plan = plan_of(s);
    const BlockKeys<D> keys_of = keys_of_scene<D>(s);
    test::Random random(7);
    Boundaries<Cpu, D> boundaries(exec, s, plan);
    EXPECT_TRUE(boundaries.lists());
    Seen seen;
    std::map<std::uint64_t, std::vector<WallAsks>> last;
    std::vector<std::uint64_t> keys;
    for (int k = 0; k < 6; ++k) {
        keys = next_keys(keys_of, keys, random);
        const Table<D> table(keys_of, keys);
        Boundaries<Cpu, D> fresh(exec, s, plan);
        Clock clock{};
        clock.time = 0.25 * (k - 1);
        for (Boundaries<Cpu, D>* each : {&boundaries, &fresh}) {
            if (k > 0) exec.single(each->begin_step(&clock));
            each->touch(table.view);
        }
        expect_same(boundaries, fresh);
        EXPECT_EQ(fresh.blocks_classified(), fresh.blocks().size());
        std::size_t had = 0;
        const auto now = asks_by_key(fresh, table);
        for (const auto& [key, asks] : now) {
            const auto before = last.find(key);
            had += before != last.end();
            seen.changed += before != last.end() && before->second != asks;
            for (const WallAsks a : asks) seen.asked[a] = true;
        }
        const std::size_t kept = now.size() - boundaries.blocks_classified();
        EXPECT_LE(kept, had);
        seen.kept += kept;
        seen.again += had - kept;
        last = now;
    }
    return seen;
}

template <int D>
void at_rest() {
    for (const bool contacts : {false, true}) {
        Spec s = scene<D>(contacts);
        const Seen seen = run<D>(s);
        EXPECT_GT(seen.kept, 100u);
        EXPECT_EQ(seen.again, 0u);
        EXPECT_EQ(seen.changed, 0u);
        for (const WallAsks a : {WallNode::free, WallNode::on_lines, WallNode::surface,
                                 WallNode::edges, WallNode::unknown})
            EXPECT_TRUE(seen.asked[a]) << int(a);
        if (contacts) continue;
        // A box that stays where it is while its face moves.
        s.boundaries[1].moves = true;
        s.boundaries[1].motion.time = {0, 1};
        s.boundaries[1].motion.value.assign(2 * D, 0.5);
        s.boundaries[1].end = 1e301;  // later than any run
        EXPECT_EQ(run<D>(s).again, 0u);
    }
}
TEST(KeptWallNodes, AreThoseOfASearchBesideBoundariesAtRestInThePlane) { at_rest<2>(); }
TEST(KeptWallNodes, AreThoseOfASearchBesideBoundariesAtRestInSpace) { at_rest<3>(); }

template <int D>
void changing() {
    Spec s = scene<D>(true);
    // A ball that goes along the roof, and comes back.
    BoundarySpec moving = surface<D>(ball<D>(3, (D == 2 ? 56 : 9) * cell, 1), false);
    TableSpec& way = moving.surface.path.table;
    moving.surface.path.of_places = true;
    way.time = {0, 0.5, 1};
    way.value.assign(3 * D, 0.0);
    way.value[D] = D == 2 ? 20 : 14;
    way.end = TableEnd::repeat;
    moving.upper[0] += int(way.value[D] / cell);
    s.boundaries.push_back(moving);
    const Seen moves = run<D>(s);
    EXPECT_GT(moves.kept, 20u);
    EXPECT_GT(moves.changed, 0u);
    EXPECT_GT(moves.again, moves.changed);
    EXPECT_TRUE(moves.asked[WallNode::watched | WallNode::on_lines]);

    s.boundaries.pop_back();
    for (const std::size_t b : {1u, 3u}) {  // the post, and the ball upon the slope
        s.boundaries[b].start = 0.6;
        const Seen comes = run<D>(s);
        EXPECT_GT(comes.kept, 20u);
        EXPECT_GT(comes.again, 0u);
        s.boundaries[b].start = 0;
    }
    s.boundaries[0].end = 0.6;  // walls of the domain, which every block sees
    const Seen goes = run<D>(s);
    EXPECT_EQ(goes.kept, 0u);
    EXPECT_GT(goes.again, 0u);
}
TEST(KeptWallNodes, AreFoundAnewInSightOfWhatChangesInThePlane) { changing<2>(); }
TEST(KeptWallNodes, AreFoundAnewInSightOfWhatChangesInSpace) { changing<3>(); }

TEST(KeptWallNodes, AreForgottenWhereKeysMeanOtherBlocks) {
    Cpu exec(1);
    const Spec s = scene<2>(true);
    const Plan plan = plan_of(s);
    Boundaries<Cpu, 2> boundaries(exec, s, plan);
    BlockKeys<2> keys_of = keys_of_scene<2>(s);
    test::Random random(3);
    const std::vector<std::uint64_t> keys = next_keys(keys_of, {}, random);
    boundaries.touch(Table<2>(keys_of, keys).view);
    keys_of.counts[1] += 1;
    const Table<2> other(keys_of, keys);
    Boundaries<Cpu, 2> fresh(exec, s, plan);
    for (Boundaries<Cpu, 2>* each : {&boundaries, &fresh}) each->touch(other.view);
    expect_same(boundaries, fresh);
    EXPECT_EQ(boundaries.blocks_classified(), boundaries.blocks().size());
    boundaries.touch(other.view);
    expect_same(boundaries, fresh);
    EXPECT_EQ(boundaries.blocks_classified(), 0u);
}

}  // namespace
}  // namespace mpm
