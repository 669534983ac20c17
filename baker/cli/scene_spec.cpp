#include "scene_spec.h"

#include "number_list.h"

#include <glm/gtc/matrix_transform.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

namespace nacre::cli {

static bool parseNumbers(const std::string& text, std::vector<double>& out)
{
    std::optional<std::vector<double>> read = numbersIn(text);
    if (read) out = std::move(*read);
    return read.has_value();
}

static Error badSpec(const std::string& option, const std::string& text, const std::string& expected)
{
    return {ErrorCode::kBadInput, option + " '" + text + "': expected " + expected};
}

static constexpr const char* kLightForms = "point:X,Y,Z:I, directional:X,Y,Z:E or environment:FILE.exr (I and E: a number or r,g,b, 0 or more)";

Result<Light> parseLight(const std::string& text)
{
    const size_t colon = text.find(':');
    const std::string kind = text.substr(0, colon);
    const std::string rest = colon == std::string::npos ? "" : text.substr(colon + 1);
    Light light;
    if (kind == "spot") return Error{ErrorCode::kUnsupported, "--light '" + text + "': spot lights are not supported yet; use " + kLightForms};
    if (kind == "environment" && !rest.empty()) {
        light.type = LightType::kEnvironment;
        light.environmentPath = rest;
        return light;
    }
    const size_t second = rest.find(':');
    std::vector<double> vector, intensity;
    if ((kind != "point" && kind != "directional") || second == std::string::npos || !parseNumbers(rest.substr(0, second), vector) ||
        vector.size() != 3 || !parseNumbers(rest.substr(second + 1), intensity) || (intensity.size() != 1 && intensity.size() != 3) ||
        *std::min_element(intensity.begin(), intensity.end()) < 0)
        return badSpec("--light", text, kLightForms);
    intensity.resize(3, intensity[0]);
    light.intensity = {intensity[0], intensity[1], intensity[2]};
    const glm::dvec3 v(vector[0], vector[1], vector[2]);
    if (kind == "point") {
        light.position = v;
        return light;
    }
    if (!(glm::length(v) > 0)) return badSpec("--light", text, "a direction to the light that is not zero");
    light.type = LightType::kDirectional;
    light.directionToLight = glm::normalize(v);
    return light;
}

static constexpr struct {
    const char* name;
    EditTarget target;
    float most;
} kEditTargets[] = {
    {"basecolor", EditTarget::kBaseColor, 1},   {"roughness", EditTarget::kRoughness, 1}, {"metalness", EditTarget::kMetalness, 1},
    {"subsurface", EditTarget::kSubsurface, 1}, {"residual", EditTarget::kResidual, 1e4}, {"tint", EditTarget::kResidual, 1e4},
    {"opacity", EditTarget::kOpacity, 1},
};

static bool parseRegion(const std::string& text, SplatEdit& edit)
{
    std::vector<double> n;
    const size_t colon = text.find(':');
    if (colon == std::string::npos || !parseNumbers(text.substr(colon + 1), n)) return false;
    const std::string kind = text.substr(0, colon);
    for (size_t k = 0; k < 3 && n.size() >= 3; ++k) edit.low[k] = float(n[k]);
    if (kind == "sphere" && n.size() == 4 && n[3] >= 0) {
        edit.region = EditRegion::kSphere;
        edit.high[0] = float(n[3]);
        return true;
    }
    if (kind != "box" || n.size() != 6) return false;
    edit.region = EditRegion::kBox;
    for (size_t k = 0; k < 3; ++k) edit.high[k] = float(n[3 + k]);
    return true;
}

Result<SplatEdit> parseEdit(const std::string& text)
{
    const Error bad = badSpec("--edit", text,
                              "TARGET=VALUE or TARGET=xFACTOR with basecolor, roughness, metalness, subsurface, residual (tint) or opacity; values "
                              "a number or r,g,b; then perhaps @sphere:X,Y,Z,R or @box:X,Y,Z,X,Y,Z");
    const size_t equals = text.find('='), at = text.find('@');
    if (equals == std::string::npos) return bad;
    const std::string name = text.substr(0, equals);
    std::string value = text.substr(equals + 1, at == std::string::npos ? std::string::npos : at - equals - 1);
    const auto target = std::find_if(std::begin(kEditTargets), std::end(kEditTargets), [&](const auto& t) { return name == t.name; });
    SplatEdit edit;
    if (!value.empty() && value[0] == 'x') edit.multiply = true, value.erase(0, 1);
    std::vector<double> numbers;
    if (target == std::end(kEditTargets) || !parseNumbers(value, numbers) || (at != std::string::npos && !parseRegion(text.substr(at + 1), edit))) return bad;
    edit.target = target->target;
    const bool color = edit.target == EditTarget::kBaseColor || edit.target == EditTarget::kResidual;
    const double most = edit.multiply ? 1e4 : target->most;
    if (numbers.size() != 1 && !(color && numbers.size() == 3)) return bad;
    numbers.resize(3, numbers[0]);
    for (size_t k = 0; k < 3; ++k) {
        if (!(numbers[k] >= 0 && numbers[k] <= most)) return badSpec("--edit", text, most > 1 ? "numbers from 0 to 10000" : "numbers from 0 to 1");
        edit.value[k] = float(numbers[k]);
    }
    return edit;
}

Result<PixelSize> parseSize(const std::string& text)
{
    PixelSize size;
    int used = 0;
    if (std::sscanf(text.c_str(), "%5dx%5d%n", &size.width, &size.height, &used) != 2 || size_t(used) != text.size() ||
        std::min(size.width, size.height) < 1 || std::max(size.width, size.height) > 8192)
        return badSpec("--size", text, "WIDTHxHEIGHT in pixels, 1 to 8192, e.g. 640x480");
    return size;
}

Result<ImageReference> parseImageReference(const std::string& text)
{
    const size_t second = text.rfind(':'), first = second == std::string::npos || second == 0 ? std::string::npos : text.rfind(':', second - 1);
    const std::string index = second == std::string::npos ? "" : text.substr(second + 1);
    if (first == std::string::npos || first == 0 || second == first + 1 || index.empty() || index.size() > 9 ||
        index.find_first_not_of("0123456789") != std::string::npos)
        return badSpec("--camera", text, "DATASET:SPLIT:INDEX, e.g. data/bunny:test:0");
    return ImageReference{text.substr(0, first), text.substr(first + 1, second - first - 1), size_t(std::stoul(index))};
}

Result<Orbit> parseOrbit(const std::string& text)
{
    std::vector<double> n;
    if (!parseNumbers(text, n) || n.size() < 2 || n.size() > 3 || std::abs(n[1]) > 90 || (n.size() == 3 && !(n[2] > 0)))
        return badSpec("--orbit", text, "AZ,EL or AZ,EL,DIST: azimuth and elevation (-90 to 90) in degrees, distance above 0");
    return Orbit{n[0], n[1], n.size() == 3 ? n[2] : 0.0};
}

static double quantile(std::vector<double> values, double q)
{
    if (values.empty()) return 0;
    const auto at = values.begin() + std::ptrdiff_t(q * double(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

Subject findSubject(const SplatAsset& asset)
{
    // quantiles, so that a few stray splats far away do not move the camera
    Subject subject;
    std::vector<double> values(asset.cloud.count);
    for (int axis = 0; axis < 3; ++axis) {
        for (size_t i = 0; i < values.size(); ++i) values[i] = asset.cloud.positions[i][axis];
        subject.center[axis] = quantile(values, 0.5);
    }
    for (size_t i = 0; i < values.size(); ++i) values[i] = glm::length(glm::dvec3(asset.cloud.positions[i]) - subject.center);
    subject.radius = asset.frame.scale * std::max(quantile(values, 0.98), 1e-6);
    subject.center = asset.frame.positionInDataset(subject.center);
    subject.up = glm::conjugate(glm::dquat(asset.yUpFromAsset)) * glm::dvec3(0, 1, 0);
    return subject;
}

Camera orbitCamera(const Orbit& orbit, const Subject& subject, const glm::quat& yUpFromAsset, double fovYDegrees, PixelSize size)
{
    Camera camera;
    camera.width = size.width;
    camera.height = size.height;
    camera.fx = camera.fy = 0.5 * size.height / std::tan(0.5 * glm::radians(fovYDegrees));
    camera.cx = 0.5 * size.width;
    camera.cy = 0.5 * size.height;

    // turned rather than looked-at, so that straight up and straight down are no special cases
    const double narrow = std::atan(0.5 * std::min(size.width, size.height) / camera.fy);
    const double distance = orbit.distance > 0 ? orbit.distance : 1.25 * subject.radius / std::sin(narrow);
    glm::dmat4 turn = glm::rotate(glm::dmat4(1), glm::radians(orbit.azimuth), glm::dvec3(0, 1, 0));
    turn = glm::rotate(turn, -glm::radians(orbit.elevation), glm::dvec3(1, 0, 0));
    turn = glm::translate(turn, glm::dvec3(0, 0, distance));
    const glm::dmat4 assetFromYUp = glm::mat4_cast(glm::conjugate(glm::dquat(yUpFromAsset)));
    camera.worldFromCamera = glm::translate(glm::dmat4(1), subject.center) * assetFromYUp * turn;
    return camera;
}

Camera resized(const Camera& camera, PixelSize size)
{
    const double scale = std::min(double(size.width) / camera.width, double(size.height) / camera.height);
    Camera out = camera;
    out.width = size.width;
    out.height = size.height;
    out.fx = camera.fx * scale;
    out.fy = camera.fy * scale;
    out.cx = (camera.cx - 0.5 * camera.width) * scale + 0.5 * size.width;
    out.cy = (camera.cy - 0.5 * camera.height) * scale + 0.5 * size.height;
    return out;
}

glm::dmat4 spinMatrix(const Subject& subject, double radians)
{
    const glm::dmat4 toCenter = glm::translate(glm::dmat4(1), subject.center);
    return glm::translate(glm::rotate(toCenter, radians, subject.up), -subject.center);
}

Camera spun(Camera camera, const glm::dmat4& spin)
{
    camera.worldFromCamera = spin * camera.worldFromCamera;
    return camera;
}

Light spun(Light light, const glm::dmat4& spin)
{
    light.position = glm::dvec3(spin * glm::dvec4(glm::dvec3(light.position), 1));
    light.directionToLight = glm::normalize(glm::dmat3(spin) * glm::dvec3(light.directionToLight));
    return light;
}

} // namespace nacre::cli
