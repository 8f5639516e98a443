// Simulations on the device that is none (slow_device.hpp), compiled once for all tests that run
// them: this header knows nothing of how.
#pragma once

#include <memory>

#include "mpm/solver/engine.hpp"

namespace mpm::test {

/// With as many ranks as the scene has, each a thread and a device. `reaches`: ranks read and add
/// in each other's memory; otherwise everything is sent. Of materials there are TaitFluid, with
/// every smoothing, FixedCorotated and LinearElastic; of elements FixedCorotated and VonMises.
std::unique_ptr<Engine> make_slow_engine(const Spec& s, bool reaches = true);

/// How far particles may drift between sorts there, in cells.
extern const double slow_drift_limit;

/// In which order particles add to cells; whatever it is, the bits are the same.
inline bool cells_backwards = true;

}  // namespace mpm::test
