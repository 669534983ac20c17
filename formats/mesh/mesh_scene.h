// A triangle scene as the light stage renders it: what glTF 2.0 can say, with node transforms applied and units decoded.
#pragma once

#include <glm/glm.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace nacre {

enum class TextureWrap : uint8_t { kRepeat, kMirror, kClamp };

struct MeshTexture {
    std::string name;
    int width = 0, height = 0;
    std::vector<uint8_t> rgba; // width*height*4, rows top to bottom, as stored (sRGB or data: the slot that uses it knows)
    TextureWrap wrapU = TextureWrap::kRepeat, wrapV = TextureWrap::kRepeat;
    bool nearest = false;      // magnification filter; bilinear otherwise
};

/// A material's use of a texture. uv' = (uvScaleRotate * uv) + uvOffset (KHR_texture_transform; identity without it).
struct TextureSlot {
    int texture = -1; // index into MeshScene::textures; -1: none
    int texcoord = 0; // which set of TriangleMesh::texcoords
    glm::mat2 uvScaleRotate{1.0f};
    glm::vec2 uvOffset{0.0f};
    explicit operator bool() const { return texture >= 0; }
};

enum class AlphaMode : uint8_t { kOpaque, kMask, kBlend };

/// glTF 2.0 metallic-roughness and the KHR material extensions, factors with their defaults. Colours are linear Rec.709.
/// A texture multiplies its factor, by the channels the specification names. baseColor, specularColor: sRGB textures.
struct MeshMaterial {
    std::string name;
    glm::vec4 baseColor{1.0f}; // rgb and alpha
    TextureSlot baseColorTexture;
    float metallic = 1.0f, roughness = 1.0f; // perceptual roughness: alpha = roughness^2
    TextureSlot metallicRoughnessTexture;    // G roughness, B metallic
    TextureSlot normalTexture;
    float normalScale = 1.0f;
    AlphaMode alphaMode = AlphaMode::kOpaque;
    float alphaCutoff = 0.5f;
    bool doubleSided = false;

    float ior = 1.5f;                        // KHR_materials_ior (0 means: F = 1)
    float specular = 1.0f;                   // KHR_materials_specular
    glm::vec3 specularColor{1.0f};
    TextureSlot specularTexture;             // A
    TextureSlot specularColorTexture;        // RGB, sRGB
    float anisotropy = 0.0f;                 // KHR_materials_anisotropy: strength, rotation in radians from the tangent
    float anisotropyRotation = 0.0f;
    TextureSlot anisotropyTexture;           // RG direction, B strength
    float clearcoat = 0.0f, clearcoatRoughness = 0.0f; // KHR_materials_clearcoat
    TextureSlot clearcoatTexture;            // R
    TextureSlot clearcoatRoughnessTexture;   // G
    TextureSlot clearcoatNormalTexture;
    float clearcoatNormalScale = 1.0f;
    float iridescence = 0.0f, iridescenceIor = 1.3f; // KHR_materials_iridescence: a thin film over the specular layer
    float iridescenceThicknessMinimum = 100.0f, iridescenceThicknessMaximum = 400.0f; // nanometres; without a texture it is the maximum
    TextureSlot iridescenceTexture;          // R
    TextureSlot iridescenceThicknessTexture; // G, from minimum to maximum
    float transmission = 0.0f;               // KHR_materials_transmission
    TextureSlot transmissionTexture;         // R
    float thickness = 0.0f;                  // KHR_materials_volume: > 0 makes the mesh the boundary of a medium
    glm::vec3 attenuationColor{1.0f};
    float attenuationDistance = std::numeric_limits<float>::infinity(); // metres
    float diffuseTransmission = 0.0f;        // KHR_materials_diffuse_transmission: share of the diffuse light that goes through
    bool hasVolumeScatter = false;           // KHR_materials_volume_scatter
    glm::vec3 multiscatterColor{0.0f};
    float scatterAnisotropy = 0.0f;          // Henyey-Greenstein g, (-1, 1)
};

/// One glTF primitive under one node, in world space but for MeshScene::origin (transforms, skin and morph weights applied; instances are
/// copies). Winding is counter-clockwise
/// seen from outside, also under mirroring transforms. Optional arrays are empty or have a row per vertex.
struct TriangleMesh {
    std::string name; // of the node, or else of the mesh
    int material = 0; // index into MeshScene::materials (a default material is appended if a primitive has none)
    std::vector<glm::vec3> positions;
    std::vector<glm::vec3> normals;      // unit; empty: the file has none, shade flat
    std::vector<glm::vec4> tangents;     // unit xyz, w = handedness; made from texcoords where the material needs them and the file has none
    std::vector<glm::vec2> texcoords[2];
    std::vector<glm::vec4> colors;       // linear COLOR_0, multiplies baseColor
    std::vector<glm::uvec3> triangles;
};

struct MeshScene {
    glm::dvec3 origin{0.0}; // of the positions of meshes, in the world: not 0 if the scene lies so far away that float would round it there
    std::vector<TriangleMesh> meshes;
    std::vector<MeshMaterial> materials;
    std::vector<MeshTexture> textures;
    std::vector<std::string> warnings; // one line each: what the file asks for and the reader leaves out or repairs
    size_t triangleCount() const
    {
        size_t n = 0;
        for (const TriangleMesh& m : meshes) n += m.triangles.size();
        return n;
    }
};

} // namespace nacre
