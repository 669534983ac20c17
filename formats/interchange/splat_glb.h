// Splats as plain KHR_gaussian_splatting in a .glb, as any viewer of the extension reads and writes them. Relightable assets: asset/asset_io.h.
#pragma once

#include "base/result.h"
#include "splats/plain_splats.h"

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace nacre {

/// float32 throughout, KHR_gaussian_splatting the only extension and not required: others show coloured points. Deterministic.
/// Error kUnsupported: more splats than a .glb holds.
Result<std::vector<std::byte>> encodeSplatGlb(const PlainSplats& splats);

/// The only splats of a .glb, with the transforms of their nodes applied: in the scene's metres, +Y up. Attributes may be quantised as the
/// extension allows. Any bytes are safe. Errors name the part, or the splat (from 0), at fault.
Result<PlainSplats> decodeSplatGlb(std::span<const std::byte> bytes, const std::string& name);

} // namespace nacre
