// (800 x 800 pixels, 720 x 720 of them stored, one core of two that were busy: 6 ms; by way of floats 18.)
#include "train/packed_reference.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nacre {

namespace {

/// What each stored value of a colour becomes.
struct Colours {
    std::vector<uint16_t> encoded, linear;
};

/// By the functions that it stands for.
Colours tabulate(bool halves)
{
    const int count = halves ? 65536 : 256;
    PackedBlock block;
    block.width = block.columns = count, block.height = block.rows = 1, block.halves = halves;
    std::vector<std::byte> bytes(block.bytes());
    for (int i = 0; i < count; ++i) {
        const uint8_t byte[4] = {uint8_t(i), uint8_t(i), uint8_t(i), 255};
        const uint16_t half[4] = {uint16_t(i), uint16_t(i), uint16_t(i), 0x3c00};
        if (halves) std::memcpy(bytes.data() + 8 * i, half, 8);
        else std::memcpy(bytes.data() + 4 * i, byte, 4);
    }
    const PreparedImage all = prepareImage(decodePixels(block, bytes));
    return {{all.planes.begin(), all.planes.begin() + count}, {all.linear.begin(), all.linear.begin() + count}};
}

struct Rows {
    PreparedImage& image;
    size_t pixels;
    void markUnknown(size_t at)
    {
        if (image.unknown++ == 0) image.known.assign(pixels, 65535);
        image.known[at] = 0;
    }
    template <class Value>
    void setColours(size_t at, const Value* rgb, const Colours& colours)
    {
        for (size_t c = 0; c < 3; ++c) image.planes[c * pixels + at] = colours.encoded[rgb[c]], image.linear[c * pixels + at] = colours.linear[rgb[c]];
    }
    void addBytes(size_t at, const std::byte* from, int count)
    {
        static const Colours kColours = tabulate(false);
        for (int i = 0; i < count; ++i, ++at, from += 4) {
            uint8_t rgba[4];
            std::memcpy(rgba, from, 4);
            if (isUnknown(rgba)) {
                markUnknown(at);
                continue;
            }
            setColours(at, rgba, kColours);
            image.planes[3 * pixels + at] = uint16_t(257 * rgba[3]);
        }
    }
    void addHalves(size_t at, const std::byte* from, int count)
    {
        static const Colours kColours = tabulate(true);
        for (int i = 0; i < count; ++i, ++at, from += 8) {
            uint16_t rgba[4];
            std::memcpy(rgba, from, 8);
            const float alpha = floatFromHalf(rgba[3]);
            if (alpha < 0) {
                markUnknown(at);
                continue;
            }
            setColours(at, rgba, kColours);
            image.planes[3 * pixels + at] = uint16_t(std::lround(65535.0f * std::min(alpha, 1.0f)));
        }
    }
};

} // namespace

PreparedImage preparePacked(const PackedBlock& block, std::span<const std::byte> bytes)
{
    PreparedImage out;
    out.width = block.width, out.height = block.height;
    const size_t pixels = size_t(block.width) * size_t(block.height);
    out.planes.resize(4 * pixels), out.linear.resize(3 * pixels);
    Rows rows{out, pixels};
    for (int row = 0; row < block.rows; ++row) {
        const size_t at = size_t(block.y + row) * size_t(block.width) + size_t(block.x);
        const std::byte* from = bytes.data() + size_t(row) * block.rowBytes();
        if (block.halves) rows.addHalves(at, from, block.columns);
        else rows.addBytes(at, from, block.columns);
    }
    return out;
}

} // namespace nacre
