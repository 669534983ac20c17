#include "pack/pack.h"

#include "appearance/coded_channels.h"
#include "asset/asset_decode.h"
#include "pack/pack_views.h"
#include "splat/light_visibility.h"

#include <algorithm>
#include <cmath>

namespace nacre {

namespace {

constexpr size_t kViews = 16, kImportanceViews = 48;

double lossOf(double error) { return 10 * std::log10(1 + error / kTypicalError); }

/// One asset at different steps, and what they cost.
class Packer {
public:
    Packer(const SplatAsset& asset, PackReference reference, std::vector<float> importance, int drawnVisibility)
        : reference_(std::move(reference)), source_(prepareForQuantising(asset, std::move(importance), drawnVisibility))
    {
    }

    struct Trial {
        QuantisedAsset quantised;
        std::vector<std::byte> file;
        double error = 0;
    };

    const QuantSource& source() const { return source_; }

    Result<Trial> at(const std::vector<double>& steps) const
    {
        Trial trial;
        trial.quantised = quantise(source_, steps);
        Result<std::vector<std::byte>> file = encodeCompact(trial.quantised);
        if (!file) return file.error();
        trial.file = std::move(*file);
        Result<SplatAsset> asset = dequantise(trial.quantised);
        if (!asset) return asset.error();
        expandChannels(*asset);
        reuseMaps(*asset);
        const Result<double> error = reference_.error(*asset);
        if (!error) return error.error();
        trial.error = *error;
        return trial;
    }

    /// The error of each group's rounding alone; `steps` as they are tried.
    Result<std::vector<double>> errorsByGroup(const std::vector<double>& steps) const
    {
        std::vector<double> errors;
        for (size_t g = 0; g < steps.size(); ++g) {
            const SplatAsset alone = onlyGroup(g, steps[g]);
            const Result<double> error = reference_.error(alone);
            if (!error) return error.error();
            errors.push_back(*error);
        }
        return errors;
    }

private:
    /// Maps follow from the splats, but hardly change with their rounding: searching reuses those at hand.
    void reuseMaps(SplatAsset& asset) const
    {
        if (asset.drawnVisibility == 0) return;
        asset.channels.push_back(*source_.asset.find("visibility"));
        asset.drawnVisibility = 0;
    }

    SplatAsset onlyGroup(size_t g, double step) const
    {
        QuantSource one = {source_.asset, source_.importance, {source_.groups[g]}};
        SplatAsset asset = source_.asset;
        asset.drawnVisibility = 0;
        const QuantisedAsset quantised = quantise(one, {step});
        for (const BlockTarget& target : source_.groups[g].targets)
            for (Channel& c : asset.channels)
                if (c.name == target.name && c.bytes.empty() == false) c.bytes.clear();
        Result<BlockWriter> writer = BlockWriter::create(asset, quantised.blocks[0]);
        const Block& block = quantised.blocks[0];
        for (uint32_t k = 0; k < block.columns; ++k) writer->column(k, std::span(block.codes).subspan(k * writer->rows(), writer->rows()));
        writer->finish();
        for (const CodedChannels& coded : asset.coded)
            for (Channel& c : asset.channels)
                if (c.name == coded.channels[0]) c.values.clear();
        expandChannels(asset);
        return asset;
    }

