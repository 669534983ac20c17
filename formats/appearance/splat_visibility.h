// Visibility maps (visibility_map.h) that follow from the splats themselves, so that an asset need not store them.
//
// For every direction the splats are seen from infinity: sorted by depth and drawn front to back into one small image of transmittance.
// A splat reads the image at its centre before anything within `bias` of it has been drawn: a surface does not shade itself. Resolved are
// the 98 % of the splats in the middle, and as much again around them; the few that lie farther away get all light and cast no shadow.
#pragma once

#include "appearance/shadow_splat.h"
#include "base/radix_sort.h"
#include "splats/splat_asset.h"

#include <cstdint>
#include <span>
#include <vector>

namespace nacre {

constexpr int kShadowRow = kShadowSize + 16; // floats per row: whole vectors may be written beyond the last pixel

/// Multiplies what the splat lets through into an image of kShadowRow * kShadowSize floats.
using DrawShadow = void (*)(const FlatSplat& splat, float* image);
void drawShadowScalar(const FlatSplat& splat, float* image);

float readShadow(const float* image, float x, float y);

/// Splats as all directions see them.
struct ShadowScene {
    std::vector<glm::vec3> positions;
    std::vector<glm::mat3> axes; // columns: the local axes times the standard deviations
    std::vector<float> opacities;
    glm::vec3 center{0};
    float radius = 0, bias = 0;
    size_t count() const { return positions.size(); }
};
/// From positions, axes and opacities to the rest. `medianSize`: of the splats' largest standard deviations.
void finishScene(ShadowScene& scene, float medianSize);
/// Along the light, centres of other splats nearer to a splat's own than this shade nothing.
inline float visibilityBias(float medianSize) { return 4 * medianSize; }

/// Working memory of one thread.
struct ShadowWorkspace {
    std::vector<FlatSplat> flat;
    std::vector<uint32_t> keys, order;
    RadixScratch<uint32_t> scratch;
    std::vector<float> image;
    std::vector<float> sum;       // per splat, over the directions of a texel
    std::vector<uint32_t> splats; // of flat, where these are not all
};
/// Adds to work.sum what arrives from direction w (unit).
void addDirection(const ShadowScene& scene, const glm::vec3& w, DrawShadow draw, ShadowWorkspace& work);
/// Sets work.sum to the mean of what arrives from the oversample^2 directions of a texel, times 255.
void drawTexel(const ShadowScene& scene, int size, int texel, int oversample, DrawShadow draw, ShadowWorkspace& work);

/// All maps of an asset, a few directions at a time.
class VisibilityDrawing {
public:
    /// `size`: 16 or 32 texels a side.
    VisibilityDrawing(const SplatCloud& cloud, int size);
    /// Draws the next texel of all maps; one pass over all splats. False once there is none left.
    bool step();
    /// The channel, once step has returned false.
    Channel take();

private:
    ShadowScene scene_;
    ShadowWorkspace work_;
    Channel maps_;
    std::vector<uint8_t> texels_;
    int size_, next_ = 0;
};

/// Gives an asset with drawnVisibility its channel.
void drawVisibility(SplatAsset& asset);

} // namespace nacre
