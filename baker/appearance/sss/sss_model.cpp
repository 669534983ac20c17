// sss as a TrainableAppearance: surface of each splat, the network, and what a step does with both.
#include "appearance/trainable.h"

#include "appearance/sss/sss.h"
#include "appearance/sss/sss_asset.h"
#include "appearance/sss/sss_resolve.h"
#include "appearance/sss/sss_state.h"
#include "base/random.h"
#include "render/channel_stride.h"
#include "splat/geometry.h"
#include "splat/light_visibility.h"
#include "splat/splat_normals.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace nacre {

namespace {

// The base colour of new splats is that of the object in the mean, within these bounds. From 0.5 the splats of a black object fade
// before their colour has become dark, and do not come back: a third of its pixels stayed opaque.
constexpr float kDarkestStart = 0.02f, kBrightestStart = 0.5f;
// Visibility and normals are taken from the geometry as in bigs.
constexpr double kRenewAt[] = {0.02, 0.06, 0.16, 0.3, 0.5, 0.8};
constexpr double kNormalsUntil = 0.2;
// When optional parts are judged, and what they have to be worth, in dB. A residual that only takes over errors of the surface
// terms is worth 0.3 to 0.7 dB to objects that do not scatter, a real one 4 to 6.
constexpr double kPartsJudgedAt = 0.3, kResidualWorth = 1.0, kShareWorth = 0.02, kVisibilityWorth = 0.1;
// A highlight that is narrower than the lobe hardly narrows it: it covers few pixels, and the light that leaves the rest of the lobe is missing
// there. A lobe that is too narrow is wrong at once and widens. So once the normals are known, bakes try whether roughness that starts again
// from 0.2 serves a surface better than what it has learnt until then.
constexpr const char* kLearntRoughness = "learnt-roughness"; // the optional part
constexpr double kLearntRoughnessWorth = 0.1;
constexpr float kRestartRoughness = -1.386f; // through the logistic function 0.2
// Base colour, share and 1 - metalness and 1 - subsurfaceness multiply, so an image tells only their product. Per splat and unit,
// these regularisers decide what the images leave open: a share of 1, no metal, no scattering. (A stone of roughness 0.35 and base
// colour 0.6, 0.25, 0.15 without scattering, 2000 steps: base colour off by 0.061 without regularisers, 0.035 with; test 39.03 and
// 39.56 dB, masked.) Without residual, share and metal have little left to explain: their regularisers weigh kBareWeight times as much. (The same
// stone: base colour off by 0.011.)
constexpr float kMetalWeight = 1e-2f, kScatterWeight = 1e-2f, kShareWeight = 1e-1f, kBareWeight = 10;
constexpr size_t kRanges = 64; // of blocks: each sums its own gradient of the network, so threads cannot show

class SssModel final : public TrainableAppearance {
public:
    explicit SssModel(const AppearanceOptions& options) : nearLights_(options.pointLights), region_(options.region)
    {
        state_.nearness = options.lightDistancesVary;
        for (const std::string& part : options.without) leaveOut(part, {});
        state_.codeOn = std::find(options.without.begin(), options.without.end(), "code") == options.without.end();
        const float base = std::clamp(options.brightness, kDarkestStart, kBrightestStart);
        for (int k = 0; k < 3; ++k) start_[size_t(kSssRowBase + k)] = std::log(base / (1 - base));
        Random random(7);
        const auto layer = [&](int at, int outputs, int inputs, float gain) {
            const float bound = gain * std::sqrt(6.0f / float(inputs));
            for (int k = 0; k < outputs * inputs; ++k) state_.weights.value[size_t(at + k)] = bound * (2 * random.uniform() - 1);
        };
        layer(kSssFirstFixed, kSssHidden1, kSssFixedInputs + kSssLightInputs, 1); // the light's inputs lie behind
        for (int j = 0; !state_.nearness && j < kSssHidden1; ++j) state_.weights.value[size_t(kSssFirstLight + kSssLightInputs * j + kSssNearnessInput)] = 0;
        layer(kSssSecond, kSssHidden2, kSssHidden1, 1), layer(kSssThird, kSssHidden3, kSssHidden2, 1);
        layer(kSssResidual, 3, kSssHidden3, 0.3f), layer(kSssShare, kSssHiddenShare, kSssHidden3, 1);
        layer(kSssCode, kSssHidden1, kSssCodeInputs, 1);
        for (int c = 0; c < 3; ++c) state_.weights.value[size_t(kSssResidualBias + c)] = -2.0f;
        state_.weights.transpose();
        state_.networkMomentum.assign(kSssAllWeights, 0), state_.networkSecond.assign(kSssAllWeights, 0);
    }

