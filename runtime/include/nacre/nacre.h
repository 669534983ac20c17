// Nacre runtime: draws scenes of relightable splats inside your OpenGL frame. C99.
//
// You own window, GL context, framebuffer, files and threads. An asset is immutable data on the GPU. An instance places an asset in the
// world. A view is a camera with everything that depends on it: keep one for each eye, mirror or player. One call draws all instances of a
// view in one joint order, whatever their models. Lights belong to the context; masks say which instance sees which.
//
// Everything is named by ids that are checked: a stale, null or foreign id gives NACRE_ERROR_INVALID_ARGUMENT, never a crash. Call what
// takes a context or something of it on the thread where the GL context given to nacreContextCreate is current (nacreAssetDecode: on any
// thread); one that shares objects with it is another one. Where GL can tell, a call in another context fails with NACRE_ERROR_GL, and
// destroying there frees no GL objects, with a warning. OpenGL 3.3 core, OpenGL ES 3.0 with EXT_color_buffer_float,
// WebGL 2 with the same, or newer.
//
// Structs are zero-initialised by the host: zero always is the default. `structSize` is sizeof as the host compiled it; a smaller one than
// the library's is an older host's, whose missing fields are zero.
//
// Frames: right-handed; matrices are column-major float[16] that multiply column vectors, clip space is OpenGL's (z in [-w, w]) or what
// glClipControl makes of it. Vectors to lights point from the surface to the light.
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
#define NACRE_VERSION_MINOR 2
#define NACRE_VERSION_PATCH 0
/// MAJOR*10000 + MINOR*100 + PATCH of the library that is linked (compare with the macros of the header).
NACRE_API uint32_t nacreVersion(void);

typedef enum NacreResult {
    NACRE_OK = 0,
    NACRE_ERROR_INVALID_ARGUMENT = 1, // null pointer, stale id, non-finite number, wrong structSize
    NACRE_ERROR_BAD_ASSET = 2,        // the bytes are not a valid asset; the message names the part
    NACRE_ERROR_UNSUPPORTED = 3,      // GL too old, a limit too small for this asset
    NACRE_ERROR_OUT_OF_MEMORY = 4,
    NACRE_ERROR_GL = 5                // shader failure, incomplete framebuffer, another GL context is current
} NacreResult;

typedef enum NacreSeverity { NACRE_INFO = 0, NACRE_WARNING = 1, NACRE_ERROR = 2 } NacreSeverity;

/// Ids; 0 is none. Copy and compare them freely.
typedef struct NacreContext { uint64_t id; } NacreContext;
typedef struct NacreAsset { uint64_t id; } NacreAsset;
typedef struct NacreInstance { uint64_t id; } NacreInstance;
typedef struct NacreView { uint64_t id; } NacreView;

// ---- context -----------------------------------------------------------------------------------------------------------------------

/// Same shape as eglGetProcAddress / glfwGetProcAddress with a user pointer.
typedef void* (*NacreGetProcAddress)(const char* name, void* user);
/// `text` is one line, valid during the call.
typedef void (*NacreMessageCallback)(NacreSeverity severity, const char* text, void* user);

typedef enum NacreBackEnd {
    NACRE_BACK_END_AUTO = 0,   // the fastest that the context can do; where GL draws on the CPU, it sorts there and draws quads
    NACRE_BACK_END_GL33 = 1,   // vertex and fragment shaders only
    NACRE_BACK_END_GLES3 = 2,  // the same in OpenGL ES 3.0 and WebGL 2
    NACRE_BACK_END_GL43 = 3    // with compute shaders, which also sort and draw scenes of bigs
} NacreBackEnd;

enum NacreContextFlags {
    NACRE_HOST_RESTORES_STATE = 1  // the host sets its GL state again after each call: none is put back, hardly any read (runtime/CONTRACT.md)
};

typedef struct NacreContextDesc {
    size_t structSize;                   // sizeof(NacreContextDesc)
    NacreGetProcAddress getProcAddress;  // required
    void* getProcAddressUser;
    NacreMessageCallback message;        // optional; without it messages are dropped
    void* messageUser;
    NacreBackEnd backEnd;                // one that the GL context cannot do: NACRE_ERROR_UNSUPPORTED
    uint32_t flags;                      // NacreContextFlags
} NacreContextDesc;

