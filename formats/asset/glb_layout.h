// Names, limits and the position hash shared by the reader and the writer of the asset. Normative text: formats/SPEC.md.
#pragma once

#include "base/hash.h"
#include "base/result.h"
#include "splats/splat_asset.h"

#include <glm/glm.hpp>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <span>
#include <string>
#include <vector>

namespace nacre::glb {

static_assert(std::endian::native == std::endian::little, "glTF is little-endian; this code copies floats as they are");

constexpr const char* kSplatExtension = "KHR_gaussian_splatting";
constexpr const char* kRelightExtension = "NACRE_gaussian_splatting_relight";
constexpr int kRelightVersion = 5, kOldestRelightVersion = 1;
constexpr int kCompactVersion = 5, kFrameVersion = 4, kLeadingVersion = 3, kPlainVersion = 2; // profile compact, with a dataset frame, with channels of leading splats, with neither
constexpr const char *kLosslessProfile = "lossless", *kCompactProfile = "compact", *kInteropProfile = "interop";
constexpr const char *kLinearSpace = "lin_rec709_display", *kSrgbSpace = "srgb_rec709_display";

constexpr const char* kPosition = "POSITION";
constexpr const char* kColor = "COLOR_0";
constexpr const char* kRotation = "KHR_gaussian_splatting:ROTATION";
constexpr const char* kScale = "KHR_gaussian_splatting:SCALE";
constexpr const char* kOpacity = "KHR_gaussian_splatting:OPACITY";

constexpr int kFloat = 5126, kUnorm8 = 5121; // componentType

/// Attribute of SH function i = l*l + l + m.
inline std::string shAttribute(int i)
{
    int degree = 0;
    while ((degree + 1) * (degree + 1) <= i) ++degree;
    return "KHR_gaussian_splatting:SH_DEGREE_" + std::to_string(degree) + "_COEF_" + std::to_string(i - degree * degree);
}

/// FNV-1a 64 over the tightly packed little-endian float32 positions, as 16 lower-case hex digits: tells whether a tool has
/// moved, reordered or dropped splats without knowing about the relighting channels.
inline std::string positionHash(std::span<const glm::vec3> positions)
{
    const uint64_t hash = fnv1a(positions.data(), positions.size_bytes());
    char text[17];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
    return text;
}

/// Attribute `part` of the relighting data `name` in profile interop: four numbers each, fewer in the last.
inline std::string relightAttribute(const std::string& name, size_t part)
{
    std::string text = "_NACRE_";
    for (const char c : name) text += c >= 'a' && c <= 'z' ? char(c - 'a' + 'A') : c;
    text += '_';
    return text += std::to_string(part);
}
/// Of the codes of the group `g` of coded channels.
inline std::string codesName(size_t g) { return "CODES" + std::to_string(g); }
/// Tells that a splat's relighting data are its own: four bytes from what all splats share and its position.
constexpr const char* kStamp = "_NACRE_STAMP";
inline uint32_t stampOf(uint64_t shared, const glm::vec3& position)
{
    const uint64_t hash = fnv1a(&position, sizeof position, shared);
    return uint32_t(hash ^ hash >> 32);
}

/// The asset must be valid.
Result<std::vector<std::byte>> write(const SplatAsset& asset);
/// Profile interop; the look is in sRGB, every channel has rows for all splats, none has bytes.
Result<std::vector<std::byte>> writeInterop(const SplatAsset& asset);

/// The result has the shape the file claims; the values are not validated yet.
Result<SplatAsset> read(std::span<const std::byte> bytes);

} // namespace nacre::glb
