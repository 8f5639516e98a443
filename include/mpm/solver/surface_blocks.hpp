// The blocks of a surface's distances, as a specification lists them and as a field looks them up.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "mpm/data/distance_field.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

template <int D>
class SurfaceBlocks {
public:
    /// As `DistanceField` has them: the box around all that are named.
    std::int64_t low[D], counts[D];

    explicit SurfaceBlocks(const SurfaceSpec& s)
        : named_(s.keys.size() / D), numbers_(s.values.size()) {
        for (int a = 0; a < D; ++a) {
            low[a] = s.keys[std::size_t(a)];
            std::int64_t high = low[a];
            for (std::size_t k = 0; k < named_; ++k) {
                low[a] = std::min(low[a], s.keys[k * D + a]);
                high = std::max(high, s.keys[k * D + a]);
            }
            counts[a] = high - low[a] + 1;
        }
    }
    /// Entries of `DistanceField::all`: none where they would take more than an eighth of what the
    /// distances do, and more than 256 kB.
    std::uint64_t entries() const {
        double volume = 1;
        for (int a = 0; a < D; ++a) volume *= double(counts[a]);
        const double most = std::max(double(numbers_) / 8, 65536.0);
        return volume <= most ? std::uint64_t(volume) : 0;
    }

    /// As `DistanceField` has them: keys ascend as the blocks' numbers do, last axis fastest.
    void list(const SurfaceSpec& s, std::vector<std::uint64_t>& keys,
              std::vector<std::int32_t>& place) const {
        std::vector<std::pair<std::uint64_t, std::int32_t>> found;
        for (std::size_t k = 0; k < named_; ++k) {
            std::uint64_t key = 0;
            for (int a = 0; a < D; ++a)
                key = key * std::uint64_t(counts[a]) + std::uint64_t(s.keys[k * D + a] - low[a]);
            found.emplace_back(key, s.place[k]);
        }
        std::sort(found.begin(), found.end());
        for (const auto& [key, at] : found) {
            keys.push_back(key);
            place.push_back(at);
        }
    }
    /// `DistanceField::all`.
    std::vector<std::int32_t> all(const std::vector<std::uint64_t>& keys,
                                  const std::vector<std::int32_t>& place) const {
        std::vector<std::int32_t> found(std::size_t(entries()), DistanceField<D>::outside);
        for (std::size_t k = 0; k < keys.size() && !found.empty(); ++k) found[keys[k]] = place[k];
        return found;
    }

private:
    std::size_t named_, numbers_;
};

}  // namespace mpm
