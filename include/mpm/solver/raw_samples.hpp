// Rows of sensors as their rings have them: sums that ranks add are in pieces (core/exact.hpp), so
// that the result has the same bits however particles and nodes are shared out.
#pragma once

#include <vector>

#include "mpm/kernels/sampling.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

/// About how large the numbers of a scene are: m, m/s, kg/m^3, and kg of a cell.
struct SceneSizes {
    double length, speed, density, mass;
};
SceneSizes sizes_of(const Spec& spec, const Plan& plan);
/// Of impulses: those of a cell's mass at the speed of waves are the largest of a step.
ImpulseScales impulse_scales(const Spec& spec, const Plan& plan);

/// Numbers of a row in the ring of a sensor.
std::size_t ring_columns(const Spec& spec, int sensor);

/// What is asked for in rows of these sensors, without what is large and for their engine alone.
std::vector<SensorSpec> without_places(std::vector<SensorSpec> sensors);

/// Adds to rows of a rank's ring what another rank has of the same samples.
void join(const SensorSpec& sensor, int dimension, Samples& to, const Samples& from);

/// Rows of the rings, whole, to those of `sensor_columns`.
std::vector<Samples> finished(const std::vector<SensorSpec>& sensors, int dimension,
                              std::vector<Samples> raw);

}  // namespace mpm
