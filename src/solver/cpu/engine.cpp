#include "mpm/exec/cpu.hpp"
#include "mpm/solver/make_domain.hpp"
#include "mpm/solver/merged.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cpu_engine(const Spec& spec, std::unique_ptr<RankThreads> ranks) {
    return make_merged(spec, [&](const Spec& s) {
        const Plan plan = make_plan(s, cpu_traits(s.precision));
        const bool single = s.precision == Precision::single;
        if (const auto& processes = s.ranks.processes; processes && s.ranks.count > 1) {
            check_ranks(s, plan);
            const auto executor = [&] { return Cpu(s.threads); };
            return single ? make_rank<Cpu, float>(s, plan, processes, executor)
                          : make_rank<Cpu, double>(s, plan, processes, executor);
        }
        if (!ranks) {
            const auto executor = [&] { return Cpu(s.threads); };
            return single ? make_domain<Cpu, float>(s, plan, executor)
                          : make_domain<Cpu, double>(s, plan, executor);
        }
        check_ranks(s, plan);
        const int each = std::max(1, Cpu(s.threads).threads() / s.ranks.count);
        const auto executor = [&](int) { return Cpu(each); };
        return single ? make_ranks<Cpu, float>(s, plan, std::move(ranks), executor)
                      : make_ranks<Cpu, double>(s, plan, std::move(ranks), executor);
    });
}

std::unique_ptr<Engine> make_cpu_engine(const Spec& spec) {
    if (spec.ranks.count < 1)
        throw SceneError("the scene has " + std::to_string(spec.ranks.count) +
                         " ranks; it takes one or more");
    if (!spec.functions.kind.empty()) {
        if (spec.ranks.count > 1)
            throw SceneError("functions over cells are not built for several ranks; take one");
        return make_functions_engine(spec);
    }
    const bool threads = spec.ranks.count > 1 && !spec.ranks.processes;
    check_processes(spec);
    return make_cpu_engine(spec,
                           threads ? std::make_unique<RankThreads>(spec.ranks.count) : nullptr);
}

}  // namespace mpm
