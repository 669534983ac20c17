// glTF 2.0 -> MeshScene: every primitive under every node that shows it, placed and repaired.
//
// Placing waits until all primitives are read: positions become float about the middle of the scene, if that is far from the world's origin.
//
// Our own reading of the JSON rather than tinygltf: tinygltf, as Debian builds it, has live asserts, resolves file names itself and copies
// before it checks. The reader is in six parts: the opened file (gltf_file), accessors (gltf_accessor), nodes (gltf_nodes), skins
// (gltf_skin), primitives (gltf_mesh) and materials (gltf_material). Nothing recurses, so no nesting is too deep; every allocation is
// bounded by the bytes of the file or by kMaxDecodedBytes (gltf_file.h), which also stops a file of many nodes that show one big mesh.
#include "interchange/gltf.h"

#include "base/file.h"
#include "base/text.h"
#include "interchange/gltf_file.h"
#include "interchange/gltf_material.h"
#include "interchange/gltf_mesh.h"
#include "interchange/gltf_nodes.h"
#include "interchange/gltf_skin.h"
#include "mesh/mesh_repair.h"
#include "mesh/mesh_transform.h"
#include "mesh/tangents.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <stdexcept>

namespace nacre {
namespace gltf {
namespace {

// ---- meshes ---------------------------------------------------------------------------------------------------------------------

/// The texture whose directions the tangents follow; none if the material does not need tangents.
const TextureSlot* tangentSlot(const MeshMaterial& m)
{
    if (m.normalTexture) return &m.normalTexture;
    if (m.clearcoatNormalTexture) return &m.clearcoatNormalTexture;
    return m.anisotropy > 0.0f ? &m.anisotropyTexture : nullptr;
}

void warnAboutMissingTexcoords(File& file, const TriangleMesh& mesh, const MeshMaterial& m, const std::string& where)
{
    for (const TextureSlot* slot :
         {&m.baseColorTexture, &m.metallicRoughnessTexture, &m.normalTexture, &m.specularTexture, &m.specularColorTexture, &m.anisotropyTexture,
          &m.clearcoatTexture, &m.clearcoatRoughnessTexture, &m.clearcoatNormalTexture, &m.iridescenceTexture, &m.iridescenceThicknessTexture, &m.transmissionTexture})
        if (*slot && mesh.texcoords[slot->texcoord].empty())
            file.warn(where + " has no TEXCOORD_" + std::to_string(slot->texcoord) + ", which the textures of material " +
                      inQuotes(m.name) + " need: they are sampled at one point");
}

/// One primitive as a node shows it.
struct Shown {
    TriangleMesh mesh; // not yet placed
    SkinInfluences influences;
    std::vector<glm::dmat4> worldFromLocal; // of each copy; with influences: of each joint
    std::string where;
    bool isList = true;
};

/// The scene's middle, if coordinates about the world's origin would be rounded much more than about the middle; else that origin.
glm::dvec3 chooseOrigin(const Bounds& bounds)
{
    constexpr double kFar = 16.0; // sizes of the scene: four bits of a float's 24
    const glm::dvec3 middle = 0.5 * (bounds.low + bounds.high);
    return glm::length(middle) > kFar * glm::length(bounds.high - bounds.low) ? middle : glm::dvec3(0.0);
}

/// Reads every primitive under every node that shows it; then places and repairs them.
class SceneBuilder {
public:
    SceneBuilder(File& file, MeshScene& scene) : file_(file), scene_(scene), nodes_(readNodes(file)), nodesOfMesh_(file.meshes.size())
    {
        for (const size_t i : nodes_.shown)
            if (const JsonNode mesh = file.nodes[i]["mesh"]; mesh.exists()) nodesOfMesh_[file.index(file.meshes, mesh)].push_back(i);
    }

    void build()
    {
        for (size_t m = 0; m < file_.meshes.size(); ++m)
            if (!nodesOfMesh_[m].empty()) readMesh(file_.meshes[m], nodesOfMesh_[m]);
        file_.check();
        scene_.origin = chooseOrigin(bounds_);
        for (Shown& shown : shown_) {
            place(shown);
            repair(std::move(shown.mesh), shown.where, shown.isList);
        }
        finish();
    }

private:
    static size_t bytesPerVertex(const TriangleMesh& m)
    {
        return sizeof(glm::vec3) * (1 + !m.normals.empty()) + sizeof(glm::vec4) * (size_t(!m.tangents.empty()) + !m.colors.empty()) +
               sizeof(glm::vec2) * (size_t(!m.texcoords[0].empty()) + !m.texcoords[1].empty());
    }

    void takeCopies(const TriangleMesh& mesh, size_t copies, const std::string& where)
    {
        file_.take(mesh.positions.size(), copies * bytesPerVertex(mesh), where);
        file_.take(mesh.triangles.size(), copies * sizeof(glm::uvec3), where);
    }

