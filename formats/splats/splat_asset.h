// The relightable splat asset in memory: geometry plus the per-splat channels of one appearance model.
#pragma once

#include "base/asset_frame.h"
#include "splats/detail.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace nacre {

struct SplatCloud {                   // all arrays have `count` rows
    size_t count = 0;
    std::vector<glm::vec3> positions; // asset units, in the dataset's own axes
    std::vector<glm::quat> rotations; // unit, asset-from-local
    std::vector<glm::vec3> scales;    // standard deviations along the local axes, linear, > 0
    std::vector<float> opacities;     // [0, 1], already through the sigmoid
};

/// One quantity of the appearance model per splat, or (perAsset) one row for all of them. Row-major: [splat * components + k], in
/// `values`, or in `bytes` (b stands for b / 255) if the model says so.
struct Channel {
    std::string name;                 // e.g. "tDir"; unique within the asset
    uint32_t components = 0;          // numbers per splat, or of the one row
    std::vector<float> values{};      // rows * components, or empty
    std::vector<uint8_t> bytes{};     // rows * components, or empty
    bool perAsset = false;            // e.g. the weights of a network
    size_t leading = 0;               // > 0: only the first so many splats have a row, that of the others would be zero

    size_t rows(size_t splats) const { return perAsset ? 1 : leading > 0 ? leading : splats; }

    size_t sizeInBytes() const { return values.size() * sizeof(float) + bytes.size(); }
};

/// Channels of every splat as a few small integers. The numbers x of a splat, those of the channels side by side, from its codes c:
///     x[d] = offset[d] + sum_k c[k] basis[k * numbers + d]
/// A renderer may keep the codes as they are; expandChannels (appearance/coded_channels.h) makes values of them.
struct CodedChannels {
    std::vector<std::string> channels; // e.g. tDir, tInd: these entries of SplatAsset::channels have no values until they are expanded
    uint32_t numbers = 0, codes = 0;   // per splat
    std::vector<float> offset;         // [numbers]
    std::vector<float> basis;          // [codes][numbers]
    std::vector<int8_t> values;        // [splat][codes]
};

/// KHR_gaussian_splatting look under one fixed light, for viewers that cannot relight. Linear Rec.709.
struct NeutralLook {
    int shFunctions = 0;              // 0 (none), 1, 4, 9 or 16
    std::vector<glm::vec3> sh;        // [splat * shFunctions + i]; colour = max(0, 0.5 + sum_i sh_i y_i(mean - camera))
};

struct SplatAsset {
    std::string model;                // "bigs" or "sss"
    SplatCloud cloud;
    std::vector<Channel> channels;    // as listed by the model's channel table
    std::vector<CodedChannels> coded; // of the above, those that are kept as codes
    int drawnVisibility = 0;          // texels per side of visibility maps that are not stored, because they follow from the splats; 0: none
    std::string profile = "lossless"; // how the file stores it: lossless | compact | interop
    float lowPassVariance = 0.1f;     // px^2 added to both diagonal entries of the projected covariance, opacity-compensated (mip-splatting)
    glm::quat yUpFromAsset{1, 0, 0, 0}; // the glTF node's rotation: dataset axes -> glTF +Y up
    AssetFrame frame;                 // where the asset lies in the dataset it was baked from
    NeutralLook neutral;
    std::vector<Preset> presets;      // at most 64
    std::string bakedWith;            // one line of provenance: version, dataset name, iterations, seed

    const Channel* find(const char* name) const
    {
        for (const Channel& c : channels)
            if (c.name == name) return &c;
        return nullptr;
    }
};

} // namespace nacre
