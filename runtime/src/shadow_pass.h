// What holds up the lights of an instance outside of it: for each light and splat the factor of light that arrives, in textures of slots
// of four lights (Instance::occlusion). Looked up in shadow maps of the host (shadow_map.frag.glsl) and in those of splats
// (splat_shadow_lookup.frag.glsl), whose factors multiply.
//
// It exists only where a light of the instance has shadows. A factor is written again when the light of its slot is another one, its map
// says that it has changed, or the instance has moved; then the passes of light that read it run again, too.
#pragma once

#include "light_set.h"
#include "textures.h"

#include <memory>
#include <vector>

namespace nacre {

struct Instance;
struct SplatShadow;

class ShadowPass {
public:
    /// After the instance's lights are packed.
    Failure run(Instance& instance, NacreDrawStats& stats);

private:
    /// What a slot was made from, and in which draw.
    struct Slot {
        std::shared_ptr<const ShadowMap> map; // null: all light arrives
        uint64_t splats = 0;                  // revision of the map of splats; 0: all arrives
        uint64_t draw = 0;
        bool isMadeFrom(const Slot& o) const { return map == o.map && splats == o.splats; }
        bool shades() const { return map || splats > 0; }
    };
    Failure grow(Instance& instance);
    Failure write(Instance& instance, size_t slot, const Slot& from);
    Failure drawMap(Instance& instance, const ShadowMap& map, size_t slot, size_t light);
    Failure drawSplats(Instance& instance, const SplatShadow& map, size_t slot);

    std::vector<Slot> slots_;
    std::vector<Framebuffer> framebuffers_; // of the textures
    glm::dmat4 worldFromAsset_{0};
};

} // namespace nacre