    void readMesh(const JsonNode& mesh, const std::vector<size_t>& nodes)
    {
        const std::string meshName = mesh["name"].exists() ? mesh["name"].string() : "";
        for (const JsonNode& json : mesh["primitives"].items()) {
            const std::optional<Primitive> primitive = readPrimitive(file_, json, int(file_.materials.size()));
            if (!primitive) continue;
            for (size_t n = 0; n < nodes.size(); ++n) {
                const JsonNode& node = file_.nodes[nodes[n]];
                if (n > 0) takeCopies(primitive->mesh, 1, node.where());
                Shown shown{primitive->mesh, {}, {}, json.where(), primitive->isList};
                shown.mesh.name = node["name"].exists() ? node["name"].string() : meshName;
                applyMorphTargets(file_, json, morphWeights(mesh, node, json), shown.mesh);
                file_.check();
                transform(shown, *primitive, nodes[n]);
                if (!shown.worldFromLocal.empty()) shown_.push_back(std::move(shown));
            }
        }
    }

    /// The node's, else the mesh's, else none.
    std::vector<double> morphWeights(const JsonNode& mesh, const JsonNode& node, const JsonNode& primitive) const
    {
        if (!primitive["targets"].exists()) return {};
        const size_t count = primitive["targets"].items().size();
        const JsonNode weights = node["weights"].exists() ? node["weights"] : mesh["weights"];
        return weights.exists() ? weights.numbers(count) : std::vector<double>(count, 0.0);
    }

    /// What moves the vertices, and where they come to be.
    void transform(Shown& shown, const Primitive& primitive, size_t nodeIndex)
    {
        const JsonNode& node = file_.nodes[nodeIndex];
        const JsonNode skin = node["skin"];
        if (skin.exists() && primitive.influences.perVertex == 0)
            file_.warn(node.where() + " has a skin, but " + shown.where + " has no joints and weights: it stands where the node is");
        if (skin.exists() && primitive.influences.perVertex > 0) {
            if (File::extension(node, "EXT_mesh_gpu_instancing").exists()) file_.warn(node.where() + " has a skin: its EXT_mesh_gpu_instancing is ignored");
            shown.worldFromLocal = readJointMatrices(file_, skin, nodes_);
            file_.take(primitive.influences.joints.size(), 2 * sizeof(float), node.where());
            shown.influences = primitive.influences;
            checkJoints(shown, skin);
            addBounds(shown.mesh, shown.influences, shown.worldFromLocal, bounds_);
        } else {
            shown.worldFromLocal = instancesOf(file_, node, nodes_.worldFromLocal[nodeIndex]);
            if (shown.worldFromLocal.size() > 1) takeCopies(shown.mesh, shown.worldFromLocal.size() - 1, node.where());
            for (const glm::dmat4& m : shown.worldFromLocal) addBounds(shown.mesh, m, bounds_);
        }
    }

    void checkJoints(const Shown& shown, const JsonNode& skin) const
    {
        const std::vector<uint32_t>& joints = shown.influences.joints;
        for (size_t i = 0; i < joints.size(); ++i)
            if (shown.influences.weights[i] > 0.0f && joints[i] >= shown.worldFromLocal.size())
                bad(shown.where + ": vertex " + std::to_string(i / shown.influences.perVertex) + " hangs on joint " + std::to_string(joints[i]) + ", but " +
                    skin.where() + " has " + std::to_string(shown.worldFromLocal.size()));
    }

    void place(Shown& shown)
    {
        for (glm::dmat4& m : shown.worldFromLocal) m[3] -= glm::dvec4(scene_.origin, 0.0);
        bool finite = true;
        if (shown.influences.perVertex > 0) {
            finite = skinMesh(shown.mesh, shown.influences, shown.worldFromLocal);
        } else {
            const TriangleMesh local = shown.worldFromLocal.size() > 1 ? shown.mesh : TriangleMesh();
            finite = transformMesh(shown.mesh, shown.worldFromLocal[0]);
            for (size_t i = 1; i < shown.worldFromLocal.size(); ++i) {
                TriangleMesh copy = local;
                finite = transformMesh(copy, shown.worldFromLocal[i]) && finite;
                appendMesh(shown.mesh, copy);
            }
        }
        if (!finite) bad(shown.where + ": a position is out of the range of float in the world; scale the scene down");
    }

