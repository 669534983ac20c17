// bigs as a TrainableAppearance: initial values, schedule of rates and bands, export.
#include "appearance/bigs/bigs_state.h"
#include "appearance/bigs/indirect_sharing.h"
#include "appearance/bigs/normal_search.h"
#include "base/fibonacci_sphere.h"
#include "base/spherical_harmonics.h"
#include "splat/light_visibility.h"
#include "splat/splat_normals.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace nacre {

namespace {

// The channels of a splat: where they lie in a row, and their learning rates at the start.
struct ChannelRow {
    const char* name;
    int first, components;  // components 0: up to the end of the row
    BigsGroup group, last;  // Adam groups of the channel
    float rate;
};
constexpr ChannelRow kChannels[] = {
    {"tDir", kTDir, 25, kGroupDirect, kGroupDirect, 5e-3f},
    {"tInd", kTInd, 75, kGroupIndirect, kGroupIndirect, 3e-3f},
    {"rho", kRho, 3, kGroupRho, kGroupRho, 5e-3f},
    {"lobe", kLobe, kBigsLobeFloats, kGroupNormal, kGroupNormal, 1e-2f},
    {"shadow", kShadow, 1, kGroupShadow, kGroupShadow, 2e-2f},
    {"forward", kForward, kBigsForwardFloats, kGroupShadow, kGroupShadow, 2e-2f},
    {"s", kScatter, 0, kGroupScatter0, BigsGroup(kBigsGroups - 1), 1e-3f},
};
constexpr float kRateSharpness = 6e-2f /* of its logarithm */, kRateLobeColor = 5e-2f;
constexpr float kPlainRate = 5e-3f; // of everything, for comparison
// When the bands are switched on, as fractions of the bake: degree d of T_dir and T_ind at d * kBandEvery, of s from kScatterStart.
constexpr double kBandEvery = 0.02, kScatterStart = 0.06;
// Lobe and visibility come in together, when T_dir knows where light comes from. Visibility is renewed as the geometry moves, and normals
// are taken from the geometry again until kNormalsUntil; from then on they only learn. Later, what they have learnt is worth more: taken
// anew at 0.3 of a bake of 30 minutes they cost knob_marble 0.6 dB, which the falling rates never made up for.
constexpr double kSharpStart = 0.06, kVisibilityAt[] = {kSharpStart, 0.16, 0.3, 0.5, 0.8};
constexpr double kNormalsUntil = 0.2;
// Then they are searched for, while there is time left to learn from what that finds: a search in the second half cost monkey_relief 0.8 dB. (3000
// steps, masked, highlights missing and invented, without and with: monkey_relief 26.56 and 26.72 dB, 0.39 and 0.31 %, 0.056 and 0.032 %;
// bunny_wax 30.09 and 30.24 dB, 0.09 and 0.06 %, 0.013 and 0.013 %.)
constexpr double kSearchAt[] = {0.2, 0.3, 0.42};
// Without maps of visibility T_dir has to learn the shadows. It starts from what is drawn of them then, cut at the horizon. (4000 steps of the
// paper's channels, masked: bunny_wax 26.46 dB without this start, 26.68 with; knob_marble 24.07 and 24.54.)
constexpr double kTransportStart = 0.02;
constexpr int kStartFunctions = 16, kStartDirections = 256;
constexpr int kVisibilityOversample = 1;
// What optional parts have to be worth, in dB, and when. s is more than half of the memory, and anything that depends on view and light gets
// something from it (marble 0.3 dB, wax 0.2), but held-out views only do if nothing else fits (fur 0.8 dB). Lobe and visibility are worth
// 0.1 dB to fur, where held-out views are better without.
constexpr double kScatterJudgedAt = 0.2, kScatterWorth = 0.5, kSharpJudgedAt = 0.3, kSharpWorth = 0.2;
// Neighbours share how T_ind depends on the light once all its bands are there. (bunny_wax, 8000 steps, 24 k splats, masked: 29.35 dB without,
// 29.71 dB with; without it the error rises again from the middle of a long bake.)
constexpr double kShareFrom = 0.1;
constexpr int kShareEvery = 16;
constexpr float kShareRate = 0.032f;
constexpr float kInitialSharpness = 15, kInitialRho = 0.3f, kInitialLobeColor = 0.05f;
// A darker object starts darker: else its splats fade before their colour has become dark, and do not come back.
constexpr float kUsualBrightness = 0.4f, kLeastStart = 0.02f;
constexpr float kLeastTint = 0.1f, kMostTint = 3; // of a splat's start, by what it looks like
constexpr float kInitialForwardSharpness = 4;
constexpr float kPositiveWeight = 0.01f, kEnergyWeight = 0.01f;

int functionsOfDegree(int degree) { return (degree + 1) * (degree + 1); }

class BigsModel final : public TrainableAppearance {
public:
    explicit BigsModel(const AppearanceOptions& options)
    {
        const auto with = [&](const char* part) { return std::find(options.without.begin(), options.without.end(), part) == options.without.end(); };
        lobeOn_ = with("lobe"), forwardOn_ = with("forward"), visibilityOn_ = with("visibility");
        sharing_ = with("sharing"), scheduled_ = with("schedule"), searching_ = with("normal-search");
        nearLights_ = options.pointLights, region_ = options.region;
        start_ = std::clamp(options.brightness / kUsualBrightness, kLeastStart, 1.0f);
        state_.shared = state_.sharedForward = SharedAdam(sharing_ && scheduled_);
        state_.parameters.sFunctions = state_.bands.scatter = scatterFunctions_ = with("s") ? options.scatterFunctions : 0; // all in use until beginStep says otherwise
    }

