// Layout: "NCKP", version u32, identity, skipped images, BakeState, trainer state, FNV-1a of all before it.
#include "train/checkpoint.h"

#include "base/hash.h"
#include "dataset/packed_images.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace nacre {

namespace {

constexpr uint32_t kMagic = 0x504b434e, kVersion = 14;

Error bad(const std::string& what) { return {ErrorCode::kBadInput, what + "; start again with --restart"}; }

uint64_t hashOf(const OlatDataset& dataset, const OlatSplit& split)
{
    uint64_t hash = fnv1a(dataset.convention.data(), dataset.convention.size() + 1, kFnvOffset);
    const auto add = [&](const auto&... x) { ((hash = fnv1a(&x, sizeof x, hash)), ...); };
    for (const Camera& c : split.cameras) add(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.worldFromCamera);
    for (const OlatImage& image : split.images) {
        const Light& l = image.light;
        add(image.camera, l.type, l.position, l.directionToLight, l.intensity, l.radius, developmentOf(dataset, split, image));
    }
    if (dataset.backgroundInView || dataset.rig != LightRig::kFixed) add(dataset.backgroundInView, dataset.rig);
    return hash;
}

/// The file without its checksum, behind magic number and version.
Result<ByteReader> open(std::span<const std::byte> bytes)
{
    if (bytes.size() < sizeof(uint64_t)) return bad("not a checkpoint (too short)");
    const std::span<const std::byte> body = bytes.first(bytes.size() - sizeof(uint64_t));
    ByteReader tail(bytes.subspan(body.size())), in(body);
    if (in.value<uint32_t>() != kMagic || in.value<uint32_t>() != kVersion) return bad("not a checkpoint of this version");
    if (tail.value<uint64_t>() != fnv1a(body.data(), body.size())) return bad("damaged checkpoint (its checksum differs)");
    return in;
}

} // namespace

std::string bakeIdentity(const OlatDataset& dataset, const OlatSplit& split, const BakeOptions& options)
{
    std::ostringstream text;
    text.precision(17);
    text << "--model " << options.model << "\n--quality " << options.quality << "\n--iterations " << options.iterations << "\n--minutes "
         << options.minutes << "\n--seed " << options.seed << "\n--max-splats " << options.maxSplats << (options.splatsByPixels ? " at most" : "") << "\n--s-functions "
         << options.sFunctions << "\n--dssim " << options.dssim << "\n--refine-lights " << (options.refineLights ? "on" : "off")
         << "\n--without ";
    for (const std::string& part : options.without) text << part << ',';
    if (options.bounds) text << "\n--bounds " << options.bounds->x << ',' << options.bounds->y << ',' << options.bounds->z << ',' << options.bounds->w;
    if (options.init) text << "\n--init of hash " << std::hex << options.init->hash;
    text << "\n--keep-background " << (options.keepBackground ? "on" : "off");
    text << "\ndataset " << std::hex << hashOf(dataset, split) << '\n';
    return text.str();
}

std::string identityDifference(const std::string& theirs, const std::string& ours)
{
    std::istringstream a(theirs), b(ours);
    std::string was, is;
    while (std::getline(a, was) && std::getline(b, is))
        if (was != is) return was.rfind("--", 0) == 0 ? "it has " + was + ", this one " + is : "its images, cameras or lights differ";
    return "its options differ";
}

std::vector<std::byte> encodeCheckpoint(const std::string& identity, const std::vector<UnusableImage>& skipped, const BakeState& state,
                                        const Trainer& trainer)
{
    ByteWriter out;
    out.value(kMagic), out.value(kVersion), out.array(identity);
    out.value(uint64_t(skipped.size()));
    for (const UnusableImage& image : skipped) out.array(image.path), out.array(image.why);
    out.value(state.gain), out.value(state.step), out.value(state.stepsSinceReset), out.value(state.seconds), out.value(state.nextTrack);
    out.array(state.history), out.array(state.lights), out.array(state.parts);
    out.value(state.masksTried), out.value(state.masks != nullptr);
    if (state.masks) state.masks->save(out);
    trainer.save(out);
    out.value(fnv1a(out.bytes.data(), out.bytes.size()));
    return std::move(out.bytes);
}

static std::vector<UnusableImage> readSkipped(ByteReader& in)
{
    std::vector<UnusableImage> skipped;
    for (uint64_t left = in.value<uint64_t>(); left > 0 && !in.failed; --left) {
        UnusableImage& image = skipped.emplace_back();
        in.array(image.path), in.array(image.why);
    }
    return skipped;
}

/// What is there before the state.
static Result<std::pair<std::vector<UnusableImage>, double>> readStart(std::span<const std::byte> checkpoint)
{
    auto in = open(checkpoint);
    if (!in) return in.error();
    std::string identity;
    in->array(identity);
    auto skipped = readSkipped(*in);
    const auto gain = in->value<double>();
    if (in->failed || !(gain > 0 && std::isfinite(gain))) return bad("checkpoint that ends too soon");
    return std::pair(std::move(skipped), gain);
}

Result<std::vector<UnusableImage>> skippedImages(std::span<const std::byte> checkpoint)
{
    auto start = readStart(checkpoint);
    if (!start) return start.error();
    return std::move(start->first);
}

Result<double> learningGainOf(std::span<const std::byte> checkpoint)
{
    const auto start = readStart(checkpoint);
    if (!start) return start.error();
    return start->second;
}

Result<BakeState> decodeCheckpoint(std::span<const std::byte> bytes, const std::string& identity, size_t cameras, Trainer& trainer)
{
    auto in = open(bytes);
    if (!in) return in.error();
    std::string theirs;
    in->array(theirs);
    if (theirs != identity) return bad("checkpoint of another bake: " + identityDifference(theirs, identity));
    readSkipped(*in);
    BakeState state;
    state.gain = in->value<double>(), state.step = in->value<int32_t>(), state.stepsSinceReset = in->value<int32_t>();
    state.seconds = in->value<double>(), state.nextTrack = in->value<double>();
    in->array(state.history), in->array(state.lights), in->array(state.parts);
    state.masksTried = in->value<bool>();
    if (in->value<bool>()) {
        state.masks = std::make_shared<LearntMasks>(cameras);
        if (!state.masks->load(*in)) return bad("checkpoint whose masks are damaged");
    }
    if (in->failed || !trainer.load(*in) || in->remaining() != 0 || state.step < 0) return bad("checkpoint does not fit this model");
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
