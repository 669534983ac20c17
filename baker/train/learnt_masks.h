// Masks of images that came without: what a bake's own splats of the object cover, drawn once it knows where the object is. From then on the bake learns
// from masked images, whose surroundings can neither shine through the object nor be explained by splats before it.
#pragma once

#include "base/byte_stream.h"
#include "train/loss.h"

#include <cstdint>
#include <vector>

namespace nacre {

class LearntMasks {
public:
    explicit LearntMasks(size_t cameras) : masks_(cameras) {}

    /// alpha: [height][width] of a render of nothing but the object.
    void set(size_t camera, int width, int height, const float* alpha);

    /// The image with alpha 1 where the object is, black with alpha 0 where it is not, and unknown in between.
    PreparedImage applied(const PreparedImage& image, size_t camera) const;

    /// Fractions of all pixels.
    struct Shares { double object = 0, unknown = 0; };
    Shares shares() const;

    void save(ByteWriter& out) const;
    /// False if the bytes are not masks of so many cameras.
    bool load(ByteReader& in);

private:
    enum Cell : uint8_t { kBackground, kUnknown, kObject };
    /// Square cells of `size` pixels, four of them a byte: 16 KB a camera at most, whatever its resolution.
    struct Mask {
        int32_t width = 0, height = 0, size = 1;
        std::vector<uint8_t> cells;
        int32_t columns() const { return (width + size - 1) / size; }
        int32_t rows() const { return (height + size - 1) / size; }
        size_t count() const { return size_t(columns()) * size_t(rows()); }
        Cell at(size_t cell) const { return Cell(cells[cell / 4] >> 2 * (cell % 4) & 3); }
    };
    std::vector<Mask> masks_;
};

} // namespace nacre
