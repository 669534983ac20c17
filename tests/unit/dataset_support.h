// Fixtures for the dataset tests: a temporary folder, byte builders for EXR and PNG files that the library would never write,
// and a small scene rendered on the spot.
#pragma once

#include "base/color.h"
#include "base/file.h"
#include "dataset/olat_dataset.h"
#include "interchange/exr.h"
#include "interchange/png.h"

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <stdlib.h> // mkdtemp

namespace nacre {

using nlohmann::json;

struct TempFolder {
    std::filesystem::path path;
    TempFolder()
    {
        std::string name = (std::filesystem::temp_directory_path() / "nacre-test-XXXXXX").string();
        REQUIRE(mkdtemp(name.data()) != nullptr);
        path = name;
    }
    ~TempFolder()
    {
        std::error_code ec;
        std::filesystem::remove_all(path, ec);
    }
    std::string file(const std::string& name) const { return (path / name).string(); }
    void writeText(const std::string& name, const std::string& text) const
    {
        std::filesystem::create_directories((path / name).parent_path());
        std::ofstream(path / name, std::ios::binary) << text;
    }
};

using Bytes = std::vector<std::byte>;

inline void append(Bytes& out, const void* data, size_t size)
{
    for (size_t i = 0; i < size; i++) out.push_back(static_cast<const std::byte*>(data)[i]);
}
template <class T> void appendValue(Bytes& out, T v) { append(out, &v, sizeof v); } // the tests run on little-endian machines

/// An uncompressed scanline EXR of float channels, spelled out byte by byte: an independent witness for the reader.
struct ExrBuilder {
    std::vector<std::string> channels = {"A", "B", "G", "R"}; // sorted, as the format demands
    int32_t dataWindow[4] = {0, 0, 3, 2}, displayWindow[4] = {0, 0, 3, 2};
    int32_t sampling = 1;
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
            for (int32_t v : {2, 0, sampling, sampling}) appendValue(list, v); // FLOAT, pLinear + padding
        }
        appendValue(list, uint8_t(0));
        attribute("channels", "chlist", list);
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

/// A PNG with one stored (uncompressed) deflate block.
struct PngBuilder {
    uint32_t width = 2, height = 2;
    uint8_t bitDepth = 8, colorType = 6; // 0 grey, 2 RGB, 4 grey + alpha, 6 RGBA
    std::vector<uint8_t> rows;           // filter byte 0 + samples, per row

    Bytes build() const
    {
        Bytes out;
        append(out, "\x89PNG\r\n\x1a\n", 8);
        Bytes header;
        appendBig(header, width);
        appendBig(header, height);
        for (uint8_t b : {bitDepth, colorType, uint8_t(0), uint8_t(0), uint8_t(0)}) appendValue(header, b);
        chunk(out, "IHDR", header);
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
        uint32_t crc = 0xffffffffu;
        for (size_t i = start; i < out.size(); i++) {
            crc ^= uint32_t(out[i]);
            for (int k = 0; k < 8; k++) crc = (crc & 1) ? 0xedb88320u ^ (crc >> 1) : crc >> 1;
        }
        appendBig(out, crc ^ 0xffffffffu);
    }
};

/// Camera at `position` looking at the origin, world +Z up.
inline Camera lookAtOrigin(glm::dvec3 position, int size)
{
    Camera camera;
    camera.width = camera.height = size;
    camera.fx = camera.fy = 1.4 * size;
    camera.cx = camera.cy = 0.5 * size;
    const glm::dvec3 z = glm::normalize(position), x = glm::normalize(glm::cross(glm::dvec3(0, 0, 1), z)), y = glm::cross(z, x);
    camera.worldFromCamera = glm::dmat4(glm::dvec4(x, 0), glm::dvec4(y, 0), glm::dvec4(z, 0), glm::dvec4(position, 1));
    return camera;
}

/// A diffuse sphere of radius 0.7 at the origin under a point light; linear, premultiplied, 2 x 2 samples per pixel.
inline Image renderSphere(const Camera& camera, glm::dvec3 light, double intensity)
{
    Image image{camera.width, camera.height, std::vector<float>(size_t(camera.width) * size_t(camera.height) * 4, 0.0f)};
    for (int y = 0; y < camera.height; y++)
        for (int x = 0; x < camera.width; x++)
            for (int s = 0; s < 4; s++) {
                const double px = x + 0.25 + 0.5 * (s & 1), py = y + 0.25 + 0.5 * (s >> 1);
                const glm::dvec3 local((px - camera.cx) / camera.fx, -(py - camera.cy) / camera.fy, -1.0);
                const glm::dvec3 d = glm::normalize(glm::dmat3(camera.worldFromCamera) * local), o = camera.position();
                const double b = glm::dot(o, d), disc = b * b - glm::dot(o, o) + 0.49;
                if (disc < 0) continue;
                const glm::dvec3 p = o + d * (-b - std::sqrt(disc)), l = light - p;
                const double shade = intensity * std::max(glm::dot(glm::normalize(p), glm::normalize(l)), 0.0) / glm::dot(l, l);
                const double albedo[3] = {0.8, 0.5, 0.3};
                for (int c = 0; c < 3; c++) image.pixel(x, y)[c] += float(0.25 * shade * albedo[c] / 3.14159265358979);
                image.pixel(x, y)[3] += 0.25f;
            }
    return image;
}

inline json toJson(const glm::dmat4& m)
{
    json rows = json::array();
    for (int r = 0; r < 4; r++) rows.push_back({m[0][r], m[1][r], m[2][r], m[3][r]});
    return rows;
}
inline json toJson(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

inline bool mentions(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

/// The whole contract of an error: the code, one line, not a page, and the words that matter.
inline void checkError(const Error& error, ErrorCode code, std::initializer_list<const char*> words)
{
    INFO(error.message);
    CHECK(error.code == code);
    CHECK(error.message.size() < 700);
    CHECK(!mentions(error.message, "\n"));
    for (const char* word : words) {
        INFO(word);
        CHECK(mentions(error.message, word));
    }
}

} // namespace nacre
