#include "train/display_code.h"

#include "base/color.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace nacre {

namespace {

constexpr int kShift = 15;                                       // bits of a float within a cell
constexpr uint32_t kFirst = std::bit_cast<uint32_t>(0x1p-24f);   // below, all is 0: 12.92 * 65535 * 2^-24 < 0.5
constexpr uint32_t kLast = std::bit_cast<uint32_t>(1.0f);

uint16_t slowCode(float x) { return uint16_t(std::lround(65535.0f * srgbFromLinear(x))); }

} // namespace

const DisplayCodes& DisplayCodes::table()
{
    static const DisplayCodes kTable;
    return kTable;
}

DisplayCodes::DisplayCodes() : least_(65537)
{
    uint32_t low = 0; // has a smaller code
    for (uint32_t code = 1; code < 65536; ++code) {
        uint32_t high = kLast;
        while (high - low > 1) {
            const uint32_t middle = low + (high - low) / 2;
            (slowCode(std::bit_cast<float>(middle)) >= code ? high : low) = middle;
        }
        least_[code] = std::bit_cast<float>(high);
    }
    least_[65536] = 2.0f;
    const auto codeAt = [](uint32_t bits) { return 65535.0f * srgbFromLinear(std::bit_cast<float>(bits)); };
    for (uint32_t bits = kFirst; bits <= kLast; bits += 1u << kShift)
        cells_.push_back({codeAt(bits), (codeAt(bits + (1u << kShift)) - codeAt(bits)) / float(1u << kShift)});
}

uint16_t DisplayCodes::operator()(float x) const
{
    if (!(x >= std::bit_cast<float>(kFirst))) return 0; // -0 is 0, too
    const uint32_t bits = std::bit_cast<uint32_t>(x);
    const uint32_t cell = (bits - kFirst) >> kShift, step = (bits - kFirst) & ((1u << kShift) - 1);
    uint32_t code = std::min(uint32_t(cells_[cell].code + cells_[cell].perStep * float(step) + 0.5f), 65535u);
    while (x < least_[code]) --code;
    while (x >= least_[code + 1]) ++code;
    return uint16_t(code);
}

} // namespace nacre
