#include "scene.h"

#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/gtc/type_ptr.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <numbers>

namespace viewer {

constexpr float kPi = std::numbers::pi_v<float>;

Subject findSubject(const NacreAssetInfo& info)
{
    Subject s;
    s.boundsMin = glm::make_vec3(info.boundsMin);
    s.boundsMax = glm::make_vec3(info.boundsMax);
    s.center = 0.5f * (s.boundsMin + s.boundsMax);
    // an object rarely reaches into the corners of its box: its longest side says more than the diagonal
    const glm::vec3 size = s.boundsMax - s.boundsMin;
    s.radius = std::max(0.6f * std::max({size.x, size.y, size.z}), 1e-3f);
    const float* q = info.yUpFromAsset;
    s.assetFromYUp = glm::mat3_cast(glm::conjugate(glm::quat(q[3], q[0], q[1], q[2])));
    s.datasetScale = info.datasetScale;
    s.datasetTranslation = glm::make_vec3(info.datasetTranslation);
    s.datasetLightGain = info.datasetLightGain;
    return s;
}

Orbit homeOrbit(const Subject& subject, float aspect)
{
    const float tangent = std::tan(0.5f * glm::radians(kFovYDegrees)) * std::min(aspect, 1.0f);
    Orbit orbit;
    orbit.distance = 1.1f * subject.radius / std::sin(std::atan(tangent));
    return orbit;
}

/// From y-up axes at the object's centre: turned rather than looked-at, so that straight up and down are no special cases.
static glm::mat3 turned(float azimuth, float elevation)
{
    const glm::mat4 turn = glm::rotate(glm::mat4(1), glm::radians(azimuth), glm::vec3(0, 1, 0));
    return glm::mat3(glm::rotate(turn, -glm::radians(elevation), glm::vec3(1, 0, 0)));
}

glm::vec3 directionAt(const Subject& subject, float azimuth, float elevation)
{
    return glm::normalize(subject.assetFromYUp * turned(azimuth, elevation)[2]);
}

NacreDrawDesc drawDesc(const Subject& subject, const Orbit& camera, int width, int height)
{
    NacreDrawDesc desc{};
    desc.structSize = sizeof desc;
    desc.viewportWidth = width, desc.viewportHeight = height;
    const glm::mat3 axes = subject.assetFromYUp * turned(camera.azimuth, camera.elevation);
    glm::mat4 worldFromView(axes);
    worldFromView[3] = glm::vec4(subject.center + camera.distance * axes[2], 1);
    const glm::mat4 viewFromWorld = glm::inverse(worldFromView),
        clipFromView = glm::infinitePerspective(glm::radians(kFovYDegrees), float(width) / float(height), 0.01f * subject.radius);
    std::memcpy(desc.viewFromWorld, glm::value_ptr(viewFromWorld), sizeof desc.viewFromWorld);
    std::memcpy(desc.clipFromView, glm::value_ptr(clipFromView), sizeof desc.clipFromView);
    return desc;
}

std::vector<Lamp> defaultLamps(const Orbit& camera)
{
    const float d = 1.5f * camera.distance;
    return {
        {.azimuth = camera.azimuth - 40, .elevation = 40, .distance = d, .intensity = 0.7f * kPi * d * d},
        {.type = NACRE_LIGHT_DIRECTIONAL, .headlight = true, .azimuth = 35, .distance = d, .intensity = 0.15f * kPi},
    };
}

NacreLight toNacre(const Lamp& lamp, const Orbit& camera, const Subject& subject)
{
    const float azimuth = lamp.azimuth + (lamp.headlight ? camera.azimuth : 0), elevation = lamp.elevation + (lamp.headlight ? camera.elevation : 0);
    const glm::vec3 towards = directionAt(subject, azimuth, elevation), intensity = lamp.intensity * lamp.color;
    const glm::vec3 position = subject.center + lamp.distance * towards;
    NacreLight light{};
    light.structSize = sizeof light, light.type = lamp.type;
    std::memcpy(light.position, glm::value_ptr(position), sizeof light.position);
    std::memcpy(light.direction, glm::value_ptr(towards), sizeof light.direction);
    std::memcpy(light.intensity, glm::value_ptr(intensity), sizeof light.intensity);
    return light;
}

const EditTargetInfo kEditTargetInfos[kEditTargets] = { // in the order of NacreEditTarget
    {"basecolor", "base colour", true, 1}, {"roughness", "roughness", false, 1}, {"metalness", "metalness", false, 1},
    {"subsurface", "subsurface", false, 1}, {"residual", "residual tint", true, 1e4f}, {"opacity", "opacity", false, 1},
};

/// "1,2,3" -> numbers; false for anything that is not finite numbers between commas.
static bool parseNumbers(const std::string& text, std::vector<float>* out)
{
    for (const char* at = text.c_str();;) {
        char* end = nullptr;
        out->push_back(std::strtof(at, &end));
        if (end == at || !std::isfinite(out->back()) || (*end != '\0' && *end != ',')) return false;
        if (*end == '\0') return true;
        at = end + 1;
    }
}

static bool parseRegion(const std::string& text, NacreEdit* edit)
{
    const size_t colon = text.find(':');
    std::vector<float> n;
    if (colon == std::string::npos || !parseNumbers(text.substr(colon + 1), &n)) return false;
    const std::string kind = text.substr(0, colon);
    const bool sphere = kind == "sphere" && n.size() == 4 && n[3] >= 0;
    if (!sphere && !(kind == "box" && n.size() == 6)) return false;
    edit->region = sphere ? NACRE_REGION_SPHERE : NACRE_REGION_BOX;
    std::copy_n(n.begin(), 3, edit->low);
    std::copy(n.begin() + 3, n.end(), edit->high);
    return true;
}

bool parseEdit(const std::string& text, NacreEdit* edit)
{
    *edit = {};
    const size_t equals = text.find('='), at = text.find('@');
    if (equals == std::string::npos || (at != std::string::npos && (at < equals || !parseRegion(text.substr(at + 1), edit)))) return false;
    std::string name = text.substr(0, equals), value = text.substr(equals + 1, at == std::string::npos ? at : at - equals - 1);
    if (name == "tint") name = "residual";
    const auto info = std::find_if(std::begin(kEditTargetInfos), std::end(kEditTargetInfos), [&](const auto& t) { return name == t.name; });
    if (info == std::end(kEditTargetInfos)) return false;
    edit->target = NacreEditTarget(info - kEditTargetInfos);
    edit->operation = value.starts_with('x') ? NACRE_EDIT_MULTIPLY : NACRE_EDIT_SET;
    if (edit->operation == NACRE_EDIT_MULTIPLY) value.erase(0, 1);
    std::vector<float> numbers;
    if (!parseNumbers(value, &numbers) || (numbers.size() != 1 && !(info->hasColor && numbers.size() == 3))) return false;
    const float most = edit->operation == NACRE_EDIT_MULTIPLY ? 1e4f : info->most;
    if (!std::all_of(numbers.begin(), numbers.end(), [&](float v) { return v >= 0 && v <= most; })) return false;
    numbers.resize(3, numbers[0]);
    std::copy_n(numbers.begin(), 3, edit->value);
    return true;
}

void addEdit(const NacreEdit& edit, std::vector<EditGroup>* groups)
{
    EditGroup group;
    group.region = edit.region;
    const glm::vec3 low = glm::make_vec3(edit.low), high = glm::make_vec3(edit.high);
    if (edit.region == NACRE_REGION_SPHERE) group.center = low, group.halfSize = glm::vec3(high.x);
    if (edit.region == NACRE_REGION_BOX) group.center = 0.5f * (low + high), group.halfSize = 0.5f * (high - low);

    // behind the last edit there is: into the last group only, and only where it says nothing of this target yet
    const EditGroup& last = groups->back();
    const bool sameRegion = last.region == group.region && last.center == group.center && last.halfSize == group.halfSize;
    const bool untouched = std::none_of(std::begin(last.rows), std::end(last.rows), [](const EditRow& row) { return row.on; });
    if (untouched) groups->back() = group;
    else if (!sameRegion || last.rows[edit.target].on) groups->push_back(group);

    const glm::vec3 value = glm::make_vec3(edit.value);
    const float most = std::max({value.x, value.y, value.z});
    EditRow& row = groups->back().rows[edit.target];
    row.on = true;
    row.operation = edit.operation;
    row.amount = kEditTargetInfos[edit.target].hasColor && most <= 1 ? 1 : most; // colours that a picker can show stay whole
    row.color = most > 0 ? value / row.amount : value;
}

std::vector<NacreEdit> toNacre(const std::vector<EditGroup>& groups)
{
    std::vector<NacreEdit> edits;
    for (const EditGroup& group : groups)
        for (int target = 0; target < kEditTargets; ++target) {
            const EditRow& row = group.rows[target];
            if (!row.on) continue;
            NacreEdit edit{NacreEditTarget(target), row.operation, {}, group.region, {}, {}};
            const bool sphere = group.region == NACRE_REGION_SPHERE, everywhere = group.region == NACRE_REGION_EVERYWHERE;
            for (int k = 0; k < 3; ++k) {
                edit.value[k] = row.amount * (kEditTargetInfos[target].hasColor ? row.color[k] : 1);
                edit.low[k] = everywhere ? 0 : sphere ? group.center[k] : group.center[k] - group.halfSize[k];
                edit.high[k] = everywhere ? 0 : sphere ? group.halfSize.x : group.center[k] + group.halfSize[k];
            }
            edits.push_back(edit);
        }
    return edits;
}

static std::string numbers(const float* values, int count)
{
    std::string text;
    for (int k = 0; k < count; ++k) {
        char digits[32];
        std::snprintf(digits, sizeof digits, "%s%.4g", k ? "," : "", double(values[k]));
        text += digits;
    }
    return text;
}

/// "0.5" for three equal values.
static std::string colorNumbers(const float value[3]) { return numbers(value, value[0] == value[1] && value[1] == value[2] ? 1 : 3); }

std::string editText(const NacreEdit& edit)
{
    std::string text = kEditTargetInfos[edit.target].name;
    text += (edit.operation == NACRE_EDIT_MULTIPLY ? "=x" : "=") + colorNumbers(edit.value);
    if (edit.region == NACRE_REGION_SPHERE) text += "@sphere:" + numbers(edit.low, 3) + "," + numbers(edit.high, 1);
    if (edit.region == NACRE_REGION_BOX) text += "@box:" + numbers(edit.low, 3) + "," + numbers(edit.high, 3);
    return text;
}

std::string lightText(const NacreLight& light)
{
    const bool point = light.type == NACRE_LIGHT_POINT;
    return (point ? "point:" : "directional:") + numbers(point ? light.position : light.direction, 3) + ":" + colorNumbers(light.intensity);
}

/// scale * p + translation.
static void moved(float p[3], double scale, const glm::dvec3& translation)
{
    for (int k = 0; k < 3; ++k) p[k] = float(scale * p[k] + translation[k]);
}

static NacreEdit moved(NacreEdit edit, double scale, const glm::dvec3& translation)
{
    if (edit.region != NACRE_REGION_EVERYWHERE) moved(edit.low, scale, translation);
    if (edit.region == NACRE_REGION_BOX) moved(edit.high, scale, translation);
    if (edit.region == NACRE_REGION_SPHERE) edit.high[0] = float(scale * edit.high[0]);
    return edit;
}

NacreLight inDataset(const Subject& subject, NacreLight light)
{
    const bool point = light.type == NACRE_LIGHT_POINT;
    if (point) moved(light.position, subject.datasetScale, subject.datasetTranslation), light.radius = float(subject.datasetScale * light.radius);
    const double gain = (point ? subject.datasetScale * subject.datasetScale : 1.0) / subject.datasetLightGain;
    for (float& i : light.intensity) i = float(i * gain);
    return light;
}

NacreEdit inDataset(const Subject& subject, NacreEdit edit) { return moved(edit, subject.datasetScale, subject.datasetTranslation); }
NacreEdit inAsset(const Subject& subject, NacreEdit edit) { return moved(edit, 1 / subject.datasetScale, -subject.datasetTranslation / subject.datasetScale); }

} // namespace viewer
