// Tangents for normal maps and anisotropy, for meshes whose file has none.
#pragma once

#include "mesh/mesh_scene.h"

namespace nacre {

/// Fills mesh.tangents from the texture coordinates that `slot` samples (its transform included; without that set: any direction across
/// the normal). glTF's sign: bitangent = cross(normal, tangent) * w, and it points to falling v. A vertex between mirrored halves of a texture is
/// split in two, so that no tangent averages over both.
void makeTangents(TriangleMesh& mesh, const TextureSlot& slot);

} // namespace nacre
