// A scene, or a saved state, cut into what each rank begins with. Knows no precision: compiled
// once, in src/solver/common/rank_scene.cpp, for two and three dimensions.
#pragma once

#include <algorithm>
#include <vector>

#include "mpm/data/partition_groups.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/rank_share.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

namespace detail {

/// Keys of the blocks of some rows of a body; those outside the domain, which will be refused,
/// count to its first block.
template <int D>
std::vector<std::uint64_t> keys_of_rows(const Spec& spec, const BodySpec& body,
                                        const BlockKeys<D>& keys, std::uint64_t first,
                                        std::uint64_t last);

}  // namespace detail

template <int D>
BlockKeys<D> keys_of_domain(const Spec& spec) {
    BlockKeys<D> keys{};
    keys.fields = spec.contact.fields;
    for (int a = 0; a < D; ++a) {
        keys.counts[a] =
            (std::max<std::int64_t>(spec.cells[std::size_t(a)], 1) + Block<D>::edge - 1) /
                Block<D>::edge +
            2 * BlockKeys<D>::rim;
    }
    return keys;
}

/// The partition that ranks begin with: where the loads are even, unless planes or groups of bodies
/// were asked for. `present`: at hand, whose row is kept; else a row is chosen where none is named.
template <int D>
BlockPartition<D> first_partition(const BlockKeys<D>& keys, const RanksSpec& ranks,
                                  std::vector<BlockWeight> blocks,
                                  const std::vector<GroupWeight>& groups,
                                  const BlockPartition<D>* present = nullptr);

/// What each rank begins with: the same scene with its own particles, which keep their ids. Of one
/// rank `only`, where the others are elsewhere; theirs are then without particles.
template <int D>
struct RankScenes {
    BlockPartition<D> partition;
    std::vector<Spec> spec;

    explicit RankScenes(const Spec& scene, int only = -1);
};

/// Blocks of a saved state by their particles.
std::vector<BlockWeight> weigh_state(const State& all, std::size_t bodies);

/// Particles of a saved state by their blocks and groups.
std::vector<GroupWeight> group_state(const State& all, const std::vector<BodySpec>& bodies);

/// The part of a saved state that lies in the blocks of one rank, and the blocks around them.
template <int D>
State share_of_state(const State& all, std::size_t bodies, const BlockPartition<D>& partition,
                     const BlockKeys<D>& keys_of, const BlocksTogether& together, int rank);

}  // namespace mpm
