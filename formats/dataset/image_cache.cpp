// Images on demand: decode, convert to linear premultiplied, check, keep the most recently used within a byte budget.
//
// Conversion, by the flags of the dataset (EXR is linear whatever they say):
//   linear, premultiplied       as stored
//   linear, straight            rgb * a
//   sRGB, premultiplied         linearFromSrgb(rgb)       the file holds the encoded premultiplied colour; checked on SSS-GS
//                               files against EXRs of the same renders: soft edges agree to 5e-4 rms, 0.07 if divided by alpha first
//   sRGB, straight              linearFromSrgb(rgb) * a
// The budget covers what the cache keeps. An image that alone exceeds it is loaded and handed out but not kept.
// Decoding runs outside the lock: threads that miss the same image may both decode it, and the first result is kept.
#include "dataset/olat_dataset.h"

#include "base/color.h"
#include "base/text.h"
#include "dataset/develop.h"
#include "dataset/packed_images.h"
#include "interchange/image_file.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <list>
#include <map>
#include <mutex>
#include <set>
#include <unordered_map>

namespace nacre {
namespace {

constexpr float kAlphaSlack = 1e-3f; // half-float and lossy compression round; within this alpha is clamped to [0, 1]
// Filters with negative lobes overshoot at a step by up to 9 % (Lanczos) or 7 % (bicubic) a direction, so 19 % in corners.
constexpr float kAlphaOvershoot = 0.2f;
constexpr float kShownWhite = 0.9999f;

/// How the colours of one file are stored, and what they are in the unit of the lights.
struct Encoding {
    ColorSpace colorSpace;
    bool premultiplied;
    float blackLevel, whiteLevel; // file values
    glm::vec3 gain;
};

using Note = std::function<void(const std::string& kind, const std::string& path)>;

/// Linear if the file says so and nobody else does. What it says and does not get goes to `note`.
ColorSpace colorSpaceOf(const PngColor& color, ColorSpace assumed, bool isGuess, const std::string& path, const Note& note)
{
    if (assumed == ColorSpace::kLinear && !isGuess) return assumed;
    const auto near = [&](double gamma) { return std::fabs(color.gamma - gamma) < 0.03; }; // 1/2.2 is written as 0.45, 0.4545, 0.4762
    if (color.isSrgb) return assumed;
    std::string profile = color.profile;
    for (char& c : profile) c = char(std::tolower(static_cast<unsigned char>(c)));
    if (!profile.empty() && profile.find("srgb") == std::string::npos)
        note("have the colour profile " + inQuotes(color.profile) + ", which is not applied: they are read as sRGB; convert them to sRGB", path);
    if (profile.empty() && near(1.0)) {
        if (isGuess) return ColorSpace::kLinear; // as PNG demands
        note("say that they are linear (gAMA 1) and the description says srgb: they are read as sRGB; correct color_space or the files", path);
    } else if (profile.empty() && color.gamma > 0 && !near(1 / 2.2)) {
        char gamma[32];
        std::snprintf(gamma, sizeof gamma, "%.3g", color.gamma);
        note(std::string("have gAMA ") + gamma + ", which is not applied: they are read as sRGB; convert them to sRGB", path);
    }
    if (profile.empty() && !areRec709(color.primaries)) note("have primaries (cHRM) other than those of sRGB, which are not applied; convert them to sRGB", path);
    return assumed;
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

Status convert(Image& image, Encoding encoding, const std::string& path, const Note& note)
{
    const std::vector<float>& table = linearFromSrgbTable();
    const bool isSrgb = encoding.colorSpace == ColorSpace::kSrgb, hasBlack = encoding.blackLevel > 0;
    bool clamped = false;
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        float* p = image.rgba.data() + i;
        if (p[0] == 0 && p[1] == 0 && p[2] == 0 && p[3] == 0 && !hasBlack) continue; // most of many images; 800 x 800 take 4 ms instead of 11
        if (!(p[3] >= -kAlphaOvershoot && p[3] <= 1.0f + kAlphaOvershoot)) {
            const size_t pixel = i / 4, w = size_t(image.width);
            return Error{ErrorCode::kBadInput, path + ": alpha " + std::to_string(p[3]) + " at pixel (" + std::to_string(pixel % w) + ", " +
                                                   std::to_string(pixel / w) + "), expected 0 to 1" +
                                                   (p[3] > 2 ? "; is alpha stored as 0 to 255, or is it depth?" : "")};
        }
        clamped = clamped || p[3] < -kAlphaSlack || p[3] > 1.0f + kAlphaSlack;
        p[3] = std::clamp(p[3], 0.0f, 1.0f);
        bool unknown = false;
        for (int c = 0; c < 3; c++) {
            const bool saturated = p[c] >= encoding.whiteLevel;
            if (hasBlack) p[c] = (p[c] - encoding.blackLevel) / (1.0f - encoding.blackLevel);
            if (isSrgb) p[c] = table[size_t(std::clamp(p[c], 0.0f, 1.0f) * 65535.0f + 0.5f)];
            p[c] *= encoding.gain[c];
            unknown = unknown || (saturated && p[c] < kShownWhite); // above that, losses and metrics know it to be white at least
            if (!encoding.premultiplied) p[c] *= p[3];
        }
        if (unknown) p[0] = p[1] = p[2] = 0, p[3] = kUnknownAlpha;
    }
    if (clamped) note("have alpha a little outside 0 to 1, which is clamped: a resizing filter with negative lobes (Lanczos, bicubic) does that; resize "
                      "with a box or area filter", path);
    return ok();
}

Image shrunk(const Image& image, int by)
{
    Image out{image.width / by, image.height / by, {}};
    out.rgba.resize(size_t(4) * out.width * out.height);
    const float weight = 1.0f / float(by * by);
    for (int y = 0; y < out.height * by; ++y)
        for (int x = 0; x < out.width * by; ++x) {
            float* to = out.pixel(x / by, y / by);
            if (to[3] < 0) continue;
            const float* from = image.pixel(x, y);
            if (from[3] < 0) to[0] = to[1] = to[2] = 0, to[3] = kUnknownAlpha;
            else for (int c = 0; c < 4; ++c) to[c] += weight * from[c];
        }
    return out;
}

template <class... T>
void appendBytes(std::string& key, const T&... values)
{
    (key.append(reinterpret_cast<const char*>(&values), sizeof values), ...);
}

/// `camera` of images that are `by` times as large.
Camera enlarged(Camera camera, int by)
{
    camera.width *= by, camera.height *= by;
    for (double* length : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *length *= by;
    return camera;
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
        std::string key; // of all that its pixels depend on
        std::shared_ptr<const Image> image;
    };
    ColorSpace colorSpace;
    bool colorSpaceIsGuess, premultiplied, straightPng;
    float blackLevel, whiteLevel;
    bool exrHasLevels; // beside photographs in PNG or JPEG, whose levels they are, EXR files are renders
    int shrink;
    std::shared_ptr<const PackedImages> packed;
    size_t budgetBytes;

    mutable std::mutex mutex; // guards everything below
    std::list<Entry> recent;  // most recently used first
    std::unordered_map<std::string, std::list<Entry>::iterator> entryOfKey;
    size_t residentBytes = 0;
    std::list<Entry> extras;  // masks and images without light, which many images share: the last few
    std::map<std::string, std::set<std::string>> noted; // the files of each kind of note; a file may be decoded more than once

    /// The pixels of a file, linear and premultiplied.
    Result<Image> readFile(const std::string& path, const glm::vec3& gain, bool isMask = false)
    {
        const Note note = [&](const std::string& kind, const std::string& file) {
            const std::lock_guard lock(mutex);
            noted[kind].insert(file);
        };
        ImageWords words;
        Result<Image> image = readImageFile(path, &words);
        if (!image || isMask) return image;
        const bool isExr = imageKind(path) == ImageKind::kExr;
        const bool hasLevels = !isExr || exrHasLevels;
        Encoding encoding{ColorSpace::kLinear, premultiplied, hasLevels ? blackLevel : 0.0f,
                          hasLevels && whiteLevel > 0 ? whiteLevel : isExr ? std::numeric_limits<float>::infinity() : 1.0f, gain};
        if (!isExr)
            encoding.colorSpace = colorSpaceOf(words.color, colorSpace, colorSpaceIsGuess, path, note), encoding.premultiplied = premultiplied && !straightPng;
        if (words.orientation != 1)
            note("ask viewers to turn them (EXIF orientation), which is not done: cameras must be those of the pixels as they are stored", path);
        if (Status s = convert(*image, encoding, path, note); !s) return s.error();
        return image;
    }

    /// A mask or an image without light, of the size of `image`.
    Result<std::shared_ptr<const Image>> readExtra(const std::string& path, const glm::vec3& gain, bool isMask, const Image& image)
    {
        constexpr size_t kKept = 4;
        std::string key = path;
        if (isMask) key += " as mask";
        else appendBytes(key, gain); // frames of several exposures may share an image without light
        std::shared_ptr<const Image> extra;
        {
            const std::lock_guard lock(mutex);
            for (const Entry& e : extras)
                if (e.key == key) extra = e.image;
        }
        if (!extra) {
            Result<Image> read = readFile(path, gain, isMask);
            if (!read) return read.error();
            extra = std::make_shared<const Image>(std::move(*read));
            const std::lock_guard lock(mutex);
            extras.push_front({std::move(key), extra});
            if (extras.size() > kKept) extras.pop_back();
        }
        if (extra->width != image.width || extra->height != image.height)
            return Error{ErrorCode::kBadInput, path + ": " + std::to_string(extra->width) + " x " + std::to_string(extra->height) + " pixels, expected " +
                                                   std::to_string(image.width) + " x " + std::to_string(image.height) + " like the image it belongs to"};
        return extra;
    }

    Result<Image> decode(const OlatImage& entry, const Camera& camera, const FileCamera* file)
    {
        Result<Image> image = packed ? packed->load(entry.packedBlock) : develop(entry, camera, file);
        if (image && shrink > 1) *image = shrunk(*image, shrink);
        return image;
    }

    Result<Image> develop(const OlatImage& entry, const Camera& camera, const FileCamera* file)
    {
        Result<Image> image = readFile(entry.path, entry.gain);
        if (!image) return image;
        if (!entry.ambientPath.empty()) {
            const auto ambient = readExtra(entry.ambientPath, entry.gain, false, *image);
            if (!ambient) return Error{ambient.error().code, entry.path + ": its ambient image cannot be used: " + ambient.error().message};
            subtractAmbient(*image, **ambient);
        }
        if (!entry.maskPath.empty()) {
            const auto mask = readExtra(entry.maskPath, entry.gain, true, *image);
            if (!mask) return Error{mask.error().code, entry.path + ": its mask cannot be used: " + mask.error().message};
            applyMask(*image, **mask);
        }
        if (file) {
            if (image->width != file->width || image->height != file->height)
                return Error{ErrorCode::kBadInput, entry.path + ": image is " + std::to_string(image->width) + " x " + std::to_string(image->height) +
                                                       " pixels, expected " + std::to_string(file->width) + " x " + std::to_string(file->height) + " like its camera"};
            *image = resampled(*image, *file, enlarged(camera, shrink));
        }
        image->rgba.shrink_to_fit(); // the decoder grows it row by row
        return image;
    }

    std::string keyOf(const OlatImage& entry, const Camera& camera, const FileCamera* file) const
    {
        if (packed) return std::to_string(entry.packedBlock);
        std::string key = entry.path;
        key.append(1, '\0').append(entry.maskPath).append(1, '\0').append(entry.ambientPath).append(1, '\0');
        appendBytes(key, entry.gain);
        if (!file) return key;
        appendBytes(key, camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy);
        appendBytes(key, file->width, file->height, file->fx, file->fy, file->cx, file->cy, file->k, file->p);
        return key;
    }

    std::shared_ptr<const Image> find(const std::string& key)
    {
        const auto it = entryOfKey.find(key);
        if (it == entryOfKey.end()) return nullptr;
        recent.splice(recent.begin(), recent, it->second);
        return it->second->image;
    }

    void keep(const std::string& key, std::shared_ptr<const Image> image)
    {
        const size_t bytes = bytesOf(*image);
        if (bytes > budgetBytes) return;
        while (residentBytes + bytes > budgetBytes) {
            residentBytes -= bytesOf(*recent.back().image);
            entryOfKey.erase(recent.back().key);
            recent.pop_back();
        }
        recent.push_front({key, std::move(image)});
        entryOfKey[key] = recent.begin();
        residentBytes += bytes;
    }

    static size_t bytesOf(const Image& image) { return image.rgba.size() * sizeof(float); }
};

ImageCache::ImageCache(const OlatDataset& dataset, size_t budgetBytes) : state_(std::make_unique<State>())
{
    state_->colorSpace = dataset.colorSpace;
    state_->colorSpaceIsGuess = dataset.colorSpaceIsGuess;
    state_->premultiplied = dataset.premultiplied;
    state_->straightPng = dataset.straightPng;
    state_->blackLevel = dataset.blackLevel;
    state_->whiteLevel = dataset.whiteLevel;
    state_->exrHasLevels = true;
    for (const OlatSplit& split : dataset.splits)
        for (const OlatImage& image : split.images) state_->exrHasLevels = state_->exrHasLevels && imageKind(image.path) == ImageKind::kExr;
    state_->shrink = dataset.shrink;
    state_->packed = dataset.packed;
    state_->budgetBytes = budgetBytes;
}

ImageCache::~ImageCache() = default;

size_t ImageCache::residentBytes() const
{
    const std::lock_guard lock(state_->mutex);
    return state_->residentBytes;
}

std::vector<std::string> ImageCache::notes() const
{
    const std::lock_guard lock(state_->mutex);
    std::vector<std::string> out;
    for (const auto& [kind, files] : state_->noted)
        out.push_back(std::to_string(files.size()) + " of the images looked at, " + inQuotes(*files.begin()) + " among them, " + kind);
    return out;
}

Result<std::shared_ptr<const Image>> ImageCache::load(const OlatSplit& split, size_t imageIndex)
{
    assert(imageIndex < split.images.size());
    const OlatImage& entry = split.images[imageIndex];
    const Camera& camera = split.cameras[entry.camera];
    const FileCamera* file = split.files.empty() ? nullptr : &split.files[entry.camera];
    const std::string key = state_->keyOf(entry, camera, file);
    std::shared_ptr<const Image> image;
    {
        const std::lock_guard lock(state_->mutex);
        image = state_->find(key);
    }
    if (!image) {
        Result<Image> decoded = state_->decode(entry, camera, file);
        if (!decoded) return decoded.error();
        image = std::make_shared<const Image>(std::move(*decoded));
        const std::lock_guard lock(state_->mutex);
        if (std::shared_ptr<const Image> other = state_->find(key)) image = other;
        else state_->keep(key, image);
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
