#include "train/trainer.h"

#include "splats/morton.h"

#include <algorithm>
#include <cmath>

namespace nacre {

constexpr float kFirstAmbient = 0.01f; // a radiance
constexpr float kDeadOpacity = 0.01f;
constexpr double kMostOutside = 0.1;   // of all splats, around the object's region

Trainer::Trainer(const TrainerOptions& options, std::unique_ptr<TrainableAppearance> appearance, const MakeStepEngine& makeEngine)
    : options_(options), makeEngine_(makeEngine), state_(std::make_unique<SplatState>())
{
    state_->appearance = std::move(appearance);
    startEngine();
}

bool Trainer::prepareStep(double progress, const std::function<bool()>& goOn)
{
    const HostGeometry geometry = [&] {
        engine_->toHost();
        return std::span<const GaussianGeometry<float>>(state_->geometry.activated);
    };
    return state_->appearance->prepareStep(progress, geometry, goOn);
}

void Trainer::useEvidence(double progress, std::span<const ViewEvidence> views)
{
    engine_->toHost();
    state_->appearance->useEvidence(progress, state_->geometry.activated, views);
    engine_->changed();
}

void Trainer::leaveOut(const std::string& part, std::span<const uint8_t> kept)
{
    engine_->toHost();
    state_->appearance->leaveOut(part, kept);
    engine_->changed();
}

void Trainer::finishInitialize()
{
    resizeAmbient(count());
    resetStatistics();
}

void Trainer::initialize(std::span<const OrientedPoint> points, float spacing, bool flat, float opacity)
{
    engine_->toHost();
    geometry().resize(points.size());
    for (size_t i = 0; i < points.size(); ++i) {
        const float* n = points[i].normal;
        GeometryRow& r = geometry().raw[i];
        for (int k = 0; k < 3; ++k) r[k] = points[i].position[k], r[3 + k] = std::log(0.6f * spacing);
        if (flat) r[5] = std::log(0.2f * spacing);
        // Shortest rotation of +Z onto the normal.
        r[6] = 1 + n[2], r[7] = -n[1], r[8] = n[0], r[9] = 0;
        if (n[2] < -0.9999f) r[6] = 0, r[7] = 1, r[8] = 0;
        r[10] = logit(opacity);
        geometry().activate(i);
    }
    state_->appearance->resize(points.size());
    finishInitialize();
}

void Trainer::initialize(const SplatCloud& cloud, std::span<const glm::vec3> tints)
{
    engine_->toHost();
    geometry().resize(cloud.count);
    for (size_t i = 0; i < cloud.count; ++i) {
        GeometryRow& r = geometry().raw[i];
        const glm::quat& q = cloud.rotations[i];
        for (int k = 0; k < 3; ++k) r[k] = cloud.positions[i][k], r[3 + k] = std::log(cloud.scales[i][k]);
        r[6] = q.w, r[7] = q.x, r[8] = q.y, r[9] = q.z;
        r[10] = logit(cloud.opacities[i]); // of 0 and 1 infinite, which is then kept within bounds
        geometry().activate(i);
    }
    state_->appearance->resize(cloud.count);
    for (size_t i = 0; i < cloud.count; ++i) state_->appearance->tint(i, tints[i]);
    finishInitialize();
}

void Trainer::resizeAmbient(size_t count)
{
    const float start = std::log(kFirstAmbient);
    if (options_.ambient) state_->ambient.resize(count, {{start, start, start}, {}, {}});
}

void Trainer::resetStatistics()
{
    engine_->toHost();
    state_->gradientSum.assign(count(), 0.0f);
    state_->seen.assign(count(), 0);
    engine_->changed();
}

// Cuts the parent in two along its longest axis. Second moments are kept; the opacity makes the pair as opaque at the old centre as the
// parent was there.
void Trainer::splitSplat(size_t parent, size_t child)
{
    GeometryRow& p = geometry().raw[parent];
    const int axis = int(std::max_element(&p[3], &p[6]) - &p[3]);
    const float sigma = std::exp(p[3 + axis]);
    float rotation[9];
    detail::rotationMatrix(&p[6], rotation);
    constexpr float kShift = 0.6f; // in standard deviations; (1 - kShift^2) is the variance that is left
    p[3 + axis] += 0.5f * std::log(1 - kShift * kShift);
    const float opacity = geometry().activated[parent].opacity, atCentre = std::exp(-0.5f * kShift * kShift / (1 - kShift * kShift));
    p[10] = logit(std::clamp((1 - std::sqrt(1 - opacity)) / atCentre, 0.005f, 0.99f));
    geometry().raw[child] = p;
    for (int k = 0; k < 3; ++k) {
        const float shift = kShift * sigma * rotation[3 * k + axis];
        geometry().raw[parent][k] += shift, geometry().raw[child][k] -= shift;
    }
    for (size_t i : {parent, child}) geometry().clearMoments(i), geometry().activate(i);
    state_->appearance->copySplat(parent, child);
    if (!state_->ambient.empty()) state_->ambient[child] = {state_->ambient[parent].value, {}, {}};
}

void Trainer::densify(size_t grow)
{
    engine_->toHost();
    const size_t old = geometry().count();
    grow = std::min(grow, options_.maxSplats - std::min(options_.maxSplats, old));
    std::vector<uint32_t> children, alive; // children: rows to fill, first those of the dead, then new ones
    for (size_t i = 0; i < old; ++i)
        (geometry().activated[i].opacity < kDeadOpacity || state_->seen[i] == 0 ? children : alive).push_back(uint32_t(i));
    const auto score = [&](uint32_t i) { return state_->gradientSum[i] / float(std::max(1u, state_->seen[i])); };
    const auto needsMore = [&](uint32_t a, uint32_t b) { return std::pair(-score(a), a) < std::pair(-score(b), b); };
    if (options_.region) { // the surroundings have to be behind the object, not sharp
        const auto first = std::stable_partition(alive.begin(), alive.end(), [&](uint32_t i) { return options_.region->holds(geometry().activated[i].position); });
        const size_t outside = size_t(alive.end() - first), most = size_t(kMostOutside * double(options_.maxSplats));
        std::sort(first, alive.end(), needsMore);
        alive.resize(alive.size() - outside + std::min(outside, most - std::min(outside, most)));
    }
    const size_t dead = children.size(), splits = std::min(dead + grow, alive.size() / 2);
    for (size_t i = old; children.size() < splits; ++i) children.push_back(uint32_t(i));
    std::partial_sort(alive.begin(), alive.begin() + splits, alive.end(), needsMore);
    const size_t count = old + splits - std::min(splits, dead);
    geometry().resize(count);
    state_->appearance->resize(count);
    resizeAmbient(count);
    for (size_t i = 0; i < splits; ++i) splitSplat(alive[i], children[i]);

    permute(mortonOrder(count, [&](size_t i) { return geometry().raw[i].data(); }));
    resetStatistics();
}

void Trainer::permute(const std::vector<uint32_t>& order)
{
    geometry().permute(order);
    state_->appearance->permute(order);
    if (state_->ambient.empty()) return;
    std::vector<AmbientRow> moved;
    for (uint32_t i : order) moved.push_back(state_->ambient[i]);
    state_->ambient = std::move(moved);
}

void Trainer::startEngine()
{
    engine_.reset(); // first: on a device there may be no room for two
    engine_ = makeEngine_(*state_, {options_.lowPassVariance, options_.sceneSize, options_.loss, options_.seed});
}

void Trainer::weighAlpha(float weight)
{
    engine_->toHost();
    options_.loss.alphaWeight = weight;
    startEngine();
}

size_t Trainer::prune()
{
    engine_->toHost();
    std::vector<uint32_t> kept, dropped;
    for (size_t i = 0; i < count(); ++i) (state_->seen[i] > 0 && geometry().activated[i].opacity >= kMinAlpha ? kept : dropped).push_back(uint32_t(i));
    keepRows(kept, dropped);
    return dropped.size();
}

void Trainer::keepRows(const std::vector<uint32_t>& kept, const std::vector<uint32_t>& dropped)
{
    std::vector<uint32_t> order = kept;
    order.insert(order.end(), dropped.begin(), dropped.end());
    permute(order);
    geometry().resize(kept.size());
    state_->appearance->resize(kept.size());
    resizeAmbient(kept.size());
    resetStatistics();
}

ObjectCut Trainer::keepObject(const ObjectRegion& region, const std::vector<Camera>& cameras)
{
    engine_->toHost();
    ObjectCut cut = findObject(cloud(), region, cameras);
    std::vector<uint32_t> kept, dropped;
    for (size_t i = 0; i < count(); ++i) (cut.kept[i] ? kept : dropped).push_back(uint32_t(i));
    keepRows(kept, dropped);
    return cut;
}

SplatCloud Trainer::cloud() const
{
    SplatCloud cloud;
    cloud.count = count();
    for (const GaussianGeometry<float>& g : state_->geometry.activated) {
        float q[4];
        detail::normalizeQuaternion(g.rotation, q);
        cloud.positions.emplace_back(g.position[0], g.position[1], g.position[2]);
        cloud.rotations.emplace_back(q[0], q[1], q[2], q[3]);
        cloud.scales.emplace_back(g.scale[0], g.scale[1], g.scale[2]);
        cloud.opacities.push_back(g.opacity);
    }
    return cloud;
}

void Trainer::exportTo(SplatAsset& asset) const
{
    engine_->toHost();
    asset.cloud = cloud();
    asset.lowPassVariance = options_.lowPassVariance;
    asset.channels = state_->appearance->exportChannels();
}

void Trainer::save(ByteWriter& out) const
{
    engine_->toHost();
    const SplatGeometry& geometry = state_->geometry;
    out.array(geometry.raw), out.array(geometry.momentum), out.array(geometry.second);
    out.array(state_->gradientSum), out.array(state_->seen), out.array(state_->ambient);
    state_->appearance->save(out);
}

bool Trainer::load(ByteReader& in)
{
    SplatGeometry& geometry = state_->geometry;
    in.array(geometry.raw), in.array(geometry.momentum), in.array(geometry.second);
    in.array(state_->gradientSum), in.array(state_->seen), in.array(state_->ambient);
    const size_t n = geometry.raw.size();
    if (in.failed || geometry.momentum.size() != n || geometry.second.size() != n || state_->gradientSum.size() != n || state_->seen.size() != n ||
        state_->ambient.size() != (options_.ambient ? n : 0))
        return false;
    geometry.activated.resize(n);
    for (size_t i = 0; i < n; ++i) geometry.activate(i);
    if (!state_->appearance->load(in) || state_->appearance->count() != n) return false;
    engine_->changed();
    return true;
}

std::vector<std::byte> Trainer::snapshot() const
{
    ByteWriter out;
    save(out);
    return std::move(out.bytes);
}

Status Trainer::restore(std::span<const std::byte> snapshot)
{
    ByteReader in(snapshot);
    if (!load(in)) return Error{ErrorCode::kIo, "a trial could not be undone: the trainer refuses its own state; please report this"};
    return ok();
}

} // namespace nacre
