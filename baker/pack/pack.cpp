#include "pack/pack.h"

#include "appearance/coded_channels.h"
#include "appearance/detail.h"
#include "appearance/model_table.h"
#include "asset/asset_decode.h"
#include "pack/importance.h"
#include "pack/pack_views.h"
#include "pack/quantise.h"
#include "splat/light_visibility.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace nacre {

namespace {

constexpr size_t kViews = 12, kImportanceViews = 48;

double errorOf(double lossDecibel) { return kTypicalError * (std::pow(10.0, lossDecibel / 10) - 1); }
double lossOf(double error) { return 10 * std::log10(1 + error / kTypicalError); }

SplatAsset withoutChannel(SplatAsset asset, const std::string& name)
{
    std::erase_if(asset.channels, [&](const Channel& c) { return c.name == name; });
    return asset;
}

/// That is part of the look; those that say how splats are left out are not.
bool mayBeAbsent(const SplatAsset& asset, const Channel& channel)
{
    if (channel.name == "importance" || channel.name == "growth") return false;
    for (const ChannelSpec& spec : findAppearanceModel(asset.model)->channels)
        if (channel.name == spec.name) return spec.components[0] == 0;
    return false;
}

/// One asset at different steps, and what they cost.
class Packer {
public:
    Packer(QuantSource source, const PackReference& reference) : source_(std::move(source)), reference_(&reference) {}

    struct Trial {
        QuantisedAsset quantised;
        std::vector<std::byte> file;
        double error = 0, each = 0;
        double bytesPerSplat() const { return double(file.size()) / double(quantised.frame.cloud.count); }
    };

    const QuantSource& source() const { return source_; }

    /// Measures what rounding costs; first at steps that are about right, then at those that will be used.
    Status calibrate()
    {
        steps_.clear();
        for (const QuantGroup& g : source_.groups) steps_.push_back(g.firstStep);
        if (Status s = measure(); !s) return s;
        constexpr double kAbout = 2e-6; // 0.3 dB over the numbers of a splat
        steps_ = balanced(kAbout);
        return measure();
    }

    /// Of a reduced version of the same asset, which may lack groups: what rounding costs hardly changes.
    void calibrateLike(const Packer& whole)
    {
        steps_.clear(), errors_.clear();
        for (const QuantGroup& group : source_.groups)
            for (size_t g = 0; g < whole.steps_.size(); ++g)
                if (whole.source_.groups[g].name == group.name) steps_.push_back(whole.steps_[g]), errors_.push_back(whole.errors_[g]);
    }

    QuantisedAsset quantisedAt(double each) const { return quantise(source_, balanced(each)); }

    /// Every number adds an error of `each`.
    Result<Trial> at(double each) const
    {
        Trial trial;
        trial.each = each;
        trial.quantised = quantisedAt(each);
        Result<std::vector<std::byte>> file = encodeCompact(trial.quantised);
        if (!file) return file.error();
        trial.file = std::move(*file);
        Result<SplatAsset> asset = read(trial.quantised);
        if (!asset) return asset.error();
        const Result<double> error = reference_->error(*asset);
        if (!error) return error.error();
        trial.error = *error;
        return trial;
    }

    /// As a reader gets it, but for drawn maps, which hardly change with the rounding of splats: those at hand serve.
    Result<SplatAsset> read(const QuantisedAsset& quantised) const
    {
        Result<SplatAsset> asset = dequantise(quantised);
        if (!asset) return asset;
        expandChannels(*asset);
        if (asset->drawnVisibility > 0) asset->channels.push_back(*source_.asset.find("visibility")), asset->drawnVisibility = 0;
        return asset;
    }

    Result<double> errorWithout(const std::string& channel) const
    {
        SplatAsset asset = withoutChannel(source_.asset, channel);
        asset.drawnVisibility = 0;
        return reference_->error(asset);
    }

private:
    std::vector<double> balanced(double each) const
    {
        std::vector<double> steps;
        for (size_t g = 0; g < steps_.size(); ++g) {
            if (source_.groups[g].exact) {
                steps.push_back(source_.groups[g].firstStep);
                continue;
            }
            const double wanted = each * source_.groups[g].activeNumbers;
            const double factor = errors_[g] > 0 ? std::sqrt(wanted / errors_[g]) : 64.0;
            steps.push_back(steps_[g] * std::clamp(factor, 1.0 / 256, 64.0));
        }
        return steps;
    }

