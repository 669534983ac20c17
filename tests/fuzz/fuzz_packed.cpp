// Any bytes as the description of a packed dataset, and as its pixels: a dataset that keeps its promises, or an error of one line.
#include "dataset/packed_images.h"
#include "dataset_promises.h"

#include <algorithm>
#include <cstring>

using namespace nacre;

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
    const auto bytes = std::as_bytes(std::span(data, size));
    const auto dataset = decodePackedDescription(bytes, "fuzz", 4096);
    if (!dataset) {
        requireLine(dataset.error());
        return 0;
    }
    std::vector<std::byte> pixels(4096);
    for (size_t i = 0; i < pixels.size(); ++i) pixels[i] = bytes[i % size];
    for (const OlatSplit& split : dataset->splits)
        for (const OlatImage& image : split.images) {
            require(image.camera < split.cameras.size() && image.packedBlock < dataset->packed->blocks.size());
            const PackedBlock& block = dataset->packed->blocks[image.packedBlock];
            const Camera& camera = split.cameras[image.camera];
            require(block.width == camera.width && block.height == camera.height && block.offset + block.bytes() <= pixels.size());
            if (size_t(block.width) * size_t(block.height) > 1 << 16) continue; // allowed, but slow
            const Image decoded = decodePixels(block, std::span(pixels).subspan(block.offset, block.bytes()));
            for (size_t i = 0; i < decoded.rgba.size(); ++i)
                require(std::isfinite(decoded.rgba[i]) && (i % 4 != 3 || decoded.rgba[i] == kUnknownAlpha || (decoded.rgba[i] >= 0 && decoded.rgba[i] <= 1)));
        }
    return 0;
}

extern "C" size_t nacreFuzzSeed(uint8_t* out, size_t cap, unsigned i)
{
    if (i > 1) return 0;
    OlatDataset dataset;
    dataset.convention = "canonical";
    OlatSplit& split = dataset.splits.emplace_back();
    split.name = "train";
    Camera camera;
    camera.width = 8, camera.height = 6, camera.fx = camera.fy = 9, camera.cx = 4, camera.cy = 3;
    split.cameras = {camera};
    PackedImages packed;
    for (int k = 0; k < 2; ++k) {
        OlatImage image{0, {}, "a.png"};
        image.packedBlock = uint32_t(k);
        PackedBlock block;
        Image pixels{8, 6, std::vector<float>(8 * 6 * 4, 0.5f)};
        block.offset = k * encodePixels(pixels, i == 1, block).size();
        packed.blocks.push_back(block);
        split.images.push_back(image);
    }
    packed.skipped = {{"train", "b.png", "b.png: black"}};
    const std::string text = encodePackedDescription(dataset, packed);
    if (text.size() > cap) return 0;
    std::memcpy(out, text.data(), text.size());
    return text.size();
}
