// Inside the glTF reader: skins (glTF 2.0, section 3.7.3).
#pragma once

#include "interchange/gltf_nodes.h"

#include <vector>

namespace nacre::gltf {

/// Per joint, from the space of the mesh into the world, as the joints stand at rest: joint's node times inverse bind matrix. The node that
/// shows the mesh has no part in it (section 3.7.3.3).
std::vector<glm::dmat4> readJointMatrices(File& file, const JsonNode& skinIndex, const Nodes& nodes);

} // namespace nacre::gltf
