#include "interchange/splat_glb.h"

#include "asset/glb_layout.h"
#include "base/color.h"
#include "base/limits.h"
#include "base/text.h"
#include "interchange/gltf_accessor.h"
#include "interchange/gltf_nodes.h"
#include "interchange/rotate_splats.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <new>
#include <stdexcept>

namespace nacre {
namespace {

constexpr double kDegree0 = 0.28209479177387814;

// ---- Out ----------------------------------------------------------------------------------------------------------------------

/// Attributes one after the other, as the buffer and as the JSON that describes it.
class Writer {
public:
    explicit Writer(size_t count) : count_(count) {}

    /// `at(i)` gives `components` floats of splat i. `more` is added to the accessor.
    template <class At>
    void add(const std::string& name, int components, At at, const std::string& more = "")
    {
        constexpr const char* kTypes[] = {"", "SCALAR", "", "VEC3", "VEC4"};
        const size_t row = sizeof(float) * size_t(components), offset = bytes.size();
        const std::string index = std::to_string(attributes_++), comma = index == "0" ? "" : ",";
        bytes.resize(offset + row * count_);
        for (size_t i = 0; i < count_; ++i) std::memcpy(bytes.data() + offset + i * row, at(i), row);
        views += comma + "{\"buffer\":0,\"byteOffset\":" + std::to_string(offset) + ",\"byteLength\":" + std::to_string(row * count_) +
                 ",\"byteStride\":" + std::to_string(row) + ",\"target\":34962}";
        accessors += comma + "{\"bufferView\":" + index + ",\"componentType\":5126,\"count\":" + std::to_string(count_) + ",\"type\":\"" +
                     kTypes[components] + "\"" + more + "}";
        attributes += comma + "\"" + name + "\":" + index;
    }

