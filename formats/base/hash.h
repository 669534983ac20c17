// FNV-1a, 64 bit: for noticing change and damage, not for security.
#pragma once

#include <cstddef>
#include <cstdint>

namespace nacre {

constexpr uint64_t kFnvOffset = 0xcbf29ce484222325ull;

inline uint64_t fnv1a(const void* data, size_t size, uint64_t hash = kFnvOffset)
{
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * 0x100000001b3ull;
    return hash;
}

} // namespace nacre
