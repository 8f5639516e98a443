#include "make_on.hpp"

namespace mpm {

template std::unique_ptr<Engine> make_on_cpu<double, 3>(const Spec&, const Plan&,
                                                        std::unique_ptr<RankThreads>&);

}  // namespace mpm
