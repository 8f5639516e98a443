// Ranks of a scene whose bodies have fields of velocities of their own. What becomes of a node
// where several fields meet follows from the sums of all of them there and at the nodes around it,
// whoever owns their particles (design/ranks.md).
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "mpm/data/blocks.hpp"

namespace mpm {

namespace detail {

inline bool holds(const std::vector<std::uint64_t>& keys, std::uint64_t key) {
    return std::binary_search(keys.begin(), keys.end(), key);
}

}  // namespace detail

/// Keys of the blocks that some slots are of: those of field 0, ascending.
template <int D>
std::vector<std::uint64_t> blocks_of_slots(const BlockKeys<D>& keys_of,
                                           const std::vector<std::uint64_t>& keys) {
    std::vector<std::uint64_t> blocks;
    for (const std::uint64_t key : keys) blocks.push_back(keys_of.of_block(key));
    std::sort(blocks.begin(), blocks.end());
    blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
    return blocks;
}

/// The table of a rank whose homes reach the slots `reached`: of `all` that anyone's do, those of
/// every field in these blocks, where the rank moves nodes, and in the blocks around them, whose
/// nodes say how faces are turned. Both by ascending key.
template <int D>
std::vector<std::uint64_t> table_of_fields(const BlockKeys<D>& keys_of,
                                           const std::vector<std::uint64_t>& reached,
                                           const std::vector<std::uint64_t>& all) {
    std::vector<std::uint64_t> around;
    for (const std::uint64_t key : blocks_of_slots(keys_of, reached)) {
        std::int64_t at[D];
        keys_of.block(key, at);
        for (int n = 0; n < Block<D>::neighbours; ++n) {
            std::int64_t b[D];
            if (keys_of.beside(at, n, b)) around.push_back(keys_of.key(b));
        }
    }
    std::sort(around.begin(), around.end());
    std::vector<std::uint64_t> table;
    for (const std::uint64_t key : all)
        if (detail::holds(around, keys_of.of_block(key))) table.push_back(key);
    return table;
}

}  // namespace mpm
