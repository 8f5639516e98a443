// Planes of the domain whose sides read each other's nodal sums.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "mpm/data/blocks.hpp"

namespace mpm {

/// Blocks on both sides of a mirrored wall, where these are not the same.
struct MirrorPlane {
    int axis;
    std::int64_t low, high;  // number of the blocks along the axis
};

/// Adds to the keys of a table the blocks across mirrored walls from them: nodes on both sides
/// share their sums, so whoever has those of one side must have those of the other.
template <int D>
void add_images(const BlockKeys<D>& keys_of, const std::vector<MirrorPlane>& planes,
                std::vector<std::uint64_t>& keys) {
    for (const MirrorPlane& plane : planes) {
        const std::size_t n = keys.size();
        for (std::size_t k = 0; k < n; ++k) {
            std::int64_t b[D];
            keys_of.block(keys[k], b);
            std::int64_t& at = b[plane.axis];
            if (at != plane.low && at != plane.high) continue;
            at = at == plane.low ? plane.high : plane.low;
            keys.push_back(keys_of.key(b));
        }
    }
    std::sort(keys.begin(), keys.end());
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
}

}  // namespace mpm
