// Splats as .ply files in the layout of 3D Gaussian splatting (Kerbl et al. 2023), which every trainer writes and every splat viewer reads:
// an element `vertex` with the properties x y z, f_dc_0..2, f_rest_* (channel by channel), opacity (logit), scale_0..2 (natural logarithm),
// rot_0..3 (w x y z).
#pragma once

#include "base/result.h"
#include "splats/plain_splats.h"

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace nacre {

struct PlyFile {
    PlainSplats splats;                // valid; in the file's own axes and units
    std::vector<std::string> warnings; // what had to be mended, one line each
};

/// Whether the bytes begin like a .ply.
bool looksLikePly(std::span<const std::byte> bytes);

/// Reads binary files of both byte orders and text, with numbers of any type in any order; other properties are skipped. Any bytes are safe:
/// the header is bounded and the number of splats is held against the size of the file before anything is allocated. Mended are rotations of
/// length 0 (none), infinite opacities (0 and 1) and scales that are 0 (e^-40). Errors name the header's line or the splat (from 0):
/// kBadInput, and kUnsupported for files whose splats are packed or flat.
Result<PlyFile> decodePly(std::span<const std::byte> bytes);

/// Binary, little-endian, float32, with normals of 0, which some viewers want to find. Opacities of 0 and 1 become logits of -16 and 16.
std::vector<std::byte> encodePly(const PlainSplats& splats);

} // namespace nacre
