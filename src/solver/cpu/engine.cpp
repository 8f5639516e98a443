#include "mpm/solver/merged.hpp"
#include "mpm/solver/ranks.hpp"
#include "precisions.hpp"

namespace mpm {

namespace {

/// Of what was built: all, unless LIBMPM_DOMAINS names some.
std::unique_ptr<Engine> make_built(const Spec& s, const Plan& plan,
                                   std::unique_ptr<RankThreads>& ranks) {
    [[maybe_unused]] constexpr Precision of_single = Precision::single,
                                         of_double = Precision::double_;
#define MPM_DOMAIN(name, T, D) \
    if (s.precision == of_##name && s.dimension == D) return make_on_cpu<T, D>(s, plan, ranks);
#include "mpm/solver/cpu_domains.inc"
#undef MPM_DOMAIN
    throw SceneError("precision '" + cpu_traits(s.precision).numbers() + "' in " +
                     std::to_string(s.dimension) +
                     " dimensions is not built for the CPU; build without LIBMPM_DOMAINS");
}

}  // namespace

std::unique_ptr<Engine> make_cpu_engine(const Spec& spec, std::unique_ptr<RankThreads> ranks) {
    return make_merged(spec, [&](const Spec& s) {
        const Plan plan = make_plan(s, cpu_traits(s.precision));
        if (ranks || (s.ranks.processes && s.ranks.count > 1)) check_ranks(s);
        return make_built(s, plan, ranks);
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
