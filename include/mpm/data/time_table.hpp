// A piecewise linear function of time with values of D components, as plain memory that both
// backends read.
#pragma once

#include <cstdint>

#include "mpm/core/config.hpp"

namespace mpm {

enum class TableEnd : int { hold = 0, repeat = 1, zero = 2 };

struct TimeTableView {
    const double* time;
    const double* value;  // (count, components)
    std::int32_t count;
    std::int32_t components;
    TableEnd end;

    MPM_HD void at(double t, double* out) const {
        const double last = time[count - 1];
        if (t > last && end == TableEnd::repeat && count > 1) {
            const double period = last - time[0];
            const double cycles = (t - time[0]) / period;
            t = time[0] + (cycles - double(std::int64_t(cycles))) * period;
        }
        if (t > last && end == TableEnd::zero) {
            for (int c = 0; c < components; ++c) out[c] = 0;
            return;
        }
        int low = 0, high = count;  // the last entry with time <= t lies in [low, high)
        while (high - low > 1) {
            const int middle = (low + high) / 2;
            if (time[middle] <= t)
                low = middle;
            else
                high = middle;
        }
        double share = 0;
        if (low + 1 < count && t > time[low]) share = (t - time[low]) / (time[low + 1] - time[low]);
        for (int c = 0; c < components; ++c) {
            const double a = value[low * components + c];
            out[c] = low + 1 < count ? a + share * (value[(low + 1) * components + c] - a) : a;
        }
    }
};

}  // namespace mpm
