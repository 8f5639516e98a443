// Smoothing (physics/smoothing.hpp) of a field on given points, on cells of given size: what the
// phase of a step does, for data from anywhere.
#pragma once

#include <cstdint>
#include <vector>

#include "mpm/kernels/cell_smoothing.hpp"

namespace mpm::cpu {

/// A field on points in one to three dimensions.
struct PointField {
    int dimension = 1;
    std::int64_t count = 0;
    int components = 1;
    const double* position = nullptr;  // (count, dimension) m
    const double* mass = nullptr;      // (count,) kg
    double cell_size = 1;              // m; a cell's lower corner is a multiple of it
};

/// Smooths `field` (count, components) in place, `passes` times; the energy of each pass.
std::vector<SmoothingEnergy> smooth_points(const PointField& points, const SmoothingChoice& choice,
                                           int passes, double* field);

}  // namespace mpm::cpu
