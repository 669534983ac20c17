// glTF 2.0 -> MeshScene: nodes, instances and repairs.
//
// Our own reading of the JSON rather than tinygltf: tinygltf, as Debian builds it, has live asserts, resolves file names itself and copies
// before it checks. The reader is in four parts: the opened file (gltf_file), accessors (gltf_accessor), primitives (gltf_mesh) and
// materials (gltf_material). Nothing recurses, so no nesting is too deep; every allocation is bounded by the bytes of the file or by
// kMaxDecodedBytes (gltf_file.h), which also stops a file of many nodes that show one big mesh.
#include "interchange/gltf.h"

#include "base/file.h"
#include "base/text.h"
#include "interchange/gltf_file.h"
#include "interchange/gltf_material.h"
#include "interchange/gltf_mesh.h"
#include "mesh/mesh_repair.h"
#include "mesh/tangents.h"

#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <cmath>
#include <new>
#include <stdexcept>

namespace nacre {
namespace gltf {
namespace {

// ---- nodes ----------------------------------------------------------------------------------------------------------------------

glm::dmat4 localTransform(const JsonNode& node)
{
    const JsonNode matrix = node["matrix"];
    if (matrix.exists()) {
        const std::vector<double> v = matrix.numbers(16);
        glm::dmat4 m;
        for (int i = 0; i < 16; ++i) m[i / 4][i % 4] = v[size_t(i)]; // column by column, like GLM
        const glm::dvec4 lastRow(m[0][3], m[1][3], m[2][3], m[3][3]);
        if (lastRow != glm::dvec4(0, 0, 0, 1)) matrix.fail("affine matrix, last row 0 0 0 1", "another last row");
        return m;
    }
    glm::dvec3 translation(0.0), scale(1.0);
    glm::dquat rotation(1, 0, 0, 0);
    const auto vec3 = [](const JsonNode& n) {
        const std::vector<double> v = n.numbers(3);
        return glm::dvec3(v[0], v[1], v[2]);
    };
    if (node["translation"].exists()) translation = vec3(node["translation"]);
    if (node["scale"].exists()) scale = vec3(node["scale"]);
    if (node["rotation"].exists()) {
        const std::vector<double> v = node["rotation"].numbers(4);
        rotation = glm::dquat(v[3], v[0], v[1], v[2]); // stored x y z w
        const double length = glm::length(rotation);
        if (!(length > 1e-6) || !std::isfinite(length)) node["rotation"].fail("unit quaternion", "length " + std::to_string(length));
        else rotation /= length;
    }
    glm::dmat4 m = glm::mat4_cast(rotation);
    for (int i = 0; i < 3; ++i) m[i] *= scale[i];
    m[3] = glm::dvec4(translation, 1.0);
    return m;
}

struct NodeTree {
    std::vector<int> parents;                  // -1: a root
    std::vector<std::vector<size_t>> children;
};

NodeTree readTree(const File& file)
{
    const size_t count = file.nodes.size();
    NodeTree tree{std::vector<int>(count, -1), std::vector<std::vector<size_t>>(count)};
    for (size_t i = 0; i < count; ++i) {
        const JsonNode children = file.nodes[i]["children"];
        if (!children.exists()) continue;
        for (const JsonNode& index : children.items()) {
            const size_t child = file.index(file.nodes, index);
            if (tree.parents[child] >= 0)
                bad(file.nodes[child].where() + " has two parents, nodes " + std::to_string(tree.parents[child]) + " and " + std::to_string(i));
            tree.parents[child] = int(i);
            tree.children[i].push_back(child);
        }
    }
    // With one parent each, a node that leads to no root is in or below a cycle.
    std::vector<size_t> reached;
    for (size_t i = 0; i < count; ++i)
        if (tree.parents[i] < 0) reached.push_back(i);
    std::vector<bool> seen(count, false);
    for (size_t k = 0; k < reached.size(); ++k) {
        seen[reached[k]] = true;
        reached.insert(reached.end(), tree.children[reached[k]].begin(), tree.children[reached[k]].end());
    }
    const auto missed = std::find(seen.begin(), seen.end(), false);
    if (missed != seen.end()) bad(file.nodes[size_t(missed - seen.begin())].where() + " is in or below a cycle of children");
    return tree;
}

/// The roots of the default scene, else of the first, else all nodes without a parent.
std::vector<size_t> rootNodes(const File& file, const NodeTree& tree)
{
    std::vector<size_t> roots;
    if (file.scenes.empty()) {
        for (size_t i = 0; i < tree.parents.size(); ++i)
            if (tree.parents[i] < 0) roots.push_back(i);
        return roots;
    }
    const JsonNode chosen = file.root()["scene"];
    const JsonNode nodes = (chosen.exists() ? file.at(file.scenes, chosen) : file.scenes[0])["nodes"];
    if (nodes.exists())
        for (const JsonNode& index : nodes.items()) roots.push_back(file.index(file.nodes, index));
    file.check();
    return roots;
}

struct Instance {
    size_t node;
    glm::dmat4 worldFromLocal;
};

/// Where every mesh of the file is shown, parents before children.
std::vector<std::vector<Instance>> placeMeshes(const File& file)
{
    const NodeTree tree = readTree(file);
    std::vector<Instance> placed;
    std::vector<bool> seen(file.nodes.size(), false);
    const auto place = [&](size_t node, const glm::dmat4& parent) {
        if (seen[node]) bad(file.nodes[node].where() + " is twice in the scene");
        seen[node] = true;
        placed.push_back({node, parent * localTransform(file.nodes[node])});
    };
    for (size_t root : rootNodes(file, tree)) place(root, glm::dmat4(1.0));
    for (size_t k = 0; k < placed.size(); ++k)
        for (size_t child : tree.children[placed[k].node]) place(child, glm::dmat4(placed[k].worldFromLocal));

    std::vector<std::vector<Instance>> byMesh(file.meshes.size());
    for (const Instance& instance : placed)
        if (const JsonNode mesh = file.nodes[instance.node]["mesh"]; mesh.exists())
            byMesh[file.index(file.meshes, mesh)].push_back(instance);
    file.check();
    return byMesh;
}

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
          &m.clearcoatTexture, &m.clearcoatRoughnessTexture, &m.clearcoatNormalTexture, &m.transmissionTexture})
        if (*slot && mesh.texcoords[slot->texcoord].empty())
            file.warn(where + " has no TEXCOORD_" + std::to_string(slot->texcoord) + ", which the textures of material " +
                      inQuotes(m.name) + " need: they are sampled at one point");
}