/// Compiles nothing yet; checks the GL version and limits. On failure `*context` is 0.
NACRE_API NacreResult nacreContextCreate(const NacreContextDesc* desc, NacreContext* context);
/// Destroys everything of the context. 0 and stale ids are allowed, here and in the other destroy functions.
NACRE_API void nacreContextDestroy(NacreContext context);
/// 1: glFinish around relight, sort and raster so that the stats are true times. Slows drawing down. Default 0.
NACRE_API void nacreContextSetProfiling(NacreContext context, int enabled);

typedef struct NacreContextInfo {
    size_t structSize;          // sizeof(NacreContextInfo), set by the caller
    NacreBackEnd backEnd;       // the one in use
    uint32_t assets, instances, views;
    uint64_t gpuBytes;          // textures and buffers of all of them
    uint32_t programs;          // compiled so far
} NacreContextInfo;
NACRE_API NacreResult nacreContextGetInfo(NacreContext context, NacreContextInfo* info);

// ---- assets ------------------------------------------------------------------------------------------------------------------------

/// Uploads an asset (.glb bytes) to the GPU. `bytes` may be freed when this returns. Safe on untrusted input: a damaged file
/// gives NACRE_ERROR_BAD_ASSET and one message; nothing is created and `*asset` is 0. A GL error that was pending is cleared, with a
/// warning.
NACRE_API NacreResult nacreAssetCreate(NacreContext context, const void* bytes, size_t byteCount, NacreAsset* asset);

/// The same in slices. Decode on any thread, also while the context draws (but destroy the context only afterwards); it makes no GL call.
/// Visibility maps that the file leaves out are drawn in it, which takes about 0.25 ms a splat of one core: 6 s for 24,000.
/// Then, on the context's thread, upload about `budgetBytes` at each step, at least one piece, until `*bytesLeft` (may be null) is 0.
/// Instances of an asset that is not complete are not drawn.
NACRE_API NacreResult nacreAssetDecode(NacreContext context, const void* bytes, size_t byteCount, NacreAsset* asset);
NACRE_API NacreResult nacreAssetUploadStep(NacreAsset asset, uint64_t budgetBytes, uint64_t* bytesLeft);

/// Parts that an asset can do without; what it does not have anyway may be named.
enum NacreDetailParts {
    NACRE_WITHOUT_VISIBILITY = 1, // maps of what hides lights from a splat: every light arrives
    NACRE_WITHOUT_LOBE = 2,       // bigs: mirror-like highlights
    NACRE_WITHOUT_FORWARD = 4,    // bigs: light that shines through
    NACRE_WITHOUT_SCATTER = 8,    // bigs: the part of direct light that depends on light and camera
    NACRE_WITHOUT_INDIRECT = 16,  // bigs: light that has been reflected or has travelled inside
    NACRE_WITHOUT_NETWORK = 32    // sss: light beneath the surface
};

/// How much of an asset to load, which costs image quality (nacre report measures how much of which asset) and saves time and memory. For levels of
/// detail load an asset several times, and draw, of instances at one place, the one that fits the distance.
typedef struct NacreDetail {
    size_t structSize;            // sizeof(NacreDetail)
    float splats;                 // share of them, above 0 to 1; 0: all. The most important, which grow to fill the gaps. Files without an order of importance: NACRE_ERROR_INVALID_ARGUMENT; nacre pack makes one
    uint32_t leaveOut;            // NacreDetailParts
    uint32_t transportFunctions;  // bigs: most SH functions of light transport: 1, 4, 9 or 16; 0: all 25
    uint32_t visibilitySize;      // most texels per side of visibility maps: 16; 0: as they are
    const char* preset;           // a preset of the file by its name (nacre info lists them), instead of the fields above; null or empty: none
} NacreDetail;

/// nacreAssetCreate and nacreAssetDecode of less than everything. `detail` may be null.
NACRE_API NacreResult nacreAssetCreateDetail(NacreContext context, const void* bytes, size_t byteCount, const NacreDetail* detail, NacreAsset* asset);
NACRE_API NacreResult nacreAssetDecodeDetail(NacreContext context, const void* bytes, size_t byteCount, const NacreDetail* detail, NacreAsset* asset);

