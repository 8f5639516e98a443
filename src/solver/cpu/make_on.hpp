#pragma once

#include "components.hpp"
#include "grid_passes.hpp"
#include "mpm/solver/make_domain.hpp"
#include "precisions.hpp"

namespace mpm {

template <class T, int D>
std::unique_ptr<Engine> make_on_cpu(const Spec& s, const Plan& plan,
                                    std::unique_ptr<RankThreads>& ranks) {
    const auto executor = [&] { return Cpu(s.threads); };
    if (const auto& processes = s.ranks.processes; processes && s.ranks.count > 1)
        return make_rank<Cpu, T, D>(s, plan, processes, executor);
    if (!ranks) return make_domain<Cpu, T, D>(s, plan, executor);
    const int each = std::max(1, Cpu(s.threads).threads() / s.ranks.count);
    return make_ranks<Cpu, T, D>(s, plan, std::move(ranks), [&](int) { return Cpu(each); });
}

}  // namespace mpm
