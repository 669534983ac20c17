// Fixtures for the dataset tests: a temporary folder and a small scene rendered on the spot.
#pragma once

#include "dataset_file_builders.h"

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
