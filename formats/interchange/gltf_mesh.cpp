// Primitives: attributes and triangles (glTF 2.0, section 3.7.2), plain or compressed with Draco.
#include "interchange/gltf_mesh.h"

#include "base/text.h"
#include "interchange/draco.h"
#include "interchange/gltf_accessor.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace nacre::gltf {
namespace {

enum Mode : int { kTriangles = 4, kStrip = 5, kFan = 6 };

template <int N>
using Rows = std::vector<glm::vec<N, float>>;

template <int N>
ptrdiff_t firstNotFinite(const Rows<N>& rows)
{
    const auto it = std::find_if(rows.begin(), rows.end(), [](const auto& v) {
        for (int i = 0; i < N; ++i)
            if (!std::isfinite(v[i])) return true;
        return false;
    });
    return it == rows.end() ? -1 : it - rows.begin();
}

/// Where a primitive's attributes come from: accessors or, for those that the extension names, Draco data.
class Attributes {
public:
    Attributes(File& file, const JsonNode& primitive) : file_(file), where_(primitive.where()), accessors_(primitive["attributes"])
    {
        const JsonNode extension = File::extension(primitive, "KHR_draco_mesh_compression");
        if (extension.exists()) decode(extension);
    }

    bool has(const char* name) const { return accessors_[name].exists(); }
    const DracoMesh* draco() const { return draco_ ? &*draco_ : nullptr; }

    /// Components of an attribute that is there.
    int components(const char* name) const
    {
        const DracoAttribute* attribute = compressed(name);
        return attribute ? attribute->components : accessor(name).components;
    }

    template <int N>
    Rows<N> read(const char* name)
    {
        const Accessor a = accessor(name);
        const DracoAttribute* attribute = compressed(name);
        if (!attribute) return readVectors<N>(file_, a);
        if (attribute->components != N)
            bad(where_ + ": Draco attribute " + name + " has " + std::to_string(attribute->components) + " components, expected " + std::to_string(N));
        Rows<N> out(draco_->vertexCount);
        file_.take(out.size(), sizeof(out[0]), where_);
        if (!out.empty())
            convertRows(attribute->rows.data(), out.size(), attribute->rows.size() / out.size(), N, attribute->componentType, a.normalized, &out[0][0]);
        return out;
    }

    Accessor accessor(const char* name) const { return readAccessor(file_, accessors_[name]); }
    bool isCompressed(const char* name) const { return compressed(name) != nullptr; }

private:
    void decode(const JsonNode& extension)
    {
        const JsonNode names = extension["attributes"];
        std::vector<uint32_t> ids;
        for (const std::string& name : names.keys()) {
            const uint32_t id = uint32_t(names[name.c_str()].size(UINT32_MAX));
            ids.push_back(id);
            ids_.emplace_back(name, id);
        }
        file_.check();
        const File::View view = file_.view(extension["bufferView"]);
        Result<DracoMesh> mesh = decodeDraco(view.bytes, ids, extension.where());
        if (!mesh) throw Fault{mesh.error().code, mesh.error().message};
        draco_ = std::move(*mesh);
        file_.take(draco_->triangles.size(), sizeof(glm::uvec3), where_);
    }

    const DracoAttribute* compressed(const char* name) const
    {
        const auto it = std::find_if(ids_.begin(), ids_.end(), [&](const auto& e) { return e.first == name; });
        if (it == ids_.end()) return nullptr;
        return &draco_->attributes[size_t(it - ids_.begin())];
    }

