#pragma once

#include "components.cuh"
#include "grid_passes.cuh"
#include "mpm/kernels/cuda/tally.cuh"
#include "mpm/solver/make_domain.hpp"
#include "precisions.hpp"

namespace mpm {

/// With particles in T and D dimensions: one rank, as many as there are devices, or one of several
/// processes.
template <class X, class T, int D>
std::unique_ptr<Engine> make_in(const Spec& s, const Plan& plan) {
    if (s.ranks.count == 1)
        return make_domain<X, T, D>(s, plan, [&] { return X(s.device, s.shared_device); });
    check_ranks(s);
    check_devices(s);
    if (s.ranks.processes)
        return make_rank<X, T, D>(s, plan, s.ranks.processes,
                                  [&] { return X(s.device, s.shared_device); });
    return make_ranks<X, T, D>(
        s, plan, std::make_unique<RankThreads>(s.ranks.count),
        [&](int rank) { return X(s.ranks.devices[std::size_t(rank)], s.shared_device); });
}
template <class X, class T>
std::unique_ptr<Engine> make_on(const Spec& s, const Plan& plan) {
    return s.dimension == 2 ? make_in<X, T, 2>(s, plan) : make_in<X, T, 3>(s, plan);
}

}  // namespace mpm
