// Splats that tests cast shadows on.
#pragma once

#include "runtime_fixture.h"

namespace nacre::test {

constexpr float kReceiverSigma = 0.012f;

/// A grid of cells x cells small white splats over [-1, 1]^2 that do not overlap in the picture of an orthographic camera above them, at
/// pseudo-random heights.
inline SplatAsset shadowReceivers(bool sss, int cells, float height)
{
    const size_t count = size_t(cells) * size_t(cells);
    SplatAsset a = sss ? randomSss(count, 0, 5) : randomAsset(count, 0, 5);
    for (size_t g = 0; g < count; ++g) {
        const int x = int(g) % cells, y = int(g) / cells;
        a.cloud.positions[g] = {(2 * x + 1.0f) / float(cells) - 1, (2 * y + 1.0f) / float(cells) - 1, height * float((g * 7919) % 101) / 101};
        a.cloud.scales[g] = glm::vec3(kReceiverSigma);
        a.cloud.opacities[g] = 0.9f;
    }
    for (Channel& c : a.channels) {
        if (c.name == "tDir")
            for (size_t i = 0; i < c.values.size(); ++i) c.values[i] = i % 25 == 0 ? 1.0f : 0.0f;
        if (c.name == "rho" || c.name == "baseColor") std::fill(c.values.begin(), c.values.end(), 0.75f);
        if (c.name == "tInd") std::fill(c.values.begin(), c.values.end(), 0.0f);
        if (c.name == "normal")
            for (size_t i = 0; i < c.values.size(); ++i) c.values[i] = i % 3 == 2 ? 1.0f : 0.0f;
    }
    return a;
}

} // namespace nacre::test
