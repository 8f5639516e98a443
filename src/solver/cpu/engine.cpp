#include "mpm/exec/cpu.hpp"
#include "mpm/solver/make_domain.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cpu_engine(const Spec& spec) {
    return make_domain<Cpu>(spec, make_plan(spec, cpu_traits(spec.single)),
                            [&] { return Cpu(spec.threads); });
}

}  // namespace mpm
