// What depends on the appearance model, in three parts as everything else: channels of an asset, what lights make of an instance, what a
// camera makes of that. One implementation of each per model of appearance/models.h.
#pragma once

#include "appearance/models.h"
#include "frame.h"
#include "textures.h"

#include <memory>
#include <span>
#include <string>

namespace nacre {

struct SplatEdit;
class DrawList;

/// Lights are evaluated in batches, so that textures stay within limits: slots t / kBatchLights, groups of four within.
constexpr int kLightsPerGroup = 4, kBatchLights = 48;

/// What a draw may spend on relighting, and what it spent.
struct RelightBudget {
    uint64_t left = ~uint64_t(0);
    NacreDrawStats* stats = nullptr;

    /// Whether a pass over so many splats may run now. The first always may: there is progress whatever the budget.
    bool take(uint64_t splats)
    {
        if (splats > left && stats->relightSplats > 0) {
            left = 0; // who comes later waits, too: oldest first
            stats->relightPending += splats;
            return false;
        }
        left -= std::min(left, splats);
        stats->relightSplats += splats;
        return true;
    }
};

/// Rows of an instance in a draw list.
struct ListRows {
    int first = 0, count = 0;
};

/// Caches that depend on the camera; one per instance and view.
class ViewModel {
public:
    virtual ~ViewModel() = default; // deletes its GL objects
    /// Brings the instance's rows of list.color (and, for sss, its scattered light) up to date, as far as the budget goes; the light-only
    /// part is done. `done`: nothing is outdated afterwards.
    virtual Failure relight(const InstanceFrame& frame, DrawList& list, const ListRows& rows, RelightBudget& budget, bool* done) = 0;
    /// Writes the instance's rows of list.attributes where outdated. `viewLights`: slots of the instance by light of the view, -1: none.
    virtual Failure gather(const InstanceFrame& frame, DrawList& list, const ListRows& rows, std::span<const int> viewLights) = 0;
};

/// Caches that depend on lights and edits; one per instance.
class InstanceModel {
public:
    virtual ~InstanceModel() = default;
    virtual Failure setEdits(std::span<const SplatEdit> edits) = 0;
    /// Brings geometry() up to date, where edits change it.
    virtual Failure updateGeometry() { return {}; }
    /// Slots as of the asset, or edited.
    virtual const Texture& geometry() const = 0;
    /// Runs the light-only passes whose inputs have changed. `done` as above.
    virtual Failure relight(RelightBudget& budget, bool* done) = 0;
    /// Bound of the radiance of a splat per unit of irradiance.
    virtual float brightest() const = 0;
    virtual std::unique_ptr<ViewModel> makeView() = 0;
};

/// Channels on the GPU; immutable.
class AssetModel {
public:
    virtual ~AssetModel() = default;
    /// What the grid and the long rows of this asset cannot hold. Before anything is uploaded.
    virtual Failure checkLayout(const SplatAsset& source) = 0;
    /// Slots of the geometry texture after the common ones.
    virtual int geometrySlots() const = 0;
    /// Slots of its tallest texture.
    virtual int mostSlots() const = 0;
    /// Makes the textures and queues what goes into them; `source` stays until the queue is empty.
    virtual Failure upload(const SplatAsset& source, UploadQueue& queue) = 0;
    /// Whether its pixels are shaded in a G-buffer.
    virtual bool shadesPixels() const = 0;
    virtual std::unique_ptr<InstanceModel> makeInstance(Instance& instance) = 0;
    /// Compiles what draws with up to so many lights can need; draws make it up.
    virtual Failure compileAhead(int mostLights) = 0;
};

#define NACRE_MODEL(name) \
    namespace name { std::unique_ptr<AssetModel> makeAssetModel(Asset& asset); }
NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL

/// By name; null if there is no such model.
std::unique_ptr<AssetModel> makeAssetModel(const std::string& model, Asset& asset);

} // namespace nacre
