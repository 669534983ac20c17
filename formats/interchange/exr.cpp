// OpenEXR through OpenEXR 3.1. Files are read through InputFile with FLOAT slices (RgbaInputFile would round float files to half).
//
// The library trusts sizes in the header when it allocates, so scanHeader() walks the attributes first and refuses anything
// out of bounds. Pixels are then read in bands and the image grows band by band: a file that lies about its height fails
// at the first missing block, long before its claimed size is allocated.
#include "interchange/exr.h"

#include "base/file.h"
#include "base/text.h"
#include "interchange/primaries.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <half.h>
#include <map>
#include <new>
#include <stdexcept>

namespace nacre {
namespace {

constexpr int kMaxSide = 1 << 16;
constexpr size_t kMaxPixels = size_t(1) << 28;
constexpr int kMaxChannels = 256;           // light groups and AOVs of a renderer stay far below
constexpr int kMaxTileHeight = 1024;        // the library holds a row of tiles at once
constexpr int kMaxOrigin = 1 << 24;         // window corners; keeps differences far from int overflow
constexpr int kBandRows = 32;
constexpr size_t kHeaderBytes = 1 << 16;    // most headers are below 1 kB; a preview image is about 40 kB
const std::string kAbsentAlpha = "nacre.absent alpha"; // a channel that no file has: the library fills it with a constant
constexpr float kHalfMax = 65504.0f;

struct Window {
    int minX = 0, minY = 0, maxX = -1, maxY = -1; // inclusive
    int64_t width() const { return int64_t(maxX) - minX + 1; }
    int64_t height() const { return int64_t(maxY) - minY + 1; }
};

Error bad(const std::string& name, const std::string& what) { return {ErrorCode::kBadInput, name + ": " + what}; }

constexpr size_t kMaxQuote = 160; // bytes; the library quotes file contents in what it throws

/// Walks "name\0 type\0 size value" up to the empty name; every size is checked against the bytes that are left.
class HeaderScan {
public:
    HeaderScan(std::span<const std::byte> bytes, const std::string& name) : bytes_(bytes), name_(name) {}

    Status run()
    {
        if (bytes_.size() < 8) return bad(name_, "not an OpenEXR file: " + std::to_string(bytes_.size()) + " bytes");
        if (int32At(0) != 20000630) return bad(name_, "not an OpenEXR file: wrong first four bytes");
        const uint32_t flags = uint32_t(int32At(4));
        if ((flags & 0xff) != 2) return bad(name_, "OpenEXR version " + std::to_string(flags & 0xff) + ", expected 2");
        if (flags & 0x1800)
            return Error{ErrorCode::kUnsupported, name_ + ": multi-part or deep OpenEXR; save one flat RGBA part instead"};
        at_ = 8;
        for (;;) {
            std::string attribute, type;
            if (!string(attribute)) return truncated();
            if (attribute.empty()) break;
            if (!string(type) || bytes_.size() - at_ < 4) return truncated();
            const int32_t size = int32At(at_);
            at_ += 4;
            if (size < 0 || size_t(size) > bytes_.size() - at_) return truncated();
            if (Status s = value(attribute, type, size_t(size)); !s) return s;
            at_ += size_t(size);
        }
        return check();
    }

private:
    Error truncated() const { return bad(name_, "OpenEXR header is damaged or cut off at byte " + std::to_string(at_)); }

    int32_t int32At(size_t offset) const
    {
        uint32_t v = 0;
        for (int i = 3; i >= 0; i--) v = (v << 8) | uint32_t(bytes_[offset + size_t(i)]);
        return int32_t(v);
    }

    bool string(std::string& out)
    {
        out.clear();
        while (at_ < bytes_.size() && out.size() < 256) {
            const char c = char(bytes_[at_++]);
            if (c == 0) return true;
            out.push_back(c);
        }
        return false;
    }

    Status value(const std::string& attribute, const std::string& type, size_t size)
    {
        if (type == "box2i" && (attribute == "dataWindow" || attribute == "displayWindow")) {
            if (size != 16) return truncated();
            Window& w = attribute == "dataWindow" ? data_ : display_;
            w = {int32At(at_), int32At(at_ + 4), int32At(at_ + 8), int32At(at_ + 12)};
        } else if (type == "chlist") {
            for (size_t i = 0; i + 16 < size; channels_++) { // name\0, then 16 bytes
                while (i < size && char(bytes_[at_ + i]) != 0) i++;
                i += 17;
            }
        } else if (type == "tiledesc") {
            if (size != 9) return truncated();
            const uint32_t x = uint32_t(int32At(at_)), y = uint32_t(int32At(at_ + 4));
            if (x == 0 || y == 0 || x > uint32_t(kMaxSide) || y > uint32_t(kMaxTileHeight))
                return bad(name_, "tiles of " + std::to_string(x) + " x " + std::to_string(y) + " pixels, expected at most " +
                                      std::to_string(kMaxTileHeight) + " rows");
        }
        return ok();
    }

