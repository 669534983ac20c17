// What went wrong on a device.
#pragma once

#include <stdexcept>

namespace nacre {

/// One line that says what failed on the device, such as memory: how much was asked for, how much there is.
struct DeviceError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

} // namespace nacre
