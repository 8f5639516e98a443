#include "make_on.hpp"

namespace mpm {

std::unique_ptr<Engine> make_cpu_single(const Spec& spec, const Plan& plan,
                                        std::unique_ptr<RankThreads>& ranks) {
    return make_on_cpu<float>(spec, plan, ranks);
}

}  // namespace mpm
