#include "train/trainer.h"

#include "base/color.h"
#include "base/random.h"
#include "splat/morton.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>

namespace nacre {

// Learning rates of the geometry at the start.
// (Measured at 3000 steps: a quarter of these rates costs 0.2 dB, half 0.05 dB.)
constexpr float kRatePosition = 1.6e-3f /* of the scene size */, kRateScale = 2e-2f, kRateRotation = 4e-3f, kRateOpacity = 2e-2f;
constexpr float kOpacityPull = 1e-8f;    // far below the gradient of a splat that matters
constexpr float kActiveWeight = 2e-3f;   // a splat whose blending weights sum to less than this over the image does not learn from it
constexpr float kRateAmbient = 2e-2f, kFirstAmbient = 0.01f; // of its logarithm; of a radiance
constexpr float kDeadOpacity = 0.01f;
constexpr double kMostOutside = 0.1;     // of all splats, around the object's region

const char* stageName(Stage stage)
{
    constexpr const char* names[kStageCount] = {"project+sort", "bin", "shade", "blend", "resolve", "loss", "blend back", "geometry back", "shade back+Adam"};
    return names[stage];
}

namespace {

// Of srgbFromLinear.
float srgbSlope(float linear) { return linear <= 0.0031308f ? 12.92f : 1.055f / 2.4f * std::pow(linear, 1 / 2.4f - 1); }

class StageClock {
public:
    explicit StageClock(std::array<double, kStageCount>& seconds) : seconds_(seconds), last_(std::chrono::steady_clock::now()) {}
    void end(Stage stage)
    {
        const auto now = std::chrono::steady_clock::now();
        seconds_[stage] += std::chrono::duration<double>(now - last_).count();
        last_ = now;
    }

private:
    std::array<double, kStageCount>& seconds_;
    std::chrono::steady_clock::time_point last_;
};

PixelRays pixelRays(const Camera& camera)
{
    PixelRays rays;
    const auto axis = [&](int column, int k) { return camera.worldFromCamera[column][k]; }; // looks along -z, y is up
    for (int k = 0; k < 3; ++k) {
        rays.eye[k] = float(axis(3, k));
        rays.right[k] = float(axis(0, k) / camera.fx), rays.down[k] = float(-axis(1, k) / camera.fy);
        rays.origin[k] = float(-axis(2, k) - axis(0, k) * camera.cx / camera.fx + axis(1, k) * camera.cy / camera.fy);
    }
    rays.width = camera.width, rays.height = camera.height;
    return rays;
}

LitView litView(const Camera& camera, std::span<const Light> lights)
{
    LitView lit;
    for (int k = 0; k < 3; ++k) lit.eye[k] = float(camera.worldFromCamera[3][k]);
    lit.lightCount = int(lights.size());
    std::copy(lights.begin(), lights.end(), lit.lights);
    return lit;
}

} // namespace

Trainer::Trainer(const TrainerOptions& options, std::unique_ptr<TrainableAppearance> appearance)
    : options_(options), appearance_(std::move(appearance))
{
}

void Trainer::initialize(std::span<const OrientedPoint> points, float spacing, bool flat, float opacity)
{
    geometry_.resize(points.size());
    for (size_t i = 0; i < points.size(); ++i) {
        const float* n = points[i].normal;
        GeometryRow& r = geometry_.raw[i];
        for (int k = 0; k < 3; ++k) r[k] = points[i].position[k], r[3 + k] = std::log(0.6f * spacing);
        if (flat) r[5] = std::log(0.2f * spacing);
        // Shortest rotation of +Z onto the normal.
        r[6] = 1 + n[2], r[7] = -n[1], r[8] = n[0], r[9] = 0;
        if (n[2] < -0.9999f) r[6] = 0, r[7] = 1, r[8] = 0;
        r[10] = logit(opacity);
        geometry_.activate(i);
    }
    appearance_->resize(points.size());
    resizeAmbient(points.size());
    resetStatistics();
}

void Trainer::initialize(const SplatCloud& cloud, std::span<const glm::vec3> tints)
{
    geometry_.resize(cloud.count);
    for (size_t i = 0; i < cloud.count; ++i) {
        GeometryRow& r = geometry_.raw[i];
        const glm::quat& q = cloud.rotations[i];
        for (int k = 0; k < 3; ++k) r[k] = cloud.positions[i][k], r[3 + k] = std::log(cloud.scales[i][k]);
        r[6] = q.w, r[7] = q.x, r[8] = q.y, r[9] = q.z;
        r[10] = logit(cloud.opacities[i]); // of 0 and 1 infinite, which is then kept within bounds
        geometry_.activate(i);
    }
    appearance_->resize(cloud.count);
    for (size_t i = 0; i < cloud.count; ++i) appearance_->tint(i, tints[i]);
    resizeAmbient(cloud.count);
    resetStatistics();
}

void Trainer::resizeAmbient(size_t count)
{
    const float start = std::log(kFirstAmbient);
    if (options_.ambient) ambient_.resize(count, {{start, start, start}, {}, {}});
}

void Trainer::addAmbient(size_t lights)
{
    if (!hasAmbient(lights)) return;
    const size_t stride = size_t(channelStride(int(3 * lights)));
    for (size_t v = 0; v < builder_.visible.count(); ++v) {
        const std::array<float, 3>& a = ambient_[builder_.visible.splatFromVisible[v]].value;
        const float color[3] = {std::exp(a[0]), std::exp(a[1]), std::exp(a[2])};
        for (size_t k = 0; k < 3 * lights; ++k) colors_[v * stride + k] += color[k % 3];
    }
}

void Trainer::stepAmbient(size_t lights, float rate)
{
    if (!hasAmbient(lights)) return;
    constexpr float kBeta1 = 0.9f, kBeta2 = 0.99f, kLeast = -16, kMost = 4;
    const size_t stride = size_t(channelStride(int(3 * lights)));
    for (size_t v = 0; v < builder_.visible.count(); ++v) {
        if (!active_[v]) continue;
        AmbientRow& row = ambient_[builder_.visible.splatFromVisible[v]];
        for (size_t c = 0; c < 3; ++c) {
            float gradient = 0;
            for (size_t l = 0; l < lights; ++l) gradient += dColors_[v * stride + 3 * l + c];
            gradient *= std::exp(row.value[c]);
            if (!(std::abs(gradient) < 1e18f)) continue;
            row.momentum[c] += (1 - kBeta1) * (gradient - row.momentum[c]);
            row.second[c] += (1 - kBeta2) * (gradient * gradient - row.second[c]);
            row.value[c] = std::clamp(row.value[c] - rate * row.momentum[c] / (std::sqrt(row.second[c]) + 1e-15f), kLeast, kMost);
        }
    }
}

VisibleView Trainer::project(const Camera& camera, int channels)
{
    view_ = makeView<float>(camera, options_.lowPassVariance);
    builder_.build(view_, geometry_.activated);
    const VisibleSplats& visible = builder_.visible;
    visibleFromSplat_.assign(geometry_.count(), ~0u);
    for (size_t v = 0; v < visible.count(); ++v) visibleFromSplat_[visible.splatFromVisible[v]] = uint32_t(v);
    const size_t floats = visible.count() * size_t(channelStride(channels));
    if (colors_.size() < floats) colors_.resize(floats), dColors_.resize(floats);
    if (dSplats_.size() < visible.count()) dSplats_.resize(visible.count()), active_.resize(visible.count());
    return {geometry_.activated, visibleFromSplat_, visible.count()};
}

void Trainer::render(const Camera& camera, std::span<const Light> lights, std::vector<float>& planes)
{
    const int channels = appearance_->channels(int(lights.size()));
    const VisibleView view = project(camera, channels);
    const LitView lit = litView(camera, lights);
    appearance_->forward(view, lit, colors_.data());
    addAmbient(lights.size());
    const size_t pixels = size_t(camera.width) * camera.height;
    planes_.resize(pixels * size_t(channels + 1));
    rasterForward(builder_.visible, builder_.tiles, colors_.data(), channels, planes_.data());
    const float* image = appearance_->resolve(pixelRays(camera), lit, planes_.data());
    planes.assign(image, image + pixels * (3 * lights.size() + 1));
}

LossStats Trainer::step(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references,
                        const Moment& moment, double* splatErrors)
{
    StageClock clock(stageSeconds);
    const int channels = appearance_->channels(int(lights.size()));
    Random random(options_.seed, uint64_t(moment.step) << 8 | 1);
    const float uniform[3] = {random.uniform(), random.uniform(), random.uniform()};
    appearance_->beginStep(moment.progress, moment.rate, moment.step, uniform, geometry_.activated);

    const VisibleView view = project(camera, channels);
    const VisibleSplats& visible = builder_.visible;
    lastVisible = visible.count(), lastEntries = builder_.tiles.entries.size();
    clock.end(kStageBin);
    stageSeconds[kStageBin] -= builder_.projectSeconds, stageSeconds[kStageProject] += builder_.projectSeconds;

    const LitView lit = litView(camera, lights);
    appearance_->forward(view, lit, colors_.data());
    addAmbient(lights.size());
    clock.end(kStageShade);

    const size_t pixels = size_t(camera.width) * camera.height;
    planes_.resize(pixels * size_t(channels + 1)), dImage_.resize(pixels * (3 * lights.size() + 1));
    rasterForward(visible, builder_.tiles, colors_.data(), channels, planes_.data());
    clock.end(kStageBlend);

    const PixelRays rays = pixelRays(camera);
    const float* image = appearance_->resolve(rays, lit, planes_.data());
    clock.end(kStageResolve);

    const LossStats stats = loss_.evaluate(image, references, int(lights.size()), options_.loss, dImage_.data());
    clock.end(kStageLoss);

    const float* dPlanes = appearance_->resolveBackward(rays, lit, planes_.data(), dImage_.data());
    clock.end(kStageResolve);

    rasterBackward(visible, builder_.tiles, colors_.data(), channels, planes_.data(), dPlanes, rasterScratch_, dColors_.data(),
                   dSplats_.data());
    clock.end(kStageBlendBack);

    const float gradientScale = float(pixels); // the loss is a mean over pixels: undo it, so that statistics do not depend on the image size
    const int distance = appearance_->distanceChannel();
    dDistances_.resize(distance < 0 ? 0 : visible.count());
    for (size_t v = 0; v < dDistances_.size(); ++v) dDistances_[v] = dColors_[v * size_t(channelStride(channels)) + size_t(distance)];
    lastActive = 0;
    for (size_t v = 0; v < visible.count(); ++v) {
        const size_t i = visible.splatFromVisible[v];
        active_[v] = dSplats_[v].weight > kActiveWeight;
        if (!active_[v]) continue;
        ++lastActive;
        gradientSum_[i] += gradientScale * std::sqrt(dSplats_[v].mean[0] * dSplats_[v].mean[0] + dSplats_[v].mean[1] * dSplats_[v].mean[1]);
        ++seen_[i];
    }
    const float rate = float(moment.rate);
    const GeometryRates rates{kRatePosition * options_.sceneSize * rate, kRateScale * rate, kRateRotation * rate, kRateOpacity * rate};
    // Geometry moves after the appearance has used it: both gradients belong to the same state.
    clock.end(kStageGeometryBack);
    stepAmbient(lights.size(), kRateAmbient * rate);
    appearance_->backwardAndStep(view, lit, active_.data(), dColors_.data());
    clock.end(kStageShadeBack);
    stepGeometry(geometry_, view_, visible.splatFromVisible, dSplats_.data(), distance < 0 ? nullptr : dDistances_.data(), active_.data(), rates,
                 moment.step, kOpacityPull);
    clock.end(kStageGeometryBack);
    if (splatErrors) shareOutErrors(camera, image, references, int(lights.size()), splatErrors);
    return stats;
}

// Blending backwards: with the error as gradient of a channel, the gradient of a splat's colour is the sum of weight times error. After a
// step, whose working memory is free then.
void Trainer::shareOutErrors(const Camera& camera, const float* image, const PreparedImage* const* references, int imageCount, double* splatErrors)
{
    constexpr int kChannels = 3; // the fewest that the rasteriser takes; the first is used
    const size_t pixels = size_t(camera.width) * camera.height, stride = size_t(channelStride(kChannels));
    const VisibleSplats& visible = builder_.visible;
    std::vector<float> colors(visible.count() * stride), planes((kChannels + 1) * pixels), errors((kChannels + 1) * pixels);
    objectErrors(image, references, imageCount, errors.data());
    std::copy_n(image + 3 * size_t(imageCount) * pixels, pixels, planes.data() + kChannels * pixels); // alpha
    rasterBackward(visible, builder_.tiles, colors.data(), kChannels, planes.data(), errors.data(), rasterScratch_, dColors_.data(),
                   dSplats_.data());
    for (size_t v = 0; v < visible.count(); ++v) splatErrors[visible.splatFromVisible[v]] += dColors_[v * stride];
}

// Blending backwards, as above, with three channels per light: residual, slope of the display, saturation.
ViewEvidence Trainer::evidence(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references)
{
    const int channels = 3 * int(lights.size());
    const size_t pixels = size_t(camera.width) * camera.height, stride = size_t(channelStride(channels));
    std::vector<float> image;
    appearance_->hideHighlights(true);
    render(camera, lights, image);
    appearance_->hideHighlights(false);
    std::vector<float> gradients(size_t(channels + 1) * pixels, 0.0f);
    for (size_t l = 0; l < lights.size(); ++l)
        for (size_t i = 0; i < pixels; ++i) {
            if (references[l]->planes[3 * pixels + i] < 32768) continue;
            constexpr float kWeights[] = {0.2126f, 0.7152f, 0.0722f}, kSaturated = 0.98f;
            float shown = 0, seen = 0;
            for (size_t c = 0; c < 3; ++c) {
                shown += kWeights[c] * std::clamp(image[(3 * l + c) * pixels + i], 0.0f, 1.0f);
                seen += kWeights[c] * linearFromSrgb(float(references[l]->planes[c * pixels + i]) / 65535.0f);
            }
            gradients[3 * l * pixels + i] = seen - shown;
            gradients[(3 * l + 1) * pixels + i] = srgbSlope(shown);
            gradients[(3 * l + 2) * pixels + i] = seen > kSaturated ? 1.0f : 0.0f;
        }
    const VisibleSplats& visible = builder_.visible;
    std::vector<float> colors(visible.count() * stride), planes(size_t(channels + 1) * pixels);
    std::copy_n(image.data() + size_t(channels) * pixels, pixels, planes.data() + size_t(channels) * pixels); // alpha
    rasterBackward(visible, builder_.tiles, colors.data(), channels, planes.data(), gradients.data(), rasterScratch_, dColors_.data(), dSplats_.data());
    ViewEvidence out{litView(camera, lights), {}};
    for (size_t v = 0; v < visible.count(); ++v) {
        const float weight = dSplats_[v].weight;
        if (!(weight > kActiveWeight)) continue;
        SplatEvidence e{visible.splatFromVisible[v], weight, {}, {}, {}};
        for (size_t l = 0; l < lights.size(); ++l) {
            const float* d = &dColors_[v * stride + 3 * l];
            e.residual[l] = d[0] / weight, e.slope[l] = d[1] / weight, e.saturated[l] = std::clamp(d[2] / weight, 0.0f, 1.0f);
        }
        out.splats.push_back(e);
    }
    return out;
}

size_t Trainer::lastBlocks() const
{
    size_t blocks = 0;
    for (const TileEntry& e : builder_.tiles.entries) blocks += size_t(std::popcount(e.blockMask));
    return blocks;
}

void Trainer::resetStatistics()
{
    gradientSum_.assign(geometry_.count(), 0.0f);
    seen_.assign(geometry_.count(), 0);
}

// Cuts the parent in two along its longest axis. Second moments are kept; the opacity makes the pair as opaque at the old centre as the
// parent was there.
void Trainer::splitSplat(size_t parent, size_t child)
{
    GeometryRow& p = geometry_.raw[parent];
    const int axis = int(std::max_element(&p[3], &p[6]) - &p[3]);
    const float sigma = std::exp(p[3 + axis]);
    float rotation[9];
    detail::rotationMatrix(&p[6], rotation);
    constexpr float kShift = 0.6f; // in standard deviations; (1 - kShift^2) is the variance that is left
    p[3 + axis] += 0.5f * std::log(1 - kShift * kShift);
    const float opacity = geometry_.activated[parent].opacity, atCentre = std::exp(-0.5f * kShift * kShift / (1 - kShift * kShift));
    p[10] = logit(std::clamp((1 - std::sqrt(1 - opacity)) / atCentre, 0.005f, 0.99f));
    geometry_.raw[child] = p;
    for (int k = 0; k < 3; ++k) {
        const float shift = kShift * sigma * rotation[3 * k + axis];
        geometry_.raw[parent][k] += shift, geometry_.raw[child][k] -= shift;
    }
    for (size_t i : {parent, child}) geometry_.clearMoments(i), geometry_.activate(i);
    appearance_->copySplat(parent, child);
    if (!ambient_.empty()) ambient_[child] = {ambient_[parent].value, {}, {}};
}

void Trainer::densify(size_t grow)
{
    const size_t old = geometry_.count();
    grow = std::min(grow, options_.maxSplats - std::min(options_.maxSplats, old));
    std::vector<uint32_t> children, alive; // children: rows to fill, first those of the dead, then new ones
    for (size_t i = 0; i < old; ++i)
        (geometry_.activated[i].opacity < kDeadOpacity || seen_[i] == 0 ? children : alive).push_back(uint32_t(i));
    const auto score = [&](uint32_t i) { return gradientSum_[i] / float(std::max(1u, seen_[i])); };
    const auto needsMore = [&](uint32_t a, uint32_t b) { return std::pair(-score(a), a) < std::pair(-score(b), b); };
    if (options_.region) { // the surroundings have to be behind the object, not sharp
        const auto first = std::stable_partition(alive.begin(), alive.end(), [&](uint32_t i) { return options_.region->holds(geometry_.activated[i].position); });
        const size_t outside = size_t(alive.end() - first), most = size_t(kMostOutside * double(options_.maxSplats));
        std::sort(first, alive.end(), needsMore);
        alive.resize(alive.size() - outside + std::min(outside, most - std::min(outside, most)));
    }
    const size_t dead = children.size(), splits = std::min(dead + grow, alive.size() / 2);
    for (size_t i = old; children.size() < splits; ++i) children.push_back(uint32_t(i));
    std::partial_sort(alive.begin(), alive.begin() + splits, alive.end(), needsMore);
    const size_t count = old + splits - std::min(splits, dead);
    geometry_.resize(count);
    appearance_->resize(count);
    resizeAmbient(count);
    for (size_t i = 0; i < splits; ++i) splitSplat(alive[i], children[i]);

    permute(mortonOrder(count, [&](size_t i) { return geometry_.raw[i].data(); }));
    resetStatistics();
}

void Trainer::permute(const std::vector<uint32_t>& order)
{
    geometry_.permute(order);
    appearance_->permute(order);
    if (ambient_.empty()) return;
    std::vector<AmbientRow> moved;
    for (uint32_t i : order) moved.push_back(ambient_[i]);
    ambient_ = std::move(moved);
}

size_t Trainer::prune()
{
    std::vector<uint32_t> kept, dropped;
    for (size_t i = 0; i < geometry_.count(); ++i) (seen_[i] > 0 && geometry_.activated[i].opacity >= kMinAlpha ? kept : dropped).push_back(uint32_t(i));
    keepRows(kept, dropped);
    return dropped.size();
}

void Trainer::keepRows(const std::vector<uint32_t>& kept, const std::vector<uint32_t>& dropped)
{
    std::vector<uint32_t> order = kept;
    order.insert(order.end(), dropped.begin(), dropped.end());
    permute(order);
    geometry_.resize(kept.size());
    appearance_->resize(kept.size());
    resizeAmbient(kept.size());
    resetStatistics();
}

ObjectCut Trainer::keepObject(const ObjectRegion& region, const std::vector<Camera>& cameras)
{
    ObjectCut cut = findObject(cloud(), region, cameras);
    std::vector<uint32_t> kept, dropped;
    for (size_t i = 0; i < geometry_.count(); ++i) (cut.kept[i] ? kept : dropped).push_back(uint32_t(i));
    keepRows(kept, dropped);
    return cut;
}

SplatCloud Trainer::cloud() const
{
    SplatCloud cloud;
    cloud.count = geometry_.count();
    for (const GaussianGeometry<float>& g : geometry_.activated) {
        float q[4];
        detail::normalizeQuaternion(g.rotation, q);
        cloud.positions.emplace_back(g.position[0], g.position[1], g.position[2]);
        cloud.rotations.emplace_back(q[0], q[1], q[2], q[3]);
        cloud.scales.emplace_back(g.scale[0], g.scale[1], g.scale[2]);
        cloud.opacities.push_back(g.opacity);
    }
    return cloud;
}

void Trainer::exportTo(SplatAsset& asset) const
{
    asset.cloud = cloud();
    asset.lowPassVariance = options_.lowPassVariance;
    asset.channels = appearance_->exportChannels();
}

void Trainer::save(ByteWriter& out) const
{
    out.array(geometry_.raw), out.array(geometry_.momentum), out.array(geometry_.second);
    out.array(gradientSum_), out.array(seen_), out.array(ambient_);
    appearance_->save(out);
}

bool Trainer::load(ByteReader& in)
{
    in.array(geometry_.raw), in.array(geometry_.momentum), in.array(geometry_.second);
    in.array(gradientSum_), in.array(seen_), in.array(ambient_);
    const size_t n = geometry_.raw.size();
    if (in.failed || geometry_.momentum.size() != n || geometry_.second.size() != n || gradientSum_.size() != n || seen_.size() != n ||
        ambient_.size() != (options_.ambient ? n : 0))
        return false;
    geometry_.activated.resize(n);
    for (size_t i = 0; i < n; ++i) geometry_.activate(i);
    return appearance_->load(in) && appearance_->count() == n;
}

} // namespace nacre
