// An asset on the GPU, and the steps of a draw: relight, sort, raster. Each file implements one of them.
//
// Textures (layout.glsl says where a splat sits in them):
//   geometry    RGBA32F  slots: mean+opacity, quaternion xyzw, scales, rho+shadow; with a lobe also normal+sharpness, k
//   transport   RGBA16F  25 slots: T_ind rgb, T_dir
//   scatter     RGBA16F  array, texel g * pairs + pair(i, j): c_ij rgb (all of a splat together: the view pass reads it 25 times)
//   visibility  R8       array, texel g * 256 + j * 16 + i of the octahedral maps
//   direct, indirect     RGBA32F  light pass: one slot per four lights
//   visible     RGBA16F  light pass: v of four lights per slot, for the lobe (v comes from bytes: half floats lose nothing of it)
//   contracted  RGBA32F  view pass: every grid row becomes one row per function of s
//   color       RGBA32F  combine pass: radiance towards the camera
// scatter and contracted exist only with s, visibility only with that channel, visible only with lobe and visibility.
#pragma once

#include "context.h"
#include "splats/splat_asset.h"

#include "base/radix_sort.h"

#include <cstdint>
#include <vector>

namespace nacre {

enum GeometrySlot { kMeanOpacity, kRotation, kScale, kRhoShadow, kNormalSharpness, kLobeColor, kGeometrySlots };

/// A program and the uniforms that change per draw (-1 where a program has no such uniform).
struct Program {
    GLuint name = 0;
    GLint lightCount = -1, worldScale2 = -1, cameraAsset = -1;
    GLint viewFromAsset = -1, viewTranslation = -1, clipFromView = -1, viewport = -1, jacobianLimit = -1, nearW = -1, lowPass = -1,
          maxColor = -1;
};

/// The host's matrices, checked and combined for one draw.
struct DrawFrame {
    glm::mat3 viewFromAsset;       // rotation times worldScale
    glm::vec3 viewTranslation;
    glm::mat4 clipFromView;
    glm::dmat4 assetFromWorld;
    glm::vec3 cameraAsset;
    float worldScale;              // world length of one asset unit
    float nearW;                   // clip w at the near plane
    glm::vec2 viewport;            // pixels
    bool operator==(const DrawFrame&) const = default;
};

struct PackedLights {              // as in the light texture: two rows of NACRE_MAX_LIGHTS texels
    glm::vec4 shape[NACRE_MAX_LIGHTS];     // asset space; see sampleLight in bigs.glsl
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
    int sFunctions = 0;
    bool hasLobe = false;
    int visibilitySize = 0; // texels per side; 0: none
    float lowPassVariance = 0;
    glm::vec3 boundsMin{0}, boundsMax{0};
    glm::quat yUpFromAsset{1, 0, 0, 0};
    uint64_t gpuBytes = 0;
    GLuint geometry = 0, transport = 0, scatter = 0, visibility = 0, contracted = 0, direct = 0, indirect = 0, visible = 0, color = 0,
           lights = 0, order = 0;
    GLuint lightFramebuffer = 0, viewFramebuffer = 0, combineFramebuffer = 0;
    nacre::Program lightPass, viewPass, combinePass, splatProgram;

    // For culling and sorting on the CPU.
    std::vector<glm::vec3> positions;
    std::vector<float> maxScales;
    std::vector<uint32_t> keys, farToNear;
    nacre::RadixScratch<uint32_t> scratch;

    // What the host set, and what the cached results were computed from.
    std::vector<NacreLight> hostLights;
    nacre::PackedLights packed{}, relitWith{};
    glm::vec3 seenFrom{0};         // camera of the last view and combine pass
    nacre::DrawFrame sortedFor{};
    int groupCapacity = 0;         // slots of direct, indirect and visible
    bool relit = false, seen = false, sorted = false;
    NacreDrawStats stats{};
};

namespace nacre {

/// Uploads a valid asset (see validate in appearance/model_table.h) and compiles its programs. On failure `asset` holds what was made
/// so far: destroyAsset frees it.
Failure uploadAsset(NacreContextImpl& context, const SplatAsset& source, NacreAssetImpl& asset);
void destroyAsset(NacreAssetImpl& asset);

/// Allocates a texture of `slots` slots; adds to gpuBytes.
GLuint createSlotTexture(NacreAssetImpl& asset, GLenum format, int slots);

/// Compiles the four programs for this asset's layout and channels.
Failure compilePrograms(NacreAssetImpl& asset);

/// Checks and combines the host's matrices.
Failure makeFrame(const NacreDrawDesc& desc, DrawFrame* frame);

/// Runs the passes whose inputs changed. Leaves framebuffer and viewport dirty.
Failure relight(NacreAssetImpl& asset, const DrawFrame& frame);

/// Fills farToNear with the splats that may touch the frame, if the frame changed. True if it did.
bool sortSplats(NacreAssetImpl& asset, const DrawFrame& frame);

Failure draw(NacreAssetImpl& asset, const NacreDrawDesc& desc);

void bindTexture(const Gl& gl, int unit, GLenum target, GLuint texture);

} // namespace nacre
