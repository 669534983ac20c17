// The light table: which light each photograph was taken under, for camera models that say nothing of light.
//
//   lights.csv   a line of column names, then a line per photograph; columns, in any order:
//     image                                         its name, with folders as the camera model has it, or without them
//     light_x, light_y, light_z                     a point light's position in the world of the cameras, or
//     direction_x, direction_y, direction_z         the direction to a light infinitely far
//     intensity, or intensity_r, _g, _b             radiant intensity of a point, irradiance of a direction; none in any line: by convention
//     exposure_ev, gain, split, mask, ambient       optional, as the keys exposure_ev, gain, mask_path and ambient_path of descriptions
//   lights.json  {"images": {"IMG_1.jpg": {"position": [x, y, z]}, ...}}, or a list whose items have "image" besides. Keys: position or direction,
//     intensity, split, and those of photographs (capture_keys.cpp). Keys of top levels (color_space, background, light_rig ...) beside "images" hold
//     for the dataset; with "light_rig": "camera" a photograph without a light has it at its camera.
// Photographs that the table does not name are left out. Without a split in any line, every tenth photograph by name is held out as "test".
#include "dataset/loader.h"

#include "base/exact_position.h"
#include "interchange/text_lines.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

namespace nacre {
namespace {

constexpr const char* kTable = "lights.csv";
constexpr size_t kHoldOut = 10;
constexpr double kFarthest = 1e9; // as of cameras

struct Row {
    OlatImage image; // light, mask, ambient, gain
    std::string split;
    bool hasLight = false, hasIntensity = false;
};
using Table = std::map<std::string, Row, std::less<>>;

std::string lineOf(const std::string& path, size_t line) { return path + ": line " + std::to_string(line) + ": "; }

/// Fields of a line; quotes may enclose one.
std::vector<std::string> fieldsOf(std::string_view line, char separator)
{
    std::vector<std::string> fields(1);
    bool quoted = false;
    for (size_t i = 0; i < line.size(); ++i) {
        if (line[i] == '"') {
            if (quoted && i + 1 < line.size() && line[i + 1] == '"') fields.back() += line[i++];
            else quoted = !quoted;
        } else if (line[i] == separator && !quoted) fields.emplace_back();
        else fields.back() += line[i];
    }
    for (std::string& field : fields) field = std::string(trimmed(field));
    return fields;
}

bool setDirection(Light& light, const glm::dvec3& d)
{
    const double length = glm::length(d);
    if (!(length > 1e-9)) return false;
    light.type = LightType::kDirectional;
    light.directionToLight = glm::vec3(d / length);
    return true;
}

/// One line of the table, by the names of its columns.
class CsvRow {
public:
    CsvRow(const std::map<std::string, size_t>& columns, const std::vector<std::string>& fields) : columns_(columns), fields_(fields) {}