/// Its instances stay until they are destroyed; the data goes with the last of them.
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
    uint32_t bakedSplatCount;   // of the file; splatCount are those that were loaded
    char preset[32];            // in use, or empty; what it advises the host to do:
    float resolutionScale;      // draw splats into a target of so much of the width and height, and enlarge it; 1 without a preset
    uint32_t environmentDirections; // for NacreEnvironment.directions; 0: any
} NacreAssetInfo;
NACRE_API NacreResult nacreAssetGetInfo(NacreAsset asset, NacreAssetInfo* info);

// ---- instances ---------------------------------------------------------------------------------------------------------------------

typedef struct NacreInstanceDesc {
    size_t structSize;          // sizeof(NacreInstanceDesc)
    NacreAsset asset;
    float worldFromAsset[16];   // rigid, mirrored or not, plus uniform scale; all zero: identity
    uint32_t lightMask;         // lit by lights whose mask has a bit in common; 0: by all
    uint32_t viewMask;          // drawn in views whose mask has a bit in common; 0: in all
    int hidden;                 // 1: not drawn
} NacreInstanceDesc;

NACRE_API NacreResult nacreInstanceCreate(const NacreInstanceDesc* desc, NacreInstance* instance);
NACRE_API void nacreInstanceDestroy(NacreInstance instance);
/// Lights are fixed to the world: moving an instance relights it.
NACRE_API NacreResult nacreInstanceSetTransform(NacreInstance instance, const float worldFromAsset[16]);
NACRE_API NacreResult nacreInstanceSetHidden(NacreInstance instance, int hidden);
NACRE_API NacreResult nacreInstanceSetMasks(NacreInstance instance, uint32_t lightMask, uint32_t viewMask);
/// Factor of the colour, linear rgb, 0 to 1e4. bigs: of all light it sends. sss: of its base colour and of the light that travels beneath
/// the surface; highlights of dielectrics keep their colour. Default 1.
NACRE_API NacreResult nacreInstanceSetTint(NacreInstance instance, const float tint[3]);

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

/// Replaces the edits of the instance; none brings back what was baked. Multiplying by 1 changes no pixel. An edited instance has
/// materials of its own. NACRE_ERROR_UNSUPPORTED: the asset's model has no materials (bigs).
NACRE_API NacreResult nacreInstanceSetEdits(NacreInstance instance, const NacreEdit* edits, size_t count);

// ---- lights ------------------------------------------------------------------------------------------------------------------------

typedef enum NacreLightType {
    NACRE_LIGHT_POINT = 0,       // intensity I: irradiance I / r^2, which stops growing inside `radius` (at least 1 mm)
    NACRE_LIGHT_DIRECTIONAL = 1, // intensity is the irradiance; `radius` is the angular radius of what shines (the sun: 0.0047), 0 to 1.6
    NACRE_LIGHT_SPOT = 2,        // a point light within a cone, as in KHR_lights_punctual
    NACRE_LIGHT_SPHERE = 3,      // a sphere of `radius` that shines like a point light of this intensity from afar
    NACRE_LIGHT_RECTANGLE = 4    // shines to one side, towards `direction`: I cos(angle) / r^2 from afar
} NacreLightType;

enum NacreLightFlags {
    NACRE_LIGHT_SPLAT_SHADOWS = 1 // instances shade one another under it (nacreContextSetShadowBudget)
};

typedef enum NacreShadowMapKind { NACRE_SHADOW_MAP_2D = 0, NACRE_SHADOW_MAP_ARRAY = 1, NACRE_SHADOW_MAP_CUBE = 2 } NacreShadowMapKind;

/// A depth texture that the host has drawn from the light: what lies behind its surfaces gets no light from it. Its sampler state does
/// not matter and stays. Point lights: a cube map, whose faces look along the axes as in GL.
typedef struct NacreShadowMap {
    size_t structSize;            // sizeof(NacreShadowMap)
    NacreShadowMapKind kind;
    uint32_t texture;             // GL name
    uint32_t layers;              // array: cascades, nearest first, 1 to 8; the first that holds a splat counts
    const float* clipFromWorld;   // 16 numbers a layer; cube: null
    float nearPlane, farPlane;    // cube: of its faces
    int distances;                // 1, cube: texels are distance / farPlane instead of depth
    int reversed;                 // 1: nearer is larger
    int zeroToOne;                // 1: clip z is in [0, w], as it was drawn with glClipControl; 0: in [-w, w]
    float bias;                   // world units on top of one that follows from splat and texel size
    float softness;               // texels: radius of the filter on top of one that covers a splat; 16 taps, so a few texels are smooth
    uint64_t revision;            // another one, in a new call of nacreContextSetLights, says that texels have changed
} NacreShadowMap;

