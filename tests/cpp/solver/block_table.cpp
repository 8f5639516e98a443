// The table of blocks without an engine: neighbours are mutual, what is occupied and what comes is
// in a new table with all around it, and slots lead from one table to another.
#include "mpm/solver/block_table.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "mpm/exec/cpu.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

/// Home blocks anywhere in a domain, some at its edge.
template <int D>
std::vector<std::uint64_t> some_homes(const BlockKeys<D>& keys_of, std::uint64_t seed) {
    test::Random random(seed);
    std::set<std::uint64_t> out;
    for (int k = 0; k < 12; ++k) {
        std::int64_t b[D];
        for (int a = 0; a < D; ++a)
            b[a] = random.integer(0, int(keys_of.counts[a]) - 2 * keys_of.rim - 1);
        out.insert(keys_of.key(b));
    }
    return {out.begin(), out.end()};
}

template <int D>
std::vector<std::int64_t> cells() {
    return D == 2 ? std::vector<std::int64_t>{90, 61} : std::vector<std::int64_t>{30, 25, 18};
}

template <int D>
void expect_links() {
    Cpu exec(1);
    BlockTable<Cpu, D> table(exec, cells<D>(), 1);
    const auto homes = some_homes<D>(table.view().keys_of, 3);
    Buffer<Cpu, std::uint64_t> list(exec);
    list.assign(homes);
    table.make(list);
    table.link();
    const BlockTableView<D>& view = table.view();
    ASSERT_EQ(std::size_t(view.slots), table.keys().size());
    EXPECT_TRUE(std::is_sorted(view.keys, view.keys + view.slots));
    constexpr int sides = Block<D>::neighbours, middle = sides / 2;
    for (std::int32_t slot = 0; slot < view.slots; ++slot) {
        std::int64_t b[D];
        view.keys_of.block(view.keys[slot], b);
        for (int a = 0; a < D; ++a) EXPECT_EQ(view.corners[slot * D + a], b[a] * Block<D>::edge);
        EXPECT_EQ(view.neighbours[slot * sides + middle], slot);
        for (int n = 0; n < sides; ++n) {
            const std::int32_t beside = view.neighbours[slot * sides + n];
            if (beside < 0) continue;
            EXPECT_EQ(view.neighbours[beside * sides + sides - 1 - n], slot);
        }
    }
    // All that a particle of a home can reach is there.
    for (const std::uint64_t home : homes) {
        const std::int32_t slot = find_key(view.keys, view.slots, home);
        ASSERT_GE(slot, 0);
        for (int n = 0; n < sides; ++n) EXPECT_GE(view.neighbours[slot * sides + n], 0);
    }
}

TEST(BlockTable, NeighboursAreMutual) {
    expect_links<2>();
    expect_links<3>();
}

TEST(BlockTable, IsRebuiltOfWhatIsOccupiedAndWhatComes) {
    Cpu exec(1);
    BlockTable<Cpu, 2> table(exec, cells<2>(), 1);
    const auto homes = some_homes<2>(table.view().keys_of, 5);
    Buffer<Cpu, std::uint64_t> list(exec), more(exec), keys(exec), again(exec);
    list.assign(homes);
    table.make(list);
    table.link();
    // Half of the homes have emptied; one block comes that the table may not have.
    std::vector<std::uint32_t> flag(std::size_t(table.view().slots), 0);
    std::vector<std::uint64_t> left;
    for (std::size_t k = 0; k < homes.size(); k += 2) {
        flag[std::size_t(find_key(table.view().keys, table.view().slots, homes[k]))] = 1;
        left.push_back(homes[k]);
    }
    const std::uint64_t coming = table.view().keys_of.key({7, 0});
    left.push_back(coming);
    std::sort(left.begin(), left.end());
    Buffer<Cpu, std::uint32_t> occupied(exec);
    occupied.assign(flag);
    more.assign({coming});
    Buffer<Cpu, std::int32_t> map(exec), back(exec);
    table.rebuild(occupied, more, keys, map);
    list.assign(left);
    table.neighbourhood(list, again);
    EXPECT_EQ(keys.host(), again.host());

    const BlockTableView<2> coming_view = table.view_of(keys);
    const auto before = table.keys().host();
    for (std::size_t slot = 0; slot < before.size(); ++slot)
        EXPECT_EQ(map.host()[slot], find_key(coming_view.keys, coming_view.slots, before[slot]));
    table.slots_of(keys, back);
    for (std::size_t k = 0; k < keys.size(); ++k) {
        const std::int32_t slot = back.host()[k];
        if (slot < 0) continue;
        EXPECT_EQ(map.host()[std::size_t(slot)], std::int32_t(k));
    }
    const auto after = keys.host();
    table.adopt(keys);
    EXPECT_EQ(table.keys().host(), after);
    EXPECT_EQ(keys.host(), before);
    EXPECT_EQ(table.view().keys, table.keys().data());
}

TEST(BlockTable, FieldsOfABlockFollowEachOtherAndKeepApart) {
    Cpu exec(1);
    BlockTable<Cpu, 2> table(exec, cells<2>(), 3);
    const auto& keys_of = table.view().keys_of;
    Buffer<Cpu, std::uint64_t> list(exec);
    list.assign({keys_of.key({4, 4}, 0), keys_of.key({5, 4}, 2)});
    table.make(list);
    table.link();
    const BlockTableView<2>& view = table.view();
    EXPECT_EQ(view.slots, 2 * Block<2>::neighbours);
    for (std::int32_t k = 0; k < view.slots * Block<2>::neighbours; ++k) {
        const std::int32_t slot = k / Block<2>::neighbours, beside = view.neighbours[k];
        if (beside < 0) continue;
        EXPECT_EQ(keys_of.field(view.keys[slot]), keys_of.field(view.keys[beside]));
    }
}

TEST(BlockTable, OfOneRankHasBothSidesOfAMirroredWall) {
    Cpu exec(1);
    BlockTable<Cpu, 2> table(exec, cells<2>(), 1);
    BlocksTogether together;
    together.planes = {{0, 2, 3}};
    table.share(together);
    const auto& keys_of = table.view().keys_of;
    Buffer<Cpu, std::uint64_t> list(exec), keys(exec);
    list.assign({keys_of.key({1, 4})});
    table.neighbourhood(list, keys);
    const auto found = keys.host();
    for (std::int64_t y = 3; y <= 5; ++y)
        for (std::int64_t x = 0; x <= 3; ++x)
            EXPECT_TRUE(std::binary_search(found.begin(), found.end(), keys_of.key({x, y})));
    EXPECT_EQ(found.size(), 12u);
}

TEST(BlockTable, RefusesADomainWithoutCells) {
    Cpu exec(1);
    EXPECT_THROW((BlockTable<Cpu, 2>(exec, {8, 0}, 1)), SceneError);
}

}  // namespace
}  // namespace mpm
