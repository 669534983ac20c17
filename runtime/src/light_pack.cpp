// Which points light an instance, and in which slots of its light texture.
#include "light_set.h"

#include "base/hash.h"
#include "base/light.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_map>

namespace nacre {

PackedLight packPoint(const LightPoint& p, const InstancePlace& place)
{
    const glm::dmat3 turn(place.assetFromWorld);
    PackedLight out{};
    if (p.directional) {
        out.row[0] = glm::vec4(glm::vec3(glm::normalize(turn * glm::dvec3(p.direction))), -1.0f);
        out.row[1] = glm::vec4(p.intensity, highlightWidening(p.sourceRadius));
        return out;
    }
    const float cap = std::max(p.capRadius, kMinLightRadius), range = std::max(p.range, kMinLightRadius);
    out.row[0] = glm::vec4(glm::vec3(place.assetFromWorld * glm::dvec4(p.position, 1.0)), cap * cap);
    out.row[1] = glm::vec4(p.intensity, 0.0f);
    if (p.emission != kEmitsAround) out.row[2] = glm::vec4(glm::vec3(glm::normalize(turn * glm::dvec3(p.axis))), p.coneScale);
    out.row[3] = glm::vec4(p.coneOffset, p.range > 0 ? 1.0f / (range * range) : 0.0f, highlightWidening(p.sourceRadius), float(p.emission));
    return out;
}

namespace {

/// sss shades surface points, which lie a little off the centres that the box was made from: part of its diagonal.
constexpr double kBoxMargin = 0.02;
constexpr double kRounding = 1e-5; // rows and shaders are float

struct Candidate {
    PackedLight light;
    uint32_t point = 0;
    LightBounds bounds;
};

/// Whether the point is the right one of those that stand for its area light at this distance.
bool hasRightDistance(const LightPoint& p, const InstancePlace& place)
{
    if (p.nearest == 0 && p.farthest == std::numeric_limits<float>::infinity()) return true;
    const glm::dvec3 at = place.assetFromWorld * glm::dvec4(p.centre, 1.0);
    const double distance = glm::distance(at, glm::clamp(at, glm::dvec3(place.boundsMin), glm::dvec3(place.boundsMax))) * place.worldScale;
    return distance >= p.nearest && distance < p.farthest;
}

/// Least and largest cosine between the axis of a light and the way from it to any place within `radius` of `centre`.
std::pair<double, double> boundCosine(const PackedLight& light, const glm::dvec3& centre, double radius)
{
    const glm::dvec3 way = centre - glm::dvec3(light.row[0]);
    const double distance = glm::length(way);
    if (!(distance > radius * (1 + kRounding))) return {-1.0, 1.0};
    const double angle = std::acos(std::clamp(glm::dot(way, glm::dvec3(light.row[2])) / distance, -1.0, 1.0)), wide = std::asin(radius / distance);
    return {std::cos(std::min(angle + wide, std::numbers::pi)) - kRounding, std::cos(std::max(angle - wide, 0.0)) + kRounding};
}

double emitted(const PackedLight& light, double cosine)
{
    const double shines = std::clamp(light.row[3].x + light.row[2].w * cosine, 0.0, 1.0);
    return light.row[3].w < float(kEmitsCosine) ? shines * shines : shines;
}

double window(const PackedLight& light, double distance2)
{
    const double reach = std::min(distance2 * light.row[3].y, 1.0);
    return 1 - reach * reach;
}

struct SlotHash {
    size_t operator()(const PackedLight& light) const { return size_t(fnv1a(&light, sizeof light)); }
};

/// The slots of `lights` after its candidates have changed: what was there and still is keeps its place.
void assignSlots(const std::vector<Candidate>& candidates, size_t pointCount, InstanceLights* lights)
{
    constexpr uint32_t kNone = ~0u;
    const size_t oldCount = lights->packed.size();
    std::vector<uint32_t> inSlot(oldCount, kNone); // candidates
    std::vector<uint32_t> ofPoint(pointCount, kNone);
    std::vector<bool> placed(candidates.size());
    for (size_t i = 0; i < candidates.size(); ++i) ofPoint[candidates[i].point] = uint32_t(i);
    const auto put = [&](size_t slot, uint32_t candidate) { inSlot[slot] = candidate, placed[candidate] = true; };
    const auto ownOf = [&](size_t slot) { return lights->point[slot] < pointCount ? ofPoint[lights->point[slot]] : kNone; };

    // The same light of the same number.
    for (size_t s = 0; s < oldCount; ++s)
        if (const uint32_t c = ownOf(s); c != kNone && candidates[c].light == lights->packed[s]) put(s, c);
    // The same light of another number: lights before it have come or gone.
    std::unordered_multimap<PackedLight, uint32_t, SlotHash> others;
    for (uint32_t c = 0; c < candidates.size(); ++c)
        if (!placed[c]) others.emplace(candidates[c].light, c);
    for (size_t s = 0; s < oldCount && !others.empty(); ++s)
        if (inSlot[s] == kNone)
            if (const auto found = others.find(lights->packed[s]); found != others.end()) put(s, found->second), others.erase(found);
    // Another light of the same number: it has moved.
    for (size_t s = 0; s < oldCount; ++s)
        if (const uint32_t c = ownOf(s); inSlot[s] == kNone && c != kNone && !placed[c]) put(s, c);
    // New ones: free slots, then further ones.
    size_t free = 0;
    for (uint32_t c = 0; c < candidates.size(); ++c) {
        if (placed[c]) continue;
        while (free < inSlot.size() && inSlot[free] != kNone) ++free;
        if (free == inSlot.size()) inSlot.push_back(kNone);
        put(free, c);
    }
    // Slots that stay free are filled from the end.
    for (size_t s = 0; s < inSlot.size(); ++s) {
        while (!inSlot.empty() && inSlot.back() == kNone) inSlot.pop_back();
        if (s < inSlot.size() && inSlot[s] == kNone) inSlot[s] = inSlot.back(), inSlot.pop_back();
    }

    lights->packed.resize(inSlot.size());
    lights->point.resize(inSlot.size());
    for (size_t s = 0; s < inSlot.size(); ++s) lights->packed[s] = candidates[inSlot[s]].light, lights->point[s] = candidates[inSlot[s]].point;
}

} // namespace

LightBounds boundLight(const PackedLight& light, const InstancePlace& place)
{
    const double intensity = std::max({light.row[1].x, light.row[1].y, light.row[1].z});
    if (light.row[0].w < 0) return {intensity, intensity};
    const glm::dvec3 margin(kBoxMargin * glm::distance(glm::dvec3(place.boundsMin), glm::dvec3(place.boundsMax)));
    const glm::dvec3 low = glm::dvec3(place.boundsMin) - margin, high = glm::dvec3(place.boundsMax) + margin, at(light.row[0]);
    const glm::dvec3 nearest = glm::clamp(at, low, high) - at, farthest = glm::max(glm::abs(low - at), glm::abs(high - at));
    const double scale2 = double(place.worldScale) * place.worldScale;
    const double near2 = glm::dot(nearest, nearest) * scale2 * (1 - kRounding), far2 = glm::dot(farthest, farthest) * scale2 * (1 + kRounding);
    LightBounds bounds{intensity / std::max(far2, double(light.row[0].w)) * window(light, far2),
                       intensity / std::max(near2, double(light.row[0].w)) * window(light, near2)};
    if (light.row[3].w > 0) {
        const auto [least, most] = boundCosine(light, 0.5 * (low + high), 0.5 * glm::distance(low, high));
        bounds.least *= emitted(light, least), bounds.most *= emitted(light, most);
    }
    return bounds;
}

bool packLights(const LightSet& set, const InstancePlace& place, InstanceLights* lights)
{
    if (lights->revision == set.revision() && lights->place == place) return false;
    const std::vector<LightPoint>& points = set.points();
    std::vector<Candidate> candidates;
    double sum = 0;
    size_t concerned = 0;
    for (size_t i = 0; i < points.size(); ++i) {
        if (!hasRightDistance(points[i], place)) continue;
        ++concerned;
        if (!(points[i].mask & place.mask)) continue;
        Candidate c{packPoint(points[i], place), uint32_t(i), {}};
        c.bounds = boundLight(c.light, place);
        if (!points[i].shadowed) sum += c.bounds.least; // of the others it is not known what arrives
        candidates.push_back(c);
    }
    const double faint = sum * std::min(kLeastShareOfOne, kLeastShare / double(std::max<size_t>(candidates.size(), 1)));
    std::erase_if(candidates, [&](const Candidate& c) { return !(c.bounds.most > faint); });

    const std::vector<PackedLight> before = lights->packed;
    assignSlots(candidates, points.size(), lights);
    lights->skipped = concerned - candidates.size();
    lights->revision = set.revision();
    lights->place = place;
    return lights->packed != before;
}

} // namespace nacre
