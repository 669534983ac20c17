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

/// Puts candidates, in the order of their points, into the slots that are open, or further ones: whoever has one like it keeps it, as does
/// the point that was there and has changed. The last slots go where none is left. Returns whether any slot is another one.
bool fillSlots(const std::vector<uint32_t>& open, const std::vector<Candidate>& candidates, bool moved, InstanceLights* lights)
{
    std::vector<bool> filled(open.size()), placed(candidates.size());
    bool differs = false;
    const auto put = [&](size_t k, size_t c) {
        const uint32_t slot = open[k];
        filled[k] = placed[c] = true;
        differs = differs || !(lights->packed[slot] == candidates[c].light);
        lights->packed[slot] = candidates[c].light, lights->point[slot] = candidates[c].point;
    };
    // The same light, perhaps under another number: some before it have come or gone. For an instance that has moved none is the same.
    std::unordered_multimap<PackedLight, size_t, SlotHash> alike;
    for (size_t c = 0; c < candidates.size() && !open.empty() && !moved; ++c) alike.emplace(candidates[c].light, c);
    for (size_t k = 0; k < open.size() && !alike.empty(); ++k)
        if (const auto found = alike.find(lights->packed[open[k]]); found != alike.end()) put(k, found->second), alike.erase(found);
    // Another light under the same number: it has moved.
    for (size_t k = 0; k < open.size(); ++k) {
        const auto own = std::lower_bound(candidates.begin(), candidates.end(), lights->point[open[k]], [](const Candidate& c, uint32_t p) { return c.point < p; });
        if (!filled[k] && own != candidates.end() && own->point == lights->point[open[k]] && !placed[size_t(own - candidates.begin())])
            put(k, size_t(own - candidates.begin()));
    }
    // New ones.
    size_t k = 0;
    for (size_t c = 0; c < candidates.size(); ++c) {
        if (placed[c]) continue;
        while (k < open.size() && filled[k]) ++k;
        if (k < open.size()) {
            put(k, c);
        } else {
            lights->packed.push_back(candidates[c].light), lights->point.push_back(candidates[c].point);
            differs = true;
        }
    }
    // Slots that stay free: `last` is the last of them, since all behind the last slot that is taken go.
    for (size_t first = 0, last = open.size(); first < last;) {
        if (filled[last - 1]) {
            --last;
        } else if (filled[first]) {
            ++first;
        } else {
            const size_t end = lights->packed.size() - 1;
            if (open[last - 1] == end) --last;
            else lights->packed[open[first]] = lights->packed[end], lights->point[open[first]] = lights->point[end], ++first;
            lights->packed.pop_back(), lights->point.pop_back();
            differs = true;
        }
    }
    return differs;
}

LightBounds boundPoint(const LightPoint& p, const InstancePlace& place)
{
    if (!hasRightDistance(p, place)) return {0, -1};
    return p.mask & place.mask ? boundLight(packPoint(p, place), place) : LightBounds{};
}

/// What a light may give at most and be left out.
double faintest(const std::vector<LightPoint>& points, const std::vector<LightBounds>& bounds)
{
    double sum = 0;
    size_t concerned = 0;
    for (size_t i = 0; i < points.size(); ++i) {
        concerned += bounds[i].most >= 0;
        if (!points[i].shadowed) sum += bounds[i].least; // of the others it is not known what arrives
    }
    return sum * std::min(kLeastShareOfOne, kLeastShare / double(std::max<size_t>(concerned, 1)));
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
    const bool moved = !(lights->place == place);
    const auto changed = [&](size_t i) { return moved || set.changedAt()[i] > lights->revision; };
    lights->bounds.resize(points.size());
    for (size_t i = 0; i < points.size(); ++i)
        if (changed(i)) lights->bounds[i] = boundPoint(points[i], place);
    const double faint = faintest(points, lights->bounds);
    const auto matters = [&](size_t i) { return lights->bounds[i].most > faint; };

    std::vector<bool> stays(points.size());
    std::vector<uint32_t> open;
    for (uint32_t s = 0; s < lights->packed.size(); ++s) {
        const uint32_t p = lights->point[s];
        if (p < points.size() && matters(p) && !changed(p)) stays[p] = true;
        else open.push_back(s);
    }
    std::vector<Candidate> candidates;
    for (uint32_t i = 0; i < points.size(); ++i)
        if (matters(i) && !stays[i]) candidates.push_back({packPoint(points[i], place), i});
    const bool differs = fillSlots(open, candidates, moved, lights);
    const auto concerned = std::count_if(lights->bounds.begin(), lights->bounds.end(), [](const LightBounds& b) { return b.most >= 0; });
    lights->skipped = size_t(concerned) - lights->packed.size();
    lights->revision = set.revision();
    lights->place = place;
    return differs;
}

} // namespace nacre
