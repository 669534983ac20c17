// The draw list of a view: a record for each splat of its instances, each instance on rows of its own. Passes of instances write it, the
// order and the rasteriser read nothing else.
//
//   color       RGBA32F  rgb towards the camera; for sss what needs no shading
//   projected0  RGBA32F  ndc x, y, depth, opacity
//   projected1  RGBA32F  l_xx, l_yx, l_yy of the footprint in pixels, distance from the eye in the world
//   attributes  RGBA16F  array, only in views that shade pixels: normal, base, material, then three incident shares of lights to a layer
//   order       R32UI    indices in the list, far to near
// Index n is texel (n % width, n / width).
#pragma once

#include "model.h"

#include <map>

namespace nacre {

class DrawList {
public:
    explicit DrawList(Context& context) : context_(context) {}

    /// Rows for so many splats; those of an earlier call with this key if they still do. Grows the textures where needed.
    Failure place(uint32_t key, uint32_t splats, ListRows* rows);
    void remove(uint32_t key);
    /// Changes when textures were made anew: what was in them is gone.
    uint64_t revision() const { return revision_; }
    /// Makes room for attributes of so many layers. Their content goes when the array grows.
    Failure growAttributes(int layers);
    uint64_t attributesRevision() const { return attributesRevision_; }

    int width() const { return width_; }
    uint32_t firstIndex(const ListRows& rows) const { return uint32_t(rows.first) * uint32_t(width_); }
    void set(const Program& program, const ListRows& rows) const;
    /// Uploads the order.
    void upload(std::span<const uint32_t> farToNear) const;

    /// Bind a framebuffer to draw into.
    void beginColor() const { colorTarget_.bind(); }
    void beginProjected() const { projectedTarget_.bind(); }
    void beginAttributes(int first, int layers) const;

    Texture color, projected0, projected1, order, attributes;

private:
    Failure allocate(int rows);

    Context& context_;
    int width_ = 256, rows_ = 0;
    std::map<uint32_t, ListRows> placed_;
    Framebuffer colorTarget_, projectedTarget_, attributesTarget_;
    uint64_t revision_ = 0, attributesRevision_ = 0;
};

} // namespace nacre
