#include "support/slow_domain.hpp"

namespace mpm::test {

const double slow_drift_limit = SlowDevice::drift_limit;

std::unique_ptr<Engine> make_slow_engine(const Spec& s, bool reaches) {
    return s.dimension == 2 ? make_slow<2>(s, reaches) : make_slow<3>(s, reaches);
}

template std::unique_ptr<Engine> make_slow<2>(const Spec&, bool);

}  // namespace mpm::test
