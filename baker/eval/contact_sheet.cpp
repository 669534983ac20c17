#include "eval/contact_sheet.h"

#include "base/color.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace nacre {

constexpr int kSeparator = 2; // pixels
constexpr uint8_t kSeparatorGrey = 96;
constexpr float kErrorGain = 4.0f;

static float display(float linear) { return srgbFromLinear(std::clamp(linear, 0.0f, 1.0f)); }
static uint8_t byteFrom(float unit) { return uint8_t(std::lround(255.0f * std::clamp(unit, 0.0f, 1.0f))); }

static Picture blank(int width, int height, uint8_t grey)
{
    return {width, height, std::vector<uint8_t>(size_t(3) * width * height, grey)};
}

/// Every channel value from the value of the same pixel and channel of two images.
template <class F>
static Picture map(const Image& a, const Image& b, F value)
{
    assert(a.width == b.width && a.height == b.height);
    Picture out = blank(a.width, a.height, 0);
    for (size_t i = 0; i < size_t(a.width) * a.height; ++i)
        for (size_t c = 0; c < 3; ++c) out.rgb[3 * i + c] = byteFrom(value(a.rgba[4 * i + c], b.rgba[4 * i + c]));
    return out;
}

Picture displayPicture(const Image& linear)
{
    return map(linear, linear, [](float a, float) { return display(a); });
}

Picture contactRow(const Image& reference, const Image& render)
{
    const Picture parts[] = {displayPicture(reference), displayPicture(render),
                             map(reference, render, [](float a, float b) { return kErrorGain * std::abs(display(a) - display(b)); })};
    return tile(parts, 3);
}

Picture tile(std::span<const Picture> pictures, int columns)
{
    int cellWidth = 0, cellHeight = 0;
    for (const Picture& p : pictures) {
        cellWidth = std::max(cellWidth, p.width);
        cellHeight = std::max(cellHeight, p.height);
    }
    columns = std::max(1, std::min(columns, int(pictures.size())));
    const int rows = (int(pictures.size()) + columns - 1) / columns;
    if (rows == 0) return {};
    Picture out = blank(columns * (cellWidth + kSeparator) - kSeparator, rows * (cellHeight + kSeparator) - kSeparator, kSeparatorGrey);
    for (size_t i = 0; i < pictures.size(); ++i) {
        const Picture& p = pictures[i];
        const int x = int(i) % columns * (cellWidth + kSeparator), y = int(i) / columns * (cellHeight + kSeparator);
        for (int row = 0; row < p.height; ++row)
            std::copy_n(&p.rgb[size_t(3) * p.width * row], size_t(3) * p.width, &out.rgb[3 * (size_t(out.width) * (y + row) + x)]);
    }
    return out;
}

} // namespace nacre
