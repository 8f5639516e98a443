// The deposit half of the two-pass form; it knows no material and takes one channel at a time.
#include "mpm/kernels/cuda/two_pass.cuh"

namespace mpm::cuda {

template <class X, class T, int D>
void scatter_body(const Pass<X, T, D>& pass, int channels, int plain) {
    pass.exec->launch_next(&scatter_step<X, T, D>, pass.body.homes,
                           channels + 1 + (plain >= 0 ? D : 0), block_cells, pass, channels, plain);
}

template void scatter_body<Cuda, float, 2>(const Pass<Cuda, float, 2>&, int, int);
template void scatter_body<Cuda, float, 3>(const Pass<Cuda, float, 3>&, int, int);
template void scatter_body<Cuda, double, 2>(const Pass<Cuda, double, 2>&, int, int);
template void scatter_body<Cuda, double, 3>(const Pass<Cuda, double, 3>&, int, int);
template void scatter_body<CudaMixed, double, 2>(const Pass<CudaMixed, double, 2>&, int, int);
template void scatter_body<CudaMixed, double, 3>(const Pass<CudaMixed, double, 3>&, int, int);

}  // namespace mpm::cuda
