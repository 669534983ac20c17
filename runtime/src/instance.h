// An instance: an asset somewhere in the world, and the lights it sees, packed into its space.
#pragma once

#include "asset.h"
#include "shadow_pass.h"

namespace nacre {

struct Instance {
    Instance(Context& c, std::shared_ptr<Asset> a);

    Context& context;
    Handle handle;
    std::shared_ptr<Asset> asset;
    Placement placement;
    uint32_t lightMask = ~0u, viewMask = ~0u;
    bool hidden = false;
    glm::vec3 tint{1};
    uint64_t looksRevision = 1;            // of transform, tint and edits

    InstanceLights lights;
    double arriving = 0;                   // a bound of their sum, where in the box of the splats each is strongest
    std::vector<uint64_t> slotRevisions;   // of packed lights by slot; one more than lights: what was removed last
    Texture lightTexture;                  // RGBA32F, a column per slot
    std::vector<Texture> occlusion;        // RGBA8 by batch, slots of four lights: what arrives from outside; empty: everything
    ShadowPass shadows;                    // writes it
    std::unique_ptr<InstanceModel> model;  // once the asset is complete

    int lightCount() const { return int(lights.packed.size()); }
    float worldScale2() const { return float(placement.scale * placement.scale); }
    /// Largest revision in a group of four slots.
    uint64_t groupRevision(int group) const;
    int groupCount() const { return (lightCount() + kLightsPerGroup - 1) / kLightsPerGroup; }

    /// Packs the context's lights if they, the place or the mask have changed, and uploads what differs.
    Failure updateLights();
    /// What is made of the light of this slot is outdated.
    void touch(size_t slot) { slotRevisions[slot] = ++revision_; }
    void moveTo(const Placement& place);

private:
    uint64_t packedLights_ = 0, packedLooks_ = 0, revision_ = 0;
    uint32_t packedMask_ = 0;
};

} // namespace nacre
