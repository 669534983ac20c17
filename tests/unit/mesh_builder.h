// glTF files spelled out in tests: JSON edited as a tree, binary data appended as needed, then packed as .glb or .gltf.
#pragma once

#include "interchange/gltf.h"

#include "dataset_file_builders.h"

#include <nlohmann/json.hpp>

#include <glm/glm.hpp>

#include <map>
#include <string>
#include <vector>

namespace nacre {

using nlohmann::json;

inline std::string base64(const Bytes& bytes)
{
    static const char* const kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    for (size_t i = 0; i < bytes.size(); i += 3) {
        uint32_t v = 0;
        for (size_t k = 0; k < 3; k++) v = (v << 8) | (i + k < bytes.size() ? uint32_t(bytes[i + k]) : 0);
        for (size_t k = 0; k < 4; k++) out += i + k <= bytes.size() ? kDigits[(v >> (18 - 6 * k)) & 63] : '=';
    }
    return out;
}

struct GltfBuilder {
    json root = {{"asset", {{"version", "2.0"}}}};
    Bytes bin;

    /// Index of a new bufferView of the given bytes; stride 0: none.
    int view(const Bytes& bytes, int stride = 0)
    {
        while (bin.size() % 4) bin.push_back(std::byte(0));
        json v = {{"buffer", 0}, {"byteOffset", bin.size()}, {"byteLength", bytes.size()}};
        if (stride) v["byteStride"] = stride;
        append(bin, bytes.data(), bytes.size());
        return add("bufferViews", v);
    }
    /// Index of a new element of a list at the top.
    int add(const char* list, const json& value)
    {
        root[list].push_back(value);
        return int(root[list].size()) - 1;
    }
    int accessor(int bufferView, int componentType, const char* type, size_t count)
    {
        json a = {{"componentType", componentType}, {"type", type}, {"count", count}};
        if (bufferView >= 0) a["bufferView"] = bufferView;
        return add("accessors", a);
    }
    template <int N>
    int floats(const std::vector<glm::vec<N, float>>& rows)
    {
        static const char* const kTypes[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
        Bytes bytes;
        append(bytes, rows.data(), rows.size() * sizeof(rows[0]));
        return accessor(view(bytes), 5126, kTypes[N], rows.size());
    }
    template <class T>
    int indices(const std::vector<T>& values)
    {
        Bytes bytes;
        append(bytes, values.data(), values.size() * sizeof(T));
        return accessor(view(bytes), sizeof(T) == 1 ? 5121 : sizeof(T) == 2 ? 5123 : 5125, "SCALAR", values.size());
    }
    /// A mesh of one primitive, and a node that shows it; returns the mesh.
    int mesh(const json& primitive)
    {
        const int m = add("meshes", {{"primitives", {primitive}}});
        add("nodes", {{"mesh", m}});
        return m;
    }
    json& primitive(size_t mesh = 0) { return root["meshes"][mesh]["primitives"][0]; }
    json& attributes() { return primitive()["attributes"]; }

    Bytes glb() const
    {
        json document = root;
        if (!bin.empty()) document["buffers"] = {{{"byteLength", bin.size()}}};
        std::string text = document.dump();
        text.resize((text.size() + 3) / 4 * 4, ' ');
        Bytes padded = bin;
        padded.resize((bin.size() + 3) / 4 * 4);
        Bytes out;
        append(out, "glTF", 4);
        appendValue(out, uint32_t(2));
        appendValue(out, uint32_t(20 + text.size() + (bin.empty() ? 0 : 8 + padded.size())));
        appendValue(out, uint32_t(text.size()));
        append(out, "JSON", 4);
        append(out, text.data(), text.size());
        if (bin.empty()) return out;
        appendValue(out, uint32_t(padded.size()));
        append(out, "BIN\0", 4);
        append(out, padded.data(), padded.size());
        return out;
    }
    Bytes gltf(const std::string& bufferUri) const
    {
        json document = root;
        if (!bin.empty()) document["buffers"] = {{{"byteLength", bin.size()}, {"uri", bufferUri}}};
        const std::string text = document.dump(2);
        Bytes out;
        append(out, text.data(), text.size());
        return out;
    }
    Bytes gltfEmbedded() const { return gltf("data:application/octet-stream;base64," + base64(bin)); }
};

using Vec2s = std::vector<glm::vec2>;
using Vec3s = std::vector<glm::vec3>;
using Vec4s = std::vector<glm::vec4>;

/// The corners of [-1, 1]^2 at z = 0, counter-clockwise seen from +z, and two triangles.
inline const Vec3s kQuad = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
inline const Vec2s kQuadTexcoords = {{0, 1}, {1, 1}, {1, 0}, {0, 0}}; // an image upright on it: v points down
inline const std::vector<uint16_t> kQuadIndices = {0, 1, 2, 0, 2, 3};

/// The quad with normals and texture coordinates under material 0.
inline GltfBuilder quadBuilder(const json& material = json::object())
{
    GltfBuilder b;
    json primitive = {{"attributes", {{"POSITION", b.floats(kQuad)}, {"NORMAL", b.floats(Vec3s(4, {0, 0, 1}))}, {"TEXCOORD_0", b.floats(kQuadTexcoords)}}}};
    primitive["indices"] = b.indices(kQuadIndices);
    primitive["material"] = b.add("materials", material);
    b.mesh(primitive);
    return b;
}

/// Files that are not on a disk.
inline UriReader readerOf(std::map<std::string, Bytes> files)
{
    return [files = std::move(files)](const std::string& uri) -> Result<Bytes> {
        const auto it = files.find(uri);
        if (it == files.end()) return Error{ErrorCode::kBadInput, "cannot read '" + uri + "': there is no such file"};
        return it->second;
    };
}

inline Result<MeshScene> decode(const Bytes& bytes, std::map<std::string, Bytes> files = {}) { return decodeGltf(bytes, "scene.glb", readerOf(std::move(files))); }

/// A 2 x 2 PNG: red, green / blue, white with alpha 128.
inline Bytes smallPng()
{
    PngBuilder png;
    png.rows = {0, 255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 0, 255, 255, 255, 255, 255, 128};
    return png.build();
}

} // namespace nacre
