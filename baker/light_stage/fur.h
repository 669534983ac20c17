// Grows hair-like fibres on the surface of a mesh.
#pragma once

#include "base/result.h"
#include "light_stage/hair_strands.h"
#include "mesh/mesh_scene.h"

#include <cstddef>
#include <cstdint>
#include <string>

namespace nacre {

/// Lengths are in the units of the mesh's positions (metres in a glTF file), densities per square of them.
struct FurSettings {
    float density = 0.0f;         // strands per unit of area; required
    float length = 0.0f;          // of the longest strand, along its curve; required
    float radius = 0.0f;          // at the root; required, below the length
    std::string material;         // grow on triangles of this material only: name or "#index"; empty or "*": on all
    float lengthVariation = 0.3f; // lengths are uniform in [1 - this, 1] * length; [0, 1)
    float tipRadius = 0.15f;      // radius at the tip over radius at the root; [0, 1]
    float lean = 0.6f;            // how far tips lean from the normal towards the ground (-Y) and into slow waves; [0, 1]
    float disorder = 0.25f;       // how far each strand strays on its own; [0, 1]
    float clump = 0.35f;          // how far tips are drawn together into tufts, half a length apart; [0, 1]
    uint64_t seed = 0;
};

/// 76 bytes each here; with its ray acceleration structure the renderer holds about 185 (measured).
constexpr size_t kMaxFurStrands = 4'000'000;

/// One cubic segment per strand, tapering to the tip. Roots lie on the triangles (on their front), evenly by area: a region of area A holds
/// density * A strands, give or take a few. A strand has the material's base colour (factor, texture, COLOR_0) at its root; none grows
/// where an alpha mask cuts the surface away. Triangles without area are passed over. Same settings and mesh: same strands.
/// Errors kBadInput, one line: a setting out of range, a material that does not exist, no area, no or more than kMaxFurStrands strands.
Result<HairStrands> growFur(const MeshScene& mesh, const FurSettings& settings);

} // namespace nacre