    size_t count() const override { return state_.row.size(); }
    int channels(int lights) const override { return kSssSurfaceChannels + kSssLightChannels * lights; }
    int distanceChannel() const override { return kSssDepth; }

    void resize(size_t count) override
    {
        state_.row.resize(count, start_);
        state_.momentum.resize(count), state_.second.resize(count);
        if (!state_.visibility.empty()) state_.visibility.resize(count * kVisibilityTexels, 255);
    }
    void tint(size_t splat, const glm::vec3& factor) override
    {
        for (int k = 0; k < 3; ++k) {
            float& raw = state_.row[splat][size_t(kSssRowBase + k)];
            const float base = std::clamp(factor[k] / (1 + std::exp(-raw)), kDarkestStart, kBrightestStart);
            raw = std::log(base / (1 - base));
        }
    }
    void copySplat(size_t from, size_t to) override
    {
        state_.row[to] = state_.row[from], state_.momentum[to] = state_.second[to] = SssRow{};
        if (!state_.visibility.empty())
            std::copy_n(&state_.visibility[from * kVisibilityTexels], kVisibilityTexels, &state_.visibility[to * kVisibilityTexels]);
    }
    void permute(std::span<const uint32_t> order) override
    {
        const auto apply = [&](auto& data, size_t stride) {
            auto moved = data;
            for (size_t i = 0; i < order.size(); ++i) std::copy_n(&data[order[i] * stride], stride, &moved[i * stride]);
            data.swap(moved);
        };
        apply(state_.row, 1), apply(state_.momentum, 1), apply(state_.second, 1);
        if (!state_.visibility.empty()) apply(state_.visibility, kVisibilityTexels);
    }

    bool prepareStep(double progress, const HostGeometry& geometry, const std::function<bool()>& goOn) override
    {
        if (!visibilityOn_ || renewalsDue(progress) <= renewed_) return true;
        ahead_ = lightVisibilityWithin(region_, geometry(), kVisibilitySize, 1, nearLights_, goOn, visibilityDrawer_);
        return !ahead_.empty();
    }

    void beginStep(double progress, double rate, int step, const float*, const HostGeometry& geometry) override
    {
        if (state_.frame[3] == 0) findFrame(geometry());
        const int due = renewalsDue(progress);
        if (due > renewed_) {
            if (progress < kNormalsUntil || renewed_ == 0) findNormals(geometry());
            if (visibilityOn_) state_.visibility = ahead_.empty() ? lightVisibilityWithin(region_, geometry(), kVisibilitySize, 1, nearLights_, {}, visibilityDrawer_) : std::move(ahead_);
            ahead_.clear();
            renewed_ = due;
        }
        state_.rate = float(rate);
        state_.correction1 = 1 - std::pow(kSssBeta1, float(step)), state_.correction2 = 1 - std::pow(kSssBeta2, float(step));
    }

