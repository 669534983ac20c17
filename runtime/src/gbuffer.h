// Pixels that are shaded: splats of a view are blended into layers, surface and incident shares of lights, and the layers are resolved into
// the host's frame (sss.h has the equations). Splats of bigs have a colour and no surface, so that mixed models share one order.
//
// Layers: scattered light; normal; base; roughness, metalness, subsurface; depth and the first lights; three lights each. A pass blends as
// many as the GPU draws into at once; of more lights than kMostLayers hold, further rounds add up in a sum.
#pragma once

#include "draw_list.h"

namespace nacre {

/// A light in the space of the resolve pass, and whose it is.
struct ViewLights {
    std::vector<uint32_t> points;     // of the LightSet, ascending
    std::vector<PackedLight> packed;  // in the world, relative to the eye
};

struct GbufferInput {
    const ViewFrame& frame;
    const DrawList& list;
    const ViewLights& lights;
    uint32_t splats;          // in the order
    bool mixed;               // some splats have no surface
    bool depthTest;
    bool bright;              // light may not fit half floats
    glm::vec3 low, high;      // box of the shaded instances, in the world from the eye
    float smallest;           // size of the smallest of them
};

constexpr int kMostLayers = 8; // of a pass of splats; the surface takes five, the fifth has room for two lights, or one where models are mixed

class Gbuffer {
public:
    explicit Gbuffer(Context& context) : context_(context) {}

    Failure draw(const GbufferInput& input, GlStateGuard& state);
    Failure compileAhead(int mostLights, bool mixed);

private:
    /// Viewport-sized layers.
    struct Target {
        Texture layers, depth;  // depth: its own texture, which may be finer
        Framebuffer framebuffer;
    };
    /// What one pass of splats blends.
    struct Pass {
        bool extra, mixed;
        int firstLayer, layers;
    };

    Failure splatProgram(const Pass& pass, const Program** program);
    Failure findSplatProgram(const Pass& pass, const Program** program);
    Failure findResolveProgram(bool extra, bool mixed, int layers, const Program** program);
    Failure resolveProgram(bool extra, bool mixed, int lights, const Program** program);
    Failure composeProgram(const Program** program);
    Failure grow(Target& target, GLenum format, GLenum depthFormat, int width, int height, int layers);
    void attach(const Target& target, int first, int count, bool extra) const;
    Failure blend(const GbufferInput& input, Target& target, bool extra, int layers, int firstLight, GlStateGuard& state);
    Failure resolve(const GbufferInput& input, bool extra, int lights, int firstLight, const float viewport[4], float maxColor);

    Context& context_;
    Target first_, further_, summed_;
    Texture lights_;
    float depthOrigin_ = 0, depthUnit_ = 1; // of the draw that runs
    ProgramOnce splat_[2][2][kMostLayers][kMostLayers + 1], resolve_[2][2][kMostLayers + 1]; // [extra][mixed][first layer][layers]
};

} // namespace nacre