    size_t count() const override { return state_.parameters.count; }

    void resize(size_t count) override
    {
        const size_t old = state_.parameters.count;
        state_.parameters.resize(count);
        for (size_t i = old; i < count; ++i) {
            at(i, kTDir) = 0.5f / 0.28209479f; // T_dir = 0.5 in every direction
            for (int c = 0; c < 3; ++c) at(i, kRho + c) = start_ * kInitialRho, at(i, kLobeColor + c) = at(i, kForward + 1 + c) = start_ * kInitialLobeColor;
            at(i, kLobe + 2) = 1.0f;
            at(i, kLobeSharpness) = std::log(kInitialSharpness);
            at(i, kForward) = std::log(kInitialForwardSharpness);
            at(i, kShadow) = 1.0f;
        }
    }

    void tint(size_t splat, const glm::vec3& factor) override
    {
        for (int c = 0; c < 3; ++c) at(splat, kRho + c) *= std::clamp(factor[c], kLeastTint, kMostTint);
    }

    // Splats come to lie elsewhere only here: permute follows every copy.
    void copySplat(size_t from, size_t to) override { state_.parameters.copySplat(from, to); }
    void permute(std::span<const uint32_t> order) override
    {
        state_.parameters.permute(order);
        state_.shared.reset(), state_.sharedForward.reset();
        state_.neighbours.clear();
    }

    bool prepareStep(double progress, const HostGeometry& geometry, const std::function<bool()>& goOn) override
    {
        const bool renewed = visibilityOn_ && renewalsDue(progress) > renewed_;
        if (!renewed && (visibilityOn_ || transportStarted_ || progress < kTransportStart)) return true;
        ahead_ = lightVisibilityWithin(region_, geometry(), kVisibilitySize, kVisibilityOversample, nearLights_, goOn, visibilityDrawer_);
        return !ahead_.empty();
    }

    void beginStep(double progress, double rate, int step, const float random[3], const HostGeometry& geometry) override
    {
        const int due = renewalsDue(progress);
        if (lobeOn_ && due > 0 && (!normalsKnown_ || (due > renewed_ && progress < kNormalsUntil))) findNormals(geometry());
        state_.bands.lobe = lobeOn_ && normalsKnown_;
        state_.bands.forward = forwardOn_ && progress >= kSharpStart;
        if (visibilityOn_ && due > renewed_) state_.parameters.visibility = drawnVisibility(geometry());
        renewed_ = due;
        if (!visibilityOn_ && !transportStarted_ && progress >= kTransportStart) startTransport(geometry());
        transportStarted_ = progress >= kTransportStart;
        const int degree = std::min(4, int(progress / kBandEvery));
        state_.bands.direct = state_.bands.indirect = functionsOfDegree(degree);
        const int scatterDegree = std::min(4, int((progress - kScatterStart) / kBandEvery));
        state_.bands.scatter = progress < kScatterStart ? 0 : std::min(state_.parameters.sFunctions, functionsOfDegree(scatterDegree));
        state_.shareRate = sharing_ && progress >= kShareFrom && step % kShareEvery == 0 ? kShareRate : 0;
        if (state_.shareRate > 0 && state_.neighbours.empty()) findNeighbours(geometry());
        for (const ChannelRow& c : kChannels)
            for (int group = c.group; group <= c.last; ++group) state_.update.rate[group] = scheduled_ ? c.rate * float(rate) : kPlainRate;
        state_.sharedRates = {scheduled_ ? kRateSharpness * float(rate) : kPlainRate, scheduled_ ? kRateLobeColor * float(rate) : kPlainRate,
                              state_.update.beta1, state_.update.beta2};
        state_.update.step = step;
        state_.update.positiveWeight = kPositiveWeight / float(state_.parameters.count);
        state_.update.energyWeight = kEnergyWeight / float(state_.parameters.count);
        const float z = 2 * random[0] - 1, r = std::sqrt(std::max(0.0f, 1 - z * z)), phi = 6.2831853f * random[1];
        state_.random = {kPositiveWeight > 0 || kEnergyWeight > 0, {r * std::cos(phi), r * std::sin(phi), z}};
    }

