// Picks the writer of a convention, leaves out what the convention has no words for, and encodes image files.
#include "dataset/dataset_writer.h"

#include "base/color.h"
#include "base/text.h"
#include "interchange/exr.h"
#include "interchange/png.h"
#include "writers/writer.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <tuple>

namespace nacre {
namespace {

enum Words : unsigned { kPoints = 1, kDirectionals = 2, kEnvironments = 4, kGroups = 8 };

struct Writer {
    const char* convention;
    ColorSpace colorSpace; // kSrgb: 8-bit PNG, kLinear: EXR
    bool premultiplied;
    unsigned words;        // the lights it can say
    glm::vec3 up;          // zero: any
    Status (*fit)(OlatDataset&);
    std::vector<DescriptionFile> (*describe)(const OlatDataset&, const OlatSplit&, const Json&);
};

constexpr Writer kWriters[] = {
    {"canonical", ColorSpace::kLinear, true, kPoints | kDirectionals | kEnvironments | kGroups, {0, 0, 1}, fitCanonical, describeCanonical},
    {"plpos", ColorSpace::kLinear, true, kPoints, {0, 0, 0}, fitPlpos, describePlpos},
    {"sssgs", ColorSpace::kSrgb, true, kPoints, {0, 0, 0}, fitSssgs, describeSssgs},
    {"bigs", ColorSpace::kLinear, false, kPoints | kGroups, {0, 1, 0}, fitBigs, describeBigs},
    {"colmap", ColorSpace::kLinear, true, kPoints | kDirectionals, {0, 0, 0}, fitColmap, describeColmap},
    {"rene", ColorSpace::kSrgb, true, kPoints, {0, 0, 1}, fitRene, describeRene},
};

const Writer* findWriter(const std::string& convention)
{
    for (const Writer& w : kWriters)
        if (convention == w.convention) return &w;
    return nullptr;
}

unsigned wordFor(LightType type) { return 1u << unsigned(type); }
static_assert(1u << unsigned(LightType::kGroup) == kGroups && 1u << unsigned(LightType::kEnvironment) == kEnvironments);

const char* nameOf(LightType type)
{
    static constexpr const char* kNames[] = {"point", "directional", "environment", "all_on"};
    return kNames[size_t(type)];
}

/// A split whose lights the convention cannot say goes as a whole, so that no split means something else than in other conventions.
void leaveOutUnsayable(OlatDataset& dataset, const Writer& writer)
{
    std::erase_if(dataset.splits, [&](const OlatSplit& split) {
        for (const OlatImage& image : split.images) {
            if (writer.words & wordFor(image.light.type)) continue;
            dataset.warnings.push_back("split '" + split.name + "' left out: the " + writer.convention + " convention has no words for " +
                                       nameOf(image.light.type) + " lights");
            return true;
        }
        return false;
    });
}

/// The turn that takes one world axis to another (+Y to +Z: (x, y, z) -> (x, -z, y), as glTF importers do); other pairs are not used.
glm::dmat4 turnUp(const glm::vec3& from, const glm::vec3& to)
{
    if (from == to) return glm::dmat4(1.0);
    const double s = to.z > 0.5f ? 1.0 : -1.0;
    return glm::dmat4(1, 0, 0, 0, 0, 0, s, 0, 0, -s, 0, 0, 0, 0, 0, 1);
}

Light turned(Light light, const glm::dmat4& turn)
{
    light.position = glm::vec3(turn * glm::dvec4(light.position, 1.0));
    light.directionToLight = glm::vec3(turn * glm::dvec4(light.directionToLight, 0.0));
    return light;
}

void turnWorld(OlatDataset& dataset, const glm::vec3& up)
{
    const glm::dmat4 turn = turnUp(dataset.up, up);
    dataset.up = up;
    if (turn == glm::dmat4(1.0)) return;
    std::vector<std::pair<const void*, std::shared_ptr<const std::vector<Light>>>> groups; // images share them: turn each once
    const auto turnedGroup = [&](const std::shared_ptr<const std::vector<Light>>& group) {
        for (const auto& [before, after] : groups)
            if (before == group.get()) return after;
        auto out = std::make_shared<std::vector<Light>>(*group);
        for (Light& light : *out) light = turned(light, turn);
        groups.emplace_back(group.get(), out);
        return groups.back().second;
    };
    for (OlatSplit& split : dataset.splits) {
        for (Camera& camera : split.cameras) camera.worldFromCamera = turn * camera.worldFromCamera;
        for (OlatImage& image : split.images) {
            image.light = turned(image.light, turn);
            if (image.light.group) image.light.group = turnedGroup(image.light.group);
        }
    }
}

std::vector<uint8_t> displayBytes(const Image& image)
{
    std::vector<uint8_t> out(image.rgba.size());
    for (size_t i = 0; i < out.size(); ++i) {
        const float x = std::clamp(image.rgba[i], 0.0f, 1.0f);
        out[i] = uint8_t(std::lround(255.0f * (i % 4 == 3 ? x : srgbFromLinear(x))));
    }
    return out;
}

Image straightAlpha(Image image)
{
    for (size_t i = 0; i < image.rgba.size(); i += 4)
        for (size_t c = 0; c < 3; ++c) image.rgba[i + c] = image.rgba[i + 3] > 0 ? image.rgba[i + c] / image.rgba[i + 3] : 0.0f;
    return image;
}

} // namespace

std::span<const char* const> writableConventions()
{
    static const std::vector<const char*> kNames = [] {
        std::vector<const char*> names;
        for (const Writer& w : kWriters) names.push_back(w.convention);
        return names;
    }();
    return kNames;
}

Result<OlatDataset> fitToConvention(OlatDataset dataset, const std::string& convention)
{
    const Writer* writer = findWriter(convention);
    if (!writer) return Error{ErrorCode::kBadInput, "no dataset convention " + inQuotes(convention) + " to write"};
    dataset.convention = convention;
    dataset.colorSpace = writer->colorSpace;
    dataset.premultiplied = writer->premultiplied;
    leaveOutUnsayable(dataset, *writer);
    turnWorld(dataset, writer->up == glm::vec3(0.0f) ? dataset.up : writer->up);
    const auto order = [](const OlatSplit& s) { return std::tuple(s.name == "train" ? 0 : s.name == "test" ? 1 : 2, s.name); };
    std::sort(dataset.splits.begin(), dataset.splits.end(), [&](const OlatSplit& a, const OlatSplit& b) { return order(a) < order(b); });
    if (Status s = writer->fit(dataset); !s) return s.error();
    if (dataset.splits.empty())
        return Error{ErrorCode::kBadInput, "no split is left that the " + convention + " convention can say; choose other splits or another convention"};
    return dataset;
}

Status writeDatasetImage(const OlatDataset& dataset, const Image& image, const std::string& path)
{
    if (std::filesystem::path(path).extension() == ".png") return writePng(path, image.width, image.height, 4, displayBytes(image));
    return dataset.premultiplied ? writeExr(image, path) : writeExr(straightAlpha(image), path);
}

std::vector<DescriptionFile> describeSplit(const OlatDataset& dataset, const OlatSplit& split, const std::string& topLevel)
{
    const Writer* writer = findWriter(dataset.convention);
    assert(writer);
    return writer->describe(dataset, split, Json::parse(topLevel));
}

// ---- What the writers share ----

void nameImages(OlatSplit& split, const std::string& extension)
{
    char number[32];
    for (size_t i = 0; i < split.images.size(); ++i) {
        std::snprintf(number, sizeof number, "/r_%04zu", i);
        split.images[i].path = split.name + number + extension;
    }
}

Json rowsOf(const glm::dmat4& m)
{
    Json rows = Json::array();
    for (int r = 0; r < 4; ++r) rows.push_back({m[0][r], m[1][r], m[2][r], m[3][r]});
    return rows;
}

Json toJson(const glm::vec3& v) { return {v.x, v.y, v.z}; }

static std::tuple<double, double, double, double, int, int> intrinsics(const Camera& c) { return {c.fx, c.fy, c.cx, c.cy, c.width, c.height}; }

bool sharedIntrinsics(const OlatSplit& split)
{
    return std::all_of(split.cameras.begin(), split.cameras.end(), [&](const Camera& c) { return intrinsics(c) == intrinsics(split.cameras[0]); });
}

void addIntrinsics(Json& to, const Camera& camera)
{
    if (camera.fx == camera.fy && camera.cx == 0.5 * camera.width && camera.cy == 0.5 * camera.height) {
        to["camera_angle_x"] = 2.0 * std::atan(0.5 * camera.width / camera.fx);
        return;
    }
    to["fl_x"] = camera.fx, to["fl_y"] = camera.fy;
    to["cx"] = camera.cx, to["cy"] = camera.cy;
}

DescriptionFile descriptionFile(const std::string& path, const Json& json)
{
    return {path, json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n"}; // `replace`: a file name need not be UTF-8
}

} // namespace nacre