    Status measure()
    {
        errors_.clear();
        SplatAsset unrounded = source_.asset;
        unrounded.drawnVisibility = 0;
        const Result<double> rest = reference_->error(unrounded); // of what is left out
        if (!rest) return rest.error();
        for (size_t g = 0; g < steps_.size(); ++g) {
            if (source_.groups[g].exact) {
                errors_.push_back(0);
                continue;
            }
            const Result<double> error = reference_->error(onlyGroup(g, steps_[g]));
            if (!error) return error.error();
            errors_.push_back(std::max(0.0, *error - *rest));
        }
        return ok();
    }

    /// The source with one group rounded.
    SplatAsset onlyGroup(size_t g, double step) const
    {
        SplatAsset asset = source_.asset;
        asset.drawnVisibility = 0;
        const QuantisedAsset quantised = quantise({asset, source_.importance, {source_.groups[g]}}, {step});
        const Block& block = quantised.blocks[0];
        for (Channel& c : asset.channels)
            if (c.name == block.targets[0].name && !block.basis.empty()) c.values.clear(), c.bytes.clear();
        Result<BlockWriter> writer = BlockWriter::create(asset, block);
        const size_t rows = writer->rows();
        for (uint32_t k = 0; k < block.columns; ++k) writer->column(k, std::span(block.codes).subspan(k * rows, rows));
        writer->finish();
        expandChannels(asset);
        return asset;
    }

    QuantSource source_;
    const PackReference* reference_;
    std::vector<double> steps_, errors_; // by group, as measured
};

/// How far a trial is from its bound: below 0 it keeps it. Falls, or grows, smoothly with log2 of the error that each number adds.
struct Bound {
    double error = 0, bytesPerSplat = 0; // one of them
    double excess(const Packer::Trial& t) const { return bytesPerSplat > 0 ? t.bytesPerSplat() / bytesPerSplat - 1 : std::log2(std::max(t.error, 1e-12) / error); }
    double slope() const { return bytesPerSplat > 0 ? -0.15 : 1; } // of the excess, about
    double slack() const { return bytesPerSplat > 0 ? 0.015 : 0.1; }
    bool prefers(const Packer::Trial& a, const Packer::Trial& b) const
    {
        if (excess(a) > 0 || excess(b) > 0) return excess(a) < excess(b);
        return bytesPerSplat > 0 ? a.error < b.error : a.file.size() < b.file.size();
    }
};

Result<Packer::Trial> search(const Packer& packer, const Bound& bound, const std::function<void(const std::string&)>& say)
{
    constexpr int kTrials = 7;
    constexpr double kFinest = -34, kCoarsest = -8; // log2 of an error
    double numbers = 0;
    for (const QuantGroup& g : packer.source().groups) numbers += g.activeNumbers;
    double x = std::log2(bound.error > 0 ? bound.error / numbers : 2e-6);
    std::optional<Packer::Trial> best;
    double lastX = 0, lastExcess = 0;
    for (int i = 0; i < kTrials; ++i) {
        say("packing, trial " + std::to_string(i + 1));
        Result<Packer::Trial> trial = packer.at(std::exp2(x));
        if (!trial) return trial;
        const double excess = bound.excess(*trial);
        const auto better = [&] { // of two that keep the bound, the one nearer to it; else the one that breaks it less
            const double other = bound.excess(*best);
            return excess <= 0 ? other > 0 || excess > other : excess < other;
        };
        if (!best || better()) best = std::move(*trial);
        if (excess <= 0 && excess > -bound.slack()) break;
        double slope = i > 0 && x != lastX ? (excess - lastExcess) / (x - lastX) : bound.slope();
        if (!(slope / bound.slope() > 0.1)) slope = bound.slope();
        lastX = x, lastExcess = excess;
        x = std::clamp(x + std::clamp((-0.5 * bound.slack() - excess) / slope, -6.0, 6.0), kFinest, kCoarsest);
        if (x == lastX) break;
    }
    return std::move(*best);
}

std::string nameOf(const Block& block)
{
    std::string name;
    for (const BlockTarget& t : block.targets) name += (name.empty() ? "" : "+") + t.name;
    return name;
}

/// What each part takes and is worth. Several blocks of a channel: together.
Result<std::vector<PackedPart>> partsOf(const Packer& packer, const Packer::Trial& trial)
{
    std::vector<PackedPart> parts;
    for (const Block& block : trial.quantised.blocks) {
        const std::string name = nameOf(block);
        const auto same = std::find_if(parts.begin(), parts.end(), [&](const PackedPart& p) { return p.name == name; });
        if (same == parts.end()) parts.push_back({name, encodedBytes(block)});
        else same->bytes += encodedBytes(block);
    }
    const SplatAsset& asset = packer.source().asset;
    for (const Channel& channel : asset.channels) {
        if (!mayBeAbsent(asset, channel)) continue;
        const Result<double> error = packer.errorWithout(channel.name);
        if (!error) return error.error();
        auto part = std::find_if(parts.begin(), parts.end(), [&](const PackedPart& p) { return p.name == channel.name; });
        if (part == parts.end()) part = parts.insert(parts.end(), PackedPart{channel.name});
        part->lossWithout = lossOf(*error);
    }
    return parts;
}

/// At the balance of steps one bit a splat less costs this much error (at high rate the error is 2^(-2 bits)).
double errorPerBit(const Packer::Trial& trial) { return 2 * std::numbers::ln2 * trial.each; }

} // namespace

