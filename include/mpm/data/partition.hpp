// Who owns which blocks where several ranks share a scene. Blocks are put in a row, along a Hilbert
// curve or by planes across one axis, and the row is cut into a piece for each rank. A partition is
// a few numbers, the same on every rank, and covers all blocks there are, particles or not: nobody
// has to ask who owns a block.
#pragma once

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <utility>
#include <vector>

#include "mpm/data/blocks.hpp"

namespace mpm {

/// Place of a block along a Hilbert curve through a cube of 2^bits blocks an edge: Skilling (2004),
/// "Programming the Hilbert curve". Neighbours along it share a face.
template <int D>
MPM_HD inline std::uint64_t hilbert_place(const std::int64_t (&block)[D], int bits) {
    std::uint64_t x[D];
    for (int a = 0; a < D; ++a) x[a] = std::uint64_t(block[a]);
    const std::uint64_t top = std::uint64_t(1) << (bits - 1);
    for (std::uint64_t q = top; q > 1; q >>= 1) {
        const std::uint64_t below = q - 1;
        for (int a = 0; a < D; ++a) {
            if (x[a] & q) {
                x[0] ^= below;
            } else {
                const std::uint64_t t = (x[0] ^ x[a]) & below;
                x[0] ^= t;
                x[a] ^= t;
            }
        }
    }
    for (int a = 1; a < D; ++a) x[a] ^= x[a - 1];
    std::uint64_t flip = 0;
    for (std::uint64_t q = top; q > 1; q >>= 1)
        if (x[D - 1] & q) flip ^= q - 1;
    std::uint64_t place = 0;
    for (int b = bits - 1; b >= 0; --b)
        for (int a = 0; a < D; ++a) place = place << 1 | ((x[a] ^ flip) >> b & 1);
    return place;
}

/// Place of a block in the row that is cut: along the curve, or by planes across an axis.
template <int D>
MPM_HD inline std::uint64_t place_in_row(const BlockKeys<D>& keys, std::uint64_t key, int axis,
                                         int bits) {
    std::int64_t block[D];
    keys.block(key, block);
    for (int a = 0; a < D; ++a) block[a] += BlockKeys<D>::rim;
    return axis < 0 ? hilbert_place<D>(block, bits) : std::uint64_t(block[axis]);
}

/// A block and what it costs, in any unit.
struct BlockWeight {
    std::uint64_t key, weight;
};

template <int D>
class BlockPartition {
public:
    static constexpr int curve = -1;

    BlockPartition() = default;
    /// Along the curve, or by planes across an axis.
    BlockPartition(const BlockKeys<D>& keys, int axis) : keys_(keys), axis_(axis) {
        std::int64_t most = 1;
        for (std::int64_t n : keys_.counts) most = std::max(most, n);
        while ((std::int64_t(1) << bits_) < most) ++bits_;
    }

    /// Place in the row that is cut.
    std::uint64_t place(std::uint64_t key) const { return place_in_row(keys_, key, axis_, bits_); }
    int owner(std::uint64_t key) const {
        return int(std::upper_bound(cuts_.begin(), cuts_.end(), place(key)) - cuts_.begin());
    }
    int ranks() const { return int(cuts_.size()) + 1; }
    int axis() const { return axis_; }
    int bits() const { return bits_; }
    /// Where each rank but the first begins.
    const std::vector<std::uint64_t>& cuts() const { return cuts_; }
    void set_cuts(std::vector<std::uint64_t> cuts) { cuts_ = std::move(cuts); }
    /// Planes in front of these blocks, which are counted from the first of the domain.
    void cut_at(const std::vector<std::int64_t>& planes) {
        cuts_.clear();
        for (std::int64_t first : planes) cuts_.push_back(std::uint64_t(first + BlockKeys<D>::rim));
    }