    void forward(const VisibleView& view, const LitView& lit, float* out) override
    {
        const size_t stride = size_t(channelStride(channels(lit.lightCount)));
        batches_.resize((count() + kSssLanes - 1) / kSssLanes);
        const SssStep step = sssStep(state_, lit.lightCount);
        forEachBatch(view, [&](size_t, size_t first, int lanes) {
            Batch& batch = batches_[first / kSssLanes];
            fill(view, lit, first, lanes, batch);
            if (step.network()) sssBatchForward(state_.weights, lit.lightCount, batch.network);
            for (int lane = 0; lane < lanes; ++lane) {
                const size_t splat = first + size_t(lane);
                const uint32_t v = view.visibleFromSplat[splat];
                if (v == ~0u) continue;
                const float* row = state_.row[splat].data();
                float* to = out + v * stride;
                sssRowChannels(row, view.geometry[splat].position, lit.eye, step.residual, to);
                const float subsurface = sssRowSubsurface(row, step.residual);
                for (int l = 0; l < lit.lightCount; ++l) {
                    const int at = l * kSssLanes + lane;
                    sssRowLightChannels(step, batch.network.light[at][kSssVisibilityInput], batch.falloff[at], &lit.lights[l].intensity.x, subsurface,
                                        batch.network.share[at], batch.network.residual[at], to + kSssSurfaceChannels + kSssLightChannels * l);
                }
            }
        });
    }

    const float* resolve(const PixelRays& rays, const LitView& lit, const float* planes) override
    {
        image_.resize(size_t(rays.width) * rays.height * (3 * lit.lightCount + 1));
        sssResolve(rays, lit, planes, image_.data());
        return image_.data();
    }
    const float* resolveBackward(const PixelRays& rays, const LitView& lit, const float* planes, const float* dImage) override
    {
        dPlanes_.resize(size_t(rays.width) * rays.height * (channels(lit.lightCount) + 1));
        sssResolveBackward(rays, lit, planes, dImage, dPlanes_.data());
        return dPlanes_.data();
    }

    void backwardAndStep(const VisibleView& view, const LitView& lit, const uint8_t* active, const float* dChannels) override
    {
        const size_t stride = size_t(channelStride(channels(lit.lightCount)));
        const SssStep step = sssStep(state_, lit.lightCount);
        if (step.network()) dWeights_.assign(kRanges * kSssAllWeights, 0.0f);
        forEachBatch(view, [&](size_t range, size_t first, int lanes) {
            Batch& batch = batches_[first / kSssLanes];
            SssBatch& network = batch.network;
            bool any = false;
            float dSubsurface[kSssLanes] = {};
            std::memset(network.dResidual, 0, sizeof network.dResidual), std::memset(network.dShare, 0, sizeof network.dShare);
            for (int lane = 0; lane < lanes; ++lane) {
                const size_t splat = first + size_t(lane);
                if (!isActive(view, active, splat)) continue;
                any = true;
                const float* d = dChannels + view.visibleFromSplat[splat] * stride;
                const float subsurface = sssRowSubsurface(state_.row[splat].data(), step.residual);
                for (int l = 0; l < lit.lightCount; ++l) {
                    const int at = l * kSssLanes + lane;
                    sssRowLightBackward(step, d + kSssSurfaceChannels + kSssLightChannels * l, network.light[at][kSssVisibilityInput], batch.falloff[at],
                                        &lit.lights[l].intensity.x, subsurface, network.share[at], network.residual[at], network.dResidual[at],
                                        &network.dShare[at], &dSubsurface[lane]);
                }
            }
            if (!any) return;
            if (step.network()) sssBatchBackward(state_.weights, lit.lightCount, network, &dWeights_[range * kSssAllWeights]);
            for (int lane = 0; lane < lanes; ++lane) {
                const size_t splat = first + size_t(lane);
                if (isActive(view, active, splat))
                    stepRow(splat, dChannels + view.visibleFromSplat[splat] * stride, dSubsurface[lane], network.dCode[lane], step);
            }
        });
        if (step.network()) stepNetwork(step);
    }

    std::vector<OptionalPart> optionalParts() const override
    {
        std::vector<OptionalPart> parts;
        if (state_.residualOn) parts.push_back({"residual", kPartsJudgedAt, kResidualWorth});
        if (state_.weights.share) parts.push_back({"share", kPartsJudgedAt, kShareWorth});
        if (!state_.visibility.empty()) parts.push_back({"visibility", kPartsJudgedAt, kVisibilityWorth});
        if (roughnessMayRestart_) parts.push_back({kLearntRoughness, kPartsJudgedAt, kLearntRoughnessWorth, true});
        return parts;
    }

