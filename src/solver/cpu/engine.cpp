#include "mpm/exec/cpu.hpp"
#include "mpm/solver/make_domain.hpp"
#include "mpm/solver/merged.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cpu_engine(const Spec& spec) {
    return make_merged(spec, [](const Spec& s) {
        return make_domain<Cpu>(s, make_plan(s, cpu_traits(s.single)),
                                [&] { return Cpu(s.threads); });
    });
}

}  // namespace mpm