    /// Pieces as even as whole blocks, or planes of them, allow. Weights are integers and blocks
    /// are put in order first, so every rank that knows the same blocks finds the same cuts.
    void cut(const std::vector<BlockWeight>& blocks, int ranks) {
        std::vector<std::pair<std::uint64_t, std::uint64_t>> row;  // place, weight
        row.reserve(blocks.size());
        std::uint64_t total = 0;
        for (const BlockWeight& b : blocks) {
            row.emplace_back(place(b.key), b.weight);
            total += b.weight;
        }
        std::sort(row.begin(), row.end());
        cuts_.clear();
        std::uint64_t before = 0;
        std::size_t k = 0;
        for (int r = 1; r < ranks; ++r) {
            // A place goes to the side of the cut on which more than half of it lies.
            const double wanted = double(total) * r / ranks;
            while (k < row.size()) {
                std::size_t end = k;
                std::uint64_t here = 0;
                while (end < row.size() && row[end].first == row[k].first)
                    here += row[end++].second;
                if (double(before) + 0.5 * double(here) > wanted) break;
                before += here;
                k = end;
            }
            cuts_.push_back(k < row.size() ? row[k].first : ~std::uint64_t(0));
        }
    }

private:
    BlockKeys<D> keys_{};
    int axis_ = curve;
    int bits_ = 1;
    std::vector<std::uint64_t> cuts_;
};

/// The largest load over the mean one; 1 where there is none.
inline double imbalance(const std::vector<std::uint64_t>& loads) {
    std::uint64_t total = 0, most = 0;
    for (std::uint64_t load : loads) {
        total += load;
        most = std::max(most, load);
    }
    return total == 0 ? 1.0 : double(most) * double(loads.size()) / double(total);
}

/// The load of each rank by these blocks.
template <int D>
std::vector<std::uint64_t> loads_of(const BlockPartition<D>& partition,
                                    const std::vector<BlockWeight>& blocks) {
    std::vector<std::uint64_t> loads(std::size_t(partition.ranks()), 0);
    for (const BlockWeight& b : blocks) loads[std::size_t(partition.owner(b.key))] += b.weight;
    return loads;
}

/// Makes new cuts by these blocks, unless they are hardly better: few blocks are never even, and
/// what is gained by less than 3 % is not worth the way. Those who want them at any price, who say
/// 0, have them. `was`: how uneven the present cuts are. Whether cuts have moved.
template <int D>
bool recut(BlockPartition<D>& partition, const std::vector<BlockWeight>& blocks,
           double rebalance_above, double was) {
    const auto before = partition.cuts();
    partition.cut(blocks, partition.ranks());
    if (partition.cuts() == before) return false;
    if (rebalance_above > 0 && imbalance(loads_of(partition, blocks)) > 0.97 * was) {
        partition.set_cuts(before);
        return false;
    }
    return true;
}

/// Faces between blocks of different owners, which is what ranks will have to share. `blocks`: by
/// ascending key.
template <int D>
std::uint64_t cut_faces(const BlockKeys<D>& keys, const std::vector<BlockWeight>& blocks,
                        const BlockPartition<D>& partition) {
    std::vector<int> owner;
    for (const BlockWeight& b : blocks) owner.push_back(partition.owner(b.key));
    std::uint64_t faces = 0, stride = std::uint64_t(keys.fields);
    for (int a = D - 1; a >= 0; --a) {  // keys count blocks, the last axis fastest
        std::size_t next = 0;           // the neighbour further along the axis
        for (std::size_t k = 0; k < blocks.size(); ++k) {
            while (next < blocks.size() && blocks[next].key < blocks[k].key + stride) ++next;
            if (next == blocks.size()) break;
            faces += blocks[next].key == blocks[k].key + stride && owner[next] != owner[k];
        }
        stride *= std::uint64_t(keys.counts[a]);
    }
    return faces;
}

/// The partition of a scene whose user names none: by planes across the longest axis of the domain
/// where these cut through fewer faces of blocks than the curve does, and are even (`even` is the
/// largest load over the mean one that is) or no less so than the curve. Flumes are cut so, cubes
/// are not.
template <int D>
BlockPartition<D> choose_partition(const BlockKeys<D>& keys, std::vector<BlockWeight> blocks,
                                   int ranks, double even) {
    std::sort(blocks.begin(), blocks.end(),
              [](const BlockWeight& a, const BlockWeight& b) { return a.key < b.key; });
    const auto longest = std::max_element(std::begin(keys.counts), std::end(keys.counts));
    BlockPartition<D> curve(keys, BlockPartition<D>::curve),
        planes(keys, int(longest - std::begin(keys.counts)));
    const auto unevenness = [&](BlockPartition<D>& partition) {
        partition.cut(blocks, ranks);
        return imbalance(loads_of(partition, blocks));
    };
    const double of_curve = unevenness(curve), of_planes = unevenness(planes);
    const bool take = of_planes <= std::max(even, of_curve) &&
                      cut_faces(keys, blocks, planes) < cut_faces(keys, blocks, curve);
    return take ? planes : curve;
}

}  // namespace mpm
