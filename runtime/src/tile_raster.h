// The draw list of a view drawn by compute shaders: near to far, tile by tile, until a pixel is opaque. It reads what the quads read
// (draw_list.h), makes the picture beside the host's target and blends that over it, once a pixel. The host's depth buffer is copied and tested like GL would.
#pragma once

#include "draw_list.h"
#include "frame.h"

namespace nacre {

class TileRaster {
public:
    /// `batch`: splats that are binned at a time.
    explicit TileRaster(Context& context, uint32_t batch = 1u << 18) : context_(context), batch_(batch) {}

    /// The first `splats` of list.order into the host's target. False in `*drawn`, and nothing has been: the host's viewport is not that of
    /// the frame, or its depth buffer has samples.
    Failure draw(const ViewFrame& frame, const DrawList& list, uint32_t splats, bool depthTest, GlStateGuard& state, bool* drawn);
    Failure compile();

private:
    Failure allocate(uint32_t splats, int width, int height);
    void setDepthTest(const float viewport[4], bool upperLeft, bool zeroToOne, bool tested) const;
    void set(const Program& program, const ViewFrame& frame, const DrawList& list, uint32_t splats) const;

    Context& context_;
    const uint32_t batch_;
    Texture image_;              // RGBA32F: colour, transmittance
    Texture masks_;              // R32UI: a row a bin, a bit a splat of the batch, from the nearest on
    const Program *clearProgram_ = nullptr, *binProgram_ = nullptr, *blendProgram_ = nullptr, *composeProgram_ = nullptr;
};

} // namespace nacre
