#pragma once

#include <cstddef>

namespace nacre::cli {

/// The most memory that this process has held at once, in bytes; 0 where the system does not say.
size_t peakMemoryBytes();

} // namespace nacre::cli