    std::string text(const std::string& column) const
    {
        const auto it = columns_.find(column);
        return it == columns_.end() || it->second >= fields_.size() ? "" : fields_[it->second];
    }
    /// Nothing where the field is empty; a mismatch is kept.
    std::optional<double> number(const std::string& column)
    {
        const std::string field = text(column);
        if (field.empty()) return std::nullopt;
        const std::optional<double> x = numberOf(field);
        if (!x || !(std::fabs(*x) <= 1e30)) fault = "column " + column + ": expected a number, found " + inQuotes(field);
        return x && std::fabs(*x) <= 1e30 ? x : std::nullopt;
    }
    std::optional<glm::dvec3> vector(const std::string& prefix, const char* const (&suffix)[3])
    {
        const std::optional<double> v[] = {number(prefix + suffix[0]), number(prefix + suffix[1]), number(prefix + suffix[2])};
        if (!v[0] && !v[1] && !v[2]) return std::nullopt;
        if (!v[0] || !v[1] || !v[2]) {
            if (fault.empty()) fault = "expected all of " + prefix + suffix[0] + ", " + prefix + suffix[1] + ", " + prefix + suffix[2] + " or none";
            return std::nullopt;
        }
        return glm::dvec3(*v[0], *v[1], *v[2]);
    }
    std::string fault;

private:
    const std::map<std::string, size_t>& columns_;
    const std::vector<std::string>& fields_;
};

constexpr const char* kXyz[3] = {"x", "y", "z"};
constexpr const char* kRgb[3] = {"r", "g", "b"};

void readCsvRow(const DatasetSource& source, CsvRow& csv, Row& row)
{
    const JsonNode nowhere(nullptr, nullptr, "");
    Light& light = row.image.light;
    const std::optional<glm::dvec3> position = csv.vector("light_", kXyz), direction = csv.vector("direction_", kXyz);
    if (position && direction) csv.fault = "a position and a direction; leave one of them empty";
    if (position) {
        for (int k = 0; k < 3; ++k)
            if (!(std::fabs((*position)[k]) < kFarthest)) csv.fault = "expected coordinates below 1e9";
        setExactPosition(light, *position);
    }
    if (direction && !setDirection(light, *direction)) csv.fault = "the direction 0, 0, 0";
    row.hasLight = position || direction;

    const std::optional<double> grey = csv.number("intensity");
    const std::optional<glm::dvec3> rgb = csv.vector("intensity_", kRgb);
    if (grey && rgb) csv.fault = "intensity and intensity_r; leave one of them empty";
    row.hasIntensity = grey || rgb;
    if (row.hasIntensity) light.intensity = grey ? glm::vec3(float(*grey)) : glm::vec3(*rgb);
    if (!(light.intensity.r >= 0 && light.intensity.g >= 0 && light.intensity.b >= 0)) csv.fault = "expected an intensity that is not negative";

    const double ev = csv.number("exposure_ev").value_or(0), gain = csv.number("gain").value_or(1);
    if (!(std::fabs(ev) <= 64)) csv.fault = "column exposure_ev: expected stops, -64 to 64";
    else if (!(gain > 1e-9)) csv.fault = "column gain: expected a number above 0";
    else row.image.gain = glm::vec3(float(std::exp2(-ev) / gain));
    row.split = csv.text("split");
    if (const std::string mask = csv.text("mask"); !mask.empty()) row.image.maskPath = findImage(source, "", mask, nowhere, ".png");
    if (const std::string ambient = csv.text("ambient"); !ambient.empty()) row.image.ambientPath = findImage(source, "", ambient, nowhere);
}

Status readCsv(const DatasetSource& source, Table& table)
{
    const std::string path = source.pathOf(kTable);
    const Result<std::vector<std::byte>> bytes = source.readFile(path);
    if (!bytes) return bytes.error();
    std::string_view text = asText(*bytes), line;
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
    std::map<std::string, size_t> columns;
    char separator = ',';
    for (size_t number = 1; nextLine(text, line); ++number) {
        if (trimmed(line).empty() || line.starts_with('#')) continue;
        const auto bad = [&](const std::string& what) { return Error{ErrorCode::kBadInput, lineOf(path, number) + what}; };
        if (columns.empty()) {
            for (const char other : {';', '\t'})
                if (line.find(',') == std::string_view::npos && line.find(other) != std::string_view::npos) separator = other;
            const std::vector<std::string> names = fieldsOf(line, separator);
            for (size_t i = 0; i < names.size(); ++i)
                if (!columns.emplace(names[i], i).second) return bad("column " + inQuotes(names[i]) + " twice");
            if (!columns.count("image")) return bad("expected column names with 'image' among them, found " + inQuotes(line));
            static const std::set<std::string> kKnown = {"image", "light_x", "light_y", "light_z", "direction_x", "direction_y", "direction_z", "intensity",
                                                         "intensity_r", "intensity_g", "intensity_b", "exposure_ev", "gain", "split", "mask", "ambient"};
            for (const std::string& name : names)
                if (!kKnown.count(name)) return bad("unknown column " + inQuotes(name) + "; expected image, light_x, direction_x, intensity, exposure_ev, gain, split, mask, ambient");
            continue;
        }
        const std::vector<std::string> fields = fieldsOf(line, separator);
        if (fields.size() != columns.size()) return bad(std::to_string(fields.size()) + " fields, expected " + std::to_string(columns.size()) + " like the column names");
        CsvRow csv(columns, fields);
        Row row;
        readCsvRow(source, csv, row);
        if (!csv.fault.empty()) return bad(csv.fault);
        if (csv.text("image").empty()) return bad("no name of an image");
        if (!table.emplace(csv.text("image"), std::move(row)).second) return bad(inQuotes(csv.text("image")) + " is there twice");
    }
    if (table.empty()) return Error{ErrorCode::kBadInput, path + ": no line of a photograph"};
    return ok();
}

Status readJson(const DatasetSource& source, Table& table)
{
    const JsonNode top = source.lights->json.root(), images = top["images"];
    const std::vector<std::string> names = images.isObject() ? images.keys() : std::vector<std::string>();
    const std::vector<JsonNode> items = images.items();
    for (size_t i = 0; i < items.size(); ++i) {
        const JsonNode& item = items[i];
        Row row;
        const std::string name = names.empty() ? item["image"].string() : names[i];
        const JsonNode direction = item["direction"].exists() ? item["direction"] : item["direction_to_light"];
        row.hasLight = item["position"].exists() || direction.exists();
        if (item["position"].exists() && direction.exists()) direction.fail("a position or a direction", "both");
        if (item["position"].exists()) readLightPosition(item["position"], row.image.light);
        if (direction.exists() && !setDirection(row.image.light, glm::dvec3(readVec3(direction)))) direction.fail("a direction", "0, 0, 0");
        row.hasIntensity = item["intensity"].exists();
        if (row.hasIntensity) row.image.light.intensity = readIntensity(item["intensity"]);
        if (item["split"].exists()) row.split = item["split"].string();
        readPhotograph(source, "", item, top, row.image);
        if (!table.emplace(name, std::move(row)).second) item.fail("every image once", inQuotes(name) + " again");
        if (source.lights->json.failed()) return source.lights->json.error();
    }
    if (source.lights->json.failed()) return source.lights->json.error();
    return ok();
}

bool isOnCamera(const DatasetSource& source)
{
    for (const Description* d : source.topLevels())
        if (const JsonNode rig = d->json.root()["light_rig"]; rig.isString() && rig.string() == "camera") return true;
    return false;
}

std::string fileName(const std::string& path) { return path.substr(path.find_last_of('/') + 1); } // npos + 1 = 0

/// The row of a photograph: by its whole name, or by the file's alone if no other photograph has that.
const Row* findRow(const Table& table, const std::string& name, const std::map<std::string, size_t>& count)
{
    if (const auto it = table.find(name); it != table.end()) return &it->second;
    if (count.at(fileName(name)) > 1) return nullptr;
    const auto it = table.find(fileName(name));
    return it == table.end() ? nullptr : &it->second;
}

} // namespace

bool hasLightTable(const DatasetSource& source)
{
    return isOnCamera(source) || (source.lights && source.lights->json.root()["images"].exists()) || source.fileExists(source.pathOf(kTable));
}

Status lightPhotos(const DatasetSource& source, std::vector<Photo> photos, OlatDataset& out)
{
    Table table;
    const bool hasCsv = source.fileExists(source.pathOf(kTable)), hasJson = source.lights && source.lights->json.root()["images"].exists();
    if (hasCsv && hasJson)
        return Error{ErrorCode::kBadInput, source.path + ": two light tables, lights.csv and \"images\" of lights.json; remove one of them"};
    if (hasCsv)
        if (Status s = readCsv(source, table); !s) return s;
    if (hasJson)
        if (Status s = readJson(source, table); !s) return s;
    const bool onCamera = isOnCamera(source);

    std::sort(photos.begin(), photos.end(), [](const Photo& a, const Photo& b) { return a.name < b.name; });
    std::map<std::string, size_t> countOfFile;
    for (const Photo& photo : photos) countOfFile[fileName(photo.name)]++;
    std::vector<std::pair<std::string, const Photo*>> named; // split, photo
    size_t unlit = 0, withIntensity = 0, withSplit = 0;
    for (Photo& photo : photos) {
        const Row* row = findRow(table, photo.name, countOfFile);
        if ((!row || !row->hasLight) && !onCamera) {
            ++unlit;
            continue;
        }
        if (row) {
            photo.image.light = row->image.light;
            photo.image.gain *= row->image.gain;
            if (!row->image.maskPath.empty()) photo.image.maskPath = row->image.maskPath;
            if (!row->image.ambientPath.empty()) photo.image.ambientPath = row->image.ambientPath;
            if (!row->split.empty()) photo.split = row->split;
            withIntensity += row->hasIntensity;
        }
        if (!row || !row->hasLight) {
            setExactPosition(photo.image.light, photo.camera.position());
        }
        photo.image.path = photo.path;
        withSplit += !photo.split.empty();
        named.emplace_back(photo.split, &photo);
    }
    const std::string tableName = hasCsv ? kTable : "lights.json";
    if (named.empty())
        return Error{ErrorCode::kBadInput, source.path + ": " + tableName + " names none of the " + std::to_string(photos.size()) + " photographs" +
                                               (photos.empty() ? "" : ", the first of which is " + inQuotes(photos[0].name)) +
                                               (table.empty() ? "" : ", but " + inQuotes(table.begin()->first)) + "; names must agree, or say \"light_rig\": \"camera\""};
    if (withIntensity != 0 && withIntensity != named.size())
        return Error{ErrorCode::kBadInput, source.path + ": " + tableName + ": " + std::to_string(withIntensity) + " of " + std::to_string(named.size()) +
                                               " photographs have an intensity, expected all or none"};
    std::map<std::string, SplitBuilder> splits;
    for (size_t i = 0; i < named.size(); ++i) {
        std::string& split = named[i].first;
        if (split.empty()) split = withSplit == 0 && i % kHoldOut == kHoldOut - 1 ? "test" : "train";
        const Photo& photo = *named[i].second;
        splits.try_emplace(split, split).first->second.add(photo.camera, photo.image, photo.file);
    }
    for (const char* first : {"train", "test"})
        if (const auto it = splits.find(first); it != splits.end()) out.splits.push_back(std::move(it->second.split)), splits.erase(it);
    for (auto& [name, builder] : splits) out.splits.push_back(std::move(builder.split));
    out.up = upFromCameras(out.splits);
    if (unlit) out.warnings.push_back(std::to_string(unlit) + " of " + std::to_string(photos.size()) + " photographs left out: " + tableName + " has no light for them");
    if (withSplit == 0 && out.find("test"))
        out.warnings.push_back("no splits are stated: every tenth photograph by name is held out as 'test'");
    if (withIntensity == 0) scaleByConvention(out);
    return ok();
}

} // namespace nacre
