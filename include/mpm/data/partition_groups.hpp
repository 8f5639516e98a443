// Cuts by which groups of particles, such as those of a body or of a material, come to lie on a
// rank each, as far as pieces of a row can have it so.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

#include "mpm/data/partition.hpp"

namespace mpm {

/// Particles of one group in a block; a block has one of these for each group that it has any of.
struct GroupWeight {
    std::uint64_t key;
    int group;
    std::uint64_t particles;
};

/// Cuts for as many ranks as groups, one group each, so that as many particles as possible lie on
/// the rank of their group. Ranks get their groups in the order of the middles of these along the
/// row. Returns how many particles do lie so. Every rank that knows the same weights finds the same
/// cuts, in whatever order it knows them.
template <int D>
std::uint64_t cut_by_groups(BlockPartition<D>& partition, const std::vector<GroupWeight>& weights,
                            int groups) {
    std::vector<std::uint64_t> places;
    for (const GroupWeight& w : weights) places.push_back(partition.place(w.key));
    std::sort(places.begin(), places.end());
    places.erase(std::unique(places.begin(), places.end()), places.end());
    const std::size_t n = places.size(), count = std::size_t(groups);
    std::vector<std::vector<std::uint64_t>> here(count, std::vector<std::uint64_t>(n, 0));
    for (const GroupWeight& w : weights) {
        const auto at = std::lower_bound(places.begin(), places.end(), partition.place(w.key));
        here[std::size_t(w.group)][std::size_t(at - places.begin())] += w.particles;
    }
    // Where half of a group is passed; of one without particles at the end.
    std::vector<std::size_t> middle(count, n), order(count);
    for (std::size_t g = 0; g < count; ++g) {
        const std::uint64_t all = std::accumulate(here[g].begin(), here[g].end(), std::uint64_t(0));
        std::uint64_t passed = 0;
        for (std::size_t k = 0; k < n && all > 0 && middle[g] == n; ++k) {
            passed += here[g][k];
            if (2 * passed >= all) middle[g] = k;
        }
    }
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return middle[a] < middle[b]; });

    // The most that the first k places can have if they are dealt to the ranks up to r: the last of
    // them is r's, or r begins behind them.
    std::vector<std::uint64_t> best(n + 1, 0);
    std::vector<std::vector<std::uint8_t>> takes(count, std::vector<std::uint8_t>(n + 1, 0));
    for (std::size_t r = 0; r < count; ++r) {
        const auto& gain = here[order[r]];
        for (std::size_t k = 1; k <= n; ++k) {
            const std::uint64_t taken = best[k - 1] + gain[k - 1];
            takes[r][k] = r == 0 || taken > best[k];
            if (takes[r][k]) best[k] = taken;
        }
    }
    std::vector<std::uint64_t> cuts(count - 1, 0);
    for (std::size_t r = count, k = n; r-- > 1;) {
        while (k > 0 && takes[r][k]) --k;
        cuts[r - 1] = k < n ? places[k] : ~std::uint64_t(0);
    }
    partition.set_cuts(std::move(cuts));
    return best[n];
}

/// The same in the row, of planes across an axis or the curve, in which most particles lie so; of
/// those that are alike, the one whose cuts go through the fewest faces of `blocks`.
template <int D>
BlockPartition<D> choose_for_groups(const BlockKeys<D>& keys, std::vector<BlockWeight> blocks,
                                    const std::vector<GroupWeight>& weights, int groups) {
    std::sort(blocks.begin(), blocks.end(),
              [](const BlockWeight& a, const BlockWeight& b) { return a.key < b.key; });
    BlockPartition<D> best;
    std::uint64_t most = 0, fewest = 0;
    for (int axis = 0; axis <= D; ++axis) {
        BlockPartition<D> one(keys, axis < D ? axis : BlockPartition<D>::curve);
        const std::uint64_t good = cut_by_groups(one, weights, groups),
                            faces = cut_faces(keys, blocks, one);
        if (axis > 0 && (good < most || (good == most && faces >= fewest))) continue;
        best = one;
        most = good;
        fewest = faces;
    }
    return best;
}

}  // namespace mpm
