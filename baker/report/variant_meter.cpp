#include "report/variant_meter.h"

#include "appearance/detail.h"
#include "asset/asset_io.h"
#include "base/text.h"
#include "eval/evaluate.h"
#include "eval/headless_gl.h"
#include "eval/metrics.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace nacre::report {

namespace {

/// Texel centres as in GL: what a linear filter shows of a smaller frame.
Image enlarge(const Image& small, int width, int height)
{
    if (small.width == width && small.height == height) return small;
    Image out{width, height, std::vector<float>(size_t(4) * size_t(width) * size_t(height))};
    const auto split = [](int i, int n, int m, int* first, int* second) {
        const double at = std::clamp((i + 0.5) * m / n - 0.5, 0.0, double(m - 1));
        *first = int(at), *second = std::min(*first + 1, m - 1);
        return float(at - *first);
    };
    for (int y = 0; y < height; ++y) {
        int y0 = 0, y1 = 0;
        const float fy = split(y, height, small.height, &y0, &y1);
        for (int x = 0; x < width; ++x) {
            int x0 = 0, x1 = 0;
            const float fx = split(x, width, small.width, &x0, &x1);
            const float *a = small.pixel(x0, y0), *b = small.pixel(x1, y0), *c = small.pixel(x0, y1), *d = small.pixel(x1, y1);
            for (int k = 0; k < 4; ++k) out.pixel(x, y)[k] = (1 - fy) * ((1 - fx) * a[k] + fx * b[k]) + fy * ((1 - fx) * c[k] + fx * d[k]);
        }
    }
    return out;
}

double quantile(const std::vector<double>& sorted, double q)
{
    const double at = q * double(sorted.size() - 1);
    const size_t i = size_t(at);
    return i + 1 < sorted.size() ? sorted[i] + (at - double(i)) * (sorted[i + 1] - sorted[i]) : sorted[i];
}

} // namespace

std::string variantText(const Variant& variant)
{
    std::string text = detailText(variant.detail);
    if (variant.resolutionScale == 1) return text;
    const std::string scale = numberText(std::round(100 * variant.resolutionScale)) + " % of the width and height";
    return text == "everything" ? scale : text + ", " + scale;
}

Camera scaledCamera(const Camera& camera, double scale)
{
    Camera out = camera;
    out.width = std::max(1, int(std::lround(scale * camera.width))), out.height = std::max(1, int(std::lround(scale * camera.height)));
    const double x = double(out.width) / camera.width, y = double(out.height) / camera.height;
    out.fx *= x, out.cx *= x, out.fy *= y, out.cy *= y;
    return out;
}

/// How far machines drift between one run and the next, beyond what differs within one: 2 % was seen of medians on two shared cores.
constexpr double kDrift = 0.05;

VariantTime summarise(std::vector<RenderTimes> rounds, double moreMs)
{
    const auto sorted = [&](double RenderTimes::*figure) {
        std::vector<double> values;
        for (const RenderTimes& t : rounds) values.push_back(t.*figure);
        std::sort(values.begin(), values.end());
        return values;
    };
    const std::vector<double> frame = sorted(&RenderTimes::frameMs);
    return {quantile(frame, 0.5) + moreMs, quantile(frame, 0.05) * (1 - kDrift) + moreMs, quantile(frame, 0.95) * (1 + kDrift) + moreMs,
            quantile(sorted(&RenderTimes::relightMs), 0.5), quantile(sorted(&RenderTimes::sortMs), 0.5), quantile(sorted(&RenderTimes::rasterMs), 0.5)};
}

Result<VariantMeter> VariantMeter::create(const SplatAsset& asset, const OlatSplit& split, ImageCache& references, size_t count)
{
    VariantMeter meter;
    SplatAsset plain = asset;
    plain.neutral = {}, plain.drawnVisibility = 0;
    Result<std::vector<std::byte>> bytes = encodeAsset(plain);
    if (!bytes) return bytes.error();
    meter.bytes_ = std::move(*bytes), meter.frame_ = asset.frame;
    const size_t n = std::min(count, split.images.size());
    for (size_t i = 0; i < n; ++i) {
        const size_t k = i * split.images.size() / n;
        const OlatImage& image = split.images[k];
        const auto reference = references.load(split, k);
        if (!reference) return reference.error();
        auto lights = rendererLights(image.light);
        if (!lights) return lights.error();
        meter.views_.push_back({split.cameras[image.camera], std::move(*lights), *reference});
    }
    if (meter.views_.empty()) return Error{ErrorCode::kBadInput, "split '" + split.name + "' has no images to measure with"};
    return meter;
}

