// The binary container of glTF 2.0 (GLB): a 12-byte header, then a chunk of JSON and perhaps one of binary data.
#pragma once

#include "base/result.h"

#include <cstddef>
#include <span>

namespace nacre {

struct GlbChunks { // into the bytes given
    std::span<const std::byte> json;
    std::span<const std::byte> bin; // empty if there is none
};

/// Whether the bytes begin like a GLB ('glTF').
bool looksLikeGlb(std::span<const std::byte> bytes);

/// How many bytes the header of a GLB says it has; 0 if the bytes are too few for a header.
size_t glbLength(std::span<const std::byte> bytes);

/// Any bytes are safe. Errors: kBadInput (lengths that disagree, wrong order of chunks), kUnsupported (another version of GLB).
Result<GlbChunks> splitGlb(std::span<const std::byte> bytes);

} // namespace nacre