    Status check() const
    {
        for (const bool isData : {true, false}) {
            const Window& w = isData ? data_ : display_;
            const char* which = isData ? "data window" : "display window";
            if (std::min({w.minX, w.minY, w.maxX, w.maxY}) < -kMaxOrigin || std::max({w.minX, w.minY, w.maxX, w.maxY}) > kMaxOrigin ||
                w.width() < 1 || w.height() < 1 || w.width() > kMaxSide || w.height() > kMaxSide ||
                size_t(w.width()) * size_t(w.height()) > kMaxPixels)
                return bad(name_, std::string("OpenEXR ") + which + " [" + std::to_string(w.minX) + ", " + std::to_string(w.minY) + "] to [" +
                                      std::to_string(w.maxX) + ", " + std::to_string(w.maxY) +
                                      "], expected 1 to 65536 pixels per side and at most 2^28 pixels");
        }
        if (channels_ > kMaxChannels)
            return bad(name_, std::to_string(channels_) + " channels, expected at most " + std::to_string(kMaxChannels));
        return ok();
    }

    std::span<const std::byte> bytes_;
    const std::string& name_;
    size_t at_ = 0;
    int channels_ = 0;

public:
    Window data_, display_;
};

class MemoryIStream final : public Imf::IStream {
public:
    MemoryIStream(std::span<const std::byte> bytes, const std::string& name) : IStream(name.c_str()), bytes_(bytes) {}
    bool read(char* out, int n) override
    {
        if (n < 0 || at_ > bytes_.size() || size_t(n) > bytes_.size() - at_) throw std::runtime_error("the file ends too early");
        std::memcpy(out, bytes_.data() + at_, size_t(n));
        at_ += size_t(n);
        return at_ < bytes_.size();
    }
    uint64_t tellg() override { return at_; }
    void seekg(uint64_t position) override { at_ = size_t(position); }

private:
    std::span<const std::byte> bytes_;
    size_t at_ = 0;
};

class MemoryOStream final : public Imf::OStream {
public:
    explicit MemoryOStream(const std::string& name) : OStream(name.c_str()) {}
    void write(const char* data, int n) override
    {
        if (at_ + size_t(n) > bytes.size()) bytes.resize(at_ + size_t(n));
        std::memcpy(bytes.data() + at_, data, size_t(n));
        at_ += size_t(n);
    }
    uint64_t tellp() override { return at_; }
    void seekp(uint64_t position) override { at_ = size_t(position); }

