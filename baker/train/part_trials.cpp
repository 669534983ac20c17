// The same steps are made twice, with a part and without it; the better splats are kept. Both have adapted to what they have by
// then: merely switching a part off says that s is worth as much to marble as to fur (0.6 dB), where it is worth 0 and 0.9 dB.
#include "train/part_trials.h"

#include "train/cluster_choice.h"

#include <algorithm>

namespace nacre {

namespace {

constexpr double kTrialLength = 0.03, kTrialMost = 0.1; // of the bake,
constexpr double kTrialLeast = 150;                     // but at least so many steps, up to kTrialMost

int trialSteps(double stepsOfBake)
{
    return int(std::max(kTrialLength * stepsOfBake, std::min(kTrialLeast, kTrialMost * stepsOfBake))) + 1;
}

/// Steps that are all made at the same moment of the bake.
struct TrialSteps {
    int first, count;
    double progress, rate;
};

/// What a trial found: mean squared error of the object, and how much of the sum each splat answers for (Trainer::step).
struct TrialErrors {
    double mean = 0;
    std::vector<double> ofSplats;
};

// Steps on, and how wrong the splats were on images that they had not been fitted to just now: masked squared error of the second
// half.
Result<TrialErrors> run(const TrialSteps& steps, bool bySplat, const Trainer& trainer, const TrialStep& step)
{
    TrialErrors errors;
    double squared = 0, count = 0;
    if (bySplat) errors.ofSplats.resize(trainer.count());
    for (int i = 0; i < steps.count; ++i) {
        const bool counts = 2 * i >= steps.count;
        auto stats = step({steps.first + i, steps.progress, steps.rate}, counts && bySplat ? errors.ofSplats.data() : nullptr);
        if (!stats) return stats.error();
        if (!counts) continue;
        const bool masked = stats->countMasked > 0;
        squared += masked ? stats->squaredErrorMasked : stats->squaredError, count += masked ? stats->countMasked : stats->count;
    }
    errors.mean = squared / std::max(count, 1.0);
    return errors;
}

/// Which splats keep a part, and what it is worth.
struct Verdict {
    PartWorth worth;
    std::vector<uint8_t> kept; // [splats]
    size_t keeping;            // how many
};

Verdict judge(const OptionalPart& part, const TrialErrors& with, const TrialErrors& without, size_t splats)
{
    Verdict v;
    part.name.copy(v.worth.name, sizeof v.worth.name - 1);
    v.worth.decibel = decibelBetween(without.mean, with.mean);
    if (part.bySplat)
        v.kept = chooseClusters(with.ofSplats, without.ofSplats, part.leastWorth);
    else
        v.kept.assign(splats, v.worth.decibel >= part.leastWorth);
    v.keeping = size_t(std::count(v.kept.begin(), v.kept.end(), 1));
    v.worth.share = double(v.keeping) / double(splats);
    if (v.keeping == 0)
        v.worth.cost = v.worth.decibel;
    else if (v.keeping < splats) {
        double errorWith = 0, errorSplit = 0;
        for (size_t i = 0; i < splats; ++i) errorWith += with.ofSplats[i], errorSplit += (v.kept[i] ? with : without).ofSplats[i];
        v.worth.cost = decibelBetween(errorSplit, errorWith);
    }
    return v;
}

Result<PartWorth> tryWithout(const OptionalPart& part, const TrialSteps& steps, Trainer& trainer, const TrialStep& step)
{
    const std::vector<std::byte> before = trainer.snapshot();
    const auto undone = [&](const Error& error) {
        const Status restored = trainer.restore(before);
        return restored ? error : restored.error();
    };

    auto with = run(steps, part.bySplat, trainer, step);
    if (!with) return undone(with.error());
    const std::vector<std::byte> after = trainer.snapshot();

    if (Status s = trainer.restore(before); !s) return s.error();
    trainer.leaveOut(part.name, {});
    auto without = run(steps, part.bySplat, trainer, step);
    if (!without) return undone(without.error());

    const Verdict verdict = judge(part, *with, *without, trainer.count());
    if (verdict.keeping == 0) return verdict.worth;
    if (Status s = trainer.restore(after); !s) return s.error();
    if (verdict.keeping < trainer.count()) trainer.leaveOut(part.name, verdict.kept);
    return verdict.worth;
}

} // namespace

Status leaveOutParts(Trainer& trainer, const Schedule& schedule, const TrialStep& step, BakeState& state)
{
    for (const OptionalPart& part : trainer.appearance().optionalParts()) {
        const auto isPart = [&](const PartWorth& w) { return w.name == part.name; };
        const double progress = schedule.progress(state.step);
        if (progress < part.judgedAt || std::any_of(state.parts.begin(), state.parts.end(), isPart)) continue;
        const TrialSteps steps{state.step + 1, trialSteps(schedule.expectedSteps(state.step, progress)), progress,
                               schedule.rate(state.step, progress)};
        auto worth = tryWithout(part, steps, trainer, step);
        if (!worth) return worth.error();
        state.parts.push_back(*worth);
        state.step += steps.count, state.stepsSinceReset += steps.count;
    }
    return ok();
}

} // namespace nacre