Result<SplatRenderer*> VariantMeter::renderer(const Detail& detail)
{
    std::unique_ptr<SplatRenderer>& known = renderers_[keyOf(detail)];
    if (!known) {
        Result<std::unique_ptr<SplatRenderer>> made = makeGlRenderer(bytes_, detail);
        if (!made) return made.error();
        known = std::move(*made);
    }
    return known.get();
}

Result<std::string> VariantMeter::rendererDescription()
{
    const Result<SplatRenderer*> r = renderer({});
    if (!r) return r.error();
    return (*r)->description();
}

void VariantMeter::forgetAllBut(std::span<const Variant> variants)
{
    std::erase_if(renderers_, [&](const auto& entry) {
        return std::none_of(variants.begin(), variants.end(), [&](const Variant& v) { return keyOf(v.detail) == entry.first; });
    });
}

Result<double> VariantMeter::psnr(SplatRenderer& renderer, float scale, std::span<const View> views)
{
    double sum = 0;
    for (const View& view : views) {
        if (stopped()) return Error{ErrorCode::kCancelled, "stopped"};
        const Result<Image> image = renderer.render(scaledCamera(view.camera, scale), view.lights);
        if (!image) return image.error();
        sum += psnrMaskedOf(enlarge(*image, view.camera.width, view.camera.height), *view.reference);
    }
    return sum / double(views.size());
}

Result<double> VariantMeter::psnrMasked(const Variant& variant)
{
    const Result<SplatRenderer*> r = renderer(variant.detail);
    if (!r) return r.error();
    return psnr(**r, variant.resolutionScale);
}

Result<double> VariantMeter::psnrMasked(const SplatAsset& asset)
{
    const Result<std::vector<std::byte>> bytes = encodeAsset(asset);
    if (!bytes) return bytes.error();
    return psnrMaskedOfFile(*bytes);
}

Result<double> VariantMeter::psnrMaskedOfFile(std::span<const std::byte> file)
{
    const Result<std::unique_ptr<SplatRenderer>> r = makeGlRenderer(file);
    if (!r) return r.error();
    return psnr(**r, 1);
}

Result<VariantTime> VariantMeter::timeOfFile(std::span<const std::byte> file, float resolutionScale, int rounds, int frames)
{
    const Result<std::unique_ptr<SplatRenderer>> r = makeGlRenderer(file);
    if (!r) return r.error();
    std::vector<RenderTimes> times;
    for (int round = 0; round < rounds; ++round) {
        if (stopped()) return Error{ErrorCode::kCancelled, "stopped"};
        const Result<RenderTimes> t = (*r)->time(scaledCamera(camera(), resolutionScale), lights(), 1, frames);
        if (!t) return t.error();
        times.push_back(*t);
    }
    return summarise(std::move(times), 0);
}

static Result<VariantMeter::Compared> compareTimes(SplatRenderer& a, const std::vector<Light>& lightsA, SplatRenderer& b, const std::vector<Light>& lightsB, const Camera& camera, double seconds)
{
    constexpr int kMostRounds = 15;
    const auto start = std::chrono::steady_clock::now();
    std::vector<RenderTimes> timesA, timesB;
    for (int round = 0; round < kMostRounds && (round == 0 || std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() < seconds); ++round) {
        const Result<RenderTimes> ta = a.time(camera, lightsA, 0, 1), tb = b.time(camera, lightsB, 0, 1);
        if (!ta) return ta.error();
        if (!tb) return tb.error();
        timesA.push_back(*ta), timesB.push_back(*tb);
    }
    return VariantMeter::Compared{0, 0, summarise(std::move(timesA), 0), summarise(std::move(timesB), 0)};
}

