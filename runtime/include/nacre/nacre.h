// Nacre runtime: draws relightable splat assets inside your OpenGL frame. C99, no global state.
//
// You own window, GL context, framebuffer, files and threads. Call every function that takes a NacreContext or an asset of it on the
// thread where the GL context given to nacreContextCreate is current; one that shares objects with it is another one. Where GL can tell,
// a call in another context fails with NACRE_ERROR_GL, and destroying there frees no GL objects, with a warning. GL 3.3 core or newer.
//
// Frames: right-handed; matrices are column-major float[16] that multiply column vectors, clip space is OpenGL's (z in [-w, w]) or what
// glClipControl makes of it.
// Colour: linear Rec.709 radiance. Draw into a linear float target (RGBA16F or RGBA32F) with premultiplied "over" blending.
#ifndef NACRE_H
#define NACRE_H

#include <stddef.h>
#include <stdint.h>

// On Windows a host of the shared library defines NACRE_SHARED (nacre::runtime and nacre.pc do); NACRE_BUILDING belongs to our own build.
#if defined(_WIN32) && defined(NACRE_SHARED) && defined(NACRE_BUILDING)
#define NACRE_API __declspec(dllexport)
#elif defined(_WIN32) && defined(NACRE_SHARED)
#define NACRE_API __declspec(dllimport)
#elif defined(_WIN32)
#define NACRE_API
#else
#define NACRE_API __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define NACRE_VERSION_MAJOR 0
#define NACRE_VERSION_MINOR 1
#define NACRE_VERSION_PATCH 0
/// MAJOR*10000 + MINOR*100 + PATCH of the library that is linked (compare with the macros of the header).
NACRE_API uint32_t nacreVersion(void);

typedef enum NacreResult {
    NACRE_OK = 0,
    NACRE_ERROR_INVALID_ARGUMENT = 1, // null pointer, non-finite number, wrong structSize
    NACRE_ERROR_BAD_ASSET = 2,        // the bytes are not a valid asset; the message names the part
    NACRE_ERROR_UNSUPPORTED = 3,      // GL too old, a limit too small for this asset
    NACRE_ERROR_OUT_OF_MEMORY = 4,
    NACRE_ERROR_GL = 5                // shader failure, incomplete framebuffer, another GL context is current
} NacreResult;

typedef enum NacreSeverity { NACRE_INFO = 0, NACRE_WARNING = 1, NACRE_ERROR = 2 } NacreSeverity;

typedef struct NacreContextImpl* NacreContext;
typedef struct NacreAssetImpl* NacreAsset;

/// Same shape as eglGetProcAddress / glfwGetProcAddress with a user pointer.
typedef void* (*NacreGetProcAddress)(const char* name, void* user);
/// `text` is one line, valid during the call.
typedef void (*NacreMessageCallback)(NacreSeverity severity, const char* text, void* user);

typedef struct NacreContextDesc {
    size_t structSize;                   // sizeof(NacreContextDesc)
    NacreGetProcAddress getProcAddress;  // required
    void* getProcAddressUser;
    NacreMessageCallback message;        // optional; without it messages are dropped
    void* messageUser;
} NacreContextDesc;

/// Compiles nothing yet; checks the GL version and limits. On failure `*context` is NULL.
NACRE_API NacreResult nacreContextCreate(const NacreContextDesc* desc, NacreContext* context);
/// Frees every GL object of the context. Destroy its assets first. NULL is allowed.
NACRE_API void nacreContextDestroy(NacreContext context);

/// Uploads an asset (.glb bytes) to the GPU. `bytes` may be freed when this returns. Safe on untrusted input: a damaged file
/// gives NACRE_ERROR_BAD_ASSET and one message; nothing is created and `*asset` is NULL. A GL error that was pending is cleared, with a
/// warning.
NACRE_API NacreResult nacreAssetCreate(NacreContext context, const void* bytes, size_t byteCount, NacreAsset* asset);
NACRE_API void nacreAssetDestroy(NacreAsset asset);

typedef struct NacreAssetInfo {
    size_t structSize;          // sizeof(NacreAssetInfo), set by the caller
    uint32_t splatCount;
    uint64_t gpuBytes;          // textures and buffers of this asset
    float boundsMin[3];         // of the splat centres, asset space
    float boundsMax[3];
    float yUpFromAsset[4];      // quaternion x,y,z,w of the asset's glTF node: apply it in worldFromAsset for a +Y-up world
    char model[16];             // "bigs" or "sss"; the latter has materials to edit
    // The dataset it was baked from, for hosts that work in its units: p_dataset = datasetScale * p_asset + datasetTranslation (as
    // worldFromAsset it puts the asset there), and intensities of the dataset's lights are to be multiplied by datasetLightGain.
    double datasetScale, datasetTranslation[3], datasetLightGain;
} NacreAssetInfo;
NACRE_API NacreResult nacreAssetGetInfo(NacreAsset asset, NacreAssetInfo* info);

typedef enum NacreLightType { NACRE_LIGHT_POINT = 0, NACRE_LIGHT_DIRECTIONAL = 1 } NacreLightType;

/// World space. Point: intensity I, irradiance I / r^2, capped inside `radius` (at least 1 mm).
/// Directional: `vector` is the unit direction from the surface to the light, intensity is the irradiance; `radius` is the angular radius of
/// what shines in radians (the sun: 0.0047), 0 to 1.6. It widens highlights, which many lights that stand for an environment need.
typedef struct NacreLight {
    NacreLightType type;
    float vector[3];      // position or direction to light
    float intensity[3];   // linear rgb, 0 to 1e15
    float radius;         // see above; 0 is fine
} NacreLight;

