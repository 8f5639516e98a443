// The deposit half of the two-pass form; it knows no material and takes one channel at a time.
#include "mpm/kernels/cuda/two_pass.cuh"

namespace mpm::cuda {

template <class X, class T, int D>
void scatter_body(const Pass<X, T, D>& pass, int channels) {
    pass.exec->launch_next(&scatter_step<X, T, D>, pass.body.homes, channels + 1, block_cells, pass,
                           channels);
}

template void scatter_body<Cuda, float, 2>(const Pass<Cuda, float, 2>&, int);
template void scatter_body<Cuda, float, 3>(const Pass<Cuda, float, 3>&, int);
template void scatter_body<Cuda, double, 2>(const Pass<Cuda, double, 2>&, int);
template void scatter_body<Cuda, double, 3>(const Pass<Cuda, double, 3>&, int);
template void scatter_body<CudaMixed, double, 2>(const Pass<CudaMixed, double, 2>&, int);
template void scatter_body<CudaMixed, double, 3>(const Pass<CudaMixed, double, 3>&, int);

}  // namespace mpm::cuda
