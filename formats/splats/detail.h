// How much of an asset is drawn: what a host may leave out to save time and memory, and choices of it that were measured and kept in the file.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace nacre {

/// Parts that an asset can do without; bits of Detail::leaveOut. What an asset does not have anyway may be named.
enum DetailPart : uint32_t {
    kPartVisibility = 1, // maps of what hides lights from a splat: every light arrives
    kPartLobe = 2,       // bigs: mirror-like highlights
    kPartForward = 4,    // bigs: light that shines through
    kPartScatter = 8,    // bigs: s, the part of direct light that depends on light and camera
    kPartIndirect = 16,  // bigs: T_ind, light that has been reflected or has travelled inside
    kPartNetwork = 32,   // sss: light beneath the surface
};
struct DetailPartName {
    uint32_t part;
    const char* name;
};
constexpr DetailPartName kDetailParts[] = {{kPartVisibility, "visibility"}, {kPartLobe, "lobe"},         {kPartForward, "forward"},
                                           {kPartScatter, "scatter"},       {kPartIndirect, "indirect"}, {kPartNetwork, "network"}};
constexpr uint32_t kAllDetailParts = 63;

/// Zero and 1 where it says so: everything.
struct Detail {
    float splats = 1;                // share of them, (0, 1]: the most important ones (appearance/detail.h)
    uint32_t leaveOut = 0;           // DetailPart
    uint32_t transportFunctions = 0; // bigs: most SH functions of T_dir and T_ind: 1, 4, 9, 16; 0: all
    uint32_t visibilitySize = 0;     // most texels per side of visibility maps: 16; 0: as they are
    bool operator==(const Detail&) const = default;
};

/// A measured choice. What the asset cannot decide is advice for the host.
struct Preset {
    std::string name;                // unique in the asset
    Detail detail;
    float resolutionScale = 1;       // draw at so much of the width and height, and enlarge
    uint32_t environmentDirections = 0; // that stand for an environment; 0: as many as without a preset
    double milliseconds = 0, psnrMasked = 0; // of a frame, and dB on held-out images; 0: not measured
    std::string measuredOn;          // machine, renderer, size of the image
    bool operator==(const Preset&) const = default;
};

} // namespace nacre