#define NACRE_MAX_LIGHTS 256

/// Replaces the lights that illuminate `asset`. Copies them. Relighting runs at the next draw, only if something changed.
/// NACRE_ERROR_UNSUPPORTED: an asset of this many splats leaves room for fewer lights on this GPU (the message says how many).
NACRE_API NacreResult nacreAssetSetLights(NacreAsset asset, const NacreLight* lights, size_t count);

typedef enum NacreEditTarget {
    NACRE_EDIT_BASE_COLOR = 0, // value: linear rgb, 0 to 1
    NACRE_EDIT_ROUGHNESS = 1,  // value[0], 0 to 1, as are the next two
    NACRE_EDIT_METALNESS = 2,
    NACRE_EDIT_SUBSURFACE = 3,
    NACRE_EDIT_RESIDUAL = 4,   // value: rgb factor of the light that travels beneath the surface; 1 as baked
    NACRE_EDIT_OPACITY = 5     // value[0], 0 to 1
} NacreEditTarget;
typedef enum NacreEditOperation { NACRE_EDIT_SET = 0, NACRE_EDIT_MULTIPLY = 1 } NacreEditOperation;
typedef enum NacreEditRegion { NACRE_REGION_EVERYWHERE = 0, NACRE_REGION_BOX = 1, NACRE_REGION_SPHERE = 2 } NacreEditRegion;

/// A change of baked materials, in order of the array. Asset space; a splat is inside if its centre is.
typedef struct NacreEdit {
    NacreEditTarget target;
    NacreEditOperation operation;
    float value[3];       // 0 to 1e4; what it makes of a material is held in the range above
    NacreEditRegion region;
    float low[3];         // box: lower corner; sphere: centre
    float high[3];        // box: upper corner; sphere: high[0] is the radius
} NacreEdit;

#define NACRE_MAX_EDITS 64

/// Replaces the edits of `asset`; none brings back what was baked. Multiplying by 1 changes no pixel. Cost at the next draw: all materials
/// are uploaded again. NACRE_ERROR_UNSUPPORTED: the asset's model has no materials (bigs).
NACRE_API NacreResult nacreAssetSetEdits(NacreAsset asset, const NacreEdit* edits, size_t count);

typedef struct NacreDrawDesc {
    size_t structSize;          // sizeof(NacreDrawDesc)
    float worldFromAsset[16];   // rigid, mirrored or not, plus uniform scale
    float viewFromWorld[16];    // the same; usually without scale
    float clipFromView[16];     // perspective projection; off-centre, jittered, reversed, with an oblique near plane: all are fine
    int viewportWidth;          // pixels of the viewport the host has set (origin as the host set it); 0: nothing is drawn, nothing else is
    int viewportHeight;         // looked at (a minimised window)
    int depthTest;              // 1: test splat centres against the bound depth buffer with the host's depth function; 0: no test
} NacreDrawDesc;

/// Draws into the bound draw framebuffer. Touched GL state is saved and restored (list in README, "Embedding"). Your viewport, scissor,
/// stencil test and depth function apply; depth is never written. Cost follows change: with lights, camera and asset at rest only the
/// splats are blended. In a half-float target splat colours stop at 65504, so that blending makes no infinities. Of several draw buffers
/// only the first is written. NACRE_ERROR_GL: the bound framebuffer is incomplete. GL errors that were pending stay pending, except
/// that a draw that needs more GPU memory (the first, more lights, for sss another viewport) clears them, with a warning.
NACRE_API NacreResult nacreAssetDraw(NacreAsset asset, const NacreDrawDesc* desc);

/// Does ahead what draws would do at first need: compiles the programs that draws with up to `mostLights` lights can need (many lights on
/// an asset of the model sss: seconds), and, unless `desc` is NULL, sorts and relights for this camera and the lights and edits set now.
/// Draws nothing, needs no framebuffer. Relighting inside conditional rendering is dropped with the draw; it is noticed and made up a draw
/// later, but called outside of it this does the work where it counts, and keeps it out of your occlusion queries.
NACRE_API NacreResult nacreAssetPrepare(NacreAsset asset, const NacreDrawDesc* desc, size_t mostLights);

/// CPU-side record of the last draw, for tests and profilers.
typedef struct NacreDrawStats {
    size_t structSize;            // sizeof(NacreDrawStats), set by the caller
    uint32_t splatsDrawn;         // after culling
    uint32_t lightPassesRun;      // 1 if the light-only part was re-evaluated in the last draw, else 0; a frame or two after a
                                  // change again, until the GPU has told that it was drawn
    uint32_t viewPassesRun;       // 1 if the view-only contraction was re-evaluated
    uint32_t combinePassesRun;    // 1 if the final colours were re-evaluated
    uint32_t sorted;              // 1 if the splats were sorted again
    double relightSeconds;        // CPU wall time of submission unless nacreContextSetProfiling(1), which inserts glFinish
    double sortSeconds;
    double rasterSeconds;
} NacreDrawStats;
NACRE_API NacreResult nacreAssetGetDrawStats(NacreAsset asset, NacreDrawStats* stats);
/// 1: glFinish around relight, sort and raster so that the stats are true times. Slows drawing down. Default 0.
NACRE_API void nacreContextSetProfiling(NacreContext context, int enabled);

#ifdef __cplusplus
}
#endif
#endif
