// Errors that reach the user. Each names the object, the value, the rule and the remedy; Python
// raises the class of the same name.
#pragma once

#include <stdexcept>
#include <string>

namespace mpm {

struct Error : std::runtime_error {
    using std::runtime_error::runtime_error;
};
/// The description asks for something impossible or not built.
struct SceneError : Error {
    using Error::Error;
};
/// No device, no driver, a failed launch.
struct DeviceError : Error {
    using Error::Error;
};
/// Memory, or a count beyond what an index can hold.
struct CapacityError : Error {
    using Error::Error;
};
/// The computation left the range in which it is meaningful.
struct NumericalError : Error {
    using Error::Error;
};

}  // namespace mpm