    File& file_;
    std::string where_;
    JsonNode accessors_;
    std::optional<DracoMesh> draco_;
    std::vector<std::pair<std::string, uint32_t>> ids_; // in the order of draco_->attributes
};

/// Triangles of a list, strip or fan of `count` vertices, where vertexAt(i) is the i-th.
template <class VertexAt>
std::vector<glm::uvec3> assemble(int mode, size_t count, VertexAt vertexAt)
{
    std::vector<glm::uvec3> out;
    if (count < 3) return out;
    out.resize(mode == kTriangles ? count / 3 : count - 2);
    for (size_t i = 0; i < out.size(); ++i) {
        if (mode == kTriangles) out[i] = {vertexAt(3 * i), vertexAt(3 * i + 1), vertexAt(3 * i + 2)};
        else if (mode == kStrip) out[i] = {vertexAt(i), vertexAt(i + 1 + i % 2), vertexAt(i + 2 - i % 2)};
        else out[i] = {vertexAt(i + 1), vertexAt(i + 2), vertexAt(0)};
    }
    return out;
}

std::vector<glm::uvec3> readTriangles(File& file, const JsonNode& primitive, int mode, const Attributes& attributes, size_t vertexCount)
{
    if (attributes.draco()) return attributes.draco()->triangles; // a list in either mode, indices checked
    if (!primitive["indices"].exists()) {
        file.take(mode == kTriangles ? vertexCount / 3 : vertexCount, sizeof(glm::uvec3), primitive.where());
        return assemble(mode, vertexCount, [](size_t i) { return uint32_t(i); });
    }
    const std::vector<uint32_t> indices = readIndices(file, primitive["indices"]);
    for (size_t i = 0; i < indices.size(); ++i)
        if (indices[i] >= vertexCount)
            bad(primitive.where() + ".indices: element " + std::to_string(i) + " is " + std::to_string(indices[i]) + ", there are " +
                std::to_string(vertexCount) + " vertices");
    file.take(mode == kTriangles ? indices.size() / 3 : indices.size(), sizeof(glm::uvec3), primitive.where());
    return assemble(mode, indices.size(), [&](size_t i) { return indices[i]; });
}

/// An optional attribute: as many rows as vertices, or a fault; dropped with a warning if a value is not finite.
template <int N>
Rows<N> readOptional(File& file, Attributes& attributes, const char* name, size_t vertexCount)
{
    if (!attributes.has(name)) return {};
    Rows<N> rows = attributes.read<N>(name);
    const std::string where = attributes.accessor(name).where + " (" + name + ")";
    if (rows.size() != vertexCount)
        bad(where + " has " + std::to_string(rows.size()) + " elements, POSITION has " + std::to_string(vertexCount));
    if (const ptrdiff_t i = firstNotFinite<N>(rows); i >= 0) {
        file.warn("left out: " + where + ", whose element " + std::to_string(i) + " is not finite");
        return {};
    }
    return rows;
}

Rows<4> readColors(File& file, Attributes& attributes, size_t vertexCount)
{
    if (!attributes.has("COLOR_0")) return {};
    const Accessor a = attributes.accessor("COLOR_0");
    if (!a.normalized && a.componentType != kFloat32) bad(a.where + " (COLOR_0) has integers that are not normalized");
    if (attributes.components("COLOR_0") == 4) return readOptional<4>(file, attributes, "COLOR_0", vertexCount);
    const Rows<3> rgb = readOptional<3>(file, attributes, "COLOR_0", vertexCount);
    file.take(rgb.size(), sizeof(glm::vec4), a.where);
    Rows<4> rgba(rgb.size());
    std::transform(rgb.begin(), rgb.end(), rgba.begin(), [](const glm::vec3& c) { return glm::vec4(c, 1.0f); });
    return rgba;
}

/// Positions far from their own origin are rounded in the file itself; nothing that is done here brings them back.
void warnAboutRounding(File& file, const Accessor& accessor, const Rows<3>& positions)
{
    constexpr double kVisible = 1e-4; // of the size: about a twentieth of a pixel at 512 pixels
    Bounds bounds;
    for (const glm::vec3& p : positions) bounds.add(p);
    const double size = glm::length(bounds.high - bounds.low);
    const glm::dvec3 far = glm::max(glm::abs(bounds.low), glm::abs(bounds.high));
    const double rounding = std::max({far.x, far.y, far.z}) * double(std::numeric_limits<float>::epsilon());
    if (accessor.componentType == kFloat32 && size > 0 && rounding > kVisible * size)
        file.warn(accessor.where + " (POSITION) lies so far from its origin that the file itself rounds it to " + std::to_string(rounding / size * 100) +
                  " % of the mesh's size; export it about its own origin, with the place in the node");
}

/// JOINTS_n and WEIGHTS_n, all sets side by side.
SkinInfluences readInfluences(File& file, Attributes& attributes, size_t vertexCount)
{
    constexpr int kMostSets = 8; // of four joints; the specification has no bound, exporters write one or two
    std::vector<Rows<4>> joints, weights;
    for (int set = 0; set < kMostSets; ++set) {
        const std::string number = std::to_string(set), jointsName = "JOINTS_" + number, weightsName = "WEIGHTS_" + number;
        if (!attributes.has(jointsName.c_str()) || !attributes.has(weightsName.c_str())) break;
        if (const Accessor a = attributes.accessor(jointsName.c_str()); a.normalized || a.componentType == kFloat32)
            bad(a.where + " (" + jointsName + ") has numbers of joints that are not plain integers");
        joints.push_back(readOptional<4>(file, attributes, jointsName.c_str(), vertexCount));
        weights.push_back(readOptional<4>(file, attributes, weightsName.c_str(), vertexCount));
        if (joints.back().empty() || weights.back().empty()) return {};
    }
    SkinInfluences out;
    out.perVertex = 4 * joints.size();
    file.take(vertexCount * out.perVertex, 2 * sizeof(float), "skin weights");
    size_t unbound = 0;
    for (size_t i = 0; i < vertexCount && !joints.empty(); ++i) {
        double sum = 0.0;
        for (const Rows<4>& set : weights)
            for (int k = 0; k < 4; ++k) sum += double(std::max(0.0f, set[i][k]));
        unbound += !(sum > 0.0);
        for (size_t set = 0; set < joints.size(); ++set)
            for (int k = 0; k < 4; ++k) {
                const double weight = sum > 0.0 ? double(std::max(0.0f, weights[set][i][k])) / sum : double(set == 0 && k == 0);
                out.joints.push_back(uint32_t(std::clamp(joints[set][i][k], 0.0f, 4e9f)));
                out.weights.push_back(float(weight));
            }
    }
    if (unbound > 0) file.warn(std::to_string(unbound) + " vertices of a skin have no weights: their first joint moves them");
    return out;
}

} // namespace