/// World space. Unused fields are ignored.
typedef struct NacreLight {
    size_t structSize;            // sizeof(NacreLight); that of the first is the stride of the array
    NacreLightType type;
    float position[3];            // all but directional
    float direction[3];           // unit. directional: from the surface to the light; spot, rectangle: where it shines
    float intensity[3];           // linear rgb, 0 to 1e15
    float radius;                 // see the types
    float range;                  // point, spot, sphere, rectangle: no light beyond (KHR_lights_punctual's window, of the points that stand
                                  // for sphere and rectangle); 0: unlimited
    float innerCone, outerCone;   // spot: half angles in radians, 0 <= inner < outer <= pi / 2
    float halfWidth[3];           // rectangle: from its centre to the middle of one side, at a right angle to `direction`
    float halfHeight;             // rectangle: along cross(direction, halfWidth)
    uint32_t samples;             // sphere, rectangle: points that stand for it, up to 1024; 0: chosen for each instance, fewer from afar
    uint32_t mask;                // see NacreInstanceDesc.lightMask; 0: all bits
    uint32_t flags;               // NacreLightFlags
    const NacreShadowMap* shadowMap; // may be null; copied
} NacreLight;

/// Replaces the lights. Copies them; any number. Relighting runs at the next draw, for what has changed: a light at rest costs nothing, a
/// moved one its own share.
NACRE_API NacreResult nacreContextSetLights(NacreContext context, const NacreLight* lights, size_t count);

/// Light from all around. Either pixels or sh; where they are negative, as filtered maps and series are, nothing shines.
typedef struct NacreEnvironment {
    size_t structSize;            // sizeof(NacreEnvironment)
    int width, height;            // of the pixels
    const float* pixels;          // rgb, linear radiance, top row first: equirectangular, -Z in the middle, +X to its right, +Y up; copied
    const float* sh;              // radiance: 3 * shCount numbers, rgb of function 0, rgb of function 1 ... (order l, m = -l..l;
                                  // orthonormal, with the Condon-Shortley sign, as in files of 3DGS: function 1 is -0.4886 y, 2 is 0.4886 z, 3 -0.4886 x)
    uint32_t shCount;             // 1 (ambient light), 4, 9, 16 or 25
    float worldFromMap[9];        // rotation, column-major; all zero: identity
    float intensity;              // factor; 0: 1
    uint32_t directions;          // that stand for it, 1 to 1024; 0: 64
    uint32_t mask;                // as of lights
} NacreEnvironment;
/// Replaces the environment. Null: none.
NACRE_API NacreResult nacreContextSetEnvironment(NacreContext context, const NacreEnvironment* environment);

/// Shadows of splats on other instances, under lights that ask for them: a map for each such light and instance that it reaches past
/// others. Per draw at most `mostMaps` maps of `size` x `size` texels (16 to 4096) are drawn again, the longest outdated first; until its
/// first turn a light is not held up. Defaults 16 and 128; 0 maps: what is there stays. All instances cast that are not hidden and that
/// the light's mask includes, drawn or not. An area light casts from its centre; a light within the bounds of an instance has no shadows
/// on it, with a warning.
NACRE_API NacreResult nacreContextSetShadowBudget(NacreContext context, uint32_t mostMaps, uint32_t size);

// ---- views -------------------------------------------------------------------------------------------------------------------------

typedef struct NacreViewDesc {
    size_t structSize;          // sizeof(NacreViewDesc)
    uint32_t mask;              // see NacreInstanceDesc.viewMask; 0: all bits
} NacreViewDesc;
/// `desc` may be null.
NACRE_API NacreResult nacreViewCreate(NacreContext context, const NacreViewDesc* desc, NacreView* view);
NACRE_API void nacreViewDestroy(NacreView view);

