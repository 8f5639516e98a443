#include "support/slow_domain.hpp"

namespace mpm::test {

template std::unique_ptr<Engine> make_slow<3>(const Spec&, bool);

}  // namespace mpm::test
