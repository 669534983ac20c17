#include "interchange/image_file.h"

#include "base/text.h"
#include "interchange/exr.h"

#include <string_view>

namespace nacre {

ImageKind imageKind(const std::string& path)
{
    const auto endsWith = [&](std::string_view extension) {
        if (path.size() < extension.size()) return false;
        for (size_t i = 0; i < extension.size(); ++i) {
            const char c = path[path.size() - extension.size() + i];
            if ((c >= 'A' && c <= 'Z' ? char(c + 'a' - 'A') : c) != extension[i]) return false;
        }
        return true;
    };
    if (endsWith(".exr")) return ImageKind::kExr;
    if (endsWith(".png")) return ImageKind::kPng;
    return endsWith(".jpg") || endsWith(".jpeg") ? ImageKind::kJpeg : ImageKind::kNone;
}

static Error unknownKind(const std::string& path)
{
    return {ErrorCode::kUnsupported, "image " + inQuotes(path) + ": expected .exr, .png, .jpg or .jpeg; convert it first"};
}

Result<Image> readImageFile(const std::string& path, ImageWords* words)
{
    switch (imageKind(path)) {
    case ImageKind::kExr: return readExr(path);
    case ImageKind::kPng: return readPng(path, words ? &words->color : nullptr);
    case ImageKind::kJpeg: break;
    case ImageKind::kNone: return unknownKind(path);
    }
    JpegHeader header;
    Result<Image> image = readJpeg(path, &header);
    if (words) words->color.profile = header.profile, words->orientation = header.orientation;
    return image;
}

Result<Image> readImageFileSize(const std::string& path)
{
    switch (imageKind(path)) {
    case ImageKind::kExr: return readExrSize(path);
    case ImageKind::kPng: return readPngSize(path);
    case ImageKind::kJpeg: return readJpegSize(path);
    case ImageKind::kNone: break;
    }
    return unknownKind(path);
}

} // namespace nacre
