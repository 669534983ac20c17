// What a host says about its lights, checked and copied. Structs may be an older host's.
#pragma once

#include "failure.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <vector>

namespace nacre {

/// In the library's size.
inline NacreShadowMap wholeShadowMap(const NacreShadowMap& map)
{
    NacreShadowMap whole{};
    std::memcpy(&whole, &map, std::min(map.structSize, sizeof whole));
    return whole;
}

/// `index` is for the message. Looks at the shadow map, too.
Failure checkLight(const NacreLight& light, size_t index);
/// Looks at every pixel.
Failure checkEnvironment(const NacreEnvironment& environment);

/// Copies that have the library's size, what the host does not know being zero. Fails where a light is not as it should be.
Failure readLights(const NacreLight* lights, size_t count, std::vector<NacreLight>* copies);
/// The same of an environment. Its pixels and coefficients stay the host's.
Failure readEnvironment(const NacreEnvironment& environment, NacreEnvironment* copy);

} // namespace nacre