    void repair(TriangleMesh mesh, const std::string& where, bool isList)
    {
        const size_t dropped = dropZeroAreaTriangles(mesh);
        zeroAreaTriangles_ += dropped;
        if (isList) unexpectedZeroAreaTriangles_ += dropped;
        dropUnusedVertices(mesh);
        if (mesh.triangles.empty()) return;
        zeroNormals_ += replaceZeroNormals(mesh);
        constexpr double kBackward = 0.02; // of the triangles: at creases of low-poly meshes a few are
        if (const size_t backward = countBackwardTriangles(mesh); double(backward) > kBackward * double(mesh.triangles.size()))
            file_.warn(where + ": the normals of " + std::to_string(backward) + " of " + std::to_string(mesh.triangles.size()) +
                       " triangles point behind them (counter-clockwise is the front): shaded flat there; turn the normals or the triangles round");
        if (std::any_of(mesh.tangents.begin(), mesh.tangents.end(), [](const glm::vec4& t) { return glm::vec3(t) == glm::vec3(0.0f); })) {
            file_.warn(where + " has tangents of length 0: they are made anew where they are needed");
            mesh.tangents.clear();
        }
        if (size_t(mesh.material) == scene_.materials.size()) scene_.materials.emplace_back().name = "default";
        const MeshMaterial& material = scene_.materials[size_t(mesh.material)];
        warnAboutMissingTexcoords(file_, mesh, material, where);
        if (const TextureSlot* slot = tangentSlot(material); slot && mesh.tangents.empty()) {
            file_.take(mesh.positions.size(), 2 * sizeof(glm::vec4), "tangents"); // at most every vertex is split in two
            makeTangents(mesh, *slot);
        }
        scene_.meshes.push_back(std::move(mesh));
    }

    void finish()
    {
        const auto triangles = [](size_t n) { return std::to_string(n) + (n == 1 ? " triangle" : " triangles"); };
        if (scene_.meshes.empty())
            bad(zeroAreaTriangles_ == 0 ? "the scene has no triangles"
                                        : "the scene has no triangles with area: " + triangles(zeroAreaTriangles_) + " are points or lines (is a scale 0?)");
        if (unexpectedZeroAreaTriangles_ > 0) file_.warn("dropped: " + triangles(unexpectedZeroAreaTriangles_) + " without area");
        if (zeroNormals_ > 0) file_.warn("replaced by face normals: " + std::to_string(zeroNormals_) + " normals of length 0");
        constexpr double kSmallest = 1e-30; // float begins to lose digits at 1e-38
        if (const double size = glm::length(bounds_.high - bounds_.low); size < kSmallest) bad("the scene is too small for float (below 1e-30 m); scale it up");
    }

    File& file_;
    MeshScene& scene_;
    const Nodes nodes_;
    std::vector<std::vector<size_t>> nodesOfMesh_;
    std::vector<Shown> shown_;
    Bounds bounds_; // of everything shown, in the world
    size_t zeroAreaTriangles_ = 0, unexpectedZeroAreaTriangles_ = 0, zeroNormals_ = 0;
};

void warnAboutIgnoredParts(File& file)
{
    const auto has = [&](const char* key) { return file.root()[key].firstItem().exists(); };
    if (has("animations")) file.warn("ignored: animations (nodes stay where the file puts them)");
    if (has("cameras")) file.warn("ignored: cameras");
    if (File::extension(file.root(), "KHR_lights_punctual").exists()) file.warn("ignored: lights");
}

MeshScene readOrThrow(std::span<const std::byte> bytes, const UriReader& readUri, uint64_t maxDecodedBytes)
{
    File file(bytes, readUri, maxDecodedBytes);
    MeshScene scene;
    warnAboutIgnoredParts(file);
    readMaterials(file, scene);
    SceneBuilder(file, scene).build();
    scene.warnings = std::move(file.warnings);
    return scene;
}

} // namespace

Result<MeshScene> decodeWithin(uint64_t maxDecodedBytes, std::span<const std::byte> bytes, const std::string& name, const UriReader& readUri)
{
    try {
        return readOrThrow(bytes, readUri, maxDecodedBytes);
    } catch (const Fault& fault) {
        return Error{fault.code, name + ": " + fault.message};
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::kIo, name + ": out of memory while reading the scene"};
    } catch (const std::length_error&) {
        return Error{ErrorCode::kIo, name + ": out of memory while reading the scene"};
    }
}

} // namespace gltf

Result<MeshScene> decodeGltf(std::span<const std::byte> bytes, const std::string& name, const UriReader& readUri)
{
    return gltf::decodeWithin(gltf::kMaxDecodedBytes, bytes, name, readUri);
}

Result<MeshScene> readGltf(const std::string& path)
{
    Result<std::vector<std::byte>> bytes = readFile(path);
    if (!bytes) return bytes.error();
    const size_t slash = path.rfind('/');
    const std::string folder = slash == std::string::npos ? "" : path.substr(0, slash + 1);
    return decodeGltf(*bytes, path, [&](const std::string& uri) { return readFile(folder + uri); });
}

} // namespace nacre