    std::vector<std::byte> bytes;
    std::string views, accessors, attributes;

private:
    size_t count_, attributes_ = 0;
};

std::string list(std::initializer_list<float> numbers)
{
    std::string text;
    for (float x : numbers) {
        text += text.empty() ? '[' : ',';
        text += numberText(x);
    }
    return text += ']';
}

void append(const void* data, size_t size, std::vector<std::byte>& out)
{
    const auto* bytes = static_cast<const std::byte*>(data);
    out.insert(out.end(), bytes, bytes + size);
}

// ---- In -----------------------------------------------------------------------------------------------------------------------

using namespace gltf;

struct Found {
    JsonNode primitive;
    size_t mesh;
};

Found findSplats(const File& file)
{
    std::vector<Found> found;
    for (size_t m = 0; m < file.meshes.size(); ++m)
        for (const JsonNode& primitive : file.meshes[m]["primitives"].items())
            if (File::extension(primitive, glb::kSplatExtension).exists()) found.push_back({primitive, m});
    file.check();
    if (found.empty()) bad("a glTF file without Gaussian splats (KHR_gaussian_splatting)");
    if (found.size() > 1) unsupported("the file holds several primitives of splats, one is expected");
    return found[0];
}

/// Faults if the attribute is missing, of another size, or has a number that is not finite.
template <int N>
std::vector<glm::vec<N, float>> attribute(File& file, const JsonNode& attributes, const std::string& name, size_t count)
{
    const JsonNode index = attributes[name.c_str()];
    if (!index.exists()) bad("the splats have no attribute " + name);
    const Accessor accessor = readAccessor(file, index);
    file.check();
    if (!accessor.rows) unsupported(accessor.where + " (" + name + ") has no data of its own (compressed splats?)");
    if (count > 0 && accessor.count != count)
        bad(accessor.where + " (" + name + ") has " + std::to_string(accessor.count) + " rows, expected " + std::to_string(count));
    auto rows = readVectors<N>(file, accessor);
    for (size_t i = 0; i < rows.size(); ++i)
        for (int k = 0; k < N; ++k)
            if (!(std::abs(rows[i][k]) <= kLargestNumber)) bad("splat " + std::to_string(i) + ": " + name + " has a number that is not finite or too large");
    return rows;
}

void readCloud(File& file, const JsonNode& attributes, SplatCloud& cloud)
{
    cloud.positions = attribute<3>(file, attributes, glb::kPosition, 0);
    cloud.count = cloud.positions.size();
    if (cloud.count == 0) bad("the file holds no splats");
    cloud.scales = attribute<3>(file, attributes, glb::kScale, cloud.count);
    for (const auto& o : attribute<1>(file, attributes, glb::kOpacity, cloud.count)) cloud.opacities.push_back(o.x);
    for (const glm::vec4& q : attribute<4>(file, attributes, glb::kRotation, cloud.count)) {
        if (!(glm::length(q) > 1e-6f)) bad("splat " + std::to_string(cloud.rotations.size()) + ": its rotation has length 0");
        cloud.rotations.push_back(glm::normalize(glm::quat(q.w, q.x, q.y, q.z)));
    }
    for (size_t i = 0; i < cloud.count; ++i) {
        for (int k = 0; k < 3; ++k) {
            if (cloud.scales[i][k] < 0) bad("splat " + std::to_string(i) + ": a scale below 0");
            cloud.scales[i][k] = std::max(cloud.scales[i][k], 1e-18f); // quantised scales may be 0, which has no logarithm
        }
        if (!(cloud.opacities[i] >= 0 && cloud.opacities[i] <= 1)) bad("splat " + std::to_string(i) + ": an opacity outside 0 to 1");
    }
}

void readLook(File& file, const JsonNode& attributes, size_t count, NeutralLook& look)
{
    std::vector<std::vector<glm::vec3>> columns;
    for (int functions : {1, 4, 9, 16}) {
        if (functions > 1 && !attributes[glb::shAttribute(functions - 1).c_str()].exists()) break;
        for (int f = int(columns.size()); f < functions; ++f) columns.push_back(attribute<3>(file, attributes, glb::shAttribute(f), count));
    }
    look.shFunctions = int(columns.size());
    for (size_t i = 0; i < count; ++i)
        for (const auto& column : columns) look.sh.push_back(column[i]);
}

/// Moves the splats to where their node shows them.
void place(const glm::dmat4& world, PlainSplats& splats)
{
    glm::dmat3 axes(world);
    const double size = glm::length(axes[0]);
    for (int k = 0; k < 3; ++k)
        if (!(std::abs(glm::length(axes[k]) - size) <= 1e-4 * size) || !(size > 0) || !(size < double(kLargestNumber)) || glm::determinant(axes) < 0)
            unsupported("the splats' node is mirrored or scales them unevenly; apply its transform first");
    axes /= size;
    rotateSplats(glm::normalize(glm::quat_cast(axes)), splats);
    AssetFrame frame;
    frame.scale = size, frame.translation = glm::dvec3(world[3]);
    placeInDataset(frame, splats.cloud);
}

PlainSplats readOrThrow(std::span<const std::byte> bytes)
{
    const UriReader none = [](const std::string& uri) -> Result<std::vector<std::byte>> {
        return Error{ErrorCode::kUnsupported, "the file refers to " + inQuotes(uri) + "; only what it holds itself is read"};
    };
    File file(bytes, none, uint64_t(2) << 30);
    const Found found = findSplats(file);
    const JsonNode splatting = File::extension(found.primitive, glb::kSplatExtension);
    if (const std::string kernel = splatting["kernel"].string(); kernel != "ellipse") unsupported("the splats' kernel is " + inQuotes(kernel) + ", expected 'ellipse'");
    const std::string colorSpace = splatting["colorSpace"].string();
    if (colorSpace != "srgb_rec709_display" && colorSpace != "lin_rec709_display")
        unsupported("the splats' colour space is " + inQuotes(colorSpace) + ", expected 'srgb_rec709_display' or 'lin_rec709_display'");

    PlainSplats splats;
    splats.srgb = colorSpace == "srgb_rec709_display";
    const JsonNode attributes = found.primitive["attributes"];
    readCloud(file, attributes, splats.cloud);
    readLook(file, attributes, splats.cloud.count, splats.look);
    file.check();

    const Nodes nodes = readNodes(file);
    std::vector<size_t> showing;
    for (size_t n : nodes.shown)
        if (file.nodes[n]["mesh"].exists() && file.index(file.meshes, file.nodes[n]["mesh"]) == found.mesh) showing.push_back(n);
    file.check();
    if (showing.size() > 1) unsupported("the file shows its splats " + std::to_string(showing.size()) + " times, once is expected");
    if (!showing.empty()) place(nodes.worldFromLocal[showing[0]], splats);
    return splats;
}

} // namespace

Result<std::vector<std::byte>> encodeSplatGlb(const PlainSplats& splats)
{
    const SplatCloud& cloud = splats.cloud;
    const size_t functions = size_t(splats.look.shFunctions), rowBytes = sizeof(float) * (3 + 4 + 3 + 1 + 4 + 3 * functions);
    if (cloud.count > (std::numeric_limits<uint32_t>::max() - (size_t(1) << 20)) / rowBytes)
        return Error{ErrorCode::kUnsupported, std::to_string(cloud.count) + " splats need more than the 4 GiB that a .glb holds"};
    glm::vec3 low = cloud.positions[0], high = low;
    for (const glm::vec3& p : cloud.positions) low = glm::min(low, p), high = glm::max(high, p);

    Writer out(cloud.count);
    glm::vec4 row;
    out.add(glb::kPosition, 3, [&](size_t i) { return &cloud.positions[i].x; },
            ",\"min\":" + list({low.x, low.y, low.z}) + ",\"max\":" + list({high.x, high.y, high.z}));
    out.add(glb::kRotation, 4, [&](size_t i) {
        const glm::quat& q = cloud.rotations[i];
        row = {q.x, q.y, q.z, q.w};
        return &row.x;
    });
    out.add(glb::kScale, 3, [&](size_t i) { return &cloud.scales[i].x; });
    out.add(glb::kOpacity, 1, [&](size_t i) { return &cloud.opacities[i]; });
    for (size_t f = 0; f < functions; ++f) out.add(glb::shAttribute(int(f)), 3, [&](size_t i) { return &splats.look.sh[i * functions + f].x; });
    out.add(glb::kColor, 4, [&](size_t i) { // for viewers that know no splats; always linear
        for (int c = 0; c < 3; ++c) {
            const float x = std::clamp(0.5f + float(kDegree0) * splats.look.sh[i * functions][c], 0.0f, 1.0f);
            row[c] = splats.srgb ? linearFromSrgb(x) : x;
        }
        row.w = cloud.opacities[i];
        return &row.x;
    });

    const glm::quat& q = splats.yUpFromSplats;
    std::string json = "{\"asset\":{\"version\":\"2.0\",\"generator\":\"Nacre\"},\"extensionsUsed\":[\"KHR_gaussian_splatting\"],\"scene\":0,"
                       "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"rotation\":" +
                       list({q.x, q.y, q.z, q.w}) + "}],\"meshes\":[{\"primitives\":[{\"mode\":0,\"attributes\":{" + out.attributes +
                       "},\"extensions\":{\"KHR_gaussian_splatting\":{\"kernel\":\"ellipse\",\"colorSpace\":\"" +
                       (splats.srgb ? "srgb_rec709_display" : "lin_rec709_display") +
                       "\",\"projection\":\"perspective\",\"sortingMethod\":\"cameraDistance\"}}}]}],\"accessors\":[" + out.accessors +
                       "],\"bufferViews\":[" + out.views + "],\"buffers\":[{\"byteLength\":" + std::to_string(out.bytes.size()) + "}]}";
    json.resize((json.size() + 3) / 4 * 4, ' ');

    std::vector<std::byte> file;
    file.reserve(28 + json.size() + out.bytes.size());
    const uint32_t head[] = {0x46546C67, 2, uint32_t(28 + json.size() + out.bytes.size()), uint32_t(json.size()), 0x4E4F534A};
    const uint32_t bin[] = {uint32_t(out.bytes.size()), 0x004E4942};
    append(head, sizeof head, file), append(json.data(), json.size(), file);
    append(bin, sizeof bin, file), append(out.bytes.data(), out.bytes.size(), file);
    return file;
}

Result<PlainSplats> decodeSplatGlb(std::span<const std::byte> bytes, const std::string& name)
{
    try {
        return readOrThrow(bytes);
    } catch (const Fault& fault) {
        return Error{fault.code, name + ": " + fault.message};
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::kIo, name + ": out of memory while reading splats"};
    } catch (const std::length_error&) {
        return Error{ErrorCode::kIo, name + ": out of memory while reading splats"};
    }
}

} // namespace nacre
