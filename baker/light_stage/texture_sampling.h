// Texture look-up of the light stage: bilinear or nearest, wrapped, colours decoded before filtering.
#pragma once

#include "base/color.h"
#include "mesh/mesh_scene.h"

#include <glm/glm.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace nacre::stage {

inline int wrapTexel(int i, int size, TextureWrap wrap)
{
    if (wrap == TextureWrap::kClamp) return std::clamp(i, 0, size - 1);
    const int period = wrap == TextureWrap::kMirror ? 2 * size : size;
    const int m = (i % period + period) % period;
    return m < size ? m : period - 1 - m;
}

inline glm::vec4 texel(const MeshTexture& t, int x, int y, bool srgb)
{
    static const std::array<float, 256> kLinear = [] {
        std::array<float, 256> table;
        for (size_t i = 0; i < 256; ++i) table[i] = float(linearFromSrgb(double(i) / 255.0));
        return table;
    }();
    const uint8_t* p = t.rgba.data() + 4 * (size_t(wrapTexel(y, t.height, t.wrapV)) * size_t(t.width) + size_t(wrapTexel(x, t.width, t.wrapU)));
    if (srgb) return {kLinear[p[0]], kLinear[p[1]], kLinear[p[2]], float(p[3]) / 255.0f};
    return glm::vec4(p[0], p[1], p[2], p[3]) / 255.0f;
}

/// `uv` as in glTF: (0, 0) is the corner of the first texel. A coordinate that is not finite reads the corner.
inline glm::vec4 sampleTexture(const MeshTexture& t, glm::vec2 uv, bool srgb)
{
    // Whole periods are dropped first so that far coordinates keep their fraction and fit an int.
    for (int i = 0; i < 2; ++i) {
        const TextureWrap wrap = i ? t.wrapV : t.wrapU;
        const float period = wrap == TextureWrap::kMirror ? 2.0f : 1.0f;
        uv[i] = wrap == TextureWrap::kClamp ? std::clamp(uv[i], -1.0f, 2.0f) : uv[i] - period * std::floor(uv[i] / period);
        if (!(std::abs(uv[i]) <= 4.0f)) uv[i] = 0.0f;
    }
    if (t.nearest) return texel(t, int(std::floor(uv.x * float(t.width))), int(std::floor(uv.y * float(t.height))), srgb);
    const glm::vec2 at = uv * glm::vec2(t.width, t.height) - 0.5f, low = glm::floor(at), f = at - low;
    const int x = int(low.x), y = int(low.y);
    return glm::mix(glm::mix(texel(t, x, y, srgb), texel(t, x + 1, y, srgb), f.x),
                    glm::mix(texel(t, x, y + 1, srgb), texel(t, x + 1, y + 1, srgb), f.x), f.y);
}

} // namespace nacre::stage
