#include "report/measure.h"

#include "appearance/detail.h"
#include "appearance/model_table.h"
#include "asset/asset_io.h"
#include "eval/channel_pictures.h"
#include "eval/contact_sheet.h"
#include "eval/evaluate.h"
#include "selftest/selftest.h"
#include "train/image_screen.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <limits>
#include <thread>

namespace nacre::report {

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr size_t kSmallScene = 300; // random scenes of the self-test

std::string decibels(double x)
{
    char text[32];
    std::snprintf(text, sizeof text, "%.2f dB", x);
    return text;
}

struct Measurement {
    const SplatAsset& asset;
    std::span<const std::byte> file;
    const OlatDataset& dataset;
    const MeasureOptions& options;
    ImageCache& references;
    ReportData data;

    Status say(const std::string& text) const
    {
        if (options.says(text)) return ok();
        return Error{ErrorCode::kCancelled, "stopped"};
    }
};

SplitFigures figuresOf(const std::string& split, const EvalResult& r)
{
    const ImageMetrics& m = r.mean;
    return {split, r.images.size(), m.psnr, m.psnrMasked, m.ssim, m.flip, m.relMseLinear, m.highlightMissing, m.highlightFalse, r.psnrHighlight, kNan};
}

/// Reference | render | error of one image.
Status addImage(Measurement& m, const OlatSplit& split, SplatRenderer& renderer, size_t index, const std::string& what, double psnr)
{
    const auto reference = m.references.load(split, index);
    if (!reference) return reference.error();
    const auto lights = rendererLights(split.images[index].light);
    if (!lights) return lights.error();
    const auto image = renderer.render(split.cameras[split.images[index].camera], *lights);
    if (!image) return image.error();
    char number[16];
    std::snprintf(number, sizeof number, "%04zu", index);
    m.data.images.push_back({what + " of " + split.name + ": " + number + ", " + decibels(psnr) + " over the object", contactRow(**reference, *image)});
    return ok();
}

Status measureSplits(Measurement& m)
{
    const Result<std::unique_ptr<SplatRenderer>> renderer = makeGlRenderer(m.file);
    if (!renderer) return renderer.error();
    m.data.renderer = (*renderer)->description();
    const Result<const OlatSplit*> main = heldOutSplit(m.dataset);
    if (!main) return main.error();
    for (const OlatSplit& whole : m.dataset.splits) {
        if (whole.name == "train" || whole.images.empty()) continue;
        // All of the main split; of the others at most eight, evenly: they say where it breaks, not by how much to the hundredth.
        OlatSplit split = whole;
        constexpr size_t kFew = 8, kMany = 64;
        const size_t most = &whole == *main ? kMany : kFew;
        if (split.images.size() > most) {
            split.images.clear();
            for (size_t i = 0; i < most; ++i) split.images.push_back(whole.images[i * whole.images.size() / most]);
            m.data.notes.push_back("split " + split.name + ": " + std::to_string(most) + " of " + std::to_string(whole.images.size()) + " images, evenly picked");
        }
        const auto done = [&](const EvalImage& image) { return m.say("split " + split.name + ", image " + std::to_string(image.index + 1) + " of " + std::to_string(image.count)); };
        const auto result = evaluate(split, m.references, **renderer, {0}, done);
        if (!result) return result.error();
        for (const UnusableImage& image : result->skipped) m.data.notes.push_back("skipped: " + image.why);
        m.data.splits.push_back(figuresOf(split.name, *result));
        std::vector<size_t> order(result->images.size());
        for (size_t i = 0; i < order.size(); ++i) order[i] = i;
        std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return result->images[a].psnrMasked < result->images[b].psnrMasked; });
        if (order.empty()) continue;
        const auto add = [&](const char* what, size_t at) { return addImage(m, split, **renderer, result->indices[at], what, result->images[at].psnrMasked); };
        if (Status s = add("worst", order.front()); !s) return s;
        if (&whole == *main)
            if (Status s = add("median", order[order.size() / 2]); !s) return s;
    }
    return ok();
}

TimedFrame frameOf(const VariantTime& t) { return {t.ms, t.low, t.high, t.relightMs, t.sortMs, t.rasterMs}; }

std::string presetOf(const SplatAsset& asset, const Variant& variant)
{
    for (const Preset& p : asset.presets)
        if (p.detail == variant.detail && p.resolutionScale == variant.resolutionScale) return p.name;
    return "";
}

