// The training side of an appearance model, as the trainer sees it. One implementation per model of
// appearance/models.h.
#pragma once

#include "appearance/models.h"
#include "base/byte_stream.h"
#include "base/light.h"
#include "render/projection.h"
#include "splat/light_visibility.h"
#include "splats/splat_asset.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace nacre {

constexpr int kMaxLightsPerStep = 4;

/// One camera and the lights (point or directional) under which it is rendered in one pass.
struct LitView {
    float eye[3] = {0, 0, 0};
    int lightCount = 0;
    Light lights[kMaxLightsPerStep];
};

/// Where a pixel's light comes from: pixel (x, y) looks from `eye` along origin + x * right + y * down (at pixel centres x + 0.5), a vector
/// whose length along the camera's axis is one.
struct PixelRays {
    float eye[3], origin[3], right[3], down[3];
    int width = 0, height = 0;
};

/// The visible splats of a view. All per-visible arrays are in the rasteriser's front-to-back order.
struct VisibleView {
    std::span<const GaussianGeometry<float>> geometry; // all splats
    std::span<const uint32_t> visibleFromSplat;        // all splats; ~0u = not visible
    size_t visibleCount = 0;
};

/// A group of channels that an asset can do without; or what values have learnt so far, which may serve worse than starting again (learnt roughness of sss).
struct OptionalPart {
    std::string name;
    double judgedAt;   // fraction of the bake: when it has to show what it is worth
    double leastWorth; // dB of training images that it has to be worth
    bool bySplat = false; // some splats may do without it
};

struct ViewEvidence; // evidence.h

/// Geometry of all splats, and whatever else a model keeps on the host, as the last step has left them: asked for before anything is looked at or
/// changed, as they may have to come from a device.
using HostGeometry = std::function<std::span<const GaussianGeometry<float>>()>;

class TrainableAppearance {
public:
    virtual ~TrainableAppearance() = default;

    virtual size_t count() const = 0;
    virtual void resize(size_t count) = 0;                       // new splats get neutral coefficients
    virtual void tint(size_t splat, const glm::vec3& factor) = 0; // of a new splat: its colour times so much
    virtual void copySplat(size_t from, size_t to) = 0;          // clears the optimiser state of `to`
    virtual void permute(std::span<const uint32_t> order) = 0;

    /// What takes long in the beginStep that comes next, done ahead so that it can be given up: false once `goOn`, asked now and then, says no.
    virtual bool prepareStep(double progress, const HostGeometry& geometry, const std::function<bool()>& goOn)
    {
        return (void)progress, (void)geometry, !goOn || goOn();
    }
    /// `progress` in [0, 1] says what is in use, `rate` scales the learning rates; `step` counts from 1; `random` are three
    /// numbers in [0, 1). Now and then the model looks at the geometry of all splats, for what follows from it (normals, visibility).
    virtual void beginStep(double progress, double rate, int step, const float random[3], const HostGeometry& geometry) = 0;
    /// After beginStep: what splats learn from their neighbours before anybody looks at them. Devices have their own.
    virtual void shareAmongNeighbours() {}
    /// How many channels are blended under so many lights: a count that the rasteriser takes (raster.h).
    virtual int channels(int lightCount) const { return 3 * lightCount; }
    /// Which of them is the distance of the splat's centre from the eye, so that its gradient moves splats; -1: none.
    virtual int distanceChannel() const { return -1; }
    /// channels[visible][channelStride], of which resolve makes three per light.
    virtual void forward(const VisibleView& view, const LitView& lit, float* channels) = 0;
    /// From blended channels (planes of channels(), then alpha) to what the image shows (three planes per light, then alpha). A model
    /// that shades splats, not pixels, has nothing to do. Valid until the next call.
    virtual const float* resolve(const PixelRays&, const LitView&, const float* planes) { return planes; }
    /// The other way, after resolve of the same view: gradient of the planes from that of the image.
    virtual const float* resolveBackward(const PixelRays&, const LitView&, const float* planes, const float* dImage) { return (void)planes, dImage; }
    /// Steps every visible splat with active[visible] != 0. Call after forward of the same view.
    virtual void backwardAndStep(const VisibleView& view, const LitView& lit, const uint8_t* active, const float* dChannels) = 0;

    /// Whether useEvidence, with what all views show beyond a render without highlights (hideHighlights), is to be called before the step at `progress`.
    virtual bool wantsEvidence(double progress) const { return (void)progress, false; }
    virtual void hideHighlights(bool hidden) { (void)hidden; }
    virtual void useEvidence(double progress, std::span<const GaussianGeometry<float>> geometry, std::span<const ViewEvidence> views)
    {
        (void)progress, (void)geometry, (void)views;
    }

    /// Of those in use now.
    virtual std::vector<OptionalPart> optionalParts() const = 0;
    /// Neither evaluated nor trained nor exported from here on; except where kept[splat] != 0 (only of parts by splat; else empty).
    virtual void leaveOut(const std::string& part, std::span<const uint8_t> kept) = 0;

    /// Who draws visibility maps from here on; none: the CPU.
    void setVisibilityDrawer(VisibilityDrawer drawer) { visibilityDrawer_ = std::move(drawer); }

    virtual std::vector<Channel> exportChannels() const = 0;
    virtual void save(ByteWriter& out) const = 0;
    virtual bool load(ByteReader& in) = 0;                       // false if the bytes do not fit this model

protected:
    VisibilityDrawer visibilityDrawer_;
};

struct AppearanceOptions {
    int scatterFunctions = 0;          // bigs: SH functions of s
    std::vector<std::string> without{}; // for comparisons: optional parts, "code" of sss, "normal-search" of highlights, "sharing" between neighbours, "schedule": plain Adam with one constant rate
    float brightness = 1;               // estimate of the mean albedo, to start a dark object dark
    bool lightDistancesVary = false;    // sss: else nothing is to be learnt from how near a light is
    glm::vec4 region{0};                  // centre and radius of the only splats that shade each other; radius 0: all do
    std::vector<glm::vec3> pointLights{}; // of training, each place once: visibility ends at those that stand among the splats
};

#define NACRE_MODEL(name) \
    namespace name { std::unique_ptr<TrainableAppearance> makeTrainable(const AppearanceOptions& options); }
NACRE_APPEARANCE_MODELS(NACRE_MODEL)
#undef NACRE_MODEL

/// By name; null if there is no such model.
std::unique_ptr<TrainableAppearance> makeTrainableAppearance(const std::string& model, const AppearanceOptions& options);

} // namespace nacre