Result<VariantMeter::Compared> VariantMeter::compareHost(const GlHost& other, double seconds)
{
    const Result<SplatRenderer*> usual = renderer({});
    if (!usual) return usual.error();
    const Result<std::unique_ptr<SplatRenderer>> changed = makeGlRenderer(bytes_, {}, other);
    if (!changed) return changed.error();
    Result<Compared> compared = compareTimes(**usual, lights(), **changed, lights(), camera(), seconds);
    if (!compared) return compared;
    const std::span<const View> one(views_.data(), 1); // pixels hardly differ
    const Result<double> a = psnr(**usual, 1, one), b = psnr(**changed, 1, one);
    if (!a) return a.error();
    if (!b) return b.error();
    compared->psnrMasked = *a, compared->otherPsnrMasked = *b;
    return compared;
}

Result<VariantMeter::Compared> VariantMeter::compareDirections(const OlatSplit& split, ImageCache& references, size_t images, int fewer, int most, double seconds)
{
    std::vector<View> many, few;
    for (size_t i = 0; i < split.images.size() && many.size() < images; ++i) {
        const OlatImage& image = split.images[i];
        if (image.light.isPunctual() || image.light.type == LightType::kGroup) continue;
        const auto reference = references.load(split, i);
        if (!reference) return reference.error();
        for (const auto& [views, count] : {std::pair(&many, most), std::pair(&few, fewer)}) {
            auto lights = expandEnvironment(image.light, count);
            if (!lights) return lights.error();
            views->push_back({split.cameras[image.camera], std::move(*lights), *reference});
        }
    }
    if (many.empty()) return Error{ErrorCode::kBadInput, "split '" + split.name + "' has no image under an environment"};
    const Result<SplatRenderer*> r = renderer({});
    if (!r) return r.error();
    Result<Compared> compared = compareTimes(**r, many[0].lights, **r, few[0].lights, many[0].camera, seconds);
    if (!compared) return compared;
    const Result<double> a = psnr(**r, 1, many), b = psnr(**r, 1, few);
    if (!a) return a.error();
    if (!b) return b.error();
    compared->psnrMasked = *a, compared->otherPsnrMasked = *b;
    return compared;
}

Result<std::vector<VariantTime>> VariantMeter::time(std::span<const Variant> variants, int rounds, int frames)
{
    std::vector<std::vector<RenderTimes>> times(variants.size());
    std::vector<double> enlarging(variants.size());
    for (size_t v = 0; v < variants.size(); ++v) {
        if (variants[v].resolutionScale == 1) continue;
        const Camera small = scaledCamera(camera(), variants[v].resolutionScale);
        const Result<double> ms = enlargingMilliseconds(small.width, small.height, camera().width, camera().height);
        if (!ms) return ms.error();
        enlarging[v] = *ms;
    }
    for (int round = 0; round < rounds; ++round)
        for (size_t v = 0; v < variants.size(); ++v) {
            if (stopped()) return Error{ErrorCode::kCancelled, "stopped"};
            const Result<SplatRenderer*> r = renderer(variants[v].detail);
            if (!r) return r.error();
            const Result<RenderTimes> t = (*r)->time(scaledCamera(camera(), variants[v].resolutionScale), lights(), 1, frames);
            if (!t) return t.error();
            times[v].push_back(*t);
        }
    std::vector<VariantTime> out;
    for (size_t v = 0; v < variants.size(); ++v) out.push_back(summarise(std::move(times[v]), enlarging[v]));
    return out;
}

Result<std::vector<VariantTime>> VariantMeter::time(const Detail& detail, std::span<const Camera> cameras, std::span<const std::vector<Light>> lights, int rounds, int frames)
{
    const Result<SplatRenderer*> r = renderer(detail);
    if (!r) return r.error();
    std::vector<std::vector<RenderTimes>> times(cameras.size());
    for (int round = 0; round < rounds; ++round)
        for (size_t k = 0; k < cameras.size(); ++k) {
            if (stopped()) return Error{ErrorCode::kCancelled, "stopped"};
            const Result<RenderTimes> t = (*r)->time(cameras[k], lights[k], 1, frames);
            if (!t) return t.error();
            times[k].push_back(*t);
        }
    std::vector<VariantTime> out;
    for (std::vector<RenderTimes>& rounds : times) out.push_back(summarise(std::move(rounds), 0));
    return out;
}

} // namespace nacre::report
