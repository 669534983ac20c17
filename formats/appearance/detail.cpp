#include "appearance/detail.h"

#include "appearance/visibility_map.h"
#include "base/limits.h"
#include "base/text.h"
#include "splats/morton.h"
#include "splats/reorder.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace nacre {

namespace {

Error bad(std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; }

/// Nearest of some points: a balanced k-d tree in the order of its points.
class NearestPoint {
public:
    explicit NearestPoint(std::span<const glm::vec3> points) : points_(points), order_(points.size())
    {
        std::iota(order_.begin(), order_.end(), 0u);
        build(0, order_.size(), 0);
    }

    /// distance(index) is at least the one of the point itself.
    template <class Distance>
    uint32_t find(const glm::vec3& p, Distance distance) const
    {
        Best best;
        search(p, 0, order_.size(), 0, distance, best);
        return best.index;
    }

private:
    struct Best {
        float distance = std::numeric_limits<float>::infinity();
        uint32_t index = 0;
        int visits = 4096; // more than any object takes; files can be made to take all points for each
    };

    void build(size_t first, size_t end, int axis)
    {
        if (end - first < 2) return;
        const size_t middle = (first + end) / 2;
        std::nth_element(order_.begin() + ptrdiff_t(first), order_.begin() + ptrdiff_t(middle), order_.begin() + ptrdiff_t(end), [&](uint32_t a, uint32_t b) {
            return std::pair(points_[a][axis], a) < std::pair(points_[b][axis], b); // one order: the same tree on every machine
        });
        build(first, middle, (axis + 1) % 3);
        build(middle + 1, end, (axis + 1) % 3);
    }

    template <class Distance>
    void search(const glm::vec3& p, size_t first, size_t end, int axis, Distance& distance, Best& best) const
    {
        if (first == end || best.visits == 0) return;
        --best.visits;
        const size_t middle = (first + end) / 2;
        const uint32_t index = order_[middle];
        if (const float d = distance(index); d < best.distance || (d == best.distance && index < best.index)) best.distance = d, best.index = index;
        const float across = p[axis] - points_[index][axis];
        const bool low = across < 0;
        search(p, low ? first : middle + 1, low ? middle : end, (axis + 1) % 3, distance, best);
        if (std::abs(across) < best.distance) search(p, low ? middle + 1 : first, low ? end : middle, (axis + 1) % 3, distance, best);
    }

