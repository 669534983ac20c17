#include "train/choose_model.h"

#include "appearance/model_table.h"
#include "base/byte_stream.h"
#include "base/hash.h"
#include "train/checkpoint.h"
#include "train/held_out.h"

#include <algorithm>
#include <limits>

namespace nacre {

// Models learn at different speeds: sss is 4 dB behind bigs after 8 % of a bake at whose end it leads by 1 dB. So a trial is a small bake that
// goes further: with fewer splats and pixels the models stand after 3200 steps as they do after 10000 of the bake proper (sss less bigs,
// masked: knob_marble 1.0 and 1.2 dB, bunny_wax -0.1 and 0.2), at a fifth of the time a step.
constexpr double kTrialShare = 0.06, kTrialSteps = 0.3; // of the bake's time or steps, for each model: as far as the bake proper will come
constexpr int kSmaller = 4;           // splats
constexpr int kLeastPixels = 100;     // no image is halved to less
constexpr int kLeastTrialSteps = 300; // less says nothing
constexpr uint32_t kJudgeEvery = 8;   // cameras

static OlatDataset withJudges(OlatDataset dataset)
{
    std::erase_if(dataset.splits, [](const OlatSplit& s) { return s.name != "train"; });
    return holdOut(std::move(dataset), kJudgeEvery);
}

static OlatDataset withSmallImages(OlatDataset dataset)
{
    int side = std::numeric_limits<int>::max(); // the shortest of any image
    for (const OlatSplit& split : dataset.splits)
        for (const Camera& camera : split.cameras) side = std::min({side, camera.width, camera.height});
    for (; side >= 2 * kLeastPixels; side /= 2) dataset = halved(std::move(dataset));
    return dataset;
}

// Layout: "NTRI", identity, skipped images, trials, FNV-1a of all before it.
constexpr uint32_t kTrialsMagic = 0x4952544e;

std::vector<std::byte> encodeTrials(const std::string& identity, const TrialRecord& record)
{
    ByteWriter out;
    out.value(kTrialsMagic), out.array(identity), out.value(uint64_t(record.skipped.size()));
    for (const UnusableImage& image : record.skipped) out.array(image.path), out.array(image.why);
    out.value(uint64_t(record.trials.size()));
    for (const ModelTrial& t : record.trials) out.array(t.model), out.value(t.psnrMasked);
    out.value(fnv1a(out.bytes.data(), out.bytes.size()));
    return std::move(out.bytes);
}

static Result<TrialRecord> readTrials(std::span<const std::byte> bytes, std::string& identity)
{
    const Error damaged{ErrorCode::kBadInput, "no or damaged record of trials; start again with --restart"};
    if (bytes.size() < sizeof(uint64_t)) return damaged;
    const std::span<const std::byte> body = bytes.first(bytes.size() - sizeof(uint64_t));
    ByteReader tail(bytes.subspan(body.size())), in(body);
    if (in.value<uint32_t>() != kTrialsMagic || tail.value<uint64_t>() != fnv1a(body.data(), body.size())) return damaged;
    TrialRecord record;
    in.array(identity);
    for (uint64_t left = in.value<uint64_t>(); left > 0 && !in.failed; --left) {
        UnusableImage& image = record.skipped.emplace_back();
        in.array(image.path), in.array(image.why);
    }
    for (uint64_t left = in.value<uint64_t>(); left > 0 && !in.failed; --left) {
        ModelTrial& t = record.trials.emplace_back();
        in.array(t.model), t.psnrMasked = in.value<double>();
    }
    if (in.failed || in.remaining() != 0) return damaged;
    return record;
}

Result<TrialRecord> decodeTrials(std::span<const std::byte> bytes)
{
    std::string identity;
    return readTrials(bytes, identity);
}

Status checkTrials(std::span<const std::byte> bytes, const std::string& identity)
{
    std::string theirs;
    if (auto record = readTrials(bytes, theirs); !record) return record.error();
    if (theirs == identity) return ok();
    return Error{ErrorCode::kBadInput, "trials of another bake: " + identityDifference(theirs, identity) + "; start again with --restart"};
}

Result<std::vector<ModelTrial>> tryModels(const OlatDataset& dataset, const BakeOptions& options, std::vector<ModelTrial> trials,
                                          const std::function<Status(const std::vector<ModelTrial>&)>& tried,
                                          const std::function<void(const BakeProgress&)>& progress, const std::atomic<bool>* cancel)
{
    const OlatSplit* train = dataset.find("train");
    if (!train) return Error{ErrorCode::kBadInput, dataset.path + ": no 'train' split (expected transforms_train.json)"};
    const OlatDataset judged = withSmallImages(withJudges(dataset));
    if (judged.find("test")->images.empty())
        return Error{ErrorCode::kBadInput, dataset.path + ": --model auto needs at least " + std::to_string(kJudgeEvery) + " train cameras, to judge by; name a model"};
    for (const AppearanceModel& model : appearanceModels()) {
        if (std::any_of(trials.begin(), trials.end(), [&](const ModelTrial& t) { return t.model == model.name; })) continue;
        BakeOptions trial = options;
        trial.model = model.name;
        trial.checkpointPath.clear();
        trial.resume = false;
        trial.secondsBefore = 0;
        trial.track = BakeOptions::Track::kAtEnd;
        trial.maxSplats = std::max(1, bakeSplats(options) / kSmaller);
        if (trial.iterations > 0 || trial.minutes <= 0)
            trial.iterations = std::max(kLeastTrialSteps, int(kTrialSteps * bakeIterations(options, dataset)));
        else trial.minutes *= kTrialShare;
        auto result = bake(judged, trial, [&](const BakeProgress& p) {
            BakeProgress named = p;
            named.stage = std::string("trial of ") + model.name + ", " + p.stage;
            progress(named);
        }, cancel);
        if (!result) return result.error();
        trials.push_back({model.name, result->history.empty() ? 0.0 : result->history.back().psnrMaskedTest});
        if (Status s = tried(trials); !s) return s.error();
    }
    std::stable_sort(trials.begin(), trials.end(), [](const ModelTrial& a, const ModelTrial& b) { return a.psnrMasked > b.psnrMasked; });
    return trials;
}

BakeOptions restOf(BakeOptions options)
{
    const double share = 1.0 - kTrialShare * double(appearanceModels().size());
    if (options.iterations > 0) options.iterations = std::max(1, int(share * options.iterations));
    else if (options.minutes > 0) options.minutes *= share;
    return options;
}

} // namespace nacre
