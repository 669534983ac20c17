#include "train/learnt_masks.h"

#include <algorithm>

namespace nacre {

// Half-learnt splats of an object are transparent to a fifth, and a rim that moves by a pixel must not be cut off. (What lies in between is nobody's.)
constexpr float kObjectAlpha = 0.6f, kBackgroundAlpha = 0.3f;
constexpr int32_t kMostCells = 256; // a side

void LearntMasks::set(size_t camera, int width, int height, const float* alpha)
{
    Mask& mask = masks_[camera];
    mask.width = width, mask.height = height, mask.size = (std::max(width, height) + kMostCells - 1) / kMostCells;
    mask.cells.assign((mask.count() + 3) / 4, 0);
    for (size_t cell = 0; cell < mask.count(); ++cell) {
        const int x0 = int(cell % size_t(mask.columns())) * mask.size, y0 = int(cell / size_t(mask.columns())) * mask.size;
        float least = 1, most = 0;
        for (int y = y0; y < std::min(y0 + mask.size, height); ++y)
            for (int x = x0; x < std::min(x0 + mask.size, width); ++x) {
                const float a = alpha[size_t(y) * size_t(width) + size_t(x)];
                least = std::min(least, a), most = std::max(most, a);
            }
        const Cell found = least > kObjectAlpha ? kObject : most < kBackgroundAlpha ? kBackground : kUnknown;
        mask.cells[cell / 4] |= uint8_t(found << 2 * (cell % 4));
    }
}

PreparedImage LearntMasks::applied(const PreparedImage& image, size_t camera) const
{
    const Mask& mask = masks_[camera];
    if (mask.cells.empty() || mask.width != image.width || mask.height != image.height) return image;
    PreparedImage out = image;
    out.id = PreparedImage::newId();
    const size_t width = size_t(image.width), pixels = width * size_t(image.height);
    if (out.known.empty()) out.known.assign(pixels, 65535);
    out.unknown = 0;
    for (size_t i = 0; i < pixels; ++i) {
        const Cell cell = mask.at(i / width / size_t(mask.size) * size_t(mask.columns()) + i % width / size_t(mask.size));
        if (cell == kUnknown) out.known[i] = 0;
        if (out.known[i] == 0) ++out.unknown;
        if (cell == kObject && out.known[i]) continue;
        for (size_t c = 0; c < 4; ++c) out.planes[c * pixels + i] = 0;
        for (size_t c = 0; c < 3; ++c) out.linear[c * pixels + i] = 0;
    }
    return out;
}

LearntMasks::Shares LearntMasks::shares() const
{
    Shares s;
    double all = 0;
    for (const Mask& mask : masks_)
        for (size_t cell = 0; cell < mask.count(); ++cell) {
            const double weight = double(mask.size) * mask.size;
            all += weight, s.object += weight * (mask.at(cell) == kObject), s.unknown += weight * (mask.at(cell) == kUnknown);
        }
    if (all > 0) s.object /= all, s.unknown /= all;
    return s;
}

void LearntMasks::save(ByteWriter& out) const
{
    for (const Mask& mask : masks_) out.value(mask.width), out.value(mask.height), out.value(mask.size), out.array(mask.cells);
}

bool LearntMasks::load(ByteReader& in)
{
    constexpr int32_t kMostPixels = 1 << 16; // a side
    for (Mask& mask : masks_) {
        mask.width = in.value<int32_t>(), mask.height = in.value<int32_t>(), mask.size = in.value<int32_t>();
        in.array(mask.cells);
        if (in.failed || mask.width < 0 || mask.width > kMostPixels || mask.height < 0 || mask.height > kMostPixels || mask.size < 1 || mask.size > kMostPixels ||
            mask.cells.size() != (mask.count() + 3) / 4)
            return false;
    }
    return true;
}

} // namespace nacre
