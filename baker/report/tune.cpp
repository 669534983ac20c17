#include "report/tune.h"

#include "base/text.h"
#include "pack/pack.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace nacre::report {

namespace {

std::string text(double x) { return numberText(float(x)); }

Error unreachable(const std::string& bound, const std::string& nearest, const std::string& advice) { return Error{ErrorCode::kBadInput, bound + " cannot be kept: " + nearest + "; " + advice}; }

struct Search {
    VariantMeter& meter;
    const SplatAsset& asset;
    const TuneGoal& goal;
    const Says& says;

    VariantTime there(const VariantTime& t) const { return goal.there ? onDevice(t, asset.model, *goal.here, *goal.there) : t; }

    Result<TimedVariant> measure(const Variant& variant) const
    {
        if (!says("measuring " + variantText(variant))) return Error{ErrorCode::kCancelled, "stopped"};
        const Result<double> psnr = meter.psnrMasked(variant);
        if (!psnr) return psnr.error();
        constexpr int kRounds = 8, kFrames = 5;
        const Result<std::vector<VariantTime>> time = meter.time(std::span(&variant, 1), kRounds, kFrames);
        if (!time) return time.error();
        return TimedVariant{variant, *psnr, there((*time)[0]), false};
    }
};

/// Between shares that the front was measured at: the most that keeps the bound, `within(point)`, by halving.
Result<TimedVariant> refine(const Search& search, TimedVariant best, bool fewer, const std::function<bool(const TimedVariant&)>& within)
{
    if (!search.asset.find("importance")) return best;
    constexpr float kNext = 1.5f; // the front's shares lie at most so far apart
    constexpr int kHalvings = 4;
    float good = best.variant.detail.splats, other = fewer ? good / kNext : std::min(1.0f, good * kNext);
    for (int i = 0; i < kHalvings && std::abs(other - good) > 0.01f * good; ++i) {
        Variant between = best.variant;
        between.detail.splats = std::sqrt(good * other);
        const Result<TimedVariant> point = search.measure(between);
        if (!point) return point;
        if (within(*point)) best = *point, good = between.detail.splats;
        else other = between.detail.splats;
    }
    return best;
}

Result<Tuned> tuneTime(const Search& search, double seconds)
{
    const TuneGoal& goal = search.goal;
    Result<TimeFront> front = measureTimeFront(search.meter, search.asset, seconds, goal.scales, search.says);
    if (!front) return front.error();
    for (TimedVariant& p : front->points) p.time = search.there(p.time);
    const TimedVariant full = front->points[0];
    const auto within = [&](const TimedVariant& p) { return goal.mostMilliseconds > 0 ? p.time.ms <= goal.mostMilliseconds : p.psnrMasked >= goal.leastPsnr; };
    const auto better = [&](const TimedVariant& a, const TimedVariant& b) { return goal.mostMilliseconds > 0 ? a.psnrMasked > b.psnrMasked : a.time.ms < b.time.ms; };
    const TimedVariant *best = nullptr, *nearest = &full;
    for (const TimedVariant& p : front->points) {
        if (within(p) && (!best || better(p, *best))) best = &p;
        if (goal.mostMilliseconds > 0 ? p.time.ms < nearest->time.ms : p.psnrMasked > nearest->psnrMasked) nearest = &p;
    }
    if (!best)
        return goal.mostMilliseconds > 0 ? unreachable("--max-ms " + text(goal.mostMilliseconds), "the fastest that was measured (" + variantText(nearest->variant) + ") takes " + text(nearest->time.ms) + " ms", goal.scales ? "bake with fewer splats" : "ask for no less, or try --allow-scale")
                                         : unreachable("--min-psnr " + text(goal.leastPsnr), "the best that was measured (" + variantText(nearest->variant) + ") has " + text(nearest->psnrMasked) + " dB", "ask for no more, or bake longer");
    Result<TimedVariant> refined = refine(search, *best, goal.mostMilliseconds == 0, within);
    if (!refined) return refined.error();
    return Tuned{refined->variant, variantText(refined->variant), refined->psnrMasked, full.psnrMasked, refined->time, full.time, {}};
}

Result<Tuned> tuneBytes(const Search& search, const OlatSplit* seen, size_t givenBytes)
{
    const TuneGoal& goal = search.goal;
    Result<std::vector<SizedVariant>> points = measureBytesFront(search.meter, search.asset, seen, givenBytes, search.says);
    if (!points) return points.error();
    const auto within = [&](const SizedVariant& p) { return goal.mostBytes > 0 ? p.bytes <= goal.mostBytes : p.psnrMasked >= goal.leastPsnr; };
    const auto better = [&](const SizedVariant& a, const SizedVariant& b) { return goal.mostBytes > 0 ? a.psnrMasked > b.psnrMasked : a.bytes < b.bytes; };
    const SizedVariant *best = nullptr, *nearest = &points->front();
    double full = 0;
    for (const SizedVariant& p : *points) {
        if (std::isnan(p.rate)) full = p.psnrMasked;
        if (within(p) && (!best || better(p, *best))) best = &p;
        if (goal.mostBytes > 0 ? p.bytes < nearest->bytes : p.psnrMasked > nearest->psnrMasked) nearest = &p;
    }
    if (!best)
        return goal.mostBytes > 0 ? unreachable("--max-bytes " + std::to_string(goal.mostBytes), "the smallest that was made (" + sizedText(*nearest) + ") has " + std::to_string(nearest->bytes) + " bytes", "ask for no less, or bake with fewer splats")
                                  : unreachable("--min-psnr " + text(goal.leastPsnr), "the best that was measured (" + sizedText(*nearest) + ") has " + text(nearest->psnrMasked) + " dB", "ask for no more, or bake longer");
    // Between the rates that the front was measured at.
    std::vector<SizedVariant> candidates;
    if (!std::isnan(best->rate)) {
        const Detail detail[] = {best->variant.detail};
        const double finer = goal.mostBytes > 0 ? -1 : 1;
        std::vector<double> rates;
        for (int i = 1; i <= 7; ++i) rates.push_back(best->rate + finer * 0.3 * i);
        Result<std::vector<PackedVersion>> versions = packVersions(search.asset, seen, detail, rates, search.says);
        if (!versions) return versions.error();
        for (PackedVersion& v : *versions) {
            const Result<double> psnr = search.meter.psnrMasked(v.asset);
            if (!psnr) return psnr.error();
            candidates.push_back({{v.detail}, v.rate, v.file.size(), *psnr, false, std::move(v.file)});
            v.asset = {};
        }
    }
    std::move(points->begin(), points->end(), std::back_inserter(candidates));
    // Readers draw maps anew from what is left, so the files have the last word.
    std::erase_if(candidates, [&](const SizedVariant& p) { return !within(p); });
    std::sort(candidates.begin(), candidates.end(), better);
    constexpr size_t kMostTries = 8;
    double reached = 0;
    for (size_t i = 0; i < candidates.size(); ++i) {
        SizedVariant& p = candidates[i];
        const bool given = std::isnan(p.rate);
        if (i >= kMostTries && !given) continue;
        if (!given) {
            if (!search.says("loading the file of " + std::to_string(p.bytes) + " bytes")) return Error{ErrorCode::kCancelled, "stopped"};
            const Result<double> psnr = search.meter.psnrMaskedOfFile(p.file);
            if (!psnr) return psnr.error();
            p.psnrMasked = *psnr, reached = std::max(reached, *psnr);
        }
        if (within(p)) return Tuned{p.variant, sizedText(p), p.psnrMasked, full, {}, {}, std::move(p.file)};
    }
    return unreachable("--min-psnr " + text(goal.leastPsnr), "the best file that was made has " + text(reached) + " dB", "ask for no more, or give the asset itself, of profile lossless");
}

} // namespace

Result<Tuned> tune(VariantMeter& meter, const SplatAsset& asset, const OlatSplit* seen, size_t givenBytes, const TuneGoal& goal, double seconds, const Says& says)
{
    const Search search{meter, asset, goal, says};
    return goal.mostMilliseconds > 0 || (goal.leastPsnr > 0 && goal.fastest) ? tuneTime(search, seconds) : tuneBytes(search, seen, givenBytes);
}

} // namespace nacre::report
