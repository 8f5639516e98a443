// The clock of a saved state, of this version or an earlier one.
#pragma once

#include <cstddef>
#include <cstring>

#include "mpm/kernels/clock.hpp"
#include "mpm/solver/blob.hpp"

namespace mpm {

/// Earlier clocks end before the deposits of the step before the last, which then are none: the
/// first limit follows from the last deposits alone, as it did in those versions.
inline Clock saved_clock(const State& state) {
    const Blob& saved = detail::find(state, "clock");
    const std::size_t size = saved.bytes.size();
    if (saved.type != detail::type_code<Clock>() ||
        (size != sizeof(Clock) && size != offsetof(Clock, deposited_before)))
        throw SceneError(
            "the saved clock has another size; the state was saved by another version");
    Clock clock{};
    std::memcpy(&clock, saved.bytes.data(), size);
    return clock;
}

}  // namespace mpm
