// Which splats to draw, far to near by Euclidean distance of their means from the camera (KHR_gaussian_splatting "cameraDistance").
// Equal distances: the lower index is in front, as in a stable front-to-back sort.
//
// Culling is conservative: it uses the bound |J row|^2 * (largest scale)^2 >= Sigma'_ii, the vertex shader decides exactly.
#include "asset.h"

#include "splats/blend.h"

#include <algorithm>
#include <cmath>

namespace nacre {

/// The pixel footprint along one axis, and whether it meets [-1, 1] in ndc.
struct AxisCull {
    glm::vec3 row, wRow;
    float wTranslation, rowTranslation, halfPixels;

    bool meets(const glm::vec3& view, float w, float scale, float lowPass) const
    {
        const float ndc = (glm::dot(row, view) + rowTranslation) / w;
        const float at = std::clamp(ndc, -1.0f - kJacobianMargin, 1.0f + kJacobianMargin);
        const float slope = glm::length(row - at * wRow) * halfPixels / w * scale;
        constexpr float kReach = 3.34f; // sqrt(2 ln 255): alpha falls to 1/255 here at opacity 1
        const float reach = kReach * std::sqrt(slope * slope + lowPass) + 1.0f;
        return !(std::abs(ndc) * halfPixels > halfPixels + reach); // negated, so NaN is left to the shader
    }
};

static AxisCull axisCull(const DrawFrame& frame, int axis)
{
    const glm::mat4 p = glm::transpose(frame.clipFromView);
    return {glm::vec3(p[axis]), glm::vec3(p[3]), p[3][3], p[axis][3], 0.5f * frame.viewport[axis]};
}

bool sortSplats(NacreAssetImpl& asset, const DrawFrame& frame)
{
    if (asset.sorted && asset.sortedFor == frame) return false;
    const AxisCull cullX = axisCull(frame, 0), cullY = axisCull(frame, 1);
    asset.keys.clear();
    asset.farToNear.clear();
    for (uint32_t g = 0; g < asset.count; ++g) {
        const glm::vec3& p = asset.positions[g];
        const glm::vec3 view = frame.viewFromAsset * p + frame.viewTranslation;
        const float w = glm::dot(cullX.wRow, view) + cullX.wTranslation;
        const float scale = asset.maxScales[g] * frame.viewScale;
        if (!(w > 0.999f * frame.nearW)) continue; // a margin for rounding: the shader's test is the exact one
        if (!cullX.meets(view, w, scale, asset.lowPassVariance) || !cullY.meets(view, w, scale, asset.lowPassVariance)) continue;
        const glm::vec3 d = p - frame.cameraAsset;
        asset.keys.push_back(radixKey(glm::dot(d, d)));
        asset.farToNear.push_back(g);
    }
    radixSort(std::span(asset.keys), std::span(asset.farToNear), asset.scratch);
    std::reverse(asset.farToNear.begin(), asset.farToNear.end()); // after a stable near-to-far sort: ties keep the lower index in front
    asset.sortedFor = frame;
    asset.sorted = true;
    return true;
}

} // namespace nacre