    void shareAmongNeighbours() override
    {
        if (state_.shareRate > 0) shareIndirect(state_.parameters, state_.neighbours, state_.bands.indirect, state_.shareRate, shareScratch_);
    }

    void forward(const VisibleView& view, const LitView& lit, float* colors) override
    {
        terms_.resize(state_.parameters.blocks() * kBigsTermStride * kLanes16);
        bigsForward(state_.parameters, view, lit, state_.bands, state_.random, colors, terms_.data());
    }

    void backwardAndStep(const VisibleView& view, const LitView& lit, const uint8_t* active, const float* dColors) override
    {
        bigsBackwardAndStep(state_.parameters, view, lit, state_.bands, state_.random, active, dColors, terms_.data(), state_.update, lobeGradients_,
                            forwardGradients_);
        if (state_.bands.lobe) stepShared(state_.shared, lobeGradients_, kLobeSharpness, kMinLogSharpness, kMaxLogSharpness);
        if (state_.bands.forward) stepShared(state_.sharedForward, forwardGradients_, kForward, kMinLogForward, kMaxLogForward);
    }

    bool wantsEvidence(double progress) const override { return searching_ && state_.bands.lobe && passed(kSearchAt, progress) > searched_; }
    void hideHighlights(bool hidden) override { state_.bands.lobe = !hidden && lobeOn_ && normalsKnown_; }
    void useEvidence(double progress, std::span<const GaussianGeometry<float>> geometry, std::span<const ViewEvidence> views) override
    {
        searched_ = passed(kSearchAt, progress);
        searchNormals(state_.parameters, geometry, views);
    }

    std::vector<OptionalPart> optionalParts() const override
    {
        std::vector<OptionalPart> parts;
        if (state_.parameters.sFunctions > 0) parts.push_back({"s", kScatterJudgedAt, kScatterWorth, true});
        if (lobeOn_ && normalsKnown_) parts.push_back({"lobe", kSharpJudgedAt, kSharpWorth});
        if (state_.bands.forward) parts.push_back({"forward", kSharpJudgedAt, kSharpWorth});
        if (!state_.parameters.visibility.empty()) parts.push_back({"visibility", kSharpJudgedAt, kSharpWorth});
        return parts;
    }

    void leaveOut(const std::string& part, std::span<const uint8_t> kept) override
    {
        if (part == "s") {
            if (kept.empty()) state_.parameters.dropScatter(), state_.bands.scatter = 0;
            else state_.parameters.keepScatter(kept);
        }
        if (part == "lobe") lobeOn_ = state_.bands.lobe = false;
        if (part == "forward") forwardOn_ = state_.bands.forward = false;
        if (part == "visibility") visibilityOn_ = false, state_.parameters.visibility.clear();
    }

    std::vector<Channel> exportChannels() const override
    {
        const bool shaded = !state_.parameters.visibility.empty();
        std::vector<Channel> channels;
        for (const ChannelRow& row : kChannels) {
            const bool used = row.first == kLobe ? lobeOn_ && normalsKnown_ : row.first == kForward ? state_.bands.forward : row.first == kShadow ? shaded : true;
            const int components = row.components > 0 ? row.components : state_.parameters.coefficients() - row.first;
            if (!used || components == 0) continue;
            Channel c{row.name, uint32_t(components), std::vector<float>(state_.parameters.count * size_t(components)), {}};
            for (size_t i = 0; i < state_.parameters.count; ++i)
                for (int k = 0; k < components; ++k) c.values[i * size_t(components) + size_t(k)] = at(i, row.first + k);
            if (row.first == kLobe) finishLobes(c.values);
            if (row.first == kForward)
                for (size_t i = 0; i < c.values.size(); i += kBigsForwardFloats) c.values[i] = std::exp(c.values[i]);
            channels.push_back(std::move(c));
        }
        if (shaded) channels.push_back({"visibility", kVisibilityTexels, {}, state_.parameters.visibility});
        return channels;
    }

