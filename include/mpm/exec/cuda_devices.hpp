// What CUDA devices there are. No CUDA header, so that the binding compiles as plain C++.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace mpm {

struct CudaDevice {
    int index = 0;
    std::string name;
    std::size_t memory = 0;  // bytes
    std::size_t free = 0;
    std::string compute_capability;
};

/// Throws DeviceError with the reason when there is no driver or no device.
std::vector<CudaDevice> cuda_devices();

/// Of the runtime this library is linked with, e.g. "13.0".
std::string cuda_runtime();

}  // namespace mpm