    std::span<const glm::vec3> points_;
    std::vector<uint32_t> order_;
};

/// Begins with where splats face, of models that know; else null.
const Channel* normalsOf(const SplatAsset& asset)
{
    const Channel* normals = asset.find("normal");
    return normals ? normals : asset.find("lobe");
}

/// owner[i]: which of the kept splats, counted among them, stands for splat i: itself, or the nearest that faces the same way.
std::vector<uint32_t> ownersOf(const SplatAsset& asset, std::span<const uint32_t> kept)
{
    std::vector<glm::vec3> centres;
    for (const uint32_t i : kept) centres.push_back(asset.cloud.positions[i]);
    const NearestPoint nearest(centres);
    const Channel* normals = normalsOf(asset);
    const auto normalOf = [normals](size_t i) { return normals ? &normals->values[normals->components * i] : nullptr; };
    std::vector<uint32_t> owner(asset.cloud.count, ~0u);
    for (size_t k = 0; k < kept.size(); ++k) owner[kept[k]] = uint32_t(k);
    for (size_t i = 0; i < owner.size(); ++i) {
        if (owner[i] != ~0u) continue;
        const glm::vec3& p = asset.cloud.positions[i];
        const float* n = normalOf(i);
        owner[i] = nearest.find(p, [&](uint32_t k) {
            const float* m = normalOf(kept[k]);
            const float facing = m ? n[0] * m[0] + n[1] * m[1] + n[2] * m[2] : 1.0f;
            return glm::distance(p, centres[k]) * (2 - std::clamp(facing, -1.0f, 1.0f));
        });
    }
    return owner;
}

/// Channels hold its logarithm; none is so small that a mean over splats would divide by zero.
double importanceOf(const Channel& importance, size_t splat) { return std::exp2(std::clamp(double(importance.values[splat]), -100.0, 100.0)); }

/// Bits of i after the point, in reverse: 1/2, 1/4, 3/4 ... (van der Corput 1935), never 0.
double radicalInverse(uint32_t i)
{
    uint32_t reversed = 0;
    for (int b = 0; b < 32; ++b) reversed |= (i >> b & 1u) << (31 - b);
    return (reversed + 0.5) / 4294967296.0;
}

/// Numbers of which a mean over splats means something: not those of a lobe, whose parts go together, nor levels.
bool canBeAveraged(const Channel& c)
{
    constexpr const char* kLinear[] = {"tDir", "tInd", "rho", "s", "baseColor", "material", "normal", "code"};
    return !c.perAsset && c.leading == 0 && std::any_of(std::begin(kLinear), std::end(kLinear), [&](const char* name) { return c.name == name; });
}

/// Splats that are the only one of their neighbourhood to stay have more to cover than those whose neighbours stay.
float localGrowth(double splatsHere, double splatsOnAverage)
{
    constexpr double kLeast = 0.7, kMost = 1.5; // held-out dB hardly change from here on
    return float(std::clamp(std::pow(splatsHere / splatsOnAverage, 0.25), kLeast, kMost));
}

/// Along the surface only: what grows outwards shows around the object.
void grow(glm::vec3& scale, float by)
{
    const int thinnest = scale.x <= scale.y && scale.x <= scale.z ? 0 : scale.y <= scale.z ? 1 : 2;
    for (int c = 0; c < 3; ++c)
        if (c != thinnest) scale[c] = std::min(scale[c] * by, kLargestNumber);
}

/// The layers behind are gone. Growing further instead would show around the object: at a quarter of bunny_wax 28.6 dB over it and 30.6 dB of the
/// image instead of 28.4 and 32.5.
float thicker(float opacity, double layersInOne) { return float(1 - std::pow(1 - double(opacity), layersInOne)); }

/// Gives the rows of `kept` the mean of those that they stand for.
void averageOver(Channel& c, std::span<const uint32_t> kept, std::span<const uint32_t> owner, std::span<const double> part)
{
    const size_t n = c.components;
    std::vector<double> sums(kept.size() * n);
    for (size_t i = 0; i < owner.size(); ++i)
        for (size_t k = 0; k < n; ++k) sums[owner[i] * n + k] += part[i] * double(c.values[i * n + k]);
    for (size_t r = 0; r < kept.size(); ++r) {
        const double* mean = &sums[r * n];
        double scale = 1;
        if (c.name == "normal") {
            const double length = std::sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]);
            if (length < 0.1) continue; // of a sheet seen from both sides: its own
            scale = 1 / length;
        }
        for (size_t k = 0; k < n; ++k) c.values[kept[r] * n + k] = float(scale * mean[k]);
    }
}

Status keepShare(SplatAsset& asset, double share)
{
    if (share >= 1) return ok();
    const Channel *importance = asset.find("importance"), *growth = asset.find("growth");
    if (!importance || !growth) return bad("the asset has no order of importance, by which splats could be left out; nacre pack makes one");
    const size_t n = asset.cloud.count, count = std::max<size_t>(1, size_t(std::llround(share * double(n))));
    if (count == n) return ok();
    std::vector<uint32_t> kept = orderOfImportance(asset);
    kept.resize(count);
    std::sort(kept.begin(), kept.end()); // as they were, along a curve
    const std::vector<uint32_t> owner = ownersOf(asset, kept);
    std::vector<double> total(count), members(count), part(n);
    for (size_t i = 0; i < n; ++i) total[owner[i]] += importanceOf(*importance, i), ++members[owner[i]];
    for (size_t i = 0; i < n; ++i) part[i] = importanceOf(*importance, i) / total[owner[i]];
    const double each = double(n) / double(count);
    const auto grown = float(std::pow(each, double(growth->values[0])));

    for (Channel& c : asset.channels)
        if (canBeAveraged(c)) averageOver(c, kept, owner, part);
    reorderSplats(asset, kept);
    for (size_t k = 0; k < count; ++k) {
        grow(asset.cloud.scales[k], grown * localGrowth(members[k], each));
        asset.cloud.opacities[k] = thicker(asset.cloud.opacities[k], std::sqrt(each));
    }
    return ok();
}

/// Means of four texels: octahedral maps of even size fold over their borders as their halves do.
void halveVisibility(Channel& maps)
{
    const auto n = size_t(visibilitySize(maps.components)), half = n / 2;
    const size_t splats = maps.bytes.size() / (n * n);
    std::vector<uint8_t> out(splats * half * half);
    for (size_t g = 0; g < splats; ++g)
        for (size_t j = 0; j < half; ++j)
            for (size_t i = 0; i < half; ++i) {
                const uint8_t* from = &maps.bytes[(g * n + 2 * j) * n + 2 * i];
                out[(g * half + j) * half + i] = uint8_t((from[0] + from[1] + from[n] + from[n + 1] + 2) / 4);
            }
    maps.bytes = std::move(out), maps.components = uint32_t(half * half);
}

