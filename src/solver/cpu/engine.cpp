#include "mpm/solver/merged.hpp"
#include "mpm/solver/ranks.hpp"
#include "precisions.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cpu_engine(const Spec& spec, std::unique_ptr<RankThreads> ranks) {
    return make_merged(spec, [&](const Spec& s) {
        const Plan plan = make_plan(s, cpu_traits(s.precision));
        if (ranks || (s.ranks.processes && s.ranks.count > 1)) check_ranks(s, plan);
        return s.precision == Precision::single ? make_cpu_single(s, plan, ranks)
                                                : make_cpu_double(s, plan, ranks);
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
