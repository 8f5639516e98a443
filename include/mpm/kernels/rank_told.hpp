// What ranks on devices tell each other within a step beside their votes: a few numbers, of one
// kind at a time. Each writes them into the memory of all whom it reaches, or into its own, from
// which they are sent; once all are there, every rank makes the same of them.
#pragma once

#include <cstdint>

#include "mpm/core/config.hpp"

namespace mpm {

struct RankTold {
    static constexpr int most = 8;
    // Of a sweep the largest nodal speed and mass; of smoothing `smoothing_sums` of its particles.
    double number[most];
    std::int32_t beyond;  // of smoothing: a field larger than integer sums can hold
};

struct TellRanks {
    RankTold* const* boxes = nullptr;  // where each of these keeps what it is told, by rank
    int rank = 0, count = 0;           // none: this rank is the only one
    MPM_HD bool any() const { return count > 0; }
    MPM_HD void operator()(const RankTold& mine) const {
        for (int k = 0; k < count; ++k) boxes[k][rank] = mine;
    }
};

}  // namespace mpm
