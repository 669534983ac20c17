// Inside the glTF reader: nodes, from the hierarchy to world transforms.
#pragma once

#include "interchange/gltf_file.h"

#include <glm/glm.hpp>

#include <vector>

namespace nacre::gltf {

struct Nodes {
    std::vector<glm::dmat4> worldFromLocal; // of every node of the file
    std::vector<size_t> shown;              // nodes of the scene that are visible, parents before children
};

/// The default scene, else the first, else all root nodes. Faults: a hierarchy that is no tree, a transform that is none.
Nodes readNodes(File& file);

/// Where a node shows its mesh: once, or as often as EXT_mesh_gpu_instancing says.
std::vector<glm::dmat4> instancesOf(File& file, const JsonNode& node, const glm::dmat4& worldFromNode);

} // namespace nacre::gltf
