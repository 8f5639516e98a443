#include "make_on.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cpu_double(const Spec& spec, const Plan& plan,
                                        std::unique_ptr<RankThreads>& ranks) {
    return make_on_cpu<double>(spec, plan, ranks);
}

}  // namespace mpm