Result<PackResult> packCompact(const SplatAsset& asset, const PackOptions& options)
{
    const auto say = [&](const std::string& text) {
        if (options.progress) options.progress(text);
    };
    if (Status s = validate(asset); !s) return s.error();
    say("rendering the input");
    const Result<std::vector<PackView>> many = viewsFor(asset, options.seen, kImportanceViews);
    if (!many) return many.error();
    const Result<PackReference> reference = PackReference::render(asset, someOf(*many, kViews));
    if (!reference) return reference.error();
    const std::vector<float> importance = splatImportance(asset, *many);

    const Bound bound = options.bytesPerSplat > 0 ? Bound{0, options.bytesPerSplat} : Bound{errorOf(options.maxLossDecibel), 0};
    // As a reader gets it, with the maps that it draws from rounded splats; the search goes by those at hand, and once more where that was too good.
    const auto packed = [&](const SplatAsset& input, std::optional<Packer>& packer) -> Result<Packer::Trial> {
        say("measuring what rounding shows");
        packer.emplace(prepareForQuantising(input, importance, options.drawnVisibility), *reference);
        if (Status s = packer->calibrate(); !s) return s.error();
        Bound searched = bound;
        for (int again = 0;; ++again) {
            Result<Packer::Trial> trial = search(*packer, searched, say);
            if (!trial) return trial;
            Result<SplatAsset> read = decodeAsset(trial->file);
            if (!read) return read.error();
            expandChannels(*read), drawVisibilityInParallel(*read);
            const Result<double> error = reference->error(*read);
            if (!error) return error.error();
            const double more = std::max(0.0, *error - trial->error);
            trial->error = *error;
            if (again > 0 || bound.bytesPerSplat > 0 || bound.excess(*trial) <= 0 || !(more < 0.7 * bound.error)) return trial;
            searched.error = bound.error - more;
        }
    };
    PackResult result;
    SplatAsset input = asset;
    if (!input.find("importance")) {
        say("ordering splats by importance");
        if (Status s = addImportance(input, *many); !s) return s.error();
    }
    std::optional<Packer> packer;
    Result<Packer::Trial> best = packed(input, packer);
    if (!best) return best.error();
    say("measuring what each part is worth");
    Result<std::vector<PackedPart>> parts = partsOf(*packer, *best);
    // A part whose bytes would do more good elsewhere goes; one at a time, as they stand in for each other, and only if it does turn out better.
    for (size_t p = 0; parts && p < parts->size(); ++p) {
        const PackedPart part = (*parts)[p];
        if (part.lossWithout < 0 || part.bytes == 0) continue;
        const double bits = 8 * double(part.bytes) / double(packer->source().asset.cloud.count);
        if (errorOf(part.lossWithout) >= std::min(bits * errorPerBit(*best), 0.25 * best->error)) continue;
        const SplatAsset fewer = withoutChannel(input, part.name);
        std::optional<Packer> other;
        Result<Packer::Trial> trial = packed(fewer, other);
        if (!trial) return trial.error();
        if (!bound.prefers(*trial, *best)) continue;
        input = fewer, packer = std::move(other), best = std::move(trial);
        result.leftOut.push_back(part.name);
        parts = partsOf(*packer, *best);
        p = size_t(-1);
    }
    if (!parts) return parts.error();
    result.parts = std::move(*parts);
    size_t inParts = 0;
    for (const PackedPart& part : result.parts) inParts += part.bytes;
    result.parts.push_back({"names and structure", best->file.size() - inParts});
    result.curve.push_back({best->bytesPerSplat(), lossOf(best->error)});
    if (options.curve)
        for (const double x : {-9.0, -6.0, -4.0, -2.0, 2.0, 4.0, 6.0, 9.0}) {
            say("measuring other sizes");
            const Result<Packer::Trial> other = packer->at(best->each * std::exp2(x));
            if (!other) return other.error();
            result.curve.push_back({other->bytesPerSplat(), lossOf(other->error)});
        }
    std::sort(result.curve.begin(), result.curve.end(), [](const PackPoint& a, const PackPoint& b) { return a.bytesPerSplat < b.bytesPerSplat; });
    if (bound.excess(*best) > 0)
        result.warnings.push_back(options.bytesPerSplat > 0 ? "the file has " + std::to_string(best->bytesPerSplat()) + " bytes a splat: it cannot be made smaller"
                                                            : "the loss is " + std::to_string(lossOf(best->error)) + " dB: more than asked for" +
                                                                  (options.drawnVisibility > 0 ? "; maps drawn from the splats have their part in it (--visibility stored)" : ""));
    result.splats = packer->source().asset.cloud.count, result.pruned = asset.cloud.count - result.splats;
    result.lossDecibel = lossOf(best->error), result.psnr = -10 * std::log10(std::max(best->error, 1e-12));
    result.file = std::move(best->file);
    return result;
}

