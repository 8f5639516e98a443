// Tallies on devices: one pass asks the laws of all bodies, by their numbers.
#pragma once

#include <string>

#include "mpm/kernels/cuda/tally_sums.cuh"

namespace mpm {

/// The number of a law among those that are built in; -1 of others.
int law_number(const std::string& name);

/// Defined in the units that compile the pass (tally_laws.cuh).
template <int D>
MPM_CALL Observation<D> observe_by_number(int law, const double* state, const double (&rate)[D][D],
                                          const double* parameters);
template <int D>
MPM_CALL void adopt_by_number(int law, double* state, double loss);

template <int D>
struct LawByNumber {
    int number;
    MPM_INLINE Observation<D> observe(const double* state, const double (&rate)[D][D],
                                      const double* parameters) const {
        return observe_by_number<D>(number, state, rate, parameters);
    }
    MPM_INLINE void adopt(double* state, double loss) const {
        adopt_by_number<D>(number, state, loss);
    }
};

template <int D>
struct LawOnDevice {
    using type = LawByNumber<D>;
    template <class Ops>
    static type make(const Ops&, const std::string& name) {
        return {law_number(name)};
    }
    static bool knows(const std::string& name) { return law_number(name) >= 0; }
};
template <int D>
struct LawOf<Cuda, D> : LawOnDevice<D> {};
template <int D>
struct LawOf<CudaMixed, D> : LawOnDevice<D> {};

}  // namespace mpm

#define MPM_TALLIES_IN(prefix, X, T, D)                                                         \
    prefix template void                                                                        \
    Cuda::sum_each<1, MeasureTallies<X, T, D, LawByNumber<D>>, TakeTallies<D>, Tally, Nothing>( \
        const SumSets&, const MeasureTallies<X, T, D, LawByNumber<D>>&, const TakeTallies<D>&,  \
        Tally*, std::int64_t, const Nothing&);
#define MPM_TALLIES(prefix, X, T)   \
    MPM_TALLIES_IN(prefix, X, T, 2) \
    MPM_TALLIES_IN(prefix, X, T, 3)

namespace mpm {

MPM_TALLIES(extern, Cuda, float)
MPM_TALLIES(extern, Cuda, double)
MPM_TALLIES(extern, CudaMixed, double)

}  // namespace mpm