size_t channelBytes(const AssetSummary& summary, std::initializer_list<const char*> names)
{
    size_t bytes = 0;
    for (const AssetSummary::ChannelBytes& c : summary.channels)
        for (const char* name : names)
            if (c.name == name) bytes += c.bytes;
    return bytes;
}

/// What each knob saves and costs here, and what the bake left out before.
void addLedger(Measurement& m, const TimeFront& front)
{
    const AssetSummary summary = summarizeAsset(m.asset, m.file);
    const TimedVariant& all = front.points[0];
    for (const TimedVariant& knob : front.knobs) {
        LedgerRow row{variantText(knob.variant), false, kNan, all.time.ms - knob.time.ms, all.psnrMasked - knob.psnrMasked, "measured by leaving it out"};
        const uint32_t part = knob.variant.detail.leaveOut;
        size_t bytes = 0;
        if (part == kPartVisibility) bytes = channelBytes(summary, {"visibility", "shadow"});
        if (part == kPartLobe) bytes = channelBytes(summary, {"lobe", "lobe.normal"});
        if (part == kPartForward) bytes = channelBytes(summary, {"forward"});
        if (part == kPartScatter) bytes = channelBytes(summary, {"s"});
        if (part == kPartIndirect) bytes = channelBytes(summary, {"tInd"});
        if (part == kPartNetwork) bytes = channelBytes(summary, {"network", "code", "codeWeights"});
        if (bytes > 0) row.bytes = double(bytes);
        if (part == kPartVisibility && m.asset.drawnVisibility > 0) row.note += "; its maps take no bytes, they are drawn when the asset is loaded";
        m.data.ledger.push_back(std::move(row));
    }
    // What this asset could have and does not.
    for (const ChannelSpec& spec : findAppearanceModel(m.asset.model)->channels)
        if (spec.components[0] == 0 && !m.asset.find(spec.name) && !(m.asset.drawnVisibility > 0 && std::string(spec.name) == "visibility"))
            m.data.ledger.push_back({std::string("channel ") + spec.name, true, kNan, kNan, kNan, "not in the asset: its shader branches and textures are left out with it (--bake shows what the bake measured of it)"});
    if (m.asset.model == "bigs") m.data.ledger.push_back({"subsurface network and G-buffer", true, kNan, kNan, kNan, "of the model sss: no shader of it is compiled for this asset"});
    else m.data.ledger.push_back({"transport, view and combine passes", true, kNan, kNan, kNan, "of the model bigs: no shader of them is compiled for this asset"});
}

/// Choices that are the host's, each beside the usual one.
Status addHostChoices(Measurement& m, VariantMeter& meter)
{
    constexpr double kSeconds = 4;
    const auto add = [&](const std::string& part, bool leftOut, const VariantMeter::Compared& c, const std::string& note) {
        m.data.ledger.push_back({part, leftOut, kNan, c.time.ms - c.otherTime.ms, c.psnrMasked - c.otherPsnrMasked, note});
    };
    if (Status s = m.say("half-float target, back ends"); !s) return s;
    const auto half = meter.compareHost({GlHost::BackEnd::kAuto, true}, kSeconds);
    if (!half) return half.error();
    add("a half-float target instead of a float one", false, *half, "the host's framebuffer; both drawn in turns");
    for (const auto& [name, backEnd] : {std::pair("shaders of OpenGL 3.3 only", GlHost::BackEnd::kGl33), std::pair("compute shaders (OpenGL 4.3)", GlHost::BackEnd::kGl43)}) {
        const auto other = meter.compareHost({backEnd, false}, kSeconds);
        if (!other && other.error().code == ErrorCode::kUnsupported) m.data.notes.push_back(std::string(name) + ": " + other.error().message);
        else if (!other) return other.error();
        else add(std::string("back end: ") + name, false, *other, "instead of the one that NACRE_BACK_END_AUTO takes here");
    }
    for (const OlatSplit& split : m.dataset.splits)
        for (const int fewer : {64, 16}) {
            constexpr size_t kImages = 2;
            if (Status s = m.say("directions of environments"); !s) return s;
            const auto directions = meter.compareDirections(split, m.references, kImages, fewer, kEnvironmentDirections, kSeconds);
            if (!directions) break; // of most splits: no environment
            add(std::to_string(fewer) + " directions for an environment instead of " + std::to_string(kEnvironmentDirections), false, *directions, "images of split " + split.name);
        }
    return ok();
}

