#include "stage_spec.h"

#include "number_list.h"

#include "base/file.h"
#include "base/text.h"
#include "interchange/json.h"
#include "mesh/material_names.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>

namespace nacre::cli {

static constexpr const char* kBoundaries[] = {"diffuse", "none", "dielectric"}; // in the order of SubsurfaceBoundary
static constexpr size_t kMaxFileBytes = size_t(1) << 20;

static Error badSpec(const std::string& option, const std::string& text, const std::string& expected)
{
    return {ErrorCode::kBadInput, option + " " + inQuotes(text) + ": expected " + expected};
}

struct Property {
    std::string key, value;
};

/// Cuts the last ":KEY=VALUE" with one of these keys off the text. Names may contain colons, as long as no key follows.
static std::optional<Property> takeLast(std::string& text, std::initializer_list<const char*> keys)
{
    size_t at = std::string::npos;
    Property out;
    for (const char* key : keys) {
        const std::string mark = std::string(1, ':').append(key).append(1, '=');
        const size_t found = text.rfind(mark);
        if (found == std::string::npos || (at != std::string::npos && found < at)) continue;
        at = found;
        out = {key, text.substr(found + mark.size())};
    }
    if (at == std::string::npos) return std::nullopt;
    text.resize(at);
    return out;
}

/// Sets one property; what was expected, if the value is not that.
static std::string setProperty(SubsurfaceOverride& o, const std::string& key, const std::vector<double>& values)
{
    const auto inRange = [&](double low, double high) { return std::all_of(values.begin(), values.end(), [&](double v) { return v >= low && v <= high; }); };
    const bool isColor = values.size() == 1 || values.size() == 3;
    const glm::vec3 color = isColor ? glm::vec3(values[0], values[values.size() / 2], values.back()) : glm::vec3(0.0f);
    if (key == "g") {
        if (values.size() != 1 || !(std::fabs(values[0]) <= 0.99)) return "g from -0.99 to 0.99";
        o.anisotropy = float(values[0]);
    } else if (key == "mfp") {
        if (!isColor || !inRange(1e-9, 1e9)) return "mfp above 0, in metres: one number or r,g,b";
        o.meanFreePath = color;
    } else {
        if (!isColor || !inRange(0, 1)) return key + " from 0 to 1: one number or r,g,b";
        (key == "alpha" ? o.singleScatterAlbedo : o.albedo) = color;
    }
    return "";
}

static std::string setBoundary(SubsurfaceOverride& o, const std::string& name)
{
    const auto it = std::find(std::begin(kBoundaries), std::end(kBoundaries), name);
    if (it == std::end(kBoundaries)) return "boundary diffuse, none or dielectric";
    o.boundary = SubsurfaceBoundary(it - std::begin(kBoundaries));
    return "";
}

static std::string whatIsMissing(const SubsurfaceOverride& o, bool hasMfp)
{
    if (o.material.empty()) return "the name of a material first (or #0, or *)";
    if ((o.albedo.x >= 0) == (o.singleScatterAlbedo.x >= 0)) return "one of albedo= (diffuse) and alpha= (single scattering)";
    return hasMfp ? "" : "mfp=, the mean free path in metres";
}

Result<SubsurfaceOverride> parseSubsurface(const std::string& text)
{
    static constexpr const char* kForm = "MATERIAL:albedo=r,g,b:mfp=r,g,b[:g=0][:boundary=diffuse|none|dielectric]";
    SubsurfaceOverride out;
    bool hasMfp = false;
    out.material = text;
    while (const auto p = takeLast(out.material, {"albedo", "alpha", "mfp", "g", "boundary"})) {
        const std::string expected = p->key == "boundary" ? setBoundary(out, p->value) : setProperty(out, p->key, numbersIn(p->value).value_or(std::vector<double>{}));
        if (!expected.empty()) return badSpec("--sss", text, expected + ", found " + inQuotes(p->key + "=" + p->value));
        hasMfp = hasMfp || p->key == "mfp";
    }
    if (const std::string missing = whatIsMissing(out, hasMfp); !missing.empty()) return badSpec("--sss", text, missing + "; the form is " + kForm);
    return out;
}

Result<std::vector<SubsurfaceOverride>> readSubsurfaceFile(const std::string& path)
{
    const auto bytes = readFile(path, kMaxFileBytes);
    if (!bytes) return bytes.error();
    const auto json = JsonDocument::parse(*bytes, path);
    if (!json) return json.error();
    const std::vector<JsonNode> items = json->root().isArray() ? json->root().items() : std::vector<JsonNode>{json->root()};
    std::vector<SubsurfaceOverride> out;
    for (const JsonNode& item : items) {
        SubsurfaceOverride o;
        o.material = item["material"].string();
        for (const char* key : {"albedo", "alpha", "mfp", "g"}) {
            const JsonNode node = item[key];
            if (!node.exists()) continue;
            const std::string expected = setProperty(o, key, node.isNumber() ? std::vector<double>{node.number()} : node.numbers(3));
            if (!expected.empty()) node.fail(expected, "another value");
        }
        if (item["boundary"].exists())
            if (const std::string expected = setBoundary(o, item["boundary"].string()); !expected.empty())
                item["boundary"].fail(expected, inQuotes(item["boundary"].string()));
        if (const std::string missing = whatIsMissing(o, item["mfp"].exists()); !missing.empty()) item.fail(missing, "none or both");
        if (json->failed()) return json->error();
        out.push_back(o);
    }
    if (out.empty()) return Error{ErrorCode::kBadInput, path + ": no materials, expected at least one"};
    return out;
}

Status checkMaterial(const SubsurfaceOverride& o, const MeshScene& mesh)
{
    for (size_t i = 0; i < mesh.materials.size(); ++i)
        if (namesMaterial(o.material, mesh, i)) return ok();
    return Error{ErrorCode::kBadInput, "--sss: the mesh has no material " + inQuotes(o.material) + "; it has: " + listMaterials(mesh) + " (or * for all)"};
}

std::string textOf(const SubsurfaceOverride& o)
{
    const bool single = o.singleScatterAlbedo.x >= 0;
    const glm::vec3 a = single ? o.singleScatterAlbedo : o.albedo, m = o.meanFreePath;
    char numbers[256];
    std::snprintf(numbers, sizeof numbers, ":%s=%.9g,%.9g,%.9g:mfp=%.9g,%.9g,%.9g:g=%.9g:boundary=", single ? "alpha" : "albedo", double(a.x),
                  double(a.y), double(a.z), double(m.x), double(m.y), double(m.z), double(o.anisotropy));
    return o.material + numbers + kBoundaries[size_t(o.boundary)];
}

static constexpr struct {
    const char* key;
    float FurSettings::*value;
    float highest;
} kFurShape[] = {{"variation", &FurSettings::lengthVariation, 0.999f}, {"tip", &FurSettings::tipRadius, 1}, {"lean", &FurSettings::lean, 1},
                 {"disorder", &FurSettings::disorder, 1}, {"clump", &FurSettings::clump, 1}};

Result<FurSettings> parseFur(const std::string& text)
{
    FurSettings out;
    std::string rest = text;
    while (const auto p = takeLast(rest, {"material", "variation", "tip", "lean", "disorder", "clump"})) {
        const auto shape = std::find_if(std::begin(kFurShape), std::end(kFurShape), [&](const auto& s) { return p->key == s.key; });
        const auto number = numbersIn(p->value);
        const bool isShape = shape != std::end(kFurShape);
        if (isShape ? !number || number->size() != 1 || !((*number)[0] >= 0 && (*number)[0] <= double(shape->highest)) : p->value.empty())
            return badSpec("--fur", text, (isShape ? p->key + " from 0 to 1" : "the name of a material") + ", found " + inQuotes(p->key + "=" + p->value));
        if (isShape) out.*shape->value = float((*number)[0]);
        else out.material = p->value;
    }
    const auto v = numbersIn(rest);
    if (!v || v->size() != 3 || !(*std::min_element(v->begin(), v->end()) > 0))
        return badSpec("--fur", text, "DENSITY,LENGTH,RADIUS above 0: fibres per square metre, metres, metres; then material=, variation=, tip=, lean=, disorder=, clump=");
    out.density = float((*v)[0]), out.length = float((*v)[1]), out.radius = float((*v)[2]);
    return out;
}

std::string textOf(const FurSettings& fur)
{
    char numbers[128];
    std::snprintf(numbers, sizeof numbers, "%.9g,%.9g,%.9g:material=", double(fur.density), double(fur.length), double(fur.radius));
    std::string text = numbers + (fur.material.empty() ? "*" : fur.material);
    for (const auto& shape : kFurShape) {
        std::snprintf(numbers, sizeof numbers, ":%s=%.9g", shape.key, double(fur.*shape.value));
        text += numbers;
    }
    return text;
}

Result<int> parseTestSamples(const std::string& text, int trainSamples)
{
    constexpr double kMaxSamples = 1 << 20;
    const bool isFactor = !text.empty() && text.back() == 'x';
    const auto value = numbersIn(isFactor ? text.substr(0, text.size() - 1) : text);
    const double samples = !value || value->size() != 1 ? -1.0 : isFactor ? std::ceil((*value)[0] * trainSamples) : (*value)[0];
    if (!(samples >= 1 && samples <= kMaxSamples) || samples != std::floor(samples))
        return badSpec("--test-spp", text, "a whole number of samples (256) or a multiple of --spp (4x), up to 1048576");
    return int(samples);
}

Result<PixelSize> parseStageSize(const std::string& text)
{
    const bool square = !text.empty() && text.size() < 6 && text.find_first_not_of("0123456789") == std::string::npos;
    const auto size = parseSize(square ? text + "x" + text : text);
    if (size) return size;
    return badSpec("--size", text, "pixels of a square (256) or WIDTHxHEIGHT, each 1 to 8192");
}

Result<int> parseLightsPerCamera(const std::string& text)
{
    if (text == "all") return 0;
    const auto value = numbersIn(text);
    if (!value || value->size() != 1 || !((*value)[0] >= 1 && (*value)[0] <= 1e6) || (*value)[0] != std::floor((*value)[0]))
        return badSpec("--lights-per-camera", text, "a whole number from 1, or 'all'");
    return int((*value)[0]);
}

Result<Shard> parseShard(const std::string& text)
{
    Shard shard;
    int used = 0;
    if (std::sscanf(text.c_str(), "%7d/%7d%n", &shard.index, &shard.count, &used) != 2 || size_t(used) != text.size() || shard.index < 1 ||
        shard.index > shard.count)
        return badSpec("--shard", text, "I/N with I from 1 to N, e.g. 2/8");
    return shard;
}

} // namespace nacre::cli
