#include "mpm/kernels/staging.hpp"

#include "mpm/core/config.hpp"
#include "mpm/kernels/cpu/levels.hpp"

namespace mpm {

namespace {

template <class T>
struct AddStage {
    template <bool>
    MPM_INLINE static void run(T* to, const T* from, T mass, std::size_t count) {
        for (std::size_t k = 0; k < count; ++k) to[k] += mass * from[k];
    }
};

}  // namespace

template <class T>
void add_staged(T* to, const T* from, T mass, std::size_t count, bool first) {
    if (first)
        AddStage<T>::template run<false>(to, from, mass, count);
    else
        cpu::runner<AddStage<T>, cpu::Levels::all, T*, const T*, T, std::size_t>()(to, from, mass,
                                                                                   count);
}
template void add_staged(float*, const float*, float, std::size_t, bool);
template void add_staged(double*, const double*, double, std::size_t, bool);

}  // namespace mpm
