// bigs as a TrainableAppearance: initial values, schedule of rates and bands, export.
#include "appearance/bigs/bigs_training.h"

#include <algorithm>
#include <cmath>

namespace nacre {

namespace {

// The channels of a splat: where they lie in a row, and their learning rates at the start; all fall exponentially to kFinalRate of
// that. (Measured: lower rates and a deep anneal are worth 1 dB.)
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
    {"s", kScatter, 0, kGroupScatter0, BigsGroup(kBigsGroups - 1), 1e-3f},
};
constexpr double kFinalRate = 0.01;
// When the bands are switched on, as fractions of the bake: degree d of T_dir and T_ind at d * kBandEvery, of s from kScatterStart.
constexpr double kBandEvery = 0.02, kScatterStart = 0.06;
constexpr float kPositiveWeight = 0.01f, kEnergyWeight = 0.01f;

int functionsOfDegree(int degree) { return (degree + 1) * (degree + 1); }

class BigsModel final : public TrainableAppearance {
public:
    explicit BigsModel(int scatterFunctions)
    {
        parameters_.sFunctions = scatterFunctions;
        bands_.scatter = scatterFunctions; // all in use until beginStep says otherwise
    }

    size_t count() const override { return parameters_.count; }

    void resize(size_t count) override
    {
        const size_t old = parameters_.count;
        parameters_.resize(count);
        for (size_t i = old; i < count; ++i) {
            parameters_.value[parameters_.index(i, kTDir)] = 0.5f / 0.28209479f; // T_dir = 0.5 in every direction
            for (int c = 0; c < 3; ++c) parameters_.value[parameters_.index(i, kRho + c)] = 0.3f;
        }
    }

    void copySplat(size_t from, size_t to) override { parameters_.copySplat(from, to); }
    void permute(std::span<const uint32_t> order) override { parameters_.permute(order); }

    void beginStep(double progress, double pace, int step, const float random[3]) override
    {
        const int degree = std::min(4, int(progress / kBandEvery));
        bands_.direct = bands_.indirect = functionsOfDegree(degree);
        bands_.scatter = progress < kScatterStart
                             ? 0
                             : std::min(parameters_.sFunctions, functionsOfDegree(std::min(4, int((progress - kScatterStart) / kBandEvery))));
        const float fall = float(pace * std::pow(kFinalRate, progress));
        for (const ChannelRow& c : kChannels)
            for (int group = c.group; group <= c.last; ++group) update_.rate[group] = c.rate * fall;
        update_.step = step;
        update_.positiveWeight = kPositiveWeight / float(parameters_.count);
        update_.energyWeight = kEnergyWeight / float(parameters_.count);
        const float z = 2 * random[0] - 1, r = std::sqrt(std::max(0.0f, 1 - z * z)), phi = 6.2831853f * random[1];
        random_ = {kPositiveWeight > 0 || kEnergyWeight > 0, {r * std::cos(phi), r * std::sin(phi), z}};
    }

    void forward(const VisibleView& view, const LitView& lit, float* colors) override
    {
        if (terms_.size() < view.visibleCount * kBigsTermStride) terms_.resize(view.visibleCount * kBigsTermStride);
        bigsForward(parameters_, view, lit, bands_, random_, colors, terms_.data());
    }

    void backwardAndStep(const VisibleView& view, const LitView& lit, const uint8_t* active, const float* dColors) override
    {
        bigsBackwardAndStep(parameters_, view, lit, bands_, random_, active, dColors, terms_.data(), update_);
    }

    std::vector<Channel> exportChannels() const override
    {
        std::vector<Channel> channels;
        for (const ChannelRow& row : kChannels) {
            const int components = row.components > 0 ? row.components : parameters_.coefficients() - row.first;
            if (components == 0) continue; // left out: no view-dependent term
            Channel c{row.name, uint32_t(components), std::vector<float>(parameters_.count * components)};
            for (size_t i = 0; i < parameters_.count; ++i)
                for (int k = 0; k < components; ++k) c.values[i * components + k] = parameters_.value[parameters_.index(i, row.first + k)];
            channels.push_back(std::move(c));
        }
        return channels;
    }

    void save(ByteWriter& out) const override
    {
        out.value(int32_t(parameters_.sFunctions));
        out.value(uint64_t(parameters_.count));
        out.array(parameters_.value), out.array(parameters_.momentum), out.array(parameters_.secondMoment);
    }

    bool load(ByteReader& in) override
    {
        if (in.value<int32_t>() != parameters_.sFunctions) return false;
        BigsParameters p;
        p.sFunctions = parameters_.sFunctions;
        p.count = in.value<uint64_t>();
        in.array(p.value), in.array(p.momentum), in.array(p.secondMoment);
        const size_t floats = p.blocks() * p.coefficients() * kLanes16;
        if (in.failed || p.value.size() != floats || p.momentum.size() != floats || p.secondMoment.size() != p.blocks() * kBigsGroups * kLanes16)
            return false;
        parameters_ = std::move(p);
        return true;
    }

private:
    BigsParameters parameters_;
    BigsBands bands_;
    BigsUpdate update_;
    BigsRandomLight random_;
    AlignedVector<float> terms_;
};

} // namespace

std::unique_ptr<TrainableAppearance> makeBigsModel(const AppearanceOptions& options)
{
    return std::make_unique<BigsModel>(options.scatterFunctions);
}

} // namespace nacre
