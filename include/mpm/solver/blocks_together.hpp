// Blocks whose nodes read each other's sums: on both sides of mirrored walls, and along the lines
// of nodes towards walls and surfaces (kernels/wall_lines.hpp, kernels/surface_lines.hpp). Whoever
// has one of them must have the other.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <vector>

#include "mpm/data/blocks.hpp"

namespace mpm {

/// Blocks on both sides of a plane of the domain, where these are not the same.
struct MirrorPlane {
    int axis;
    std::int64_t low, high;  // number of the blocks along the axis
};

struct BlocksTogether {
    std::vector<MirrorPlane> planes;
    // Of blocks beside surfaces at rest, the axes along which lines of their nodes run, a bit each;
    // by their key of field 0.
    std::map<std::uint64_t, unsigned> lines;
    bool empty() const { return planes.empty() && lines.empty(); }
};

/// Adds to the keys of a table those of the blocks that must be there with them.
template <int D>
void add_together(const BlockKeys<D>& keys_of, const BlocksTogether& together,
                  std::vector<std::uint64_t>& keys) {
    for (const MirrorPlane& plane : together.planes) {
        const std::size_t n = keys.size();
        for (std::size_t k = 0; k < n; ++k) {
            std::int64_t b[D];
            keys_of.block(keys[k], b);
            std::int64_t& at = b[plane.axis];
            if (at != plane.low && at != plane.high) continue;
            at = at == plane.low ? plane.high : plane.low;
            keys.push_back(keys_of.key(b, keys_of.field(keys[k])));
        }
    }
    const auto sort = [&] {
        std::sort(keys.begin(), keys.end());
        keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
    };
    sort();
    // A line ends in the next block; lines of that one may go on.
    for (std::vector<std::uint64_t> from = keys, found; !from.empty() && !together.lines.empty();
         from.swap(found)) {
        found.clear();
        for (const std::uint64_t key : from) {
            std::int64_t b[D];
            keys_of.block(key, b);
            const auto here = together.lines.find(keys_of.key(b));
            if (here == together.lines.end()) continue;
            for (int a = 0; a < D; ++a) {
                if (!(here->second >> a & 1)) continue;
                for (const int by : {-1, 1}) {
                    b[a] += by;
                    const std::uint64_t next = keys_of.key(b, keys_of.field(key));
                    const auto there = together.lines.find(keys_of.key(b));
                    b[a] -= by;
                    if (there != together.lines.end() && (there->second >> a & 1) &&
                        !std::binary_search(keys.begin(), keys.end(), next))
                        found.push_back(next);
                }
            }
        }
        keys.insert(keys.end(), found.begin(), found.end());
        sort();
    }
}

}  // namespace mpm
