// One interface over the two ways to draw an asset, so that `eval` and `render` do not care which.
// Cameras, lights and regions of edits are those of the dataset the asset was baked from, in its units.
#pragma once

#include "appearance/sss/sss_edit.h"
#include "appearance/shown_part.h"
#include "base/camera.h"
#include "base/image.h"
#include "base/light.h"
#include "base/result.h"
#include "splats/detail.h"
#include "splats/plain_splats.h"

#include <memory>
#include <span>
#include <string>

namespace nacre {

struct RenderTimes { double relightMs = 0, sortMs = 0, rasterMs = 0, frameMs = 0; };

class SplatRenderer {
public:
    virtual ~SplatRenderer() = default;
    /// Linear radiance premultiplied by coverage over black. Point and directional lights (see expandEnvironment).
    virtual Result<Image> render(const Camera& camera, std::span<const Light> lights) = 0;
    /// Draws the same frame again and times it: median of `frames` after `warmup`, with everything re-evaluated.
    virtual Result<RenderTimes> time(const Camera& camera, std::span<const Light> lights, int warmup, int frames) = 0;
    /// Replaces the changes to the asset's materials. Error kUnsupported if its model has none.
    virtual Status setEdits(std::span<const SplatEdit> edits) = 0;
    /// e.g. "llvmpipe (LLVM 15.0.6, 256 bits), GL 4.5"
    virtual std::string description() const = 0;
};

/// What a host may choose besides.
struct GlHost {
    enum class BackEnd { kAuto, kGl33, kGl43 } backEnd = BackEnd::kAuto; // as NacreBackEnd
    bool halfTarget = false; // draw into RGBA16F instead of RGBA32F
};
/// Through the public runtime API on a headless EGL context. `assetBytes` is the .glb, of which `detail` is loaded. Errors: kGpu if there is no
/// context, kUnsupported if it cannot do the back end.
Result<std::unique_ptr<SplatRenderer>> makeGlRenderer(std::span<const std::byte> assetBytes, const Detail& detail = {}, const GlHost& host = {});

/// Textures and buffers of an asset on the GPU.
Result<uint64_t> gpuBytesOf(std::span<const std::byte> assetBytes);

/// Scalar math of formats/appearance and baker/render on the CPU.
Result<std::unique_ptr<SplatRenderer>> makeReferenceRenderer(const SplatAsset& asset);

/// One of partsOf(asset) instead of the image, by the same code. Radiance is as in the image; all else is divided by coverage where there is any, numbers
/// in all three colours; depth is in units of the dataset, overdraw counts the splats that a pixel blends.
Result<std::unique_ptr<SplatRenderer>> makePartRenderer(const SplatAsset& asset, const std::string& name);

/// Splats that only shine, in their own axes and units, by the same code; lights are ignored. The image is in the splats' colour space.
std::unique_ptr<SplatRenderer> makePlainRenderer(const PlainSplats& splats, float lowPassVariance);

/// Takes what is in the units of the dataset to a renderer of the asset's own.
std::unique_ptr<SplatRenderer> inDatasetFrame(const AssetFrame& frame, std::unique_ptr<SplatRenderer> renderer);

/// Replaces an environment light by at most `count` directional lights that err least (appearance/environment_directions.h), of the same
/// irradiance in all. Other lights pass through.
Result<std::vector<Light>> expandEnvironment(const Light& light, int count);

} // namespace nacre
