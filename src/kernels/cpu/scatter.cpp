// The deposit half of the two-pass form, for every number of channels.
#include "mpm/kernels/cpu/body_pass.hpp"

namespace mpm::cpu {

template <class T, int D, Smoothing S>
void scatter_body(const Pass<Cpu, T, D>& pass) {
    run_body<Inert, S, T, D, Stage::scatter>(pass);
}

template void scatter_body<float, 2, Smoothing::none>(const Pass<Cpu, float, 2>&);
template void scatter_body<float, 3, Smoothing::none>(const Pass<Cpu, float, 3>&);
template void scatter_body<double, 2, Smoothing::none>(const Pass<Cpu, double, 2>&);
template void scatter_body<double, 3, Smoothing::none>(const Pass<Cpu, double, 3>&);
template void scatter_body<float, 2, Smoothing::one_volume>(const Pass<Cpu, float, 2>&);
template void scatter_body<float, 3, Smoothing::one_volume>(const Pass<Cpu, float, 3>&);
template void scatter_body<double, 2, Smoothing::one_volume>(const Pass<Cpu, double, 2>&);
template void scatter_body<double, 3, Smoothing::one_volume>(const Pass<Cpu, double, 3>&);

}  // namespace mpm::cpu