    void leaveOut(const std::string& part, std::span<const uint8_t> kept) override
    {
        if (part == kLearntRoughness) restartRoughness(kept);
        if (part == "roughness-restart") roughnessMayRestart_ = false;
        if (part == "residual") state_.residualOn = false;
        if (part == "share") state_.weights.share = false;
        if (part == "visibility") visibilityOn_ = false, state_.visibility.clear();
    }

    std::vector<Channel> exportChannels() const override
    {
        const size_t n = count();
        Channel base{"baseColor", 3, std::vector<float>(3 * n), {}}, normal{"normal", 3, std::vector<float>(3 * n), {}};
        const size_t m = state_.residualOn ? 3 : 2; // roughness, metalness, subsurfaceness
        Channel material{"material", uint32_t(m), std::vector<float>(m * n), {}};
        for (size_t i = 0; i < n; ++i) {
            for (size_t c = 0; c < 3; ++c) base.values[3 * i + c] = sssFromRaw(state_.row[i][kSssRowBase + c]);
            for (size_t c = 0; c < m; ++c) material.values[m * i + c] = sssFromRaw(state_.row[i][kSssRowRough + c]);
            sssRowUnitNormal(state_.row[i].data(), &normal.values[3 * i]);
        }
        std::vector<Channel> channels{std::move(base), std::move(material), std::move(normal)};
        if (!state_.visibility.empty()) channels.push_back({"visibility", kVisibilityTexels, {}, state_.visibility});
        if (state_.residualOn || state_.weights.share) exportNetwork(channels);
        return channels;
    }

    void save(ByteWriter& out) const override
    {
        out.array(state_.row), out.array(state_.momentum), out.array(state_.second), out.array(state_.visibility);
        out.array(state_.weights.value), out.array(state_.networkMomentum), out.array(state_.networkSecond);
        out.array(std::vector<float>(state_.frame, state_.frame + 4));
        out.value(int32_t(renewed_)), out.value(uint8_t(state_.residualOn | state_.weights.share << 1 | visibilityOn_ << 2 | roughnessMayRestart_ << 3));
    }

    bool load(ByteReader& in) override
    {
        in.array(state_.row), in.array(state_.momentum), in.array(state_.second), in.array(state_.visibility);
        in.array(state_.weights.value), in.array(state_.networkMomentum), in.array(state_.networkSecond);
        std::vector<float> frame;
        in.array(frame);
        renewed_ = in.value<int32_t>();
        const uint8_t parts = in.value<uint8_t>();
        state_.residualOn = parts & 1, state_.weights.share = parts & 2, visibilityOn_ = parts & 4, roughnessMayRestart_ = parts & 8;
        const size_t n = state_.row.size();
        if (in.failed || state_.momentum.size() != n || state_.second.size() != n ||
            (!state_.visibility.empty() && state_.visibility.size() != n * kVisibilityTexels) || state_.weights.value.size() != kSssAllWeights ||
            state_.networkMomentum.size() != kSssAllWeights || state_.networkSecond.size() != kSssAllWeights)
            return false;
        if (frame.size() != 4) return false;
        std::copy_n(frame.begin(), 4, state_.frame);
        state_.weights.transpose();
        return true;
    }

private:
    static int renewalsDue(double progress)
    {
        return int(std::upper_bound(std::begin(kRenewAt), std::end(kRenewAt), progress) - std::begin(kRenewAt));
    }

    // Of all splats, or of those not kept.
    void restartRoughness(std::span<const uint8_t> kept)
    {
        for (size_t i = 0; i < state_.row.size(); ++i)
            if (kept.empty() || !kept[i]) state_.row[i][kSssRowRough] = std::min(state_.row[i][kSssRowRough], kRestartRoughness), state_.momentum[i][kSssRowRough] = 0;
        start_[kSssRowRough] = kRestartRoughness;
        roughnessMayRestart_ = false;
    }

    static bool isActive(const VisibleView& view, const uint8_t* active, size_t splat)
    {
        const uint32_t v = view.visibleFromSplat[splat];
        return v != ~0u && active[v];
    }

