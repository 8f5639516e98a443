#include "mpm/exec/cpu.hpp"
#include "mpm/solver/make_domain.hpp"
#include "mpm/solver/merged.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cpu_engine(const Spec& spec) {
    if (!spec.functions.kind.empty()) return make_functions_engine(spec);
    return make_merged(spec, [](const Spec& s) {
        const Plan plan = make_plan(s, cpu_traits(s.precision));
        const auto executor = [&] { return Cpu(s.threads); };
        return s.precision == Precision::single ? make_domain<Cpu, float>(s, plan, executor)
                                                : make_domain<Cpu, double>(s, plan, executor);
    });
}

}  // namespace mpm
