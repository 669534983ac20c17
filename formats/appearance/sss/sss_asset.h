// How an asset stores the sss model, and one splat of it as numbers. Host only.
//
//   baseColor   [splat][3]
//   material    [splat][2 or 3]   roughness, metalness and, unless the object scatters nothing, subsurfaceness
//   normal      [splat][3]        unit
//   visibility  [splat][256 or 1024] bytes (visibility_map.h), or absent: every light arrives
//   network     [kSssNetworkFloats], once: the weights (sss_network.h), then centre and 1 / half-size of the box in which positions are
//               coded; or absent: what arrives is what the map says, and nothing travels beneath the surface
//   code        [splat][kSssCodeInputs], and codeWeights [kSssHidden1][kSssCodeInputs], once: what the network knows of each splat
//               beyond its place and normal; either absent: nothing
#pragma once

#include "appearance/sss/sss_network.h"
#include "appearance/visibility_map.h"
#include "splats/splat_asset.h"

#include <algorithm>

namespace nacre {

constexpr int kSssFrame = kSssWeights; // centre x, y, z, 1 / half-size
constexpr int kSssNetworkFloats = kSssWeights + 4;

/// What a splat is made of. `residual` multiplies the scattered light: 1 as baked, other values come from edits.
struct SssMaterial {
    float base[3];
    float roughness, metalness, subsurface;
    float normal[3];
    float residual[3];
    float opacity;
};

/// The channels of a valid asset (validate in model_table.h).
class SssChannels {
public:
    explicit SssChannels(const SplatAsset& asset)
        : cloud_(&asset.cloud), base_(asset.find("baseColor")), material_(asset.find("material")), normal_(asset.find("normal")),
          visibility_(asset.find("visibility")), network_(asset.find("network")),
          code_(asset.find("code")), codeWeights_(asset.find("codeWeights"))
    {
    }

    SssMaterial material(size_t splat) const
    {
        const float *b = &base_->values[3 * splat], *m = &material_->values[material_->components * splat], *n = &normal_->values[3 * splat];
        return {{b[0], b[1], b[2]}, m[0], m[1], material_->components > 2 ? m[2] : 0.0f, {n[0], n[1], n[2]}, {1, 1, 1}, cloud_->opacities[splat]};
    }
    VisibilityMap visibility(size_t splat) const
    {
        return visibility_ ? VisibilityMap{&visibility_->bytes[visibility_->components * splat], visibilitySize(visibility_->components)} : VisibilityMap{};
    }
    const float* network() const { return network_ ? network_->values.data() : nullptr; }
    bool scatters() const { return network_ && material_->components > 2; }
    /// Whether the network says how much of the light arrives, not only what the map lets through: weights of 0 always answer 1.
    bool shares() const
    {
        const auto zero = [](float w) { return w == 0.0f; };
        return network_ && !std::all_of(network() + kSssShareOut, network() + kSssShareOutBias + 1, zero);
    }

    /// Of the first layer of the network, what light and view do not change: first[kSssHidden1].
    void firstLayer(size_t splat, float* first) const
    {
        float in[kSssFixedInputs];
        sssFixedInputs(&cloud_->positions[splat].x, &normal_->values[3 * splat], network() + kSssFrame, in);
        sssNetworkFixed(network(), in, first);
        if (code_ && codeWeights_) sssNetworkCode(codeWeights_->values.data(), &code_->values[kSssCodeInputs * splat], first);
    }

private:
    const SplatCloud* cloud_;
    const Channel *base_, *material_, *normal_, *visibility_, *network_, *code_, *codeWeights_;
};

} // namespace nacre
