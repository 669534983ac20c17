#include "report/fronts.h"

#include "appearance/detail.h"
#include "base/text.h"
#include "pack/pack.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace nacre::report {

namespace {

class Clock {
public:
    double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

private:
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

Error stopped() { return Error{ErrorCode::kCancelled, "stopped"}; }

/// Everything with one thing changed, for each thing that this asset has.
std::vector<TimedVariant> knobsOf(const SplatAsset& asset)
{
    std::vector<TimedVariant> knobs;
    const auto add = [&](Detail detail) { knobs.push_back({{detail}, 0, {}, false}); };
    const auto part = [&](const char* channel, uint32_t bit) {
        if (asset.find(channel)) add({1, bit});
    };
    part("visibility", kPartVisibility);
    part("lobe", kPartLobe), part("forward", kPartForward), part("s", kPartScatter);
    part("tInd", kPartIndirect), part("network", kPartNetwork);
    if (asset.find("tDir"))
        for (const uint32_t functions : {16u, 9u, 4u}) add({1, 0, functions});
    if (const Channel* maps = asset.find("visibility"); maps && maps->components == 1024) add({1, 0, 0, 16});
    return knobs;
}

/// What several details leave out together.
Detail join(const Detail& a, const Detail& b)
{
    const auto least = [](uint32_t x, uint32_t y) { return x == 0 ? y : y == 0 ? x : std::min(x, y); };
    return {std::min(a.splats, b.splats), a.leaveOut | b.leaveOut, least(a.transportFunctions, b.transportFunctions), least(a.visibilitySize, b.visibilitySize)};
}

constexpr double kStep = 0.8408964152537145; // 2^(-1/4)

std::vector<Variant> gridOf(bool hasOrder, bool scales, const Detail& cheap)
{
    std::vector<Variant> grid;
    const std::vector<float> resolutions = scales ? std::vector<float>{1.0f, 0.71f, 0.5f} : std::vector<float>{1.0f};
    for (const float resolution : resolutions)
        for (int k = 0; k <= (hasOrder ? 14 : 0); k += k < 4 ? 1 : 2) {
            const Variant all{{float(std::pow(kStep, k))}, resolution};
            grid.push_back(all);
            if (!(cheap == Detail{})) grid.push_back({join(all.detail, cheap), resolution});
        }
    return grid;
}

/// As good in both, better in one.
bool beats(double cost, double quality, double otherCost, double otherQuality)
{
    return cost <= otherCost && quality >= otherQuality && (cost < otherCost || quality > otherQuality);
}

void markDominated(std::vector<TimedVariant>& points)
{
    for (size_t i = 0; i < points.size(); ++i)
        points[i].dominated = std::any_of(points.begin(), points.end(), [&](const TimedVariant& q) {
            const TimedVariant& p = points[i];
            return q.variant.resolutionScale >= p.variant.resolutionScale && beats(q.time.ms, q.psnrMasked, p.time.ms, p.psnrMasked);
        });
}

/// Error, and a first idea of the time.
Status look(VariantMeter& meter, TimedVariant& point)
{
    const Result<double> psnr = meter.psnrMasked(point.variant);
    if (!psnr) return psnr.error();
    point.psnrMasked = *psnr;
    const Result<std::vector<VariantTime>> time = meter.time(std::span(&point.variant, 1), 2, 2);
    if (!time) return time.error();
    point.time = (*time)[0];
    return ok();
}

/// Those that may be on the front: what a first idea of the time is worth is about a tenth.
std::vector<TimedVariant> promising(std::vector<TimedVariant> points, size_t most)
{
    constexpr double kDoubt = 0.92;
    std::vector<TimedVariant> kept;
    for (const TimedVariant& p : points) {
        const bool hopeless = std::any_of(points.begin(), points.end(), [&](const TimedVariant& q) { return q.variant.resolutionScale >= p.variant.resolutionScale && q.time.ms < kDoubt * p.time.ms && q.psnrMasked >= p.psnrMasked; });
        if (!hopeless) kept.push_back(p);
    }
    std::sort(kept.begin(), kept.end(), [](const TimedVariant& a, const TimedVariant& b) { return a.time.ms < b.time.ms; });
    while (kept.size() > most) { // of neighbours in time the worse goes where they are closest
        size_t closest = 1;
        for (size_t i = 1; i < kept.size(); ++i)
            if (kept[i].time.ms / kept[i - 1].time.ms < kept[closest].time.ms / kept[closest - 1].time.ms) closest = i;
        kept.erase(kept.begin() + ptrdiff_t(kept[closest].psnrMasked >= kept[closest - 1].psnrMasked ? closest - 1 : closest));
    }
    return kept;
}

std::string decibels(double x) { return numberText(float(std::round(100 * x) / 100)); }

} // namespace

std::vector<bool> dominated(std::span<const double> costs, std::span<const double> qualities)
{
    std::vector<bool> out(costs.size());
    for (size_t i = 0; i < costs.size(); ++i)
        for (size_t k = 0; k < costs.size(); ++k)
            if (beats(costs[k], qualities[k], costs[i], qualities[i])) out[i] = true;
    return out;
}

Result<TimeFront> measureTimeFront(VariantMeter& meter, const SplatAsset& asset, double seconds, bool scales, const Says& says)
{
    const Clock clock;
    TimeFront front;
    TimedVariant everything;
    if (Status s = look(meter, everything); !s) return s.error();
    Detail cheap;
    front.knobs = knobsOf(asset);
    for (TimedVariant& knob : front.knobs) {
        if (!says("one by one: " + variantText(knob.variant))) return stopped();
        if (Status s = look(meter, knob); !s) return s.error();
        constexpr double kCheapDecibel = 0.3, kCheapShare = 0.03;
        if (everything.psnrMasked - knob.psnrMasked < kCheapDecibel && knob.time.ms < (1 - kCheapShare) * everything.time.ms) cheap = join(cheap, knob.variant.detail);
    }
    if (asset.find("importance"))
        for (const float share : {0.71f, 0.5f, 0.25f, 0.125f}) {
            front.shares.push_back({{{share}}, 0, {}, false});
            if (Status s = look(meter, front.shares.back()); !s) return s.error();
        }
    std::vector<TimedVariant> points = front.knobs;
    const std::vector<Variant> grid = gridOf(asset.find("importance") != nullptr, scales, cheap);
    for (size_t i = 0; i < grid.size(); ++i) {
        if (!says("roughly: " + variantText(grid[i]))) return stopped();
        if (clock.seconds() > 0.5 * seconds) { // every second of the rest would be better than stopping at some shares, but so is the clock
            front.notes.push_back("of " + std::to_string(grid.size()) + " combinations " + std::to_string(grid.size() - i) + " were left out for want of time");
            break;
        }
        if (grid[i] == Variant{}) continue;
        points.push_back({grid[i], 0, {}, false});
        if (Status s = look(meter, points.back()); !s) return s.error();
    }
    constexpr size_t kMostPoints = 11; // at all pixels, and at fewer
    const auto scaled = std::stable_partition(points.begin(), points.end(), [](const TimedVariant& p) { return p.variant.resolutionScale == 1; });
    std::vector<TimedVariant> whole = promising({points.begin(), scaled}, kMostPoints), fewer = promising({scaled, points.end()}, kMostPoints);
    points = std::move(whole);
    points.insert(points.end(), fewer.begin(), fewer.end());
    points.insert(points.begin(), everything);
    std::vector<Variant> variants;
    double frameSeconds = 0;
    const auto ask = [&](const TimedVariant& p) { variants.push_back(p.variant), frameSeconds += 1e-3 * p.time.ms; };
    for (const TimedVariant& p : points) ask(p);
    for (const TimedVariant& p : front.knobs) ask(p);
    for (const TimedVariant& p : front.shares) ask(p);
    meter.forgetAllBut(variants);
    constexpr int kRounds = 13, kFewestRounds = 5, kFrames = 4; // 52 frames after 13 that do not count
    const int rounds = std::clamp(int((seconds - clock.seconds()) / (frameSeconds * (kFrames + 1))), kFewestRounds, kRounds);
    if (rounds < kRounds) front.notes.push_back("frame times are medians of " + std::to_string(rounds * kFrames) + " frames, fewer than 50: this machine needs " + numberText(float(std::round(everything.time.ms))) + " ms a frame");
    if (!says(std::to_string(variants.size()) + " versions in " + std::to_string(rounds) + " interleaved rounds")) return stopped();
    const Result<std::vector<VariantTime>> times = meter.time(variants, rounds, kFrames);
    if (!times) return times.error();
    for (size_t i = 0; i < points.size(); ++i) points[i].time = (*times)[i];
    for (size_t i = 0; i < front.knobs.size(); ++i) front.knobs[i].time = (*times)[points.size() + i];
    for (size_t i = 0; i < front.shares.size(); ++i) front.shares[i].time = (*times)[points.size() + front.knobs.size() + i];
    front.shares.insert(front.shares.begin(), points[0]);
    std::sort(points.begin() + 1, points.end(), [](const TimedVariant& a, const TimedVariant& b) { return a.time.ms < b.time.ms; });
    markDominated(points);
    front.points = std::move(points);
    for (const TimedVariant& knob : front.knobs) {
        const bool used = std::any_of(front.points.begin(), front.points.end(), [&](const TimedVariant& p) {
            return !p.dominated && join(p.variant.detail, knob.variant.detail) == p.variant.detail;
        });
        if (!used)
            front.neverPays.push_back(variantText(knob.variant) + ": " + decibels(front.points[0].psnrMasked - knob.psnrMasked) + " dB for " +
                                      decibels(front.points[0].time.ms - knob.time.ms) + " ms of " + decibels(front.points[0].time.ms));
    }
    return front;
}

std::string sizedText(const SizedVariant& point)
{
    if (std::isnan(point.rate)) return "the file as it was given";
    const std::string detail = detailText(point.variant.detail);
    return detail + ", rounded " + (point.rate < -3 ? "very finely" : point.rate < 0 ? "finely" : point.rate < 2 ? "about as nacre bake does" : "coarsely");
}

Result<std::vector<SizedVariant>> measureBytesFront(VariantMeter& meter, const SplatAsset& asset, const OlatSplit* seen, size_t givenBytes, const Says& says)
{
    std::vector<Detail> details;
    for (int k = 0; k <= (asset.find("importance") ? 12 : 0); k += k < 4 ? 2 : 4) details.push_back({float(std::pow(kStep, k))});
    constexpr double kRates[] = {-4, -1.5, 0.5, 2.5};
    Result<std::vector<PackedVersion>> versions = packVersions(asset, seen, details, kRates, says);
    if (!versions) return versions.error();
    std::vector<SizedVariant> points;
    const Result<double> given = meter.psnrMasked(Variant{});
    if (!given) return given.error();
    points.push_back({{}, NAN, givenBytes, *given, false, {}});
    for (PackedVersion& v : *versions) {
        if (!says("looking at " + std::to_string(points.size()) + " of " + std::to_string(versions->size()))) return stopped();
        const Result<double> psnr = meter.psnrMasked(v.asset);
        if (!psnr) return psnr.error();
        points.push_back({{v.detail}, v.rate, v.file.size(), *psnr, false, std::move(v.file)});
        v.asset = {};
    }
    std::sort(points.begin(), points.end(), [](const SizedVariant& a, const SizedVariant& b) { return a.bytes < b.bytes; });
    std::vector<double> bytes, psnr;
    for (const SizedVariant& p : points) bytes.push_back(double(p.bytes)), psnr.push_back(p.psnrMasked);
    const std::vector<bool> worse = dominated(bytes, psnr);
    for (size_t i = 0; i < points.size(); ++i) points[i].dominated = worse[i];
    return points;
}

static ScalingLine fitted(std::string quantity, std::vector<double> x, const std::vector<VariantTime>& times)
{
    ScalingLine line;
    line.quantity = std::move(quantity), line.x = std::move(x);
    double sx = 0, sy = 0, sxx = 0, sxy = 0;
    const auto n = double(line.x.size());
    for (size_t i = 0; i < line.x.size(); ++i) {
        line.ms.push_back(times[i].ms);
        sx += line.x[i], sy += times[i].ms, sxx += line.x[i] * line.x[i], sxy += line.x[i] * times[i].ms;
    }
    line.slope = (n * sxy - sx * sy) / std::max(n * sxx - sx * sx, 1e-300);
    line.offset = (sy - line.slope * sx) / n;
    for (size_t i = 0; i < line.x.size(); ++i) line.residual = std::max(line.residual, std::abs(line.offset + line.slope * line.x[i] - line.ms[i]) / line.ms[i]);
    return line;
}

Result<std::vector<ScalingLine>> measureScaling(VariantMeter& meter, size_t splats, const Says& says)
{
    constexpr int kRounds = 3, kFrames = 3;
    std::vector<ScalingLine> lines;
    if (!says("frame time against lights")) return stopped();
    std::vector<double> x;
    std::vector<Camera> cameras;
    std::vector<std::vector<Light>> lights;
    for (const int count : {1, 2, 4, 8, 16}) { // the image's own, each with its share of the power; a hair apart, so that no two are one
        std::vector<Light> many;
        for (int i = 0; i < count; ++i) {
            Light light = meter.lights()[size_t(i) % meter.lights().size()];
            light.intensity *= (1 + 1e-3f * float(i)) / float(count);
            many.push_back(light);
        }
        x.push_back(count), cameras.push_back(meter.camera()), lights.push_back(std::move(many));
    }
    Result<std::vector<VariantTime>> times = meter.time(Detail{}, cameras, lights, kRounds, kFrames);
    if (!times) return times.error();
    lines.push_back(fitted("lights", x, *times));

    if (!says("frame time against pixels")) return stopped();
    x.clear(), cameras.clear(), lights.clear();
    for (const double scale : {0.5, 0.71, 1.0, 1.41}) {
        cameras.push_back(scaledCamera(meter.camera(), scale)), lights.push_back(meter.lights());
        x.push_back(double(cameras.back().width) * cameras.back().height);
    }
    times = meter.time(Detail{}, cameras, lights, kRounds, kFrames);
    if (!times) return times.error();
    lines.push_back(fitted("pixels", x, *times));

    if (!says("frame time against splats")) return stopped();
    x.clear();
    std::vector<Variant> shares;
    for (const float share : {1.0f, 0.71f, 0.5f, 0.25f}) shares.push_back({{share}}), x.push_back(std::round(double(share) * double(splats)));
    times = meter.time(shares, kRounds, kFrames);
    if (!times) { // without an order of importance there is one number of splats only
        if (times.error().code != ErrorCode::kBadInput) return times.error();
        return lines;
    }
    lines.push_back(fitted("splats", x, *times));
    return lines;
}

} // namespace nacre::report
