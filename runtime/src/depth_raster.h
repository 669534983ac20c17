// Depth of splats in the host's depth buffer: of casters of shadows, drawn whole or not at all, and of a picture, as the mean of what is
// seen at each pixel.
#pragma once

#include "draw_list.h"
#include "frame.h"

#include <span>

namespace nacre {

/// Splats of a draw list that follow one another.
struct ListSpan {
    uint32_t first = 0, count = 0;
};

class DepthRaster {
public:
    explicit DepthRaster(Context& context) : context_(context) {}

    /// In any order: the depth test finds the nearest.
    Failure drawCasters(const ViewFrame& frame, const DrawList& list, std::span<const ListSpan> spans, float leastAlpha, GlStateGuard& state);

    /// Whether depth of pictures can be written here.
    Failure check() const;
    /// Depth z of the splats is blended like colours, in their order: sum_i T_i a_i z_i and the coverage sum_i T_i a_i, whose quotient is
    /// written where the coverage reaches `leastAlpha`.
    Failure write(const ViewFrame& frame, const DrawList& list, uint32_t splats, bool depthTest, float leastAlpha, GlStateGuard& state);

private:
    Failure grow(int width, int height);
    Failure blend(const ViewFrame& frame, const DrawList& list, uint32_t splats, bool depthTest, GlStateGuard& state);

    Context& context_;
    Texture layer_;          // RGBA32F: depth, -, -, coverage
    Framebuffer framebuffer_;
};

} // namespace nacre
