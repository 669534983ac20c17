// Splats that only shine: geometry and one look, as 3DGS .ply files and plain KHR_gaussian_splatting files have them.
#pragma once

#include "splats/splat_asset.h"

namespace nacre {

struct PlainSplats {
    SplatCloud cloud;
    NeutralLook look;                   // of at least one function
    bool srgb = true;                   // colours are encoded as sRGB and blended so; else linear Rec.709
    glm::quat yUpFromSplats{1, 0, 0, 0}; // rotation of the glTF node; a .ply has none
};

} // namespace nacre
