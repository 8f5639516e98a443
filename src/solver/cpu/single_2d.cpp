#include "make_on.hpp"

namespace mpm {

template std::unique_ptr<Engine> make_on_cpu<float, 2>(const Spec&, const Plan&,
                                                       std::unique_ptr<RankThreads>&);

}  // namespace mpm
