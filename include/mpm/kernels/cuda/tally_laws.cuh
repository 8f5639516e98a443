// The laws that tallies on devices ask, by number: for the units that compile the pass.
#pragma once

#include "mpm/kernels/cuda/tally.cuh"
#include "mpm/kernels/model_headers.inc"
#include "mpm/kernels/respond.hpp"

namespace mpm {

namespace cuda {

template <class Material, int D>
MPM_CALL Observation<D> observe_with(const double* state, const double (&rate)[D][D],
                                     const double* parameters) {
    const Reconverge at_return;
    return Material::template observe<D>(state, rate, parameters);
}

}  // namespace cuda

template <int D>
MPM_CALL Observation<D> observe_by_number(int law, const double* state, const double (&rate)[D][D],
                                          const double* parameters) {
    const Reconverge at_return;
    int number = 0;
    Observation<D> out{};
#define MPM_MODEL(Model) \
    if (law == number++) out = cuda::observe_with<Model, D>(state, rate, parameters);
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
    return out;
}

template <int D>
MPM_CALL void adopt_by_number(int law, double* state, double loss) {
    const Reconverge at_return;
    int number = 0;
#define MPM_MODEL(Model)                                        \
    if constexpr (smoothable<Model, D>) {                       \
        if (law == number) adopt_volume<Model, D>(state, loss); \
    }                                                           \
    ++number;
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
}

}  // namespace mpm
