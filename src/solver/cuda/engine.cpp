#include "mpm/solver/merged.hpp"
#include "mpm/solver/ranks.hpp"
#include "precisions.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cuda_engine(const Spec& spec) {
    check_processes(spec);
    return make_merged(spec, [](const Spec& s) {
        const Plan plan = make_plan(s, cuda_traits(s.precision));
        if (s.precision == Precision::mixed) return make_cuda_mixed(s, plan);
        return s.precision == Precision::single ? make_cuda_single(s, plan)
                                                : make_cuda_double(s, plan);
    });
}

}  // namespace mpm
