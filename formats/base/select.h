// A choice that can be made for several lanes at once: code without branches compiles for a number or for a vector of them.
#pragma once

#include "base/host_device.h"

namespace nacre {

/// x where the condition holds, else y. Both are evaluated.
template <class T>
NACRE_HD inline T select(bool condition, T x, T y)
{
    return condition ? x : y;
}

} // namespace nacre
