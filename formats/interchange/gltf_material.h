// Inside the glTF reader: materials, textures and images.
#pragma once

#include "interchange/gltf_file.h"

namespace nacre::gltf {

/// Fills scene.materials, one per material of the file in its order, and scene.textures with what they use.
void readMaterials(File& file, MeshScene& scene);

} // namespace nacre::gltf
