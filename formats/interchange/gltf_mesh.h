// Inside the glTF reader: primitives of meshes.
#pragma once

#include "interchange/gltf_file.h"

#include <optional>

namespace nacre::gltf {

/// One primitive in the space of its mesh, every index checked, every value finite; normals and tangents as stored. Nothing if it is not made of
/// triangles. `defaultMaterial`: index for primitives without one.
std::optional<TriangleMesh> readPrimitive(File& file, const JsonNode& primitive, int defaultMaterial);

} // namespace nacre::gltf
