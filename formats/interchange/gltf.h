// glTF 2.0 meshes and materials in: .glb or .gltf with external or embedded buffers and images, Draco, PNG, JPEG.
#pragma once

#include "base/result.h"
#include "mesh/mesh_scene.h"

#include <cstddef>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace nacre {

/// The default scene (or the first, or all root nodes) as triangles in glTF world space (+Y up, metres).
/// Errors kBadInput, one line naming the file and the place in it: not glTF, broken JSON, index or length out of bounds, NaN position,
/// missing buffer or image, required extension that is not supported, damaged Draco data, no triangles.
/// Skins and morph targets are applied at rest: joints and weights as the file has them, without animation.
/// Warnings (MeshScene::warnings) name what is ignored: emissive, animation, unknown extensions, non-triangle primitives, zero-area
/// triangles (dropped, with their number; those of strips and fans are legal and go without a word).
Result<MeshScene> readGltf(const std::string& path);

/// The same from memory; `readUri` fetches external files (relative URI, percent-decoded). Safe for any bytes.
using UriReader = std::function<Result<std::vector<std::byte>>(const std::string& uri)>;
Result<MeshScene> decodeGltf(std::span<const std::byte> bytes, const std::string& name, const UriReader& readUri);

} // namespace nacre