    std::vector<std::byte> bytes;

private:
    size_t at_ = 0;
};

/// The channels of the file that become R, G, B, A. Luminance: one name three times. No alpha: an empty name.
struct PictureChannels {
    std::string names[4];
};

/// "ViewLayer.Combined.R" -> layer "ViewLayer.Combined", channel "R" (in capitals).
struct ChannelName {
    std::string layer, channel;
    explicit ChannelName(const std::string& name)
    {
        const size_t dot = name.rfind('.');
        layer = dot == std::string::npos ? "" : name.substr(0, dot);
        channel = name.substr(dot + 1); // npos + 1 is 0
        for (char& c : channel) c = char(std::toupper(static_cast<unsigned char>(c)));
        if (channel == "RED" || channel == "GREEN" || channel == "BLUE" || channel == "ALPHA") channel.resize(1);
    }
};

constexpr const char* kNotLuminance[] = {"X", "Z", "RY", "BY"}; // beside Y: positions, or luminance with subsampled chroma

/// The picture among the channels; an error that lists what was found if there is none, or no telling which.
Result<PictureChannels> findPicture(const Imf::ChannelList& channels, const std::string& name)
{
    std::string found;
    std::map<std::string, std::map<std::string, std::string>> layers; // names in the file by layer and channel
    for (auto c = channels.begin(); c != channels.end(); ++c) {
        found += (found.empty() ? "" : ", ") + std::string(c.name());
        const ChannelName parts(c.name());
        layers[parts.layer].emplace(parts.channel, c.name());
    }
    const auto isCombined = [](const std::string& layer) { return layer == "Combined" || layer.ends_with(".Combined"); };
    std::vector<std::string> pictures, combined;
    for (const auto& [layer, of] : layers)
        if (of.count("R") && of.count("G") && of.count("B")) {
            pictures.push_back(layer);
            if (isCombined(layer)) combined.push_back(layer);
        }
    if (pictures.size() > 1 && pictures[0].empty()) pictures.resize(1); // R, G, B without a layer: the picture itself
    else if (combined.size() == 1) pictures = combined;
    if (pictures.size() > 1) {
        std::string list;
        for (const std::string& p : pictures) list += (list.empty() ? "" : ", ") + p;
        return bad(name, std::to_string(pictures.size()) + " layers have colours: " + oneLine(list, kMaxQuote) + "; save the one that is meant alone");
    }

    PictureChannels out;
    const bool isLuminance = pictures.empty() && layers.count("") && layers[""].count("Y") &&
                             std::none_of(std::begin(kNotLuminance), std::end(kNotLuminance), [&](const char* c) { return layers[""].count(c) > 0; });
    if (pictures.empty() && !isLuminance)
        return bad(name, "channels " + oneLine(found, kMaxQuote) + ", expected R, G, B (or Y) and optionally A");
    const auto& of = layers[isLuminance ? "" : pictures[0]];
    for (size_t k = 0; k < 3; ++k) out.names[k] = of.at(isLuminance ? "Y" : std::string(1, "RGB"[k]));
    if (of.count("A")) out.names[3] = of.at("A");
    for (const std::string& wanted : out.names) {
        if (wanted.empty()) continue;
        const Imf::Channel& c = *channels.findChannel(wanted);
        if (c.xSampling != 1 || c.ySampling != 1) return bad(name, "channel " + oneLine(wanted, kMaxQuote) + " is subsampled; save all pixels of it");
        if (c.type != Imf::HALF && c.type != Imf::FLOAT)
            return bad(name, "channel " + oneLine(wanted, kMaxQuote) + " holds whole numbers, expected half or float");
    }
    return out;
}

/// From the primaries of the header to those of Rec.709.
Status convertPrimaries(Image& image, const Imf::Header& header, const std::string& name)
{
    if (!Imf::hasChromaticities(header)) return ok();
    const Imf::Chromaticities& c = Imf::chromaticities(header);
    const auto xy = [](const Imath::V2f& v) { return glm::dvec2(v.x, v.y); };
    const Primaries primaries{xy(c.red), xy(c.green), xy(c.blue), xy(c.white)};
    if (areRec709(primaries)) return ok();
    const std::optional<glm::dmat3> toRec709 = rec709From(primaries);
    if (!toRec709) return bad(name, "the chromaticities of the header are no colour space; correct them or take them out");
    const glm::mat3 m(*toRec709);
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        const glm::vec3 rgb = m * glm::vec3(image.rgba[i], image.rgba[i + 1], image.rgba[i + 2]);
        for (int k = 0; k < 3; ++k) image.rgba[i + size_t(k)] = rgb[k];
    }
    return ok();
}

Status checkFinite(const Image& image, const std::string& name)
{
    for (size_t i = 0; i < image.rgba.size(); i++)
        if (!std::isfinite(image.rgba[i])) {
            const size_t pixel = i / 4, w = size_t(image.width);
            return bad(name, std::string(std::isnan(image.rgba[i]) ? "NaN" : "infinite") + " value in channel " + "RGBA"[i % 4] +
                                 " at pixel (" + std::to_string(pixel % w) + ", " + std::to_string(pixel / w) + ")");
        }
    return ok();
}

/// Moves the data window into the display window; outside it is black and empty.
Image placeInDisplayWindow(Image data, const Window& from, const Window& to)
{
    if (from.minX == to.minX && from.minY == to.minY && from.maxX == to.maxX && from.maxY == to.maxY) return data;
    Image out{int(to.width()), int(to.height()), {}};
    out.rgba.assign(size_t(out.width) * size_t(out.height) * 4, 0.0f);
    const int x0 = std::max(from.minX, to.minX), x1 = std::min(from.maxX, to.maxX);
    if (x0 > x1) return out;
    for (int y = std::max(from.minY, to.minY); y <= std::min(from.maxY, to.maxY); y++)
        std::copy_n(data.pixel(x0 - from.minX, y - from.minY), 4 * size_t(x1 - x0 + 1), out.pixel(x0 - to.minX, y - to.minY));
    return out;
}

Result<Image> decodeChecked(std::span<const std::byte> bytes, const std::string& name, const Window& window, const Window& display)
{
    MemoryIStream stream(bytes, name);
    Imf::InputFile file(stream);
    const Imf::Header& header = file.header();
    const Imath::Box2i box = header.dataWindow();
    if (box.min.x != window.minX || box.min.y != window.minY || box.max.x != window.maxX || box.max.y != window.maxY)
        return bad(name, "two different data windows in one header");
    const Result<PictureChannels> picture = findPicture(header.channels(), name);
    if (!picture) return picture.error();
    const bool isLuminance = picture->names[0] == picture->names[1];

    Image image{int(window.width()), 0, {}};
    std::vector<float> band(4 * size_t(image.width) * kBandRows);
    for (int y = window.minY; y <= window.maxY; y += kBandRows) {
        const int last = std::min(y + kBandRows - 1, window.maxY);
        Imf::FrameBuffer frame;
        for (int c = 0; c < 4; c++) {
            if (isLuminance && (c == 1 || c == 2)) continue; // filled in below
            const std::string& channel = picture->names[c].empty() ? kAbsentAlpha : picture->names[c];
            frame.insert(channel, Imf::Slice::Make(Imf::FLOAT, band.data() + c, {window.minX, y}, image.width, last - y + 1,
                                                   4 * sizeof(float), 4 * sizeof(float) * size_t(image.width), 1, 1, c == 3 ? 1.0 : 0.0));
        }
        file.setFrameBuffer(frame);
        file.readPixels(y, last);
        for (size_t i = 0; isLuminance && i < band.size(); i += 4) band[i + 1] = band[i + 2] = band[i];
        image.rgba.insert(image.rgba.end(), band.begin(), band.begin() + ptrdiff_t(4 * size_t(image.width) * size_t(last - y + 1)));
        image.height += last - y + 1;
    }
    if (Status s = checkFinite(image, name); !s) return s.error();
    if (Status s = convertPrimaries(image, header, name); !s) return s.error();
    if (Status s = checkFinite(image, name); !s) return s.error(); // float overflow
    return placeInDisplayWindow(std::move(image), window, display);
}

} // namespace