typedef struct NacreDrawDesc {
    size_t structSize;          // sizeof(NacreDrawDesc)
    float viewFromWorld[16];    // rigid, mirrored or not; usually without scale
    float clipFromView[16];     // perspective or orthographic; off-centre, jittered, reversed, with an oblique near plane: all are fine
    int viewportWidth;          // pixels of the viewport the host has set (origin as the host set it); 0: nothing is drawn, nothing else is
    int viewportHeight;         // looked at (a minimised window)
    int depthTest;              // 1: test splat centres against the bound depth buffer with the host's depth function; 0: no test
    int depthWrite;             // 1: afterwards write depth where splats cover the pixel by `depthAlpha`: the mean of the splats, each by
                                // what it adds to the picture. Tested as the splats are. OpenGL ES without EXT_float_blend: unsupported
    float depthAlpha;           // 0 to 1; 0: 0.5
    uint64_t maxRelightSplats;  // most splats that are relit by this draw, each counted for every pass; the longest outdated first. A pass of an
                                // instance is not divided, and one always runs, however small the number. 0: all
    const NacreInstance* instances; // each once; null: all of the context. Of either, those that are not hidden and whose mask fits
    size_t instanceCount;
} NacreDrawDesc;

/// Draws into the bound draw framebuffer. Touched GL state is saved and restored (list in runtime/CONTRACT.md). Your viewport, scissor,
/// stencil test and depth function apply. Cost follows change: with lights, camera and instances at rest only the splats are blended. In a
/// half-float target splat colours stop at 65504, so that blending makes no infinities. Of several draw buffers only the first is written.
/// NACRE_ERROR_GL: the bound framebuffer is incomplete. GL errors that were pending stay pending, except that a draw that needs more GPU
/// memory clears them, with a warning.
NACRE_API NacreResult nacreViewDraw(NacreView view, const NacreDrawDesc* desc);

/// Draws depth only, into the bound framebuffer: the splats as casters of shadows. `desc` is the light's camera; depthTest and depthWrite
/// are taken as 1. A splat covers the pixels where its alpha reaches `depthAlpha`, at the depth of its centre; however small it is in the
/// picture, it keeps its opacity. Needs no colours bound. Give shadows a view of their own: a view that takes turns projects anew.
NACRE_API NacreResult nacreViewDrawDepth(NacreView view, const NacreDrawDesc* desc);

/// Does ahead what draws would do at first need: compiles the programs that draws of these instances with up to `mostLights` lights can
/// need (many lights on an asset of the model sss: seconds), and, unless `desc` is null, sorts and relights for this camera and the lights
/// and edits set now. Programs of shadows come with the first that is cast. Draws nothing, needs no framebuffer. Relighting inside
/// conditional rendering is dropped with the draw; it is noticed and made up a draw later, but called outside of it this does the work
/// where it counts, and keeps it out of your occlusion queries.
NACRE_API NacreResult nacreViewPrepare(NacreView view, const NacreDrawDesc* desc, size_t mostLights);

/// CPU-side record of the last draw, for tests and profilers.
typedef struct NacreDrawStats {
    size_t structSize;            // sizeof(NacreDrawStats), set by the caller
    uint32_t splatsDrawn;         // after culling; all of them where compute shaders sort
    uint32_t instancesDrawn;
    uint32_t lightPassesRun;      // instances whose light-only part was re-evaluated, in part or whole; a frame or two after a change
                                  // again, until the GPU has told that it was drawn
    uint32_t viewPassesRun;       // instances whose view-only part was re-evaluated
    uint32_t combinePassesRun;    // instances whose final colours were re-evaluated
    uint32_t projected;           // 1 if splats were projected again
    uint32_t sorted;              // 1 if the splats were sorted again
    uint64_t relightSplats;       // splats times light passes of this draw
    uint64_t relightPending;      // that maxRelightSplats has left for later draws
    uint32_t lightsUsed;          // lights times instances that were evaluated or kept
    uint32_t lightsSkipped;       // that reach no instance by range, cone, mask or share
    uint32_t shadowPassesRun;     // lights times instances whose shadows were looked up again
    uint32_t shadowsSkipped;      // lights times instances that have none to look up, or none that has changed
    uint32_t shadowMapsDrawn;     // of splats
    uint32_t shadowMapsPending;   // that the budget has left for later draws
    double relightSeconds;        // CPU wall time of submission unless nacreContextSetProfiling(1), which inserts glFinish
    double sortSeconds;
    double rasterSeconds;
} NacreDrawStats;
NACRE_API NacreResult nacreViewGetStats(NacreView view, NacreDrawStats* stats);

#ifdef __cplusplus
}
#endif
#endif
