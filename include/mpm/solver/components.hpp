// The components of a simulation that know no precision: compiled once for each executor and
// dimension, in units of src/solver/<backend>, and not in each unit of a simulation that has them.
#pragma once

#include "mpm/solver/block_table.hpp"
#include "mpm/solver/boundaries.hpp"
#include "mpm/solver/inflow.hpp"
#include "mpm/solver/sensors.hpp"
#include "mpm/solver/time_tables.hpp"

/// `prefix`: extern, or nothing in the unit that compiles them.
#define MPM_COMPONENTS(prefix, X, D)        \
    prefix template class BlockTable<X, D>; \
    prefix template class Boundaries<X, D>; \
    prefix template class Inflow<X, D>;     \
    prefix template class Sensors<X, D>;
#define MPM_COMPONENTS_OF_ALL(prefix, X) prefix template class TimeTables<X>;
