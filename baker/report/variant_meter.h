// Error and frame time of an asset at other choices of what is left out, through the public runtime API, as a host would load it.
#pragma once

#include "base/result.h"
#include "dataset/olat_dataset.h"
#include "eval/splat_renderer.h"
#include "splats/splat_asset.h"

#include <functional>
#include <map>
#include <memory>
#include <span>
#include <tuple>
#include <vector>

namespace nacre::report {

/// What is drawn of an asset, and at what share of the width and height of the frame, which is then enlarged (bilinear).
struct Variant {
    Detail detail;
    float resolutionScale = 1;
    bool operator==(const Variant&) const = default;
};
std::string variantText(const Variant& variant);

/// Milliseconds of a frame with everything evaluated again, enlarging included: median over the rounds, and the range of nine
/// rounds in ten, a twentieth wider for what differs between runs.
struct VariantTime {
    double ms = 0, low = 0, high = 0, relightMs = 0, sortMs = 0, rasterMs = 0;
};

class VariantMeter {
public:
    /// `asset` is expanded, with its maps. Held-out images: `count`, evenly picked from the split; the first is the one whose frames are timed.
    /// Errors: of images that cannot be read.
    static Result<VariantMeter> create(const SplatAsset& asset, const OlatSplit& split, ImageCache& references, size_t count);

    /// Asked between frames; true ends what is being measured with kCancelled.
    std::function<bool()> stopped = [] { return false; };

    /// Mean over the images of the PSNR of the object's pixels [dB].
    Result<double> psnrMasked(const Variant& variant);
    /// The same of another asset: one that packing has rounded.
    Result<double> psnrMasked(const SplatAsset& asset);
    /// The same of a file, as a host loads it.
    Result<double> psnrMaskedOfFile(std::span<const std::byte> file);
    /// Frames of a file.
    Result<VariantTime> timeOfFile(std::span<const std::byte> file, float resolutionScale, int rounds, int frames);
    /// In rounds: each variant in turn, `frames` frames after one that does not count, so that what slows the machine down slows all alike.
    Result<std::vector<VariantTime>> time(std::span<const Variant> variants, int rounds, int frames);
    /// Frames from the camera of the first image, scaled, under any lights.
    Result<std::vector<VariantTime>> time(const Detail& detail, std::span<const Camera> cameras, std::span<const std::vector<Light>> lights, int rounds, int frames);

    /// The whole asset in another back end or target, beside the usual ones: error of the first image and time of both, in turns for about so
    /// many seconds, at least once.
    struct Compared {
        double psnrMasked, otherPsnrMasked;
        VariantTime time, otherTime;
    };
    Result<Compared> compareHost(const GlHost& other, double seconds);
    /// The same of an environment by so many directions instead of `most`, over images of a split that have one.
    Result<Compared> compareDirections(const OlatSplit& split, ImageCache& references, size_t images, int fewer, int most, double seconds);

    const Camera& camera() const { return views_[0].camera; }
    const std::vector<Light>& lights() const { return views_[0].lights; }
    size_t images() const { return views_.size(); }
    Result<std::string> rendererDescription();
    /// Renderers of details that will not be asked for again go.
    void forgetAllBut(std::span<const Variant> variants);

private:
    struct View {
        Camera camera;
        std::vector<Light> lights;
        std::shared_ptr<const Image> reference;
    };
    VariantMeter() = default;
    Result<SplatRenderer*> renderer(const Detail& detail);
    Result<double> psnr(SplatRenderer& renderer, float scale) { return psnr(renderer, scale, views_); }
    Result<double> psnr(SplatRenderer& renderer, float scale, std::span<const View> views);

    std::vector<std::byte> bytes_; // lossless: loads in a fraction of a second
    AssetFrame frame_;
    std::vector<View> views_;
    using Key = std::tuple<float, uint32_t, uint32_t, uint32_t>;
    static Key keyOf(const Detail& d) { return {d.splats, d.leaveOut, d.transportFunctions, d.visibilitySize}; }
    std::map<Key, std::unique_ptr<SplatRenderer>> renderers_;
};

/// The same view with so many times the pixels along each side, at least one.
Camera scaledCamera(const Camera& camera, double scale);

/// Median, and the quantiles at 5 and 95 %, a twentieth wider.
VariantTime summarise(std::vector<RenderTimes> rounds, double moreMs);

} // namespace nacre::report
