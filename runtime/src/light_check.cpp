#include "light_check.h"

#include "base/limits.h"
#include "base/text.h"
#include "host_struct.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

namespace nacre {

namespace {

constexpr float kWidestLight = 1.6f;    // radians
constexpr float kBrightest = 1e15f;     // times falloff 1e6, the largest coefficients and many lights still finite: no inf * 0
constexpr uint32_t kMostSamples = 1024;
constexpr int kWidestMap = 16384, kHighestMap = 8192;

bool inRange(float x, float low, float high) { return x >= low && x <= high; } // NaN fails

bool isVector(const float v[3]) { return std::all_of(v, v + 3, [](float x) { return std::abs(x) <= kLargestNumber; }); }

double dot(const float a[3], const float b[3])
{
    double sum = 0;
    for (int c = 0; c < 3; ++c) sum += double(a[c]) * b[c];
    return sum;
}

Failure checkCones(const NacreLight& light, const std::string& which)
{
    if (light.innerCone >= 0 && light.innerCone < light.outerCone && light.outerCone <= std::numbers::pi_v<float> / 2 * (1 + 1e-6f)) return {};
    return invalid(which + "cones of a spot light must be 0 <= innerCone < outerCone <= pi / 2, found " + numberText(light.innerCone) + " and " +
                   numberText(light.outerCone));
}

Failure checkRectangle(const NacreLight& light, const std::string& which)
{
    const double width = isVector(light.halfWidth) ? std::sqrt(dot(light.halfWidth, light.halfWidth)) : 0;
    if (!(width > 0)) return invalid(which + "halfWidth of a rectangle must be a finite vector that is not 0");
    if (!(light.halfHeight > 0 && light.halfHeight <= kLargestNumber))
        return invalid(which + "halfHeight of a rectangle must be positive and finite, found " + numberText(light.halfHeight));
    if (!(std::abs(dot(light.halfWidth, light.direction)) <= 1e-2 * width))
        return invalid(which + "halfWidth of a rectangle must be at a right angle to its direction");
    return {};
}

constexpr uint32_t kMostCascades = 8;
constexpr float kSoftest = 64; // texels

Failure checkPlanes(const NacreShadowMap& map, const std::string& which)
{
    if (map.nearPlane > 0 && map.nearPlane < map.farPlane && map.farPlane <= kLargestNumber) return {};
    return invalid(which + "planes of a cube map must be 0 < nearPlane < farPlane, found " + numberText(map.nearPlane) + " and " + numberText(map.farPlane));
}

Failure checkMatrices(const NacreShadowMap& map, uint32_t layers, const std::string& which)
{
    if (!map.clipFromWorld) return invalid(which + "clipFromWorld is null, only cube maps have none");
    for (uint32_t i = 0; i < 16 * layers; ++i)
        if (!(std::abs(map.clipFromWorld[i]) <= kLargestNumber)) return invalid(which + "clipFromWorld of layer " + std::to_string(i / 16) + " is not finite or beyond 1e15");
    return {};
}

Failure checkShadowMap(const NacreLight& light, std::string which)
{
    which += "shadowMap: ";
    if (Failure f = checkSize("NacreShadowMap", light.shadowMap->structSize, sizeof(NacreShadowMap))) return f;
    const NacreShadowMap map = wholeShadowMap(*light.shadowMap);
    const int kind = rawEnum(map.kind);
    if (kind < NACRE_SHADOW_MAP_2D || kind > NACRE_SHADOW_MAP_CUBE) return invalid(which + "unknown kind " + std::to_string(kind));
    if (map.texture == 0) return invalid(which + "texture is 0");
    if (!inRange(map.bias, 0, kLargestNumber)) return invalid(which + "bias must be finite and not negative, found " + numberText(map.bias));
    if (!inRange(map.softness, 0, kSoftest)) return invalid(which + "softness must be from 0 to 64 texels, found " + numberText(map.softness));
    if (kind == NACRE_SHADOW_MAP_CUBE) {
        if (rawEnum(light.type) == NACRE_LIGHT_DIRECTIONAL) return invalid(which + "a directional light has no place for a cube map");
        return checkPlanes(map, which);
    }
    if (map.distances) return invalid(which + "only cube maps hold distances");
    const bool array = kind == NACRE_SHADOW_MAP_ARRAY;
    if (array && (map.layers < 1 || map.layers > kMostCascades)) return invalid(which + "layers must be 1 to 8, found " + std::to_string(map.layers));
    return checkMatrices(map, array ? map.layers : 1, which);
}

} // namespace

Failure checkLight(const NacreLight& light, size_t index)
{
    const std::string which = "light " + std::to_string(index) + ": ";
    const int type = rawEnum(light.type);
    if (type < NACRE_LIGHT_POINT || type > NACRE_LIGHT_RECTANGLE) return invalid(which + "unknown type " + std::to_string(type));
    const bool directional = type == NACRE_LIGHT_DIRECTIONAL, rectangle = type == NACRE_LIGHT_RECTANGLE, sphere = type == NACRE_LIGHT_SPHERE;
    for (const float i : light.intensity)
        if (!inRange(i, 0, kBrightest)) return invalid(which + "intensity must be from 0 to 1e15, found " + numberText(i));
    if (light.flags & ~uint32_t(NACRE_LIGHT_SPLAT_SHADOWS)) return invalid(which + "unknown flags " + std::to_string(light.flags));
    if (!directional && !isVector(light.position)) return invalid(which + "position is not finite or beyond 1e15");
    if (directional || rectangle || type == NACRE_LIGHT_SPOT) {
        if (!isVector(light.direction)) return invalid(which + "direction is not finite");
        if (const double length2 = dot(light.direction, light.direction); !(std::abs(length2 - 1) < 1e-2))
            return invalid(which + "direction must have length 1, found " + numberText(std::sqrt(length2)));
    }
    if (directional && !inRange(light.radius, 0, kWidestLight))
        return invalid(which + "radius of a directional light is an angle from 0 to 1.6 radians, found " + numberText(light.radius));
    if (sphere && !(light.radius > 0)) return invalid(which + "radius of a sphere must be positive, found " + numberText(light.radius));
    if (!directional && !rectangle && !inRange(light.radius, 0, kLargestNumber))
        return invalid(which + "radius must be finite and not negative, found " + numberText(light.radius));
    if (!directional && !inRange(light.range, 0, kLargestNumber))
        return invalid(which + "range must be finite and not negative, found " + numberText(light.range));
    if ((sphere || rectangle) && light.samples > kMostSamples)
        return invalid(which + std::to_string(light.samples) + " samples, the most is " + std::to_string(kMostSamples));
    if (type == NACRE_LIGHT_SPOT)
        if (Failure f = checkCones(light, which)) return f;
    if (rectangle)
        if (Failure f = checkRectangle(light, which)) return f;
    return light.shadowMap ? checkShadowMap(light, which) : Failure{};
}

static Failure checkPixels(const NacreEnvironment& e)
{
    if (e.width < 1 || e.width > kWidestMap || e.height < 1 || e.height > kHighestMap)
        return invalid("environment: " + std::to_string(e.width) + " x " + std::to_string(e.height) + " pixels, from 1 x 1 to 16384 x 8192 are possible");
    const size_t row = 3 * size_t(e.width);
    for (size_t y = 0; y < size_t(e.height); ++y)
        for (size_t i = 0; i < row; ++i)
            if (!(std::abs(e.pixels[y * row + i]) <= kBrightest))
                return invalid("environment: pixel (" + std::to_string(i / 3) + ", " + std::to_string(y) + ") is " + numberText(e.pixels[y * row + i]) +
                               ", the largest is 1e15");
    return {};
}

static Failure checkCoefficients(const NacreEnvironment& e)
{
    const uint32_t counts[] = {1, 4, 9, 16, 25};
    if (std::find(std::begin(counts), std::end(counts), e.shCount) == std::end(counts))
        return invalid("environment: shCount must be 1, 4, 9, 16 or 25, found " + std::to_string(e.shCount));
    for (uint32_t i = 0; i < 3 * e.shCount; ++i)
        if (!(std::abs(e.sh[i]) <= kBrightest)) return invalid("environment: sh[" + std::to_string(i) + "] is " + numberText(e.sh[i]) + ", the largest is 1e15");
    return {};
}

static Failure checkRotation(const float m[9])
{
    if (std::all_of(m, m + 9, [](float x) { return x == 0; })) return {};
    bool orthonormal = true;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j <= i; ++j) orthonormal = orthonormal && std::abs(dot(m + 3 * i, m + 3 * j) - (i == j)) < 1e-2;
    if (!orthonormal) return invalid("environment: worldFromMap is no rotation: its columns must be unit vectors at right angles");
    return {};
}

