// A prepared dataset on disk (`nacre prepare`): pixels that need no decoding, and everything else as one description.
//
//   PACKED/packed.json   the dataset without its pixels; a folder that has it is complete
//   PACKED/pixels.bin    of each image the rectangle outside of which all is background (black, alpha 0), row after row, RGBA:
//                        bytes   sRGB of the premultiplied colour, and alpha; an 8-bit sRGB file without soft edges comes back exactly, else within half a step
//                        halves  linear, premultiplied; within 2^-11 of each value
//   PACKED/maps/         environment maps
//
// A pixel of which nothing is known has alpha -1 as halves; as bytes, white without coverage.
// Blocks are read into memory of one's own, not mapped: a file that is cut while it is read then is an error and no signal, and what has been
// read of it does not count as the memory of the process.
#pragma once

#include "dataset/olat_dataset.h"

#include <atomic>
#include <cstdint>
#include <span>

namespace nacre {

/// Where and how one image is stored.
struct PackedBlock {
    uint64_t offset = 0, hash = 0;           // in pixels.bin; hashOfPixels of the bytes
    int width = 0, height = 0;               // of the whole image
    int x = 0, y = 0, columns = 0, rows = 0; // what of it is stored; may be nothing
    bool halves = false;
    size_t rowBytes() const { return size_t(columns) * (halves ? 8 : 4); }
    size_t bytes() const { return size_t(rows) * rowBytes(); }
};

uint64_t hashOfPixels(std::span<const std::byte> bytes);

/// The stored bytes of an image; `block` gets all but its offset. Values above what the format holds are cut off.
std::vector<std::byte> encodePixels(const Image& image, bool halves, PackedBlock& block);
/// Four bytes that stand for a pixel of which nothing is known.
inline bool isUnknown(const uint8_t* rgba) { return rgba[0] == 255 && rgba[1] == 255 && rgba[2] == 255 && rgba[3] == 0; }
/// A stored half; 0 for NaN and infinity, which encodePixels never stores.
float floatFromHalf(uint16_t half);
/// `bytes`: block.bytes() of them; any are safe.
Image decodePixels(const PackedBlock& block, std::span<const std::byte> bytes);

/// An image that was left out when the dataset was prepared.
struct SkippedImage {
    std::string split, path, why;
};

class PackedImages {
public:
    PackedImages() = default;
    PackedImages(const PackedImages&) = delete;
    PackedImages& operator=(const PackedImages&) = delete;
    ~PackedImages();

    /// Opens the file of pixels.
    Status open(const std::string& path);
    /// The stored bytes of a block; checked against their hash when they are read for the first time. kBadInput if they are damaged. Safe to call
    /// from several threads.
    Result<std::vector<std::byte>> read(size_t index) const;
    Result<Image> load(size_t index) const;

    std::vector<PackedBlock> blocks;   // by OlatImage::packedBlock
    std::vector<SkippedImage> skipped;
    uint64_t sourceState = 0;          // changes with the dataset that was prepared, its files included
    std::vector<uint64_t> development; // of the image of each block, before it was developed: developmentOf

private:
    int file_ = -1;
    std::string path_;
    mutable std::vector<std::atomic<bool>> checked_;
};

/// How the file of an image of the split becomes an image: changes with gain, levels, lens, crop, and whether there are a mask and an ambient image; 0 if
/// nothing is done to it. The same for the file and for what was packed of it.
uint64_t developmentOf(const OlatDataset& dataset, const OlatSplit& split, const OlatImage& image);

/// What packed.json holds: the dataset, blocks and what was skipped.
std::string encodePackedDescription(const OlatDataset& dataset, const PackedImages& packed);
/// Its inverse, without the file of pixels, which has `pixelBytes`. Any text is safe.
Result<OlatDataset> decodePackedDescription(std::span<const std::byte> text, const std::string& folder, uint64_t pixelBytes);

inline constexpr const char *kPackedDescription = "packed.json", *kPackedPixels = "pixels.bin", *kPackedJournal = "journal.bin";

/// A folder that has packed.json, as a dataset.
Result<OlatDataset> loadPacked(const std::string& folder);

} // namespace nacre
