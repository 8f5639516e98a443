// The clock in a saved state: its fields by name, those alone that the next step depends on or that
// a later report needs. What a step computes again, why the clock halted and how far the call was
// to go are no state.
#pragma once

#include "mpm/kernels/clock.hpp"
#include "mpm/solver/blob.hpp"

namespace mpm {

/// The clock as states of format 1 have it in their entry "clock", byte for byte; earlier ones end
/// before `deposited_before`.
struct ClockOfFormat1 {
    double time, dt, dt_next, dt_stable;
    std::int64_t step;
    double gravity[3];
    double drift, drift_limit;
    std::uint64_t strays, stray_limit;
    double speed;
    double unit_read[3], scale_write[3], deposited[3], deposit_limit[3];
    double sweep_scale, numbers_dt, numbers_dt_next, until;
    std::int64_t steps_left;
    std::int32_t halt, fault;
    std::uint64_t fault_particle;
    double fault_value;
    std::int64_t log_step[128];
    double log_speed[128];
    std::int32_t log_count, log_stride;
    double deposited_before[3];
};

/// What `state` says of the clock, in either format, checked: it may be run with. Raises
/// `SceneError`.
Clock saved_clock(const State& state);

/// Puts the clock into a state of the present format, in the place of one that is there.
void save_clock(State& state, const Clock& clock);

}  // namespace mpm