Status measureFronts(Measurement& m, double seconds)
{
    const Result<const OlatSplit*> split = heldOutSplit(m.dataset);
    if (!split) return split.error();
    Result<VariantMeter> meter = VariantMeter::create(m.asset, **split, m.references, m.options.frontImages);
    if (!meter) return meter.error();
    meter->stopped = m.options.stopped;
    m.data.width = meter->camera().width, m.data.height = meter->camera().height;
    m.data.notes.push_back("fronts: " + std::to_string(meter->images()) + " images of split " + (*split)->name + "; frames of the first, under its light, everything evaluated in each");
    Result<TimeFront> front = measureTimeFront(*meter, m.asset, 0.5 * seconds, true, [&](const std::string& text) { return m.options.says("frame time: " + text); });
    if (!front) return front.error();
    m.data.neverPays = front->neverPays;
    m.data.notes.insert(m.data.notes.end(), front->notes.begin(), front->notes.end());
    const auto pointOf = [&](const TimedVariant& p) {
        FrontPoint point;
        point.settings = variantText(p.variant), point.preset = presetOf(m.asset, p.variant);
        point.time = frameOf(p.time), point.psnrMasked = p.psnrMasked, point.dominated = p.dominated, point.scaled = p.variant.resolutionScale < 1;
        return point;
    };
    for (const TimedVariant& p : front->points) m.data.frontTime.push_back(pointOf(p));
    for (const TimedVariant& p : front->shares) m.data.levels.push_back(pointOf(p));
    m.data.fullFrame = m.data.frontTime[0].time;
    constexpr double kNoisy = 1.5;
    if (m.data.fullFrame.high > kNoisy * m.data.fullFrame.low) m.data.notes.insert(m.data.notes.begin(), "frame times are unsure: other work on this machine came between, the ranges tell how much");
    constexpr double kAlien = 15;
    if (m.data.frontTime[0].psnrMasked < kAlien) m.data.notes.insert(m.data.notes.begin(), "the asset and the dataset hardly agree (" + decibels(m.data.frontTime[0].psnrMasked) + "): is it the one it was baked from?");
    addLedger(m, *front);

    if (Status s = addHostChoices(m, *meter); !s) return s;
    const Result<std::vector<ScalingLine>> lines = measureScaling(*meter, m.asset.cloud.count, m.options.says);
    if (!lines) return lines.error();
    for (const ScalingLine& l : *lines) m.data.scalings.push_back({l.quantity, l.x, l.ms, l.slope, l.offset, l.residual});

    const Variant everything[] = {Variant{}};
    meter->forgetAllBut(everything);
    const Result<std::vector<SizedVariant>> sizes =
        measureBytesFront(*meter, m.asset, m.dataset.find("train"), m.file.size(), [&](const std::string& text) { return m.options.says("bytes: " + text); });
    if (!sizes) return sizes.error();
    for (const SizedVariant& p : *sizes) {
        FrontPoint point;
        point.settings = sizedText(p), point.bytes = double(p.bytes), point.psnrMasked = p.psnrMasked, point.dominated = p.dominated;
        m.data.frontBytes.push_back(std::move(point));
    }
    return ok();
}

Status addChannels(Measurement& m)
{
    const Result<const OlatSplit*> split = heldOutSplit(m.dataset);
    if (!split) return split.error();
    const std::vector<OlatImage>& images = (*split)->images;
    std::vector<size_t> lit = {0};
    if (images.size() > 1) lit.push_back(images.size() / 2);
    for (const size_t k : lit) {
        if (Status s = m.say("parts of the image"); !s) return s;
        const auto lights = rendererLights(images[k].light);
        if (!lights) return lights.error();
        const auto pictures = channelPictures(m.asset, (*split)->cameras[images[0].camera], *lights);
        if (!pictures) return pictures.error();
        ChannelSheet sheet{"the first camera of " + (*split)->name + " under the light of image " + std::to_string(k), {}};
        for (const ChannelPicture& p : *pictures) sheet.channels.push_back({p.name + " (" + p.scale + ")", p.picture});
        m.data.channels.push_back(std::move(sheet));
    }
    return ok();
}