    /// Sixteen splats between forward and backward.
    struct Batch {
        SssBatch network;
        float falloff[kSssRows];
    };

    // work(range, first splat, splats) for the batches that the camera sees something of
    template <class Work> void forEachBatch(const VisibleView& view, Work work)
    {
        const size_t batches = (count() + kSssLanes - 1) / kSssLanes;
        tbb::parallel_for(size_t(0), kRanges, [&](size_t range) {
            for (size_t batch = batches * range / kRanges; batch < batches * (range + 1) / kRanges; ++batch) {
                const size_t first = batch * kSssLanes;
                const int lanes = int(std::min<size_t>(kSssLanes, count() - first));
                bool any = false;
                for (int lane = 0; lane < lanes; ++lane) any = any || view.visibleFromSplat[first + size_t(lane)] != ~0u;
                if (any) work(range, first, lanes);
            }
        });
    }

    // Lanes beyond the last splat repeat it.
    void fill(const VisibleView& view, const LitView& lit, size_t first, int lanes, Batch& batch) const
    {
        for (int lane = 0; lane < kSssLanes; ++lane) {
            const size_t splat = first + size_t(std::min(lane, lanes - 1));
            const float *row = state_.row[splat].data(), *position = view.geometry[splat].position;
            float normal[3];
            sssRowUnitNormal(row, normal);
            sssFixedInputs(position, normal, state_.frame, batch.network.fixed[lane]);
            std::copy_n(row + kSssRowCode, kSssCodeInputs, batch.network.code[lane]);
            const LightSample<float> toEye = samplePointLight(lit.eye, 0.0f, position);
            const VisibilityMap map = {state_.visibility.empty() ? nullptr : &state_.visibility[splat * kVisibilityTexels]};
            for (int l = 0; l < lit.lightCount; ++l) {
                const int at = l * kSssLanes + lane;
                batch.falloff[at] = sssRowLight(lit.lights[l], position, toEye.dir, map, state_.frame, state_.nearness, batch.network.light[at]);
            }
        }
    }

    // The network's logistic function of the share has a factor of its own: with the share off it is told to answer 1.
    void exportNetwork(std::vector<Channel>& channels) const
    {
        std::vector<float> values(state_.weights.value.begin(), state_.weights.value.begin() + kSssWeights);
        if (!state_.weights.share) std::fill_n(values.begin() + kSssShareOut, kSssHiddenShare + 1, 0.0f);
        values.insert(values.end(), state_.frame, state_.frame + 4);
        channels.push_back({"network", uint32_t(kSssNetworkFloats), std::move(values), {}, true});
        if (!state_.codeOn) return;
        Channel code{"code", kSssCodeInputs, {}, {}};
        for (const SssRow& r : state_.row) code.values.insert(code.values.end(), r.begin() + kSssRowCode, r.end());
        channels.push_back(std::move(code));
        channels.push_back({"codeWeights", kSssHidden1 * kSssCodeInputs, {state_.weights.value.begin() + kSssCode, state_.weights.value.end()}, {}, true});
    }

    // Position and size of the splats, so that the network sees the same numbers whatever the units.
    void findFrame(std::span<const GaussianGeometry<float>> geometry)
    {
        glm::vec3 lo(1e30f), hi(-1e30f);
        for (const auto& g : geometry) {
            const glm::vec3 p(g.position[0], g.position[1], g.position[2]);
            lo = glm::min(lo, p), hi = glm::max(hi, p);
        }
        const glm::vec3 half = 0.5f * (hi - lo);
        for (int k = 0; k < 3; ++k) state_.frame[k] = 0.5f * (lo[k] + hi[k]);
        state_.frame[3] = 1.0f / std::max({half.x, half.y, half.z, 1e-6f});
    }

