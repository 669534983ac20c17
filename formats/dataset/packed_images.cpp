#include "dataset/packed_images.h"

#include "base/color.h"
#include "base/half.h"
#include "base/hash.h"
#include "base/text.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <system_error>
#include <unistd.h>

namespace nacre {
namespace {

constexpr int kMargin = 4;                  // pixels around what is not empty
constexpr float kHalfDisplayStep = 1.5e-4f; // darker than this is black on an 8-bit display

/// The sRGB byte nearest to a linear value as displayed.
class SrgbBytes {
public:
    SrgbBytes()
    {
        for (int k = 1; k < 256; ++k) least_[size_t(k)] = float(linearFromSrgb((k - 0.5) / 255.0));
        least_[0] = -1, least_[256] = 2;
        for (size_t i = 0, code = 0; i < begin_.size(); ++i) {
            while (least_[code + 1] <= float(i) / kCells) ++code;
            begin_[i] = uint8_t(code);
        }
    }
    /// A cell is narrower than the distance of two bounds (12.92 * 255 / 4096 < 1), so it contains one at most.
    uint8_t operator()(float linear) const
    {
        const float x = linear > 0 ? std::min(linear, 1.0f) : 0.0f; // NaN is 0
        const uint8_t code = begin_[size_t(x * kCells)];
        return uint8_t(code + (x >= least_[code + 1u]));
    }

private:
    static constexpr float kCells = 4096;
    std::array<float, 257> least_{};
    std::array<uint8_t, size_t(kCells) + 1> begin_{};
};

const std::array<float, 256>& linearOfBytes()
{
    static const std::array<float, 256> kTable = [] {
        std::array<float, 256> t{};
        for (size_t i = 0; i < t.size(); ++i) t[i] = float(linearFromSrgb(double(257 * i) / 65535.0)); // as of PNG files
        return t;
    }();
    return kTable;
}

// What is unknown may be the object: too bright for its file.
bool isEmpty(const float* rgba) { return rgba[3] == 0.0f && std::max({rgba[0], rgba[1], rgba[2]}) <= kHalfDisplayStep; }

/// Columns [x, x + columns) and rows [y, y + rows) outside of which all pixels are empty.
void findRectangle(const Image& image, PackedBlock& block)
{
    int left = image.width, right = -1, top = image.height, bottom = -1;
    for (int y = 0; y < image.height; ++y) {
        const float* row = image.pixel(0, y);
        int first = 0, last = image.width - 1;
        while (first <= last && isEmpty(row + 4 * first)) ++first;
        if (first > last) continue;
        while (isEmpty(row + 4 * last)) --last;
        left = std::min(left, first), right = std::max(right, last), top = std::min(top, y), bottom = y;
    }
    if (bottom < 0) return;
    block.x = std::max(left - kMargin, 0), block.columns = std::min(right + 1 + kMargin, image.width) - block.x;
    block.y = std::max(top - kMargin, 0), block.rows = std::min(bottom + 1 + kMargin, image.height) - block.y;
}

void encodeRow(const float* from, int count, uint8_t* to)
{
    static const SrgbBytes kBytes;
    for (int i = 0; i < count; ++i, from += 4, to += 4) {
        if (from[3] < 0) {
            to[0] = to[1] = to[2] = 255, to[3] = 0;
            continue;
        }
        for (int c = 0; c < 3; ++c) to[c] = kBytes(from[c]);
        to[3] = uint8_t(std::min(from[3], 1.0f) * 255.0f + 0.5f);
        if (isUnknown(to)) to[0] = 254; // light without coverage, off the scale
    }
}

void encodeRow(const float* from, int count, uint16_t* to)
{
    for (int i = 0; i < 4 * count; ++i) to[i] = halfFromFloat(std::isfinite(from[i]) ? std::clamp(from[i], -kMaxHalf, kMaxHalf) : 0.0f);
}

void decodeRow(const std::byte* from, int count, bool halves, float* to)
{
    if (halves) {
        for (int i = 0; i < 4 * count; ++i) {
            uint16_t h;
            std::memcpy(&h, from + 2 * i, 2);
            to[i] = floatFromHalf(h);
        }
        for (int i = 0; i < count; ++i) to[4 * i + 3] = to[4 * i + 3] < 0 ? kUnknownAlpha : std::min(to[4 * i + 3], 1.0f);
        return;
    }
    const std::array<float, 256>& table = linearOfBytes();
    const auto* bytes = reinterpret_cast<const uint8_t*>(from);
    for (int i = 0; i < count; ++i, bytes += 4, to += 4) {
        if (isUnknown(bytes)) {
            to[3] = kUnknownAlpha;
            continue;
        }
        for (int c = 0; c < 3; ++c) to[c] = table[bytes[c]];
        to[3] = float(bytes[3]) / 255.0f;
    }
}

} // namespace

float floatFromHalf(uint16_t half)
{
    static const std::vector<float> kTable = [] {
        std::vector<float> t(65536);
        for (uint32_t h = 0; h < t.size(); ++h) {
            const uint32_t exponent = h >> 10 & 31u, mantissa = h & 1023u;
            const float magnitude = exponent == 31 ? 0.0f : exponent == 0 ? std::ldexp(float(mantissa), -24) : std::ldexp(float(1024 + mantissa), int(exponent) - 25);
            t[h] = h & 0x8000u ? -magnitude : magnitude;
        }
        return t;
    }();
    return kTable[half];
}

// Four sums side by side, for speed: each step is a bijection of its sum, so no change of one byte goes unnoticed.
uint64_t hashOfPixels(std::span<const std::byte> bytes)
{
    constexpr uint64_t kPrime = 0x9e3779b97f4a7c15ull;
    uint64_t lanes[4] = {1, 2, 3, 4}, tail[4] = {};
    const auto add = [&](const uint64_t* words) {
        for (int k = 0; k < 4; ++k) lanes[k] = (lanes[k] ^ words[k]) * kPrime, lanes[k] ^= lanes[k] >> 29;
    };
    size_t at = 0;
    for (uint64_t words[4]; at + 32 <= bytes.size(); at += 32) std::memcpy(words, bytes.data() + at, 32), add(words);
    if (at < bytes.size()) std::memcpy(tail, bytes.data() + at, bytes.size() - at), add(tail);
    uint64_t hash = bytes.size();
    for (const uint64_t lane : lanes) hash = (hash ^ lane) * kPrime, hash ^= hash >> 32;
    return hash;
}

std::vector<std::byte> encodePixels(const Image& image, bool halves, PackedBlock& block)
{
    block = {};
    block.width = image.width, block.height = image.height, block.halves = halves;
    findRectangle(image, block);
    std::vector<std::byte> bytes(block.bytes());
    for (int row = 0; row < block.rows; ++row) {
        const float* from = image.pixel(block.x, block.y + row);
        std::byte* to = bytes.data() + size_t(row) * block.rowBytes();
        if (halves) encodeRow(from, block.columns, reinterpret_cast<uint16_t*>(to));
        else encodeRow(from, block.columns, reinterpret_cast<uint8_t*>(to));
    }
    block.hash = hashOfPixels(bytes);
    return bytes;
}

Image decodePixels(const PackedBlock& block, std::span<const std::byte> bytes)
{
    assert(bytes.size() == block.bytes());
    Image image{block.width, block.height, std::vector<float>(size_t(block.width) * size_t(block.height) * 4)};
    for (int row = 0; row < block.rows; ++row)
        decodeRow(bytes.data() + size_t(row) * block.rowBytes(), block.columns, block.halves, image.pixel(block.x, block.y + row));
    return image;
}

uint64_t developmentOf(const OlatDataset& dataset, const OlatSplit& split, const OlatImage& image)
{
    if (dataset.packed) return image.packedBlock < dataset.packed->development.size() ? dataset.packed->development[image.packedBlock] : 0;
    uint64_t hash = kFnvOffset;
    const auto add = [&](const auto&... x) { ((hash = fnv1a(&x, sizeof x, hash)), ...); };
    if (dataset.blackLevel != 0 || dataset.whiteLevel != 0) add(dataset.blackLevel, dataset.whiteLevel);
    if (!split.files.empty()) {
        const FileCamera& f = split.files[image.camera];
        add(f.width, f.height, f.fx, f.fy, f.cx, f.cy, f.k, f.p);
    }
    if (image.gain != glm::vec3(1.0f) || !image.maskPath.empty() || !image.ambientPath.empty())
        add(image.gain, uint8_t(!image.maskPath.empty() + 2 * !image.ambientPath.empty()));
    return hash == kFnvOffset ? 0 : hash;
}

PackedImages::~PackedImages()
{
    if (file_ >= 0) ::close(file_);
}

Status PackedImages::open(const std::string& path)
{
    path_ = path;
    file_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file_ < 0) return Error{ErrorCode::kBadInput, "cannot read '" + path + "': " + std::generic_category().message(errno)};
    checked_ = std::vector<std::atomic<bool>>(blocks.size());
    return ok();
}

Result<std::vector<std::byte>> PackedImages::read(size_t index) const
{
    assert(index < blocks.size());
    const PackedBlock& block = blocks[index];
    std::vector<std::byte> bytes(block.bytes());
    for (size_t done = 0; done < bytes.size();) {
        const ssize_t n = ::pread(file_, bytes.data() + done, bytes.size() - done, off_t(block.offset + done));
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0)
            return Error{ErrorCode::kBadInput, "cannot read '" + path_ + "': " +
                                                   (n < 0 ? std::generic_category().message(errno) : "it has become shorter") + "; prepare the dataset again"};
        done += size_t(n);
    }
    if (!checked_[index].load(std::memory_order_relaxed)) {
        if (hashOfPixels(bytes) != block.hash)
            return Error{ErrorCode::kBadInput, path_ + ": damaged: the checksum of block " + std::to_string(index) + ", at byte " +
                                                   std::to_string(block.offset) + ", differs; prepare the dataset again"};
        checked_[index].store(true, std::memory_order_relaxed);
    }
    return bytes;
}

Result<Image> PackedImages::load(size_t index) const
{
    const auto bytes = read(index);
    if (!bytes) return bytes.error();
    return decodePixels(blocks[index], *bytes);
}

} // namespace nacre