Status addStability(Measurement& m)
{
    if (Status s = m.say("self-test"); !s) return s;
    selftest::Options options;
    options.randomScenes = kSmallScene;
    options.progress = m.options.says;
    const Result<selftest::Report> report = selftest::run(options);
    if (!report) return report.error();
    struct Nearest {
        const selftest::Row* row;
        size_t column;
    };
    std::vector<Nearest> nearest;
    for (const selftest::Row& row : report->rows) {
        size_t at = 0;
        for (size_t c = 1; c < row.cells.size(); ++c)
            if (row.cells[c].ofBound > row.cells[at].ofBound) at = c;
        if (!row.cells.empty()) nearest.push_back({&row, at});
    }
    std::stable_sort(nearest.begin(), nearest.end(), [](const Nearest& a, const Nearest& b) { return a.row->cells[a.column].ofBound > b.row->cells[b.column].ofBound; });
    constexpr size_t kShown = 12;
    for (size_t i = 0; i < std::min(kShown, nearest.size()); ++i) {
        const selftest::Row& row = *nearest[i].row;
        const selftest::Cell& cell = row.cells[nearest[i].column];
        const std::string& column = report->columns[nearest[i].column].name;
        const selftest::Bound& bound = column.rfind("GL", 0) == 0 && row.gl.value > 0 ? row.gl : row.bound;
        m.data.stability.push_back({row.name, row.quantity, bound.reason, bound.value, cell.deviation.max, column, row.passes});
    }
    m.data.stabilityNote = std::to_string(report->rows.size()) + " cases and " + std::to_string(kSmallScene) + " random scenes in " + std::to_string(report->columns.size()) +
                           " back ends, " + std::to_string(report->failures()) + " failed";
    for (const selftest::ColumnInfo& c : report->columns)
        if (!c.skipped.empty()) m.data.notes.push_back("self-test: " + c.name + " skipped: " + c.skipped);
    return ok();
}

void addMemory(Measurement& m)
{
    m.data.memory.push_back({"file", double(m.file.size())});
    size_t host = m.asset.cloud.count * (sizeof(glm::vec3) + sizeof(glm::quat) + sizeof(glm::vec3) + sizeof(float));
    for (const Channel& c : m.asset.channels) host += c.sizeInBytes();
    m.data.memory.push_back({"host, decoded", double(host)});
    if (const Result<uint64_t> gpu = gpuBytesOf(m.file)) m.data.memory.push_back({"GPU, textures and buffers of the asset", double(*gpu)});
}

} // namespace

Result<const OlatSplit*> heldOutSplit(const OlatDataset& dataset)
{
    if (const OlatSplit* test = dataset.find("test"); test && !test->images.empty()) return test;
    for (const OlatSplit& split : dataset.splits)
        if (split.name != "train" && !split.images.empty()) return &split;
    return Error{ErrorCode::kBadInput, "the dataset has no held-out images (a split 'test'); what an asset makes of the images that it was trained on says nothing"};
}

std::string machineText()
{
    std::ifstream info("/proc/cpuinfo");
    std::string line, model = "unknown CPU";
    while (std::getline(info, line))
        if (line.rfind("model name", 0) == 0 && line.find(": ") != std::string::npos) {
            model = line.substr(line.find(": ") + 2);
            break;
        }
    return model + ", " + std::to_string(std::thread::hardware_concurrency()) + " threads";
}

Result<ReportData> measureReport(const SplatAsset& asset, std::span<const std::byte> file, const OlatDataset& dataset, const MeasureOptions& options)
{
    const auto start = std::chrono::steady_clock::now();
    ImageCache references(dataset, size_t(512) << 20);
    Measurement m{asset, file, dataset, options, references, {}};
    m.data.model = asset.model, m.data.bakedWith = asset.bakedWith, m.data.splats = asset.cloud.count, m.data.machine = machineText();
    if (Status s = measureSplits(m); !s) return s.error();
    if (options.selftest)
        if (Status s = addStability(m); !s) return s.error();
    if (Status s = addChannels(m); !s) return s.error();
    addMemory(m);
    const double spent = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (Status s = measureFronts(m, std::max(60.0, options.seconds - spent)); !s) return s.error();
    return std::move(m.data);
}

} // namespace nacre::report