    // d: gradient with respect to the channels of the surface
    void stepRow(size_t splat, const float* d, float dSubsurface, const float* dCode, const SssStep& step)
    {
        SssRow& r = state_.row[splat];
        float gradient[kSssRowFloats];
        sssRowBackward(step, r.data(), d, dSubsurface, gradient);
        for (int k = 0; k < kSssCodeInputs; ++k) gradient[kSssRowCode + k] = step.code ? dCode[k] : 0.0f;
        for (int k = 0; k < kSssRowFloats; ++k)
            sssStepNumber(step, k, gradient[k], r[size_t(k)], state_.momentum[splat][size_t(k)], state_.second[splat][size_t(k)]);
    }

    void stepNetwork(const SssStep& step)
    {
        for (size_t k = 0; k < kSssAllWeights; ++k) {
            float sum = 0;
            for (size_t range = 0; range < kRanges; ++range) sum += dWeights_[range * kSssAllWeights + k];
            sssAdam(step, kSssNetworkRate, sum, state_.weights.value[k], state_.networkMomentum[k], state_.networkSecond[k]);
        }
        state_.weights.transpose();
    }

    // The short axis, on the side that more light reaches (after the first renewal), else on the side away from the middle of
    // all.
    void findNormals(std::span<const GaussianGeometry<float>> geometry)
    {
        glm::vec3 center(0);
        for (const auto& g : geometry) center += glm::vec3(g.position[0], g.position[1], g.position[2]) / float(geometry.size());
        std::vector<glm::vec3> outside(geometry.size());
        for (size_t i = 0; i < outside.size(); ++i) {
            const auto& g = geometry[i];
            outside[i] = state_.visibility.empty() ? glm::vec3(g.position[0], g.position[1], g.position[2]) - center : openSide(i);
        }
        const std::vector<glm::vec3> normals = splatNormals(geometry, outside);
        for (size_t i = 0; i < normals.size(); ++i)
            for (int k = 0; k < 3; ++k) state_.row[i][size_t(kSssRowNormal + k)] = normals[i][k];
    }

    // Mean of all directions weighted by visibility.
    glm::vec3 openSide(size_t splat) const
    {
        glm::vec3 sum(0);
        for (int axis = 0; axis < 6; ++axis)
            for (float tilt : {-0.6f, 0.0f, 0.6f}) {
                glm::vec3 w(tilt, tilt, tilt);
                w[axis / 2] = axis % 2 ? 1.0f : -1.0f;
                w = glm::normalize(w);
                sum += mapVisibility(VisibilityMap{&state_.visibility[splat * kVisibilityTexels]}, &w.x) * w;
            }
        return sum;
    }

    friend SssState* nacre::sssState(TrainableAppearance& model);

    SssState state_;
    std::vector<uint8_t> ahead_;        // visibility, by prepareStep
    AlignedVector<Batch> batches_;
    SssRow start_{0, 0, 0, 0, -2, -1, 0, 0, 1}; // of a new splat
    bool visibilityOn_ = true;
    bool roughnessMayRestart_ = true;   // it has not yet
    std::vector<glm::vec3> nearLights_; // of training; those that matter are found among them
    glm::vec4 region_{0};               // as AppearanceOptions has it
    std::vector<float> dWeights_, image_, dPlanes_;
    int renewed_ = 0;
};

} // namespace

SssStep sssStep(const SssState& state, int lights)
{
    const auto pull = [&](float weight) { return state.residualOn ? weight : kBareWeight * weight; };
    const size_t count = state.row.size();
    SssStep step{};
    step.rate = state.rate, step.correction1 = state.correction1, step.correction2 = state.correction2;
    step.metalPull = pull(kMetalWeight) / float(count), step.scatterPull = kScatterWeight / float(count);
    step.sharePull = pull(kShareWeight) / float(count * size_t(lights));
    step.residual = state.residualOn, step.share = state.weights.share, step.code = state.codeOn && step.network();
    return step;
}

SssState* sssState(TrainableAppearance& model)
{
    SssModel* sss = dynamic_cast<SssModel*>(&model);
    return sss ? &sss->state_ : nullptr;
}

std::unique_ptr<TrainableAppearance> sss::makeTrainable(const AppearanceOptions& options)
{
    return std::make_unique<SssModel>(options);
}

} // namespace nacre