void leaveOutParts(SplatAsset& asset, uint32_t parts)
{
    const auto erase = [&](std::initializer_list<const char*> names) {
        std::erase_if(asset.channels, [&](const Channel& c) { return std::any_of(names.begin(), names.end(), [&](const char* name) { return c.name == name; }); });
    };
    if (parts & kPartVisibility) erase({"visibility", "shadow"}), asset.drawnVisibility = 0;
    if (parts & kPartLobe) erase({"lobe"});
    if (parts & kPartForward) erase({"forward"});
    if (parts & kPartScatter) erase({"s"});
    if (parts & kPartNetwork) erase({"network", "code", "codeWeights"});
    for (Channel& c : asset.channels)
        if (parts & kPartIndirect && c.name == "tInd") std::fill(c.values.begin(), c.values.end(), 0.0f);
}

/// Renderers leave out functions that are zero of all splats.
void limitFunctions(SplatAsset& asset, uint32_t functions)
{
    constexpr size_t kFunctions = 25;
    for (Channel& c : asset.channels) {
        if (c.name != "tDir" && c.name != "tInd") continue;
        const size_t each = c.components / kFunctions;
        for (size_t k = 0; k < c.values.size(); ++k)
            if (k % c.components >= functions * each) c.values[k] = 0;
    }
}

} // namespace

std::vector<uint32_t> orderOfImportance(const SplatAsset& asset)
{
    constexpr double kOdds = 0.3; // power of the importance: 0.5 keeps less of what is rarely seen, 0.2 more of what shows little
    const size_t n = asset.cloud.count;
    const Channel& importance = *asset.find("importance");
    const std::vector<uint32_t> curve = mortonOrder(n, [&](size_t i) { return &asset.cloud.positions[i].x; });
    std::vector<double> keys(n);
    for (size_t r = 0; r < n; ++r) keys[curve[r]] = std::log(radicalInverse(uint32_t(r))) / std::pow(importanceOf(importance, curve[r]), kOdds);
    std::vector<uint32_t> order(n);
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return keys[a] > keys[b]; });
    return order;
}

Status checkDetail(const Detail& detail)
{
    if (!(detail.splats > 0 && detail.splats <= 1)) return bad("the share of splats must be above 0 and at most 1, found " + std::to_string(detail.splats));
    if (detail.leaveOut & ~kAllDetailParts) return bad("parts to leave out have unknown bits: " + std::to_string(detail.leaveOut));
    const uint32_t f = detail.transportFunctions;
    if (f != 0 && f != 1 && f != 4 && f != 9 && f != 16 && f != 25) return bad("transport functions must be 1, 4, 9, 16 or 25 (0: all), found " + std::to_string(f));
    const uint32_t v = detail.visibilitySize;
    if (v != 0 && v != 16 && v != 32) return bad("the size of visibility maps must be 16 or 32 (0: as they are), found " + std::to_string(v));
    return ok();
}

Status reduceDetail(SplatAsset& asset, const Detail& detail)
{
    if (Status s = checkDetail(detail); !s) return s;
    if (Status s = keepShare(asset, double(detail.splats)); !s) return s; // first, while it is known where splats face
    leaveOutParts(asset, detail.leaveOut);
    if (detail.transportFunctions > 0) limitFunctions(asset, detail.transportFunctions);
    if (detail.visibilitySize == 16) {
        asset.drawnVisibility = std::min(asset.drawnVisibility, 16);
        for (Channel& c : asset.channels)
            if (c.name == "visibility" && c.components == 1024) halveVisibility(c);
    }
    return ok();
}

std::string detailText(const Detail& detail)
{
    std::string text;
    const auto add = [&](const std::string& part, const char* unit) {
        if (!text.empty()) text += ", ";
        text += part;
        text += unit;
    };
    const float percent = 100 * detail.splats;
    if (percent < 99.9f) add(numberText(percent < 10 ? std::round(10 * percent) / 10 : std::round(percent)), " % of the splats");
    for (const DetailPartName& p : kDetailParts)
        if (detail.leaveOut & p.part) add("no ", p.name);
    if (detail.transportFunctions > 0 && detail.transportFunctions < 25) add(std::to_string(detail.transportFunctions), " transport functions");
    if (detail.visibilitySize == 16) add("visibility maps of 16 x 16", "");
    return text.empty() ? "everything" : text;
}

} // namespace nacre
