// Changes to the materials of a baked sss asset without a new bake (SSS-GS, figure 4). One function for runtime and reference renderer.
#pragma once

#include "appearance/sss/sss_asset.h"

#include <algorithm>
#include <span>

namespace nacre {

enum class EditTarget { kBaseColor, kRoughness, kMetalness, kSubsurface, kResidual, kOpacity };
enum class EditRegion { kEverywhere, kBox, kSphere };

/// `value` (rgb for base colour and residual, else the first) replaces what is there, or multiplies it. Materials stay in [0, 1]; the
/// factor of the residual may be anything not negative. Splats count by their centres.
struct SplatEdit {
    EditTarget target = EditTarget::kBaseColor;
    bool multiply = false;
    float value[3] = {1, 1, 1};
    EditRegion region = EditRegion::kEverywhere;
    float low[3] = {0, 0, 0};  // box: lower corner; sphere: centre
    float high[3] = {0, 0, 0}; // box: upper corner; sphere: radius, first number
};

inline bool insideRegion(const SplatEdit& edit, const glm::vec3& p)
{
    if (edit.region == EditRegion::kEverywhere) return true;
    if (edit.region == EditRegion::kSphere) {
        const glm::vec3 d = p - glm::vec3(edit.low[0], edit.low[1], edit.low[2]);
        return glm::dot(d, d) <= edit.high[0] * edit.high[0];
    }
    for (int k = 0; k < 3; ++k)
        if (!(p[k] >= edit.low[k] && p[k] <= edit.high[k])) return false;
    return true;
}

/// A factor of exactly 1 changes nothing.
inline void applyEdits(std::span<const SplatEdit> edits, const glm::vec3& position, SssMaterial& m)
{
    for (const SplatEdit& edit : edits) {
        if (!insideRegion(edit, position)) continue;
        const auto apply = [&](float& x, int k, float most) { x = std::clamp(edit.multiply ? x * edit.value[k] : edit.value[k], 0.0f, most); };
        switch (edit.target) {
        case EditTarget::kBaseColor:
            for (int k = 0; k < 3; ++k) apply(m.base[k], k, 1.0f);
            break;
        case EditTarget::kRoughness: apply(m.roughness, 0, 1.0f); break;
        case EditTarget::kMetalness: apply(m.metalness, 0, 1.0f); break;
        case EditTarget::kSubsurface: apply(m.subsurface, 0, 1.0f); break;
        case EditTarget::kResidual:
            for (int k = 0; k < 3; ++k) apply(m.residual[k], k, 1e4f);
            break;
        case EditTarget::kOpacity: apply(m.opacity, 0, 1.0f); break;
        }
    }
}

} // namespace nacre
