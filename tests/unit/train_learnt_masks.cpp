// Masks that a bake draws from its own splats.
#include "train/learnt_masks.h"

#include <doctest/doctest.h>

using namespace nacre;

namespace {

PreparedImage grey(int width, int height)
{
    Image image{width, height, std::vector<float>(4 * size_t(width) * size_t(height), 0.5f)};
    for (size_t i = 3; i < image.rgba.size(); i += 4) image.rgba[i] = 1;
    image.rgba[3] = -1; // the first pixel: nobody knows
    return prepareImage(image);
}

} // namespace

TEST_CASE("learnt masks keep the object, black out its surroundings and leave what is in between open")
{
    for (const int width : {40, 700}) { // cells of one pixel, and of three
        const int height = 30;
        const size_t pixels = size_t(width) * size_t(height);
        std::vector<float> alpha(pixels);
        for (size_t i = 0; i < pixels; ++i) {
            const int x = int(i % size_t(width));
            alpha[i] = x < width / 3 ? 0.9f : x < width / 2 ? 0.45f : 0.1f;
        }
        LearntMasks masks(2);
        masks.set(1, width, height, alpha.data());
        const PreparedImage image = grey(width, height), masked = masks.applied(image, 1);
        CHECK(masks.applied(image, 0).planes == image.planes); // a camera without a mask
        CHECK(masks.applied(grey(width + 1, height), 1).planes == grey(width + 1, height).planes); // that of another size
        CHECK_FALSE(masked.isKnown(0));
        size_t unknown = 0;
        for (size_t i = 1; i < pixels; ++i) {
            const int x = int(i % size_t(width)), slack = width > 256 ? 3 : 0; // cells on a border are open
            unknown += !masked.isKnown(i);
            if (x < width / 3 - slack) {
                CHECK(masked.isKnown(i));
                for (size_t c = 0; c < 4; ++c) CHECK(masked.planes[c * pixels + i] == image.planes[c * pixels + i]);
            } else if (x >= width / 2 + slack) {
                CHECK(masked.isKnown(i));
                for (size_t c = 0; c < 4; ++c) CHECK(masked.planes[c * pixels + i] == 0);
            } else if (x >= width / 3 + slack && x < width / 2 - slack) {
                CHECK_FALSE(masked.isKnown(i));
            }
        }
        CHECK(masked.unknown == unknown + 1);
        const LearntMasks::Shares shares = masks.shares();
        CHECK(shares.object == doctest::Approx(1.0 / 3).epsilon(0.05));
        CHECK(shares.unknown == doctest::Approx(1.0 / 6).epsilon(0.1));

        ByteWriter out;
        masks.save(out);
        ByteReader in(out.bytes);
        LearntMasks again(2);
        REQUIRE(again.load(in));
        CHECK(in.remaining() == 0);
        CHECK(again.applied(image, 1).planes == masked.planes);
        for (size_t cut = 0; cut < out.bytes.size(); cut += 7) {
            ByteReader cutOff(std::span(out.bytes).first(cut));
            CHECK_FALSE(LearntMasks(2).load(cutOff));
        }
    }
}
