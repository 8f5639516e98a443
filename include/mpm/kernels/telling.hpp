// Gauges and probes of ranks on devices. Where they stand they read blocks that other ranks own, so
// whoever counts such a block tells its nodes to all, into a small table that each of them has, and
// after the ranks have met everyone takes the same sample of it. Ranks that do not reach each
// other's memory tell their own table, and add up those of all.
#pragma once

#include "mpm/exec/communicator.hpp"
#include "mpm/kernels/sampling.hpp"

namespace mpm {

/// The blocks that gauges and probes can read, as all ranks that are told hold them.
template <class T, class Sum>
struct ToldBlocks {
    Sum* sums[most_devices];    // of each, (blocks, sum channels, 64)
    T* velocity[most_devices];  // likewise
    int ranks;
};

/// What the clock was when blocks were told: in the next step its scales are others.
struct ToldClock {
    Clock clock;
    std::int64_t due;  // the step in which any gauge or probe was due
};

/// Opens the rows of those that are due, one worker each.
template <int D>
struct OpenPoints {
    const Clock* clock;
    SensorRecord* sensors;
    const PointRecord<D>* points;
    ToldClock* told;
    MPM_INLINE void operator()(std::int64_t k) const {
        if (k == 0) told->clock = *clock;
        SensorRecord& r = sensors[points[k].sensor];
        if (!r.due) return;
        open_row(r, clock->time);
        told->due = clock->step;  // everyone who writes it writes the same
    }
};

/// Tells numbers of the blocks that this rank counts, each by a worker.
template <class T, class Sum>
struct TellBlocks {
    const Clock* clock;
    const ToldClock* told;
    const std::int32_t* slot;  // of each block, -1 where another rank counts it or nobody has it
    const Sum* sums;
    const T* velocity;
    std::int32_t sums_each, velocities_each;
    ToldBlocks<T, Sum> to;
    MPM_INLINE void operator()(std::int64_t i) const {
        if (told->due != clock->step) return;
        const std::int64_t each = sums_each + velocities_each, block = i / each, k = i % each;
        if (slot[block] < 0) return;
        for (int r = 0; r < to.ranks; ++r) {
            if (k < sums_each)
                to.sums[r][block * sums_each + k] = sums[std::int64_t(slot[block]) * sums_each + k];
            else
                to.velocity[r][block * velocities_each + (k - sums_each)] =
                    velocity[std::int64_t(slot[block]) * velocities_each + (k - sums_each)];
        }
    }
};

/// Fills the rows that `OpenPoints` has opened. `points.node` is of the table of told blocks.
template <class T, class Sum, int D>
struct SampleTold {
    SamplePoints<T, Sum, D> points;
    const ToldClock* told;
    MPM_INLINE void operator()(std::int64_t k) const {
        const PointRecord<D>& point = points.points[k];
        SensorRecord& r = points.sensors[point.sensor];
        if (told->due != told->clock.step || !r.due) return;
        points.sample(point, r.values + std::int64_t(r.count - 1) * r.columns);
    }
};

/// What nobody tells next time has no mass, and adds nothing.
template <class Number>
struct ForgetBlocks {
    const ToldClock* told;
    Number* numbers;
    MPM_INLINE void operator()(std::int64_t i) const {
        if (told->due == told->clock.step) numbers[i] = Number(0);
    }
};

/// Where this rank has the blocks that it is to tell.
struct FindTold {
    const std::uint64_t* wanted;
    const std::uint64_t* keys;
    std::int32_t slots;
    const std::uint8_t* counts;
    std::int32_t* slot;
    MPM_INLINE void operator()(std::int64_t k) const {
        const std::int32_t at = find_key(keys, slots, wanted[k]);
        slot[k] = at >= 0 && counts[at] ? at : -1;
    }
};

}  // namespace mpm