Result<Image> decodeExr(std::span<const std::byte> bytes, const std::string& name)
{
    try {
        HeaderScan scan(bytes, name);
        if (Status s = scan.run(); !s) return s.error();
        return decodeChecked(bytes, name, scan.data_, scan.display_);
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::kIo, name + ": out of memory while decoding OpenEXR"};
    } catch (const std::exception& e) {
        return bad(name, "broken OpenEXR file: " + oneLine(e.what(), kMaxQuote));
    } catch (...) {
        return bad(name, "broken OpenEXR file");
    }
}

Result<Image> readExr(const std::string& path)
{
    Result<std::vector<std::byte>> bytes = readFile(path);
    if (!bytes) return bytes.error();
    return decodeExr(*bytes, path);
}

Result<Image> readExrSize(const std::string& path)
{
    Result<FileStart> start = readFileStart(path, kHeaderBytes);
    if (!start) return start.error();
    for (;;) {
        HeaderScan scan(start->bytes, path);
        if (Status s = scan.run(); !s) {
            if (start->bytes.size() >= start->fileSize) return s.error();
            start = readFileStart(path, start->fileSize); // a long header
            if (!start) return start.error();
            start->fileSize = start->bytes.size();
            continue;
        }
        return Image{int(scan.display_.width()), int(scan.display_.height()), {}};
    }
}

Status writeExr(const Image& image, const std::string& path)
{
    const size_t pixels = size_t(std::max(image.width, 0)) * size_t(std::max(image.height, 0));
    if (pixels == 0 || image.width > kMaxSide || image.height > kMaxSide || pixels > kMaxPixels || image.rgba.size() != 4 * pixels)
        return bad(path, "cannot write an image of " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                             " pixels with " + std::to_string(image.rgba.size()) + " values");
    if (Status s = checkFinite(image, path); !s) return s;
    const bool fitsHalf = std::all_of(image.rgba.begin(), image.rgba.end(), [](float v) { return std::fabs(v) <= kHalfMax; });
    try {
        std::vector<Imath::half> halves;
        if (fitsHalf) halves.assign(image.rgba.begin(), image.rgba.end());
        const Imf::PixelType type = fitsHalf ? Imf::HALF : Imf::FLOAT;
        const size_t bytes = fitsHalf ? sizeof(Imath::half) : sizeof(float); // of one value
        // the library's writer takes a pointer to non-const and only reads through it
        char* values = fitsHalf ? reinterpret_cast<char*>(halves.data()) : reinterpret_cast<char*>(const_cast<float*>(image.rgba.data()));
        MemoryOStream stream(path);
        {
            Imf::Header header(image.width, image.height);
            header.compression() = Imf::ZIP_COMPRESSION;
            Imf::FrameBuffer frame;
            for (int c = 0; c < 4; c++) {
                const char channel[2] = {"RGBA"[c], 0};
                header.channels().insert(channel, Imf::Channel(type));
                frame.insert(channel, Imf::Slice(type, values + bytes * size_t(c), 4 * bytes, 4 * bytes * size_t(image.width)));
            }
            Imf::OutputFile file(stream, header);
            file.setFrameBuffer(frame);
            file.writePixels(image.height);
        } // the destructor writes the line offsets
        return writeFileAtomically(path, stream.bytes);
    } catch (const std::exception& e) {
        return Error{ErrorCode::kIo, path + ": cannot encode OpenEXR: " + oneLine(e.what(), kMaxQuote)};
    }
}

} // namespace nacre
