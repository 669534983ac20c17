// What depends on the appearance model: its channels on the GPU, and the way from lights to pixels. One implementation per model of
// appearance/models.h.
#pragma once

#include "appearance/models.h"
#include "context.h"
#include "kept_passes.h"

#include <memory>
#include <span>
#include <string>

struct NacreAssetImpl;

namespace nacre {

struct DrawFrame;
struct SplatAsset;
struct SplatEdit;
class GlStateGuard;

constexpr int kLightsPerSlot = 4;

class GpuModel {
public:
    explicit GpuModel(NacreAssetImpl& asset);
    virtual ~GpuModel() = default; // deletes its GL objects

    /// What the grid and the long rows of this asset cannot hold. Before anything is uploaded.
    virtual Failure checkLayout(const SplatAsset& source) = 0;
    /// Slots of the geometry texture after the common ones.
    virtual int geometrySlots() const = 0;
    /// Slots of its tallest texture but those of lights, which take one for every kLightsPerSlot.
    virtual int mostSlots() const = 0;
    /// Channels and targets; the geometry texture is bound to unit 0. GL errors are the caller's to find.
    virtual Failure upload(const SplatAsset& source) = 0;
    virtual Failure compilePrograms() = 0;
    /// The rest of the programs that draws with up to so many lights can need; draws make it up.
    virtual Failure compileAhead(int mostLights) = 0;

    /// Replaces the edits of the baked material; they show from the next draw on.
    virtual Failure setEdits(std::span<const SplatEdit> edits) = 0;
    /// Runs the passes whose inputs differ from those of their last run. The light texture is up to date.
    virtual Failure relight(const DrawFrame& frame, bool lightsChanged) = 0;
    /// Draws the sorted splats into the host's frame.
    virtual Failure raster(const DrawFrame& frame, bool depthTest, GlStateGuard& state) = 0;

protected:
    NacreAssetImpl& asset_;
    KeptPasses kept_;
};

#define NACRE_MODEL(name) \
    namespace name { std::unique_ptr<GpuModel> makeGpuModel(NacreAssetImpl& asset); }
NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL

/// By name; null if there is no such model.
std::unique_ptr<GpuModel> makeGpuModel(const std::string& model, NacreAssetImpl& asset);

} // namespace nacre