std::optional<Primitive> readPrimitive(File& file, const JsonNode& primitive, int defaultMaterial)
{
    const int mode = primitive["mode"].exists() ? primitive["mode"].integer(0, 6) : kTriangles;
    file.check();
    if (mode < kTriangles) {
        file.warn("left out: points and lines (they have no surface)");
        return {};
    }
    if (!primitive["attributes"].exists()) bad(primitive.where() + " has no attributes");

    Attributes attributes(file, primitive);
    if (!attributes.has("POSITION")) {
        file.warn("left out: " + primitive.where() + ", which has no POSITION");
        return {};
    }
    if (attributes.draco() && mode != kTriangles && mode != kStrip) bad(primitive.where() + ": Draco data in mode " + std::to_string(mode));

    Primitive out;
    out.isList = mode == kTriangles;
    TriangleMesh& mesh = out.mesh;
    mesh.material = defaultMaterial;
    if (primitive["material"].exists()) mesh.material = int(file.index(file.materials, primitive["material"]));
    mesh.positions = attributes.read<3>("POSITION");
    if (const ptrdiff_t i = firstNotFinite<3>(mesh.positions); i >= 0)
        bad(attributes.accessor("POSITION").where + " (POSITION): element " + std::to_string(i) + " is not finite; repair the mesh");
    warnAboutRounding(file, attributes.accessor("POSITION"), mesh.positions);
    const size_t count = mesh.positions.size();
    mesh.triangles = readTriangles(file, primitive, mode, attributes, count);
    mesh.normals = readOptional<3>(file, attributes, "NORMAL", count);
    if (!mesh.normals.empty()) mesh.tangents = readOptional<4>(file, attributes, "TANGENT", count); // flat shading has its own (section 3.7.2.1)
    mesh.texcoords[0] = readOptional<2>(file, attributes, "TEXCOORD_0", count);
    mesh.texcoords[1] = readOptional<2>(file, attributes, "TEXCOORD_1", count);
    mesh.colors = readColors(file, attributes, count);
    out.influences = readInfluences(file, attributes, count);
    file.check();
    return out;
}

void applyMorphTargets(File& file, const JsonNode& primitive, std::span<const double> weights, TriangleMesh& mesh)
{
    if (!primitive["targets"].exists()) return;
    const std::vector<JsonNode> targets = primitive["targets"].items();
    if (weights.size() != targets.size())
        bad(primitive.where() + " has " + std::to_string(targets.size()) + " morph targets, but there are " + std::to_string(weights.size()) + " weights");
    for (size_t t = 0; t < targets.size(); ++t) {
        if (weights[t] == 0.0) continue;
        const auto add = [&](const char* name, auto& rows) {
            if (!targets[t][name].exists() || rows.empty()) return;
            const Accessor a = readAccessor(file, targets[t][name]);
            const Rows<3> moves = readVectors<3>(file, a);
            if (moves.size() != rows.size())
                bad(a.where + " (" + name + " of a morph target) has " + std::to_string(moves.size()) + " elements, the mesh has " + std::to_string(rows.size()));
            for (size_t i = 0; i < rows.size(); ++i)
                for (int k = 0; k < 3; ++k) {
                    rows[i][k] = float(double(rows[i][k]) + weights[t] * double(moves[i][k]));
                    if (!std::isfinite(rows[i][k])) bad(a.where + " (" + name + " of a morph target): element " + std::to_string(i) + " is not finite");
                }
        };
        add("POSITION", mesh.positions);
        add("NORMAL", mesh.normals);
        add("TANGENT", mesh.tangents); // the handedness stays
        for (const std::string& name : targets[t].keys())
            if (name.rfind("TEXCOORD_", 0) == 0 || name.rfind("COLOR_", 0) == 0)
                file.warn("ignored: morph targets of " + name + " (positions, normals and tangents are morphed)");
    }
    file.check();
}

} // namespace nacre::gltf
