// What the mesh tests share: checks on scenes that must load and on files that must not.
#pragma once

#include "mesh_builder.h"

#include <doctest/doctest.h>

#include <initializer_list>

namespace nacre {

inline bool mentions(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

/// The scene of a file that loads; the failure says why it does not.
inline MeshScene load(const Bytes& bytes, std::map<std::string, Bytes> files = {})
{
    Result<MeshScene> scene = decode(bytes, std::move(files));
    const std::string why = scene ? std::string() : scene.error().message;
    INFO(why);
    REQUIRE(scene);
    return std::move(*scene);
}

inline bool warns(const MeshScene& scene, const char* part)
{
    for (const std::string& line : scene.warnings)
        if (mentions(line, part)) return true;
    return false;
}

/// The whole contract of an error: the code, one line with the file's name in front, and the words that matter.
inline void checkRefused(const Bytes& bytes, ErrorCode code, std::initializer_list<const char*> words, std::map<std::string, Bytes> files = {})
{
    const Result<MeshScene> scene = decode(bytes, std::move(files));
    REQUIRE(!scene);
    INFO(scene.error().message);
    CHECK(scene.error().code == code);
    CHECK(scene.error().message.rfind("scene.glb: ", 0) == 0);
    CHECK(scene.error().message.size() < 700);
    CHECK(!mentions(scene.error().message, "\n"));
    for (const char* word : words) {
        INFO(word);
        CHECK(mentions(scene.error().message, word));
    }
}

inline bool near(const glm::vec3& a, const glm::vec3& b, float tolerance = 1e-6f) { return glm::length(a - b) <= tolerance; }

} // namespace nacre
