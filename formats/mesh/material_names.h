// How options name the materials of a mesh: by name, by "#index", or "*" for all.
#pragma once

#include "base/text.h"
#include "mesh/mesh_scene.h"

#include <algorithm>
#include <string>

namespace nacre {

inline bool namesMaterial(const std::string& filter, const MeshScene& scene, size_t index)
{
    return filter == "*" || filter == scene.materials[index].name || filter == std::string(1, '#').append(std::to_string(index));
}

/// "#0 'wax', #1 'glaze'", at most a dozen: for messages.
inline std::string listMaterials(const MeshScene& scene)
{
    constexpr size_t kMost = 12;
    std::string names;
    for (size_t i = 0; i < std::min(scene.materials.size(), kMost); ++i) {
        if (i > 0) names += ", ";
        names.append("#").append(std::to_string(i));
        if (!scene.materials[i].name.empty()) names.append(" ").append(inQuotes(scene.materials[i].name));
    }
    return scene.materials.empty() ? "none" : scene.materials.size() > kMost ? names.append(", ...") : names;
}

} // namespace nacre