    void save(ByteWriter& out) const override
    {
        const BigsParameters& p = state_.parameters;
        out.value(int32_t(p.sFunctions)), out.value(uint64_t(p.count));
        out.array(p.value), out.array(p.momentum), out.array(p.secondMoment), out.array(p.visibility), out.array(p.scatters);
        out.value(normalsKnown_), out.value(lobeOn_), out.value(visibilityOn_), out.value(transportStarted_), out.value(int32_t(renewed_)), out.value(int32_t(searched_));
        for (int functions : {state_.bands.direct, state_.bands.indirect, state_.bands.scatter}) out.value(int32_t(functions)); // a view may be drawn before the next step
        out.value(state_.bands.lobe), out.value(forwardOn_), out.value(state_.bands.forward);
        state_.shared.save(out), state_.sharedForward.save(out);
        out.array(state_.neighbours);
    }

    bool load(ByteReader& in) override
    {
        BigsParameters p;
        p.sFunctions = in.value<int32_t>();
        if (p.sFunctions != scatterFunctions_ && p.sFunctions != 0) return false; // 0: left out
        p.count = in.value<uint64_t>();
        in.array(p.value), in.array(p.momentum), in.array(p.secondMoment), in.array(p.visibility), in.array(p.scatters);
        normalsKnown_ = in.value<bool>(), lobeOn_ = in.value<bool>(), visibilityOn_ = in.value<bool>(), transportStarted_ = in.value<bool>(), renewed_ = in.value<int32_t>(), searched_ = in.value<int32_t>();
        BigsBands bands;
        for (int* functions : {&bands.direct, &bands.indirect, &bands.scatter}) *functions = in.value<int32_t>();
        bands.lobe = in.value<bool>(), forwardOn_ = in.value<bool>(), bands.forward = in.value<bool>();
        const auto in25 = [](int functions, int least) { return functions >= least && functions <= 25; };
        if (!in25(bands.direct, 1) || !in25(bands.indirect, 1) || !in25(bands.scatter, 0) || bands.scatter > p.sFunctions) return false;
        if (!state_.shared.load(in, p.count) || !state_.sharedForward.load(in, p.count)) return false;
        std::vector<uint32_t> neighbours;
        in.array(neighbours);
        if (!neighbours.empty() && neighbours.size() != p.count * kSplatNeighbours) return false;
        for (uint32_t i : neighbours)
            if (i >= p.count) return false;
        const size_t floats = p.blocks() * p.coefficients() * kLanes16;
        if (in.failed || p.value.size() != floats || p.momentum.size() != floats || p.secondMoment.size() != p.blocks() * kBigsGroups * kLanes16 ||
            (!p.visibility.empty() && p.visibility.size() != p.count * kVisibilityTexels) || (!p.scatters.empty() && p.scatters.size() != p.count))
            return false;
        state_.parameters = std::move(p), state_.neighbours = std::move(neighbours), state_.bands = bands;
        return true;
    }

private:
    float at(size_t splat, int k) const { return state_.parameters.value[state_.parameters.index(splat, k)]; }
    float& at(size_t splat, int k) { return state_.parameters.value[state_.parameters.index(splat, k)]; }

    // A splat's shortest axis is a better normal (3 degrees off in the median on a sphere) than what T_dir says (36 degrees: the lights of
    // a capture come from one side); T_dir only tells the outside from the inside. Its band 1 is -c3, -c1, c2.
    std::vector<glm::vec3> surfaceNormals(std::span<const GaussianGeometry<float>> geometry) const
    {
        std::vector<glm::vec3> lit(geometry.size());
        for (size_t i = 0; i < lit.size(); ++i) lit[i] = {-at(i, kTDir + 3), -at(i, kTDir + 1), at(i, kTDir + 2)};
        return splatNormals(geometry, lit);
    }

    void findNormals(std::span<const GaussianGeometry<float>> geometry)
    {
        const std::vector<glm::vec3> normals = surfaceNormals(geometry);
        for (size_t i = 0; i < normals.size(); ++i)
            for (int k = 0; k < 3; ++k) at(i, kLobe + k) = normals[i][k];
        normalsKnown_ = true;
    }

