// zlib streams in memory, through stb (png.cpp).
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace nacre {

/// What a whole zlib stream holds. Empty if that is more than `maxBytes` or nothing; nothing if the stream is broken or its checksum is wrong.
/// Any bytes are safe.
std::optional<std::vector<std::byte>> inflateZlib(std::span<const std::byte> zlib, size_t maxBytes);

} // namespace nacre
