// What a fault of the clock says to its reader: which object, what it did, since when. Knows no
// executor and no precision; compiled in src/solver/common/faults.cpp.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "mpm/kernels/clock.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

/// A particle of another rank has failed: this one has nothing to describe.
inline constexpr std::uint64_t fault_elsewhere = no_fault - 1;

/// The particle that a fault names, as it is stored.
struct FailedParticle {
    std::uint64_t id = 0;
    std::vector<double> offset, state;
};

/// The first step from which on the fastest node never again was slower than a tenth of what it is
/// now.
std::int64_t growth_start(const Clock& clock);

/// `particle(body, place)` is asked only where the fault names one.
template <int D>
Fault describe_fault(const Spec& spec, const Plan& plan, const Clock& clock,
                     const std::function<FailedParticle(std::size_t, std::size_t)>& particle);

/// The message of a fault that has found `element`, from its vertices, value and code; `first_id`
/// is the body's.
void name_element(Fault& fault, std::uint64_t first_id);

}  // namespace mpm