Failure checkEnvironment(const NacreEnvironment& e)
{
    if (!e.pixels == !e.sh) return invalid(e.pixels ? "environment: both pixels and sh are given, only one can count" : "environment: neither pixels nor sh");
    if (!inRange(e.intensity, 0, kBrightest)) return invalid("environment: intensity must be from 0 to 1e15, found " + numberText(e.intensity));
    if (e.directions > kMostSamples)
        return invalid("environment: " + std::to_string(e.directions) + " directions, the most is " + std::to_string(kMostSamples));
    if (Failure f = checkRotation(e.worldFromMap)) return f;
    return e.pixels ? checkPixels(e) : checkCoefficients(e);
}

Failure readLights(const NacreLight* lights, size_t count, std::vector<NacreLight>* copies)
{
    copies->clear();
    if (count == 0) return {};
    if (!lights) return invalid("lights must not be null");
    const size_t stride = lights->structSize;
    if (Failure f = checkSize("NacreLight", stride, sizeof(NacreLight))) return f;
    for (size_t i = 0; i < count; ++i) {
        NacreLight light{};
        std::memcpy(&light, reinterpret_cast<const unsigned char*>(lights) + i * stride, stride);
        if (light.structSize != stride)
            return invalid("light " + std::to_string(i) + ": structSize is " + std::to_string(light.structSize) + ", that of light 0 is " + std::to_string(stride));
        if (Failure f = checkLight(light, i)) return f;
        copies->push_back(light);
    }
    return {};
}

Failure readEnvironment(const NacreEnvironment& environment, NacreEnvironment* copy)
{
    if (Failure f = read("NacreEnvironment", &environment, copy)) return f;
    return checkEnvironment(*copy);
}

} // namespace nacre
