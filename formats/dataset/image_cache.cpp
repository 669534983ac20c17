// Images on demand: decode, convert to linear premultiplied, check, keep the most recently used within a byte budget.
//
// Conversion, by the flags of the dataset:
//   linear, premultiplied       as stored
//   linear, straight            rgb * a
//   sRGB, premultiplied         linearFromSrgb(rgb)       the file holds the encoded premultiplied colour; checked on SSS-GS
//                               files against EXRs of the same renders: soft edges agree to 5e-4 rms, 0.07 if divided by alpha first
//   sRGB, straight              linearFromSrgb(rgb) * a
// The budget covers what the cache keeps. An image that alone exceeds it is loaded and handed out but not kept.
// Decoding runs outside the lock: threads that miss the same image may both decode it, and the first result is kept.
#include "dataset/olat_dataset.h"

#include "base/color.h"
#include "interchange/exr.h"
#include "interchange/png.h"

#include <cmath>
#include <list>
#include <mutex>
#include <unordered_map>

namespace nacre {
namespace {

constexpr float kAlphaSlack = 1e-3f; // half-float and lossy compression round; within this alpha is clamped to [0, 1]

bool isPng(const std::string& path)
{
    const size_t n = path.size();
    return n >= 4 && path[n - 4] == '.' && (path[n - 3] | 32) == 'p' && (path[n - 2] | 32) == 'n' && (path[n - 1] | 32) == 'g';
}

/// Exact for 8-bit values (k/255 = 257k/65535) and 16-bit ones.
const std::vector<float>& linearFromSrgbTable()
{
    static const std::vector<float> kTable = [] {
        std::vector<float> t(65536);
        for (size_t i = 0; i < t.size(); i++) t[i] = float(linearFromSrgb(double(i) / 65535.0));
        return t;
    }();
    return kTable;
}

Status convert(Image& image, ColorSpace colorSpace, bool premultiplied, const std::string& path)
{
    const std::vector<float>& table = linearFromSrgbTable();
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        float* p = image.rgba.data() + i;
        if (!(p[3] >= -kAlphaSlack && p[3] <= 1.0f + kAlphaSlack)) {
            const size_t pixel = i / 4, w = size_t(image.width);
            return Error{ErrorCode::kBadInput, path + ": alpha " + std::to_string(p[3]) + " at pixel (" + std::to_string(pixel % w) + ", " +
                                                   std::to_string(pixel / w) + "), expected 0 to 1"};
        }
        p[3] = std::fmin(std::fmax(p[3], 0.0f), 1.0f);
        for (int c = 0; c < 3; c++) {
            if (colorSpace == ColorSpace::kSrgb) p[c] = table[size_t(std::lround(p[c] * 65535.0f))]; // PNG values are in [0, 1]
            if (!premultiplied) p[c] *= p[3];
        }
    }
    return ok();
}

Image shrunk(const Image& image, int by)
{
    Image out{image.width / by, image.height / by, {}};
    out.rgba.resize(size_t(4) * out.width * out.height);
    const float weight = 1.0f / float(by * by);
    for (int y = 0; y < out.height * by; ++y)
        for (int x = 0; x < out.width * by; ++x)
            for (int c = 0; c < 4; ++c) out.pixel(x / by, y / by)[c] += weight * image.pixel(x, y)[c];
    return out;
}

} // namespace

OlatDataset halved(OlatDataset dataset)
{
    dataset.shrink *= 2;
    for (OlatSplit& split : dataset.splits)
        for (Camera& camera : split.cameras) {
            camera.width /= 2, camera.height /= 2;
            for (double* length : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *length /= 2;
        }
    return dataset;
}

struct ImageCache::State {
    struct Entry {
        std::string path;
        std::shared_ptr<const Image> image;
    };
    ColorSpace colorSpace;
    bool premultiplied;
    int shrink;
    size_t budgetBytes;

    mutable std::mutex mutex; // guards everything below
    std::list<Entry> recent;  // most recently used first
    std::unordered_map<std::string, std::list<Entry>::iterator> entryOfPath;
    size_t residentBytes = 0;

    std::shared_ptr<const Image> find(const std::string& path)
    {
        const auto it = entryOfPath.find(path);
        if (it == entryOfPath.end()) return nullptr;
        recent.splice(recent.begin(), recent, it->second);
        return it->second->image;
    }

    void keep(const std::string& path, std::shared_ptr<const Image> image)
    {
        const size_t bytes = bytesOf(*image);
        if (bytes > budgetBytes) return;
        while (residentBytes + bytes > budgetBytes) {
            residentBytes -= bytesOf(*recent.back().image);
            entryOfPath.erase(recent.back().path);
            recent.pop_back();
        }
        recent.push_front({path, std::move(image)});
        entryOfPath[path] = recent.begin();
        residentBytes += bytes;
    }

    static size_t bytesOf(const Image& image) { return image.rgba.size() * sizeof(float); }
};

ImageCache::ImageCache(const OlatDataset& dataset, size_t budgetBytes) : state_(std::make_unique<State>())
{
    state_->colorSpace = dataset.colorSpace;
    state_->premultiplied = dataset.premultiplied;
    state_->shrink = dataset.shrink;
    state_->budgetBytes = budgetBytes;
}

ImageCache::~ImageCache() = default;

size_t ImageCache::residentBytes() const
{
    const std::lock_guard lock(state_->mutex);
    return state_->residentBytes;
}

Result<std::shared_ptr<const Image>> ImageCache::load(const OlatSplit& split, size_t imageIndex)
{
    assert(imageIndex < split.images.size());
    const OlatImage& entry = split.images[imageIndex];
    const Camera& camera = split.cameras[entry.camera];
    std::shared_ptr<const Image> image;
    {
        const std::lock_guard lock(state_->mutex);
        image = state_->find(entry.path);
    }
    if (!image) {
        Result<Image> decoded = isPng(entry.path) ? readPng(entry.path) : readExr(entry.path);
        if (!decoded) return decoded.error();
        if (Status s = convert(*decoded, state_->colorSpace, state_->premultiplied, entry.path); !s) return s.error();
        if (state_->shrink > 1) *decoded = shrunk(*decoded, state_->shrink);
        decoded->rgba.shrink_to_fit(); // the decoder grows it row by row
        image = std::make_shared<const Image>(std::move(*decoded));
        const std::lock_guard lock(state_->mutex);
        if (std::shared_ptr<const Image> other = state_->find(entry.path)) image = other;
        else state_->keep(entry.path, image);
    }
    const auto size = [&](int width, int height) { // in the file, whose odd last row or column may not be seen
        return std::to_string(width * state_->shrink) + " x " + std::to_string(height * state_->shrink);
    };
    if (image->width != camera.width || image->height != camera.height)
        return Error{ErrorCode::kBadInput, entry.path + ": image is " + size(image->width, image->height) + " pixels, expected " +
                                               size(camera.width, camera.height) + " like its camera"};
    return image;
}

} // namespace nacre
