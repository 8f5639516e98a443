// What `sum_each` of an executor adds up.
#pragma once

#include <cstdint>

#include "mpm/core/config.hpp"

namespace mpm {

/// Items first .. first + count, added up in `parts` parts whose places begin at `place`.
struct SumSet {
    std::int64_t first, count;
    std::int32_t place, parts;
};

struct SumSets {
    const SumSet* set;  // where the executor's memory is
    int count;
    std::int32_t places;  // of all sets

    /// The set that a place belongs to; every set has one or more.
    MPM_INLINE int owner(std::int32_t place) const {
        int low = 0, high = count - 1;
        while (low < high) {
            const int middle = (low + high + 1) / 2;
            if (set[middle].place <= place)
                low = middle;
            else
                high = middle - 1;
        }
        return low;
    }
};

}  // namespace mpm
