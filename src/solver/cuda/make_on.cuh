#pragma once

#include "grid_passes.cuh"
#include "mpm/solver/make_domain.hpp"
#include "precisions.hpp"

namespace mpm {

/// With particles in T: one rank, as many as there are devices, or one of several processes.
template <class X, class T>
std::unique_ptr<Engine> make_on(const Spec& s, const Plan& plan) {
    if (s.ranks.count == 1)
        return make_domain<X, T>(s, plan, [&] { return X(s.device, s.shared_device); });
    check_ranks(s, plan);
    check_devices(s);
    if (s.ranks.processes)
        return make_rank<X, T>(s, plan, s.ranks.processes,
                               [&] { return X(s.device, s.shared_device); });
    return make_ranks<X, T>(s, plan, std::make_unique<RankThreads>(s.ranks.count), [&](int rank) {
        return X(s.ranks.devices[std::size_t(rank)], s.shared_device);
    });
}

}  // namespace mpm