/// Reads, places and repairs every primitive under every node that shows it.
class SceneBuilder {
public:
    SceneBuilder(File& file, MeshScene& scene) : file_(file), scene_(scene) {}

    void addMesh(const JsonNode& mesh, const std::vector<Instance>& instances)
    {
        if (instances.empty()) return;
        const std::string meshName = mesh["name"].exists() ? mesh["name"].string() : "";
        for (const JsonNode& primitive : mesh["primitives"].items()) {
            std::optional<TriangleMesh> local = readPrimitive(file_, primitive, int(file_.materials.size()));
            if (!local) continue;
            for (size_t i = 0; i < instances.size(); ++i) {
                const JsonNode& node = file_.nodes[instances[i].node];
                local->name = node["name"].exists() ? node["name"].string() : meshName;
                file_.check();
                if (i + 1 == instances.size()) {
                    addInstance(std::move(*local), instances[i].worldFromLocal, primitive.where());
                } else {
                    file_.take(local->positions.size(), bytesPerVertex(*local), node.where());
                    file_.take(local->triangles.size(), sizeof(glm::uvec3), node.where());
                    addInstance(TriangleMesh(*local), instances[i].worldFromLocal, primitive.where());
                }
            }
        }
        file_.check();
    }

    void finish()
    {
        if (zeroAreaTriangles_ > 0) file_.warn("dropped: " + std::to_string(zeroAreaTriangles_) + " triangles without area");
        if (zeroNormals_ > 0) file_.warn("replaced by face normals: " + std::to_string(zeroNormals_) + " normals of length 0");
        if (scene_.meshes.empty()) bad("the scene has no triangles");
    }

private:
    static size_t bytesPerVertex(const TriangleMesh& m)
    {
        return sizeof(glm::vec3) * (1 + !m.normals.empty()) + sizeof(glm::vec4) * (size_t(!m.tangents.empty()) + !m.colors.empty()) +
               sizeof(glm::vec2) * (size_t(!m.texcoords[0].empty()) + !m.texcoords[1].empty());
    }

    void addInstance(TriangleMesh mesh, const glm::dmat4& worldFromLocal, const std::string& where)
    {
        if (!transformMesh(mesh, worldFromLocal)) bad(where + ": a position is out of the range of float in the world");
        zeroAreaTriangles_ += dropZeroAreaTriangles(mesh);
        dropUnusedVertices(mesh);
        if (mesh.triangles.empty()) return;
        zeroNormals_ += replaceZeroNormals(mesh);
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

    File& file_;
    MeshScene& scene_;
    size_t zeroAreaTriangles_ = 0, zeroNormals_ = 0;
};

void warnAboutIgnoredParts(File& file)
{
    const auto has = [&](const char* key) { return file.root()[key].firstItem().exists(); };
    if (has("animations")) file.warn("ignored: animations (nodes stay where the file puts them)");
    if (has("skins")) file.warn("ignored: skins (meshes have their bind pose)");
    if (has("cameras")) file.warn("ignored: cameras");
    if (File::extension(file.root(), "KHR_lights_punctual").exists()) file.warn("ignored: lights");
}

MeshScene readOrThrow(std::span<const std::byte> bytes, const UriReader& readUri, uint64_t maxDecodedBytes)
{
    File file(bytes, readUri, maxDecodedBytes);
    MeshScene scene;
    warnAboutIgnoredParts(file);
    readMaterials(file, scene);
    const std::vector<std::vector<Instance>> instances = placeMeshes(file);
    SceneBuilder builder(file, scene);
    for (size_t i = 0; i < file.meshes.size(); ++i) builder.addMesh(file.meshes[i], instances[i]);
    file.check();
    builder.finish();
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
