// An asset on the GPU, and the steps of a draw: relight, sort, raster. Each file implements one of them; what depends on the appearance
// model is behind GpuModel.
//
// Textures of every model (layout.glsl says where a splat sits in them):
//   geometry    RGBA32F  slots: mean+opacity, quaternion xyzw, scales, then the model's own
//   order       R32UI    splats far to near
//   lights      RGBA32F  row 0: see sampleLight in light.glsl; row 1: intensity
#pragma once

#include "context.h"
#include "gl_state.h"
#include "gpu_model.h"
#include "splats/splat_asset.h"

#include "base/radix_sort.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace nacre {

enum GeometrySlot { kMeanOpacity, kRotation, kScale, kCommonSlots };

/// The host's matrices, checked and combined for one draw.
struct DrawFrame {
    glm::mat3 viewFromAsset;       // rotation times viewScale
    glm::vec3 viewTranslation;
    glm::mat4 clipFromView;
    glm::dmat4 assetFromWorld;
    glm::vec3 cameraAsset;
    float worldScale;              // world length of one asset unit
    float viewScale;               // length of one in view space: another where the camera hangs on something scaled
    ClipControl clip;              // of the host
    glm::vec4 nearPlane;           // dot(nearPlane, (p, 1)) > 0 for what is beyond it, view space; tilted in mirrors and water
    float nearW;                   // smallest clip w of the near plane within the frustum
    glm::vec2 viewport;            // pixels
    bool operator==(const DrawFrame&) const = default;
};

struct PackedLights {              // as in the light texture: two rows of NACRE_MAX_LIGHTS texels
    glm::vec4 shape[NACRE_MAX_LIGHTS];     // asset space; see sampleLight in light.glsl
    glm::vec4 intensity[NACRE_MAX_LIGHTS];
    int count;
    float worldScale2;
};

} // namespace nacre

struct NacreAssetImpl {
    NacreContextImpl* context = nullptr;

    // What was uploaded.
    uint32_t count = 0;
    int width = 0, rows = 0;       // of the grid, layout.glsl
    int rowShift = 0;              // layers of the textures that hold one long row are 2^shift texels wide and high
    int mostLights = 0;            // that these textures have room for on this GPU
    float lowPassVariance = 0;
    int visibilitySize = 0; // texels per side of the visibility maps; 0: none
    glm::vec3 boundsMin{0}, boundsMax{0};
    glm::quat yUpFromAsset{1, 0, 0, 0};
    nacre::AssetFrame frame;
    uint64_t gpuBytes = 0;
    GLuint geometry = 0, lights = 0, order = 0;
    std::unique_ptr<nacre::GpuModel> model;

    std::string modelName;

    // For culling and sorting on the CPU.
    std::vector<glm::vec3> positions;
    std::vector<float> maxScales;
    std::vector<uint32_t> keys, farToNear;
    nacre::RadixScratch<uint32_t> scratch;

    // What the host set, and what the cached results were computed from.
    std::vector<NacreLight> hostLights;
    nacre::PackedLights packed{}, relitWith{};
    nacre::DrawFrame sortedFor{};
    bool relit = false, sorted = false;
    NacreDrawStats stats{};
};

namespace nacre {

/// Uploads a valid asset (see validate in appearance/model_table.h) and compiles its programs. On failure `asset` holds what was made
/// so far: destroyAsset frees it.
Failure uploadAsset(NacreContextImpl& context, const SplatAsset& source, NacreAssetImpl& asset);
void destroyAsset(NacreAssetImpl& asset);

/// Checks and combines the host's matrices.
Failure makeFrame(const NacreDrawDesc& desc, const ClipControl& clip, DrawFrame* frame);

/// Pixel (x, y) of the window looks along origin + x right + y up, asset space, any length. `viewport` as in GL.
struct WindowRays {
    glm::vec3 origin, right, up;
};
WindowRays windowRays(const DrawFrame& frame, const float viewport[4]);

/// Packs the lights and lets the model run the passes whose inputs changed. Leaves framebuffer and viewport dirty.
Failure relight(NacreAssetImpl& asset, const DrawFrame& frame);

/// Fills farToNear with the splats that may touch the frame, if the frame changed. True if it did.
bool sortSplats(NacreAssetImpl& asset, const DrawFrame& frame);

Failure draw(NacreAssetImpl& asset, const NacreDrawDesc& desc);
/// Ahead of draws: their programs and, with `desc`, passes and order.
Failure prepare(NacreAssetImpl& asset, const NacreDrawDesc* desc, int mostLights);

/// Largest value that the bound target holds, splat colours stop there.
float largestColor(const Gl& gl);
/// The quads of the splats of this frame, far to near, with the program in use.
void drawQuads(const NacreAssetImpl& asset);

} // namespace nacre
