// Inside the glTF reader: primitives of meshes.
#pragma once

#include "interchange/gltf_file.h"
#include "mesh/mesh_transform.h"

#include <optional>
#include <span>

namespace nacre::gltf {

struct Primitive {
    TriangleMesh mesh;         // in the space of its mesh; normals and tangents as stored
    SkinInfluences influences; // none if the primitive has no joints
    bool isList = true;        // false: a strip or fan, where triangles without area join its parts
};

/// One primitive, every index checked, every value finite. Nothing if it is not made of triangles. `defaultMaterial`: index for primitives
/// without one.
std::optional<Primitive> readPrimitive(File& file, const JsonNode& primitive, int defaultMaterial);

/// Adds the morph targets of `primitive` to its mesh, each by its weight.
void applyMorphTargets(File& file, const JsonNode& primitive, std::span<const double> weights, TriangleMesh& mesh);

} // namespace nacre::gltf
