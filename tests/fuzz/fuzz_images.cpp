// Any bytes through the EXR, PNG and JPEG decoders: an image that keeps its promises, or an error; never a crash or a huge allocation.
#include "interchange/exr.h"
#include "interchange/jpeg.h"
#include "interchange/png.h"

#include "dataset_file_builders.h"
#include "mesh_jpeg_builder.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <span>

static void check(const nacre::Result<nacre::Image>& image)
{
    if (!image) {
        if (image.error().message.empty() || image.error().message.find('\n') != std::string::npos) std::abort();
        return;
    }
    if (image->width < 1 || image->height < 1 || image->rgba.size() != size_t(image->width) * size_t(image->height) * 4) std::abort();
    for (float v : image->rgba)
        if (!std::isfinite(v)) std::abort();
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
    const auto bytes = std::as_bytes(std::span(data, size));
    check(nacre::decodeExr(bytes, "fuzz.exr"));
    check(nacre::decodePng(bytes, "fuzz.png"));
    const nacre::Result<nacre::Image8> jpeg = nacre::decodeJpeg(bytes, "fuzz.jpg");
    const nacre::Result<nacre::JpegHeader> header = nacre::readJpegHeader(bytes, "fuzz.jpg");
    if (jpeg && (!header || header->width != jpeg->width || header->height != jpeg->height)) std::abort();
    if (header && (header->width < 1 || header->height < 1 || header->orientation < 1 || header->orientation > 8)) std::abort();
    nacre::Bytes repaired(bytes.begin(), bytes.end());
    nacre::repairPngChecksums(repaired);
    check(nacre::decodePng(repaired, "fuzz.png"));
    return 0;
}

extern "C" size_t nacreFuzzSeed(uint8_t* out, size_t cap, unsigned i)
{
    nacre::PngBuilder rgba8, grey16;
    rgba8.rows = {0, 1, 2, 3, 4, 5, 6, 7, 8, 0, 9, 10, 11, 12, 13, 14, 15, 16};
    grey16.bitDepth = 16, grey16.colorType = 0;
    grey16.rows = {0, 0x12, 0x34, 0xff, 0xff, 0, 0x00, 0x01, 0x80, 0x00};
    const nacre::Bytes seeds[] = {nacre::ExrBuilder().build(), nacre::tiledExr(), rgba8.build(), grey16.build(),
                                 nacre::flatJpeg(200, 100, 50), nacre::withSegments(nacre::flatJpeg(1, 2, 3), 6, "Display P3")};
    if (i >= std::size(seeds) || seeds[i].size() > cap) return 0;
    std::copy_n(reinterpret_cast<const uint8_t*>(seeds[i].data()), seeds[i].size(), out);
    return seeds[i].size();
}
