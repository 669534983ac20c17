// Layout: "NCKP", version u32, options hash u64, BakeState, trainer state, FNV-1a of all before it.
#include "train/checkpoint.h"

#include "base/hash.h"

#include <algorithm>

namespace nacre {

constexpr uint32_t kMagic = 0x504b434e, kVersion = 8;

uint64_t optionsHash(const OlatDataset& dataset, const OlatSplit& split, const BakeOptions& options)
{
    uint64_t hash = kFnvOffset;
    const auto addText = [&](const std::string& text) { hash = fnv1a(text.data(), text.size() + 1, hash); };
    const auto add = [&](const auto&... x) { ((hash = fnv1a(&x, sizeof x, hash)), ...); };
    addText(dataset.convention), addText(options.model), addText(options.quality);
    add(options.iterations, options.minutes, options.seed, options.maxSplats, options.sFunctions, options.dssim, options.refineLights);
    for (const std::string& part : options.without) addText(part);
    for (const Camera& c : split.cameras) add(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.worldFromCamera);
    for (const OlatImage& image : split.images) {
        const Light& l = image.light;
        add(image.camera, l.type, l.position, l.directionToLight, l.intensity, l.radius);
    }
    return hash;
}

std::vector<std::byte> encodeCheckpoint(uint64_t optionsHash, const BakeState& state, const Trainer& trainer)
{
    ByteWriter out;
    out.value(kMagic), out.value(kVersion), out.value(optionsHash);
    out.value(state.step), out.value(state.stepsSinceReset), out.value(state.seconds), out.value(state.trackSeconds), out.value(state.nextTrack);
    out.array(state.history), out.array(state.lights), out.array(state.parts);
    trainer.save(out);
    out.value(fnv1a(out.bytes.data(), out.bytes.size()));
    return std::move(out.bytes);
}

Result<BakeState> decodeCheckpoint(std::span<const std::byte> bytes, uint64_t optionsHash, Trainer& trainer)
{
    const auto bad = [](const char* what) { return Error{ErrorCode::kBadInput, std::string(what) + "; start again without --resume"}; };
    if (bytes.size() < sizeof(uint64_t)) return bad("not a checkpoint (too short)");
    const std::span<const std::byte> body = bytes.first(bytes.size() - sizeof(uint64_t));
    ByteReader tail(bytes.subspan(body.size())), in(body);
    if (in.value<uint32_t>() != kMagic || in.value<uint32_t>() != kVersion) return bad("not a checkpoint of this version");
    if (tail.value<uint64_t>() != fnv1a(body.data(), body.size())) return bad("damaged checkpoint (its checksum differs)");
    if (in.value<uint64_t>() != optionsHash) return bad("checkpoint of another bake (dataset or options differ)");
    BakeState state;
    state.step = in.value<int32_t>(), state.stepsSinceReset = in.value<int32_t>();
    state.seconds = in.value<double>(), state.trackSeconds = in.value<double>(), state.nextTrack = in.value<double>();
    in.array(state.history), in.array(state.lights), in.array(state.parts);
    if (in.failed || !trainer.load(in) || in.remaining() != 0 || state.step < 0) return bad("checkpoint does not fit this model");
    return state;
}

bool CheckpointPace::due(double seconds, double progress) const
{
    constexpr double kSeconds = 60, kProgress = 0.05; // whichever comes first,
    constexpr double kPause = 100, kLeast = 1;        // but no sooner than this many times what the last one took, or seconds
    const double since = seconds - seconds_;
    return (since > kSeconds || progress - progress_ > kProgress) && since > std::max(kLeast, kPause * took_);
}

void CheckpointPace::written(double began, double ended, double progress)
{
    seconds_ = ended, progress_ = progress, took_ = ended - began;
}

} // namespace nacre