Result<std::vector<PackedVersion>> packVersions(const SplatAsset& asset, const OlatSplit* seen, std::span<const Detail> details, std::span<const double> rates,
                                                const std::function<bool(const std::string&)>& progress)
{
    constexpr double kAbout = 2e-6;
    constexpr int kDrawn = 32;
    if (Status s = validate(asset); !s) return s.error();
    if (!progress("measuring what rounding shows")) return Error{ErrorCode::kCancelled, "stopped"};
    const Result<std::vector<PackView>> views = viewsFor(asset, seen, kViews);
    if (!views) return views.error();
    const Result<PackReference> reference = PackReference::render(asset, *views);
    if (!reference) return reference.error();
    Packer whole(prepareForQuantising(asset, splatImportance(asset, *views), kDrawn), *reference);
    if (Status s = whole.calibrate(); !s) return s.error();
    std::vector<PackedVersion> versions;
    for (const Detail& detail : details) {
        SplatAsset reduced = asset;
        if (Status s = reduceDetail(reduced, detail); !s) return s.error();
        if (detail != Detail{}) reduced.presets.clear(); // measured of the whole
        Packer packer(prepareForQuantising(reduced, splatImportance(reduced, *views), detail.visibilitySize == 16 ? 16 : kDrawn), *reference);
        packer.calibrateLike(whole);
        for (const double rate : rates) {
            if (!progress("packing " + std::to_string(versions.size() + 1) + " of " + std::to_string(details.size() * rates.size()))) return Error{ErrorCode::kCancelled, "stopped"};
            const QuantisedAsset quantised = packer.quantisedAt(kAbout * std::exp2(rate));
            Result<std::vector<std::byte>> file = encodeCompact(quantised);
            if (!file) return file.error();
            Result<SplatAsset> read = packer.read(quantised);
            if (!read) return read.error();
            versions.push_back({detail, rate, std::move(*file), std::move(*read)});
        }
    }
    return versions;
}

} // namespace nacre
