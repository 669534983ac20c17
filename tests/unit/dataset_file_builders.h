// EXR and PNG files spelled out byte by byte, also ones that no library would write: independent witnesses for the readers.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

namespace nacre {

using Bytes = std::vector<std::byte>;

inline void append(Bytes& out, const void* data, size_t size)
{
    for (size_t i = 0; i < size; i++) out.push_back(static_cast<const std::byte*>(data)[i]);
}
template <class T> void appendValue(Bytes& out, T v) { append(out, &v, sizeof v); } // the tests run on little-endian machines

/// An uncompressed scanline EXR of float channels.
struct ExrBuilder {
    std::vector<std::string> channels = {"A", "B", "G", "R"}; // sorted, as the format demands
    int32_t dataWindow[4] = {0, 0, 3, 2}, displayWindow[4] = {0, 0, 3, 2};
    int32_t sampling = 1;
    int32_t type = 2; // FLOAT; 0 UINT
    std::vector<float> chromaticities; // red, green, blue, white as x, y; empty: the header has none
    uint32_t version = 2;
    float value(size_t channel, int x, int y) const { return float(channel) + 0.25f * float(x) + 16.0f * float(y); }

    Bytes build(float poison = 0.0f, int poisonX = -1, int poisonY = -1) const
    {
        Bytes out;
        const auto attribute = [&](const char* name, const char* type, const Bytes& v) {
            append(out, name, std::strlen(name) + 1);
            append(out, type, std::strlen(type) + 1);
            appendValue(out, int32_t(v.size()));
            append(out, v.data(), v.size());
        };
        const auto pod = [](auto... v) { Bytes b; (appendValue(b, v), ...); return b; };
        append(out, "\x76\x2f\x31\x01", 4);
        appendValue(out, version);
        Bytes list;
        for (const std::string& c : channels) {
            append(list, c.c_str(), c.size() + 1);
            for (int32_t v : {type, 0, sampling, sampling}) appendValue(list, v); // pLinear + padding
        }
        appendValue(list, uint8_t(0));
        attribute("channels", "chlist", list);
        if (!chromaticities.empty()) {
            Bytes xy;
            for (float v : chromaticities) appendValue(xy, v);
            attribute("chromaticities", "chromaticities", xy);
        }
        attribute("compression", "compression", pod(uint8_t(0)));
        attribute("dataWindow", "box2i", pod(dataWindow[0], dataWindow[1], dataWindow[2], dataWindow[3]));
        attribute("displayWindow", "box2i", pod(displayWindow[0], displayWindow[1], displayWindow[2], displayWindow[3]));
        attribute("lineOrder", "lineOrder", pod(uint8_t(0)));
        attribute("pixelAspectRatio", "float", pod(1.0f));
        attribute("screenWindowCenter", "v2f", pod(0.0f, 0.0f));
        attribute("screenWindowWidth", "float", pod(1.0f));
        appendValue(out, uint8_t(0));

        const int64_t width = int64_t(dataWindow[2]) - dataWindow[0] + 1, height = int64_t(dataWindow[3]) - dataWindow[1] + 1;
        if (width * height > 4096) return out; // a lying header needs no pixels
        const size_t lineBytes = 8 + size_t(width) * channels.size() * 4;
        const size_t first = out.size() + size_t(height) * 8;
        for (int64_t y = 0; y < height; y++) appendValue(out, uint64_t(first + size_t(y) * lineBytes));
        for (int y = dataWindow[1]; y <= dataWindow[3]; y++) {
            appendValue(out, int32_t(y));
            appendValue(out, int32_t(size_t(width) * channels.size() * 4));
            for (size_t c = 0; c < channels.size(); c++)
                for (int x = dataWindow[0]; x <= dataWindow[2]; x++)
                    appendValue(out, x == poisonX && y == poisonY && channels[c] == "G" ? poison : value(c, x, y));
        }
        return out;
    }
};

inline uint32_t pngChecksum(const std::byte* data, size_t size)
{
    uint32_t crc = 0xffffffffu;
    for (size_t i = 0; i < size; i++) {
        crc ^= uint32_t(data[i]);
        for (int k = 0; k < 8; k++) crc = (crc & 1) ? 0xedb88320u ^ (crc >> 1) : crc >> 1;
    }
    return crc ^ 0xffffffffu;
}

/// Makes the checksums right again as far as the chunks can be walked, so that damage gets past them to the decoder.
inline void repairPngChecksums(Bytes& png)
{
    for (size_t at = 8; at + 12 <= png.size();) {
        size_t length = 0;
        for (size_t i = 0; i < 4; i++) length = (length << 8) | size_t(png[at + i]);
        if (length > png.size() - at - 12) return;
        const uint32_t crc = pngChecksum(png.data() + at + 4, length + 4);
        for (size_t i = 0; i < 4; i++) png[at + 8 + length + i] = std::byte(crc >> (24 - 8 * i));
        at += length + 12;
    }
}

/// A PNG with one stored (uncompressed) deflate block.
struct PngBuilder {
    uint32_t width = 2, height = 2;
    uint8_t bitDepth = 8, colorType = 6; // 0 grey, 2 RGB, 3 by palette, 4 grey + alpha, 6 RGBA
    std::vector<uint8_t> rows;           // filter byte 0 + samples, per row
    std::vector<std::pair<std::string, std::vector<uint8_t>>> chunks; // between IHDR and IDAT: PLTE, gAMA, ...

    Bytes build() const
    {
        Bytes out;
        append(out, "\x89PNG\r\n\x1a\n", 8);
        Bytes header;
        appendBig(header, width);
        appendBig(header, height);
        for (uint8_t b : {bitDepth, colorType, uint8_t(0), uint8_t(0), uint8_t(0)}) appendValue(header, b);
        chunk(out, "IHDR", header);
        for (const auto& [type, bytes] : chunks) {
            Bytes content;
            append(content, bytes.data(), bytes.size());
            chunk(out, type.c_str(), content);
        }
        Bytes data;
        for (int b : {0x78, 0x01, 0x01}) appendValue(data, uint8_t(b));
        appendValue(data, uint16_t(rows.size()));
        appendValue(data, uint16_t(~rows.size()));
        append(data, rows.data(), rows.size());
        uint32_t s1 = 1, s2 = 0;
        for (uint8_t b : rows) s1 = (s1 + b) % 65521, s2 = (s2 + s1) % 65521;
        appendBig(data, (s2 << 16) | s1);
        chunk(out, "IDAT", data);
        chunk(out, "IEND", {});
        return out;
    }

private:
    static void appendBig(Bytes& out, uint32_t v)
    {
        for (int shift = 24; shift >= 0; shift -= 8) appendValue(out, uint8_t(v >> shift));
    }
    static void chunk(Bytes& out, const char* type, const Bytes& data)
    {
        appendBig(out, uint32_t(data.size()));
        const size_t start = out.size();
        append(out, type, 4);
        append(out, data.data(), data.size());
        appendBig(out, pngChecksum(out.data() + start, out.size() - start));
    }
};

/// 5 x 4 pixels, tiles of 2 x 3, float, ZIP, channels B G R, R = 10 y + x, G = R + 0.5, B = -R; from OpenEXR's TiledOutputFile.
inline Bytes tiledExr()
{
    static const unsigned char kBytes[] = {
#include "dataset_tiled_exr.inc"
    };
    Bytes out;
    append(out, kBytes, sizeof kBytes);
    return out;
}

} // namespace nacre
