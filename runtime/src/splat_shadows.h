// Shadows of splats on other instances: for each instance and each light that asks for them a map of what arrives past the splats of the
// others, seen from the light.
//
// A map has four planes at growing distances from the light through the receiver, one to a channel. A splat multiplies by 1 - alpha what
// arrives at the planes behind it, in any order; a receiving splat takes its share between the planes around it
// (splat_shadow.frag.glsl). The frustum just covers the receiver; a directional light's is a box. All points of an area light share the
// map of its centre; environments have none.
//
// A map is outdated when its light, the receiver or an instance between the two has changed. At most so many are drawn again in a draw,
// the longest outdated first. Nothing is looked at while nothing changes.
#pragma once

#include "draw_list.h"
#include "frame.h"
#include "light_set.h"

#include <map>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace nacre {

struct Instance;

/// What a map was drawn from.
struct SplatShadowSource {
    /// A splat cloud that casts.
    struct Caster {
        uint32_t serial = 0;
        uint64_t looks = 0; // revision
        bool operator==(const Caster&) const = default;
    };
    glm::dvec4 light{0};    // place and 1, or direction and 0
    Placement receiver;
    std::vector<Caster> casters;
    int size = 0;
    bool operator==(const SplatShadowSource&) const = default;
};

/// What a light sees of a receiver.
struct SplatShadowLamp {
    ViewFrame frame;
    glm::dvec2 low{0}, high{0};       // of the window, by depth or, orthographic, as lengths
    double nearest = 0, farthest = 0; // of the receiver from the light; orthographic: from its centre, along the light
    float firstPlane = 0, planeStep = 0;
};

struct SplatShadow {
    Texture transmittance;   // RGBA16F: of the four planes
    uint64_t revision = 0;   // another one whenever it is drawn; 0: never
    uint64_t draw = 0;
    SplatShadowSource drawn, wanted;
    SplatShadowLamp lamp, wantedLamp;
};

class SplatShadows {
public:
    explicit SplatShadows(Context& context) : context_(context), list_(context) {}

    void setBudget(uint32_t mostMaps, int size) { mostMaps_ = mostMaps, size_ = size; }
    /// Draws maps of these instances that are outdated, as far as the budget goes. Their lights are packed.
    Failure update(std::span<Instance* const> receivers, NacreDrawStats& stats);
    /// Null: nothing stands in the way, as far as is known yet. Stays until the next update.
    const SplatShadow* find(const Instance& receiver, uint32_t light) const;

private:
    using Key = std::pair<uint32_t, uint32_t>; // serial of the receiver, light
    void findWanted(std::span<Instance* const> receivers, std::vector<SplatShadow*>* outdated);
    bool isOutdated(const SplatShadow& map) const;
    Failure draw(SplatShadow& map);
    Failure prepareTarget(SplatShadow& map);
    Failure project(const ViewFrame& frame, std::span<const std::shared_ptr<Instance>> casters, std::vector<ListRows>* rows);
    uint64_t sceneHash(std::span<Instance* const> receivers) const;

    Context& context_;
    DrawList list_;          // of the map that is drawn
    Framebuffer framebuffer_;
    std::map<Key, SplatShadow> maps_;
    uint32_t mostMaps_ = 16;
    int size_ = 128;
    uint64_t lastRevision_ = 0, seenScene_ = 0;
    bool pending_ = false;   // some map is outdated
    bool warned_ = false;
};

} // namespace nacre
