// Node hierarchies (glTF 2.0, section 3.5), KHR_node_visibility and EXT_mesh_gpu_instancing. Transforms are double to the end: a node may lie an
// earth radius from the origin.
#include "interchange/gltf_nodes.h"

#include "interchange/gltf_accessor.h"

#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <cmath>

namespace nacre::gltf {
namespace {

glm::dmat4 compose(const glm::dvec3& translation, const glm::dquat& unitRotation, const glm::dvec3& scale)
{
    glm::dmat4 m = glm::mat4_cast(unitRotation);
    for (int i = 0; i < 3; ++i) m[i] *= scale[i];
    m[3] = glm::dvec4(translation, 1.0);
    return m;
}

/// The last row of a matrix that somebody inverted or multiplied in float is 0 0 0 1 but for rounding: 1e-7 times the condition.
constexpr double kLastRowTolerance = 1e-4;

glm::dmat4 readMatrix(const JsonNode& matrix)
{
    const std::vector<double> v = matrix.numbers(16);
    glm::dmat4 m;
    for (int i = 0; i < 16; ++i) m[i / 4][i % 4] = v[size_t(i)]; // column by column, like GLM
    const glm::dvec4 lastRow(m[0][3], m[1][3], m[2][3], m[3][3]);
    const double off = std::max({std::fabs(lastRow.x), std::fabs(lastRow.y), std::fabs(lastRow.z), std::fabs(lastRow.w - 1.0)});
    if (!(off <= kLastRowTolerance)) {
        const bool transposed = glm::dvec3(m[3]) == glm::dvec3(0.0) && std::fabs(lastRow.w - 1.0) <= kLastRowTolerance;
        matrix.fail("affine matrix, last row 0 0 0 1", transposed ? "a matrix stored row by row; glTF stores columns" : "another last row");
        return glm::dmat4(1.0);
    }
    if (off == 0.0) return m;
    m /= lastRow.w; // as homogeneous coordinates mean it
    for (int i = 0; i < 3; ++i) m[i][3] = 0.0;
    m[3][3] = 1.0;
    return m;
}

glm::dmat4 localTransform(File& file, const JsonNode& node)
{
    if (node["matrix"].exists()) {
        if (node["translation"].exists() || node["rotation"].exists() || node["scale"].exists())
            file.warn(node.where() + " has a matrix and a translation, rotation or scale, which exclude each other: the matrix counts");
        return readMatrix(node["matrix"]);
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
    return compose(translation, rotation, scale);
}

struct NodeTree {
    std::vector<int> parents; // -1: a root
    std::vector<std::vector<size_t>> children;
    std::vector<size_t> order; // parents before children
};

NodeTree readTree(const File& file)
{
    const size_t count = file.nodes.size();
    NodeTree tree{std::vector<int>(count, -1), std::vector<std::vector<size_t>>(count), {}};
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
    for (size_t i = 0; i < count; ++i)
        if (tree.parents[i] < 0) tree.order.push_back(i);
    std::vector<bool> seen(count, false);
    for (size_t k = 0; k < tree.order.size(); ++k) {
        const size_t node = tree.order[k];
        seen[node] = true;
        tree.order.insert(tree.order.end(), tree.children[node].begin(), tree.children[node].end());
    }
    const auto missed = std::find(seen.begin(), seen.end(), false);
    if (missed != seen.end()) bad(file.nodes[size_t(missed - seen.begin())].where() + " is in or below a cycle of children");
    return tree;
}

/// The roots of the default scene, else of the first, else all nodes without a parent.
std::vector<size_t> rootNodes(File& file, const NodeTree& tree)
{
    std::vector<size_t> roots;
    if (file.scenes.empty()) {
        for (size_t i = 0; i < tree.parents.size(); ++i)
            if (tree.parents[i] < 0) roots.push_back(i);
        return roots;
    }
    const JsonNode chosen = file.root()["scene"];
    if (!chosen.exists() && file.scenes.size() > 1)
        file.warn("the file has " + std::to_string(file.scenes.size()) + " scenes and does not say which is the default: the first is read");
    const JsonNode nodes = (chosen.exists() ? file.at(file.scenes, chosen) : file.scenes[0])["nodes"];
    if (nodes.exists())
        for (const JsonNode& index : nodes.items()) roots.push_back(file.index(file.nodes, index));
    file.check();
    return roots;
}

/// KHR_node_visibility hides a node with everything below it.
bool isVisible(const JsonNode& node)
{
    const JsonNode visible = File::extension(node, "KHR_node_visibility")["visible"];
    return !visible.exists() || visible.boolean();
}

} // namespace

Nodes readNodes(File& file)
{
    const NodeTree tree = readTree(file);
    Nodes nodes;
    nodes.worldFromLocal.resize(file.nodes.size());
    for (const size_t i : tree.order) {
        const glm::dmat4 local = localTransform(file, file.nodes[i]);
        nodes.worldFromLocal[i] = tree.parents[i] < 0 ? local : nodes.worldFromLocal[size_t(tree.parents[i])] * local;
    }

    std::vector<bool> seen(file.nodes.size(), false);
    std::vector<size_t> hidden;
    const auto reach = [&](size_t node, bool shown) {
        if (seen[node]) bad(file.nodes[node].where() + " is twice in the scene");
        seen[node] = true;
        (shown && isVisible(file.nodes[node]) ? nodes.shown : hidden).push_back(node);
    };
    for (const size_t root : rootNodes(file, tree)) reach(root, true);
    for (size_t k = 0; k < nodes.shown.size(); ++k)
        for (const size_t child : tree.children[nodes.shown[k]]) reach(child, true);
    for (size_t k = 0; k < hidden.size(); ++k)
        for (const size_t child : tree.children[hidden[k]]) reach(child, false);
    file.check();
    return nodes;
}

std::vector<glm::dmat4> instancesOf(File& file, const JsonNode& node, const glm::dmat4& worldFromNode)
{
    const JsonNode extension = File::extension(node, "EXT_mesh_gpu_instancing");
    if (!extension.exists()) return {worldFromNode};
    const JsonNode attributes = extension["attributes"];
    constexpr size_t kUnknown = SIZE_MAX;
    size_t count = kUnknown;
    const auto accessorOf = [&](const char* name) {
        const Accessor a = readAccessor(file, attributes[name]);
        if (count != kUnknown && a.count != count)
            bad(attributes.where() + " has " + std::to_string(count) + " instances, but " + name + " (" + a.where + ") has " + std::to_string(a.count));
        count = a.count;
        return a;
    };
    std::vector<glm::vec3> translations, scales;
    std::vector<glm::vec4> rotations;
    if (attributes["TRANSLATION"].exists()) translations = readVectors<3>(file, accessorOf("TRANSLATION"));
    if (attributes["ROTATION"].exists()) rotations = readVectors<4>(file, accessorOf("ROTATION"));
    if (attributes["SCALE"].exists()) scales = readVectors<3>(file, accessorOf("SCALE"));
    file.check();
    if (count == kUnknown) bad(extension.where() + " has none of TRANSLATION, ROTATION and SCALE");

    file.take(count, sizeof(glm::dmat4), extension.where());
    std::vector<glm::dmat4> out;
    for (size_t i = 0; i < count; ++i) {
        glm::dquat rotation(1, 0, 0, 0);
        if (!rotations.empty()) {
            rotation = glm::dquat(double(rotations[i].w), double(rotations[i].x), double(rotations[i].y), double(rotations[i].z));
            const double length = glm::length(rotation);
            if (!(length > 1e-6) || !std::isfinite(length)) bad(attributes.where() + ".ROTATION: element " + std::to_string(i) + " is no rotation");
            rotation /= length;
        }
        out.push_back(worldFromNode * compose(translations.empty() ? glm::dvec3(0.0) : glm::dvec3(translations[i]), rotation,
                                              scales.empty() ? glm::dvec3(1.0) : glm::dvec3(scales[i])));
    }
    return out;
}

} // namespace nacre::gltf
