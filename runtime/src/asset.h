// An asset: immutable data of splats on the GPU, shared by its instances.
//
// Textures of every model (layout.glsl says where a splat sits in them):
//   geometry    RGBA32F  slots: mean+opacity, quaternion xyzw, scales, then the model's own
#pragma once

#include "model.h"

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace nacre {

enum GeometrySlot { kMeanOpacity, kRotation, kScale, kCommonSlots };

struct Asset {
    explicit Asset(Context& c) : context(c) {}

    Context& context;
    Handle handle;
    std::string modelName;
    SplatGrid grid;
    float lowPassVariance = 0;
    int visibilitySize = 0; // texels per side of the visibility maps; 0: none
    uint32_t bakedSplats = 0; // of the file
    Preset preset;          // in use, or one without a name
    bool coded = false;     // the file holds transport as rounded codes: on the GPU bytes are exact enough for it
    glm::vec3 boundsMin{0}, boundsMax{0};
    glm::quat yUpFromAsset{1, 0, 0, 0};
    AssetFrame frame;
    uint64_t gpuBytes = 0;
    Texture geometry;
    std::unique_ptr<AssetModel> model;

    // For culling and sorting on the CPU.
    std::vector<glm::vec3> positions;
    std::vector<float> maxScales;
    float largestScale = 0;

    // Until everything is uploaded.
    std::unique_ptr<SplatAsset> source;
    UploadQueue queue;
    bool started = false;

    bool complete() const { return !source; }
};

/// What is to be drawn of an asset: a preset of the file by its name, or `detail`.
struct DetailChoice {
    std::string preset;
    Detail detail;
};
/// Checks and decodes; no GL.
Failure decode(Context& context, std::span<const std::byte> bytes, const DetailChoice& choice, std::shared_ptr<Asset>* asset);
/// Uploads about so many bytes, at least one piece. After a failure the asset stays incomplete.
Failure uploadStep(Asset& asset, uint64_t budget);

} // namespace nacre