    PackReference reference_;
    QuantSource source_;
};

/// Steps at which every number of every group adds as much error, `each`: then no bit is better spent elsewhere.
std::vector<double> balanced(const QuantSource& source, const std::vector<double>& tried, const std::vector<double>& errors, double each)
{
    std::vector<double> steps;
    for (size_t g = 0; g < tried.size(); ++g) {
        const double wanted = each * source.groups[g].activeNumbers;
        const double factor = errors[g] > 0 ? std::sqrt(wanted / errors[g]) : 64.0; // error grows as the square of the step
        steps.push_back(tried[g] * std::clamp(factor, 1.0 / 256, 64.0));
    }
    return steps;
}

} // namespace

Result<PackResult> packCompact(const SplatAsset& asset, const PackOptions& options)
{
    const auto say = [&](const std::string& text) {
        if (options.progress) options.progress(text);
    };
    say("rendering the input");
    const OlatSplit* seen = options.against ? options.against->find("train") : nullptr;
    std::vector<PackView> views, many;
    if (seen) views = viewsOf(*seen, asset.frame, kViews), many = viewsOf(*seen, asset.frame, kImportanceViews);
    if (views.empty()) {
        Result<std::vector<PackView>> around = viewsAround(asset, kImportanceViews);
        if (!around) return around.error();
        many = std::move(*around);
        for (size_t i = 0; i < kViews; ++i) views.push_back(many[i * many.size() / kViews]);
    }
    Result<PackReference> reference = PackReference::render(asset, views);
    if (!reference) return reference.error();
    const Packer packer(asset, std::move(*reference), splatImportance(asset, many), options.drawnVisibility);

    say("measuring what each channel's rounding shows");
    std::vector<double> steps;
    for (const QuantGroup& g : packer.source().groups) steps.push_back(g.firstStep);
    Result<std::vector<double>> errors = packer.errorsByGroup(steps);
    if (!errors) return errors.error();
    steps = balanced(packer.source(), steps, *errors, 2e-6); // a second look where it will be used
    errors = packer.errorsByGroup(steps);
    if (!errors) return errors.error();

    // Bisection of the one number that is left, in powers of two.
    const size_t splats = packer.source().asset.cloud.count;
    const double allowed = kTypicalError * (std::pow(10.0, options.maxLossDecibel / 10) - 1);
    double low = -30, high = -8; // log2 of the error each number may add
    PackResult result;
    Packer::Trial best;
    std::vector<double> bestSteps;
    for (int i = 0; i < 7; ++i) {
        const double middle = 0.5 * (low + high);
        say("packing, " + std::to_string(i + 1) + " of 7");
        const std::vector<double> at = balanced(packer.source(), steps, *errors, std::exp2(middle));
        Result<Packer::Trial> trial = packer.at(at);
        if (!trial) return trial.error();
        const double bytes = double(trial->file.size()) / double(splats);
        result.curve.push_back({bytes, lossOf(trial->error)});
        const bool fits = options.bytesPerSplat > 0 ? bytes <= options.bytesPerSplat : trial->error <= allowed;
        const bool finer = options.bytesPerSplat > 0 ? fits : !fits;
        (finer ? high : low) = middle;
        if (fits || best.file.empty()) best = std::move(*trial), bestSteps = at;
    }
    std::sort(result.curve.begin(), result.curve.end(), [](const PackPoint& a, const PackPoint& b) { return a.bytesPerSplat < b.bytesPerSplat; });
    result.lossDecibel = lossOf(best.error), result.psnr = -10 * std::log10(std::max(best.error, 1e-12));
    if (options.bytesPerSplat > 0 && double(best.file.size()) > options.bytesPerSplat * double(splats))
        result.warnings.push_back("no packing needs less than " + std::to_string(double(best.file.size()) / double(splats)) + " bytes a splat");
    if (options.bytesPerSplat <= 0 && best.error > allowed) result.warnings.push_back("the loss stays above what was asked for");
    Result<std::vector<double>> alone = packer.errorsByGroup(bestSteps);
    if (!alone) return alone.error();
    for (size_t g = 0; g < bestSteps.size(); ++g) result.channels.push_back({packer.source().groups[g].name, 0, lossOf((*alone)[g])});
    for (const Block& block : best.quantised.blocks) // those that share a basis: with the first
        for (size_t g = 0; g < bestSteps.size(); ++g)
            if (packer.source().groups[g].targets[0] == block.targets[0]) result.channels[g].bytes = encodedBytes(block);
    Result<SplatAsset> decoded = decodeAsset(best.file);
    if (!decoded) return decoded.error();
    expandChannels(*decoded);
    drawVisibilityInParallel(*decoded);
    result.splats = splats, result.pruned = asset.cloud.count - splats;
    result.file = std::move(best.file), result.asset = std::move(*decoded);
    return result;
}

} // namespace nacre