    static int passed(std::span<const double> moments, double progress) { return int(std::upper_bound(moments.begin(), moments.end(), progress) - moments.begin()); }
    static int renewalsDue(double progress) { return passed(kVisibilityAt, progress); }

    std::vector<uint8_t> drawnVisibility(std::span<const GaussianGeometry<float>> geometry)
    {
        if (!ahead_.empty()) return std::exchange(ahead_, {});
        return lightVisibilityWithin(region_, geometry, kVisibilitySize, kVisibilityOversample, nearLights_, {}, visibilityDrawer_);
    }

    // T_dir = visibility times twice the cosine, as spherical harmonics: on an open plane 0.5 in the mean, like the constant before.
    void startTransport(std::span<const GaussianGeometry<float>> geometry)
    {
        const std::vector<uint8_t> maps = drawnVisibility(geometry);
        const std::vector<glm::vec3> normals = surfaceNormals(geometry);
        tbb::parallel_for(size_t(0), normals.size(), [&](size_t i) {
            float sum[kStartFunctions] = {}, basis[kStartFunctions];
            for (int k = 0; k < kStartDirections; ++k) {
                const glm::vec3 w(fibonacciDirection(k, kStartDirections));
                const float value = 2 * std::max(0.0f, glm::dot(normals[i], w)) * mapVisibility(VisibilityMap{&maps[i * kVisibilityTexels]}, &w.x);
                shBasis(kStartFunctions, w.x, w.y, w.z, basis);
                for (int j = 0; j < kStartFunctions; ++j) sum[j] += 4 * std::numbers::pi_v<float> / kStartDirections * value * basis[j];
            }
            for (int j = 0; j < kStartFunctions; ++j) at(i, kTDir + j) = sum[j];
        });
    }

    void findNeighbours(std::span<const GaussianGeometry<float>> geometry) { state_.neighbours = splatNeighbours(geometry, surfaceNormals(geometry)); }

    // first: the logarithm of the sharpness, and behind it the colour.
    void stepShared(SharedAdam& adam, const BigsLobeGradients& gradients, int first, float least, float most)
    {
        const std::span<const float> steps = adam.step(gradients.gradient, gradients.active, state_.sharedRates);
        for (size_t i = 0; i < state_.parameters.count; ++i) {
            if (!gradients.active[i]) continue;
            at(i, first) = std::clamp(at(i, first) - steps[4 * i], least, most);
            for (int c = 0; c < 3; ++c) at(i, first + 1 + c) = std::max(0.0f, at(i, first + 1 + c) - steps[4 * i + 1 + size_t(c)]);
        }
    }

    // From how a lobe is trained to how it is evaluated: unit normal, sharpness.
    static void finishLobes(std::vector<float>& values)
    {
        for (size_t i = 0; i < values.size(); i += kBigsLobeFloats) {
            float* v = &values[i];
            const float length = std::sqrt(std::max(v[0] * v[0] + v[1] * v[1] + v[2] * v[2], 1e-20f));
            for (int k = 0; k < 3; ++k) v[k] /= length;
            v[3] = std::exp(v[3]);
        }
    }

    friend BigsState* nacre::bigsState(TrainableAppearance& model);

    BigsState state_;
    int scatterFunctions_ = 0;          // of s, unless it has been left out
    float start_ = 1;                   // brightness of a new splat, of the usual
    BigsLobeGradients lobeGradients_, forwardGradients_;
    std::vector<float> shareScratch_;
    bool normalsKnown_ = false, lobeOn_ = true, forwardOn_ = true, visibilityOn_ = true, sharing_ = true, scheduled_ = true;
    std::vector<uint8_t> ahead_;        // visibility, by prepareStep
    std::vector<glm::vec3> nearLights_; // of training; those that matter are found among them
    glm::vec4 region_{0};               // as AppearanceOptions has it
    bool transportStarted_ = false;     // T_dir has its start
    bool searching_ = true;
    int searched_ = 0;                  // how many of kSearchAt are done
    int renewed_ = 0;                   // how many of kVisibilityAt are done
    AlignedVector<float> terms_;
};

} // namespace

BigsState* bigsState(TrainableAppearance& model)
{
    BigsModel* bigs = dynamic_cast<BigsModel*>(&model);
    return bigs ? &bigs->state_ : nullptr;
}

std::unique_ptr<TrainableAppearance> bigs::makeTrainable(const AppearanceOptions& options)
{
    return std::make_unique<BigsModel>(options);
}

} // namespace nacre
