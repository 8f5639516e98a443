#include "mpm/kernels/staging.hpp"

#include "mpm/kernels/cpu/levels.hpp"

namespace mpm {

namespace {

template <class T>
inline void add(T* to, const T* from, T mass, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) to[k] += mass * from[k];
}

MPM_CLONES void add_in_step(float* to, const float* from, float mass, std::size_t count) {
    add(to, from, mass, count);
}
MPM_CLONES void add_in_step(double* to, const double* from, double mass, std::size_t count) {
    add(to, from, mass, count);
}

}  // namespace

template <class T>
void add_staged(T* to, const T* from, T mass, std::size_t count, bool first) {
    if (first)
        add(to, from, mass, count);
    else
        add_in_step(to, from, mass, count);
}
template void add_staged(float*, const float*, float, std::size_t, bool);
template void add_staged(double*, const double*, double, std::size_t, bool);

}  // namespace mpm
