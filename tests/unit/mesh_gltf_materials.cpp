// Materials, textures, images, extensions.
#include "mesh_jpeg_builder.h"
#include "mesh_support.h"

#include "interchange/jpeg.h"

#include <cmath>
#include <cstdlib>

using namespace nacre;

namespace {

/// The quad under `material`, with `textureCount` textures that all show one 2 x 2 PNG.
GltfBuilder texturedQuad(const json& material, int textureCount = 1)
{
    GltfBuilder b = quadBuilder(material);
    b.add("images", {{"bufferView", b.view(smallPng())}, {"mimeType", "image/png"}, {"name", "colours"}});
    for (int i = 0; i < textureCount; i++) b.add("textures", {{"source", 0}, {"sampler", b.add("samplers", {{"wrapS", i % 2 ? 33071 : 10497}})}});
    return b;
}

MeshMaterial materialOf(const json& material, int textureCount = 1) { return load(texturedQuad(material, textureCount).glb()).materials.at(0); }

json extensions(const char* name, const json& value) { return {{"extensions", {{name, value}}}}; }

} // namespace

TEST_CASE("a material that says nothing has the defaults of the specification")
{
    const MeshMaterial m = materialOf(json::object());
    CHECK(m.baseColor == glm::vec4(1.0f));
    CHECK(m.metallic == 1.0f);
    CHECK(m.roughness == 1.0f);
    CHECK(m.alphaMode == AlphaMode::kOpaque);
    CHECK(m.alphaCutoff == 0.5f);
    CHECK(!m.doubleSided);
    CHECK(m.ior == 1.5f);
    CHECK(m.specular == 1.0f);
    CHECK(m.specularColor == glm::vec3(1.0f));
    CHECK(m.anisotropy == 0.0f);
    CHECK(m.clearcoat == 0.0f);
    CHECK(m.iridescence == 0.0f);
    CHECK(m.iridescenceIor == 1.3f);
    CHECK(m.iridescenceThicknessMinimum == 100.0f);
    CHECK(m.iridescenceThicknessMaximum == 400.0f);
    CHECK(m.transmission == 0.0f);
    CHECK(m.thickness == 0.0f);
    CHECK(std::isinf(m.attenuationDistance));
    CHECK(!m.hasVolumeScatter);
    CHECK(!m.baseColorTexture);
}

TEST_CASE("every property of the core material is read")
{
    const MeshMaterial m = materialOf({{"name", "paint"},
                                       {"pbrMetallicRoughness",
                                        {{"baseColorFactor", {0.1, 0.2, 0.3, 0.4}},
                                         {"baseColorTexture", {{"index", 0}, {"texCoord", 1}}},
                                         {"metallicFactor", 0.5},
                                         {"roughnessFactor", 0.25},
                                         {"metallicRoughnessTexture", {{"index", 1}}}}},
                                       {"normalTexture", {{"index", 1}, {"scale", -0.5}}},
                                       {"alphaMode", "MASK"},
                                       {"alphaCutoff", 0.75},
                                       {"doubleSided", true}},
                                      2);
    CHECK(m.name == "paint");
    CHECK(m.baseColor == glm::vec4(0.1f, 0.2f, 0.3f, 0.4f));
    CHECK(m.baseColorTexture.texture == 0);
    CHECK(m.baseColorTexture.texcoord == 1);
    CHECK(m.metallic == 0.5f);
    CHECK(m.roughness == 0.25f);
    CHECK(m.metallicRoughnessTexture.texture == 1);
    CHECK(m.normalTexture.texture == 1);
    CHECK(m.normalScale == -0.5f);
    CHECK(m.alphaMode == AlphaMode::kMask);
    CHECK(m.alphaCutoff == 0.75f);
    CHECK(m.doubleSided);
    CHECK(materialOf({{"alphaMode", "BLEND"}}).alphaMode == AlphaMode::kBlend);
}

TEST_CASE("every property of the supported material extensions is read")
{
    const json extensions = {
        {"KHR_materials_ior", {{"ior", 1.33}}},
        {"KHR_materials_specular",
         {{"specularFactor", 0.5}, {"specularColorFactor", {0.5, 2, 0}}, {"specularTexture", {{"index", 0}}}, {"specularColorTexture", {{"index", 1}}}}},
        {"KHR_materials_anisotropy", {{"anisotropyStrength", 0.5}, {"anisotropyRotation", 1.25}, {"anisotropyTexture", {{"index", 1}}}}},
        {"KHR_materials_clearcoat",
         {{"clearcoatFactor", 0.75},
          {"clearcoatRoughnessFactor", 0.125},
          {"clearcoatTexture", {{"index", 0}}},
          {"clearcoatRoughnessTexture", {{"index", 1}}},
          {"clearcoatNormalTexture", {{"index", 0}, {"scale", 2}}}}},
        {"KHR_materials_iridescence",
         {{"iridescenceFactor", 0.5},
          {"iridescenceIor", 1.75},
          {"iridescenceThicknessMinimum", 550},
          {"iridescenceThicknessMaximum", 50},
          {"iridescenceTexture", {{"index", 1}}},
          {"iridescenceThicknessTexture", {{"index", 0}}}}},
        {"KHR_materials_transmission", {{"transmissionFactor", 0.5}, {"transmissionTexture", {{"index", 1}}}}},
        {"KHR_materials_volume", {{"thicknessFactor", 0.01}, {"attenuationDistance", 0.006}, {"attenuationColor", {0.1, 0.5, 0.9}}}},
        {"KHR_materials_volume_scatter", {{"multiscatterColor", {0.8, 0.5, 0.25}}, {"scatterAnisotropy", -0.5}}},
    };
    GltfBuilder b = texturedQuad({{"extensions", extensions}}, 2);
    for (const auto& [name, value] : extensions.items()) b.root["extensionsRequired"].push_back(name), b.root["extensionsUsed"].push_back(name);
    const MeshScene scene = load(b.glb());
    CHECK(scene.warnings.empty());
    const MeshMaterial& m = scene.materials[0];
    CHECK(m.ior == 1.33f);
    CHECK(m.specular == 0.5f);
    CHECK(m.specularColor == glm::vec3(0.5f, 2.0f, 0.0f));
    CHECK(m.specularTexture.texture >= 0);
    CHECK(m.specularColorTexture.texture >= 0);
    CHECK(m.specularTexture.texture != m.specularColorTexture.texture);
    CHECK(m.anisotropy == 0.5f);
    CHECK(m.anisotropyRotation == 1.25f);
    CHECK(m.anisotropyTexture.texture == m.specularColorTexture.texture);
    CHECK(m.clearcoat == 0.75f);
    CHECK(m.clearcoatRoughness == 0.125f);
    CHECK(m.clearcoatTexture.texture == m.specularTexture.texture);
    CHECK(m.clearcoatRoughnessTexture.texture == m.specularColorTexture.texture);
    CHECK(m.clearcoatNormalTexture.texture == m.specularTexture.texture);
    CHECK(m.clearcoatNormalScale == 2.0f);
    CHECK(m.iridescence == 0.5f);
    CHECK(m.iridescenceIor == 1.75f);
    CHECK(m.iridescenceThicknessMinimum == 550.0f); // may lie above the maximum
    CHECK(m.iridescenceThicknessMaximum == 50.0f);
    CHECK(m.iridescenceTexture.texture == m.specularColorTexture.texture);
    CHECK(m.iridescenceThicknessTexture.texture == m.specularTexture.texture);
    CHECK(m.transmission == 0.5f);
    CHECK(m.transmissionTexture.texture == m.specularColorTexture.texture);
    CHECK(m.thickness == 0.01f);
    CHECK(m.attenuationDistance == 0.006f);
    CHECK(m.attenuationColor == glm::vec3(0.1f, 0.5f, 0.9f));
    CHECK(m.hasVolumeScatter);
    CHECK(m.multiscatterColor == glm::vec3(0.8f, 0.5f, 0.25f));
    CHECK(m.scatterAnisotropy == -0.5f);
    CHECK(materialOf({{"extensions", {{"KHR_materials_ior", {{"ior", 0}}}}}}).ior == 0.0f);
}

TEST_CASE("the largest float as attenuation distance means none")
{
    CHECK(std::isinf(materialOf(extensions("KHR_materials_volume", {{"attenuationDistance", 3.4028234663852886e38}})).attenuationDistance));
    checkRefused(texturedQuad(extensions("KHR_materials_volume", {{"attenuationDistance", 0}})).glb(), ErrorCode::kBadInput, {"attenuationDistance", "above 0"});
}

TEST_CASE("factors out of range are clamped with a warning that says where")
{
    const MeshScene scene = load(quadBuilder({{"pbrMetallicRoughness", {{"roughnessFactor", 1.5}, {"baseColorFactor", {1, -1, 0, 1}}}}}).glb());
    CHECK(scene.materials[0].roughness == 1.0f);
    CHECK(scene.materials[0].baseColor == glm::vec4(1, 0, 0, 1));
    CHECK(warns(scene, "materials[0].pbrMetallicRoughness.roughnessFactor"));
    CHECK(warns(scene, "materials[0].pbrMetallicRoughness.baseColorFactor"));
}

TEST_CASE("films that cannot be are mended with a warning, or refused")
{
    const auto film = [](const json& value) { return texturedQuad(extensions("KHR_materials_iridescence", value)).glb(); };
    const MeshScene scene = load(film({{"iridescenceFactor", 2}, {"iridescenceIor", 0.5}, {"iridescenceThicknessMaximum", -1}}));
    CHECK(scene.materials[0].iridescence == 1.0f);
    CHECK(scene.materials[0].iridescenceIor == 1.0f);
    CHECK(scene.materials[0].iridescenceThicknessMaximum == 0.0f);
    for (const char* name : {"iridescenceFactor", "iridescenceIor", "iridescenceThicknessMaximum"}) CHECK(warns(scene, name));
    checkRefused(film({{"iridescenceThicknessMinimum", "thin"}}), ErrorCode::kBadInput, {"iridescenceThicknessMinimum"});
    checkRefused(film({{"iridescenceTexture", {{"index", 7}}}}), ErrorCode::kBadInput, {"iridescenceTexture"});
}

TEST_CASE("KHR_texture_transform: scale, then rotation, then offset; its example turns the lower left quarter clockwise")
{
    const auto slotOf = [](const json& transform) {
        return materialOf({{"normalTexture", {{"index", 0}, {"texCoord", 1}, {"extensions", {{"KHR_texture_transform", transform}}}}}}).normalTexture;
    };
    const auto apply = [](const TextureSlot& s, glm::vec2 uv) { return s.uvScaleRotate * uv + s.uvOffset; };
    const TextureSlot example = slotOf({{"offset", {0, 1}}, {"rotation", 1.57079632679}, {"scale", {0.5, 0.5}}});
    // The image's lower left quarter is u in [0, 0.5], v in [0.5, 1]; its lower left corner (0, 1) goes to the upper left of the surface.
    CHECK(glm::length(apply(example, {0, 0}) - glm::vec2(0, 1)) < 1e-6f);
    CHECK(glm::length(apply(example, {1, 0}) - glm::vec2(0, 0.5)) < 1e-6f);
    CHECK(glm::length(apply(example, {0, 1}) - glm::vec2(0.5, 1)) < 1e-6f);
    CHECK(example.texcoord == 1);

    const TextureSlot all = slotOf({{"offset", {0.25, -0.5}}, {"rotation", 0.3}, {"scale", {2, -3}}, {"texCoord", 0}});
    const float c = std::cos(0.3f), s = std::sin(0.3f);
    for (const glm::vec2 uv : {glm::vec2(0, 0), glm::vec2(1, 0), glm::vec2(0.3, 0.8)}) {
        const glm::vec2 scaled = uv * glm::vec2(2, -3);
        const glm::vec2 expected = glm::vec2(c * scaled.x + s * scaled.y, -s * scaled.x + c * scaled.y) + glm::vec2(0.25, -0.5);
        CHECK(glm::length(apply(all, uv) - expected) < 1e-6f);
    }
    CHECK(all.texcoord == 0); // overrides
    checkRefused(texturedQuad({{"normalTexture", {{"index", 0}, {"texCoord", 2}}}}).glb(), ErrorCode::kUnsupported, {"materials[0].normalTexture.texCoord", "2"});
}

TEST_CASE("images come from a bufferView, a file or embedded data, as PNG or JPEG, with every row where it was")
{
    const json material = {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}};
    const auto withImage = [&](const json& image) {
        GltfBuilder b = quadBuilder(material);
        b.add("images", image);
        b.add("textures", {{"source", 0}});
        return b;
    };
    for (const json& image : {json{{"uri", "t/small%20one.png"}}, json{{"uri", "data:image/png;base64," + base64(smallPng())}}}) {
        const MeshScene scene = load(withImage(image).glb(), {{"t/small one.png", smallPng()}});
        REQUIRE(scene.textures.size() == 1);
        CHECK(scene.textures[0].width == 2);
        CHECK(scene.textures[0].height == 2);
        CHECK(scene.textures[0].rgba == std::vector<uint8_t>{255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255, 255, 255, 128});
    }
    const MeshScene jpeg = load(withImage({{"uri", "flat.jpg"}}).glb(), {{"flat.jpg", flatJpeg(200, 100, 50)}});
    CHECK(jpeg.textures[0].width == 16);
    CHECK(jpeg.textures[0].height == 8);
    for (size_t i = 0; i < 16 * 8; i++)
        for (size_t c = 0; c < 4; c++) CHECK(std::abs(int(jpeg.textures[0].rgba[4 * i + c]) - std::vector<int>{200, 100, 50, 255}[c]) <= 3); // JPEG rounds

    PngBuilder deep; // 16 bits lose their lower half
    deep.bitDepth = 16, deep.colorType = 0;
    deep.rows = {0, 0x12, 0x34, 0xff, 0xff, 0, 0x00, 0x01, 0x80, 0x00};
    const MeshScene grey = load(withImage({{"uri", "deep.png"}}).glb(), {{"deep.png", deep.build()}});
    CHECK(grey.textures[0].rgba == std::vector<uint8_t>{0x12, 0x12, 0x12, 255, 255, 255, 255, 255, 0, 0, 0, 255, 0x80, 0x80, 0x80, 255});

    checkRefused(withImage({{"uri", "lost.png"}}).glb(), ErrorCode::kBadInput, {"images[0].uri", "lost.png"});
    Bytes cut = smallPng();
    cut.resize(cut.size() - 20);
    checkRefused(withImage({{"uri", "a.png"}}).glb(), ErrorCode::kBadInput, {"images[0]", "PNG"}, {{"a.png", cut}});
    checkRefused(withImage({{"uri", "a.png"}}).glb(), ErrorCode::kBadInput, {"images[0]", "neither PNG nor JPEG"}, {{"a.png", Bytes(40)}});
    checkRefused(withImage({{"uri", "data:image/png,%89PNG"}}).glb(), ErrorCode::kBadInput, {"images[0].uri", "base64"});
    checkRefused(withImage({{"uri", "data:image/png;base64,AA!A"}}).glb(), ErrorCode::kBadInput, {"images[0].uri", "character 2"});
    checkRefused(withImage(json::object()).glb(), ErrorCode::kBadInput, {"images[0].bufferView"});
}

TEST_CASE("samplers set wrapping and filter; a texture is decoded once for each way of sampling it")
{
    GltfBuilder b = quadBuilder({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}, {"metallicRoughnessTexture", {{"index", 1}}}}},
                                 {"normalTexture", {{"index", 2}}}});
    b.add("images", {{"bufferView", b.view(smallPng())}, {"name", "colours"}});
    b.add("images", {{"uri", "never-read.png"}}); // nothing uses it
    b.root["samplers"] = json::array({{{"wrapS", 33648}, {"wrapT", 33071}, {"magFilter", 9728}, {"minFilter", 9987}}});
    b.root["textures"] = json::array({{{"source", 0}, {"sampler", 0}}, {{"source", 0}}, {{"source", 0}, {"sampler", 0}}, {{"source", 1}}});
    const MeshScene scene = load(b.glb());
    REQUIRE(scene.textures.size() == 2);
    const MeshMaterial& m = scene.materials[0];
    CHECK(m.baseColorTexture.texture == m.normalTexture.texture);
    const MeshTexture& mirrored = scene.textures[size_t(m.baseColorTexture.texture)];
    const MeshTexture& plain = scene.textures[size_t(m.metallicRoughnessTexture.texture)];
    CHECK(mirrored.wrapU == TextureWrap::kMirror);
    CHECK(mirrored.wrapV == TextureWrap::kClamp);
    CHECK(mirrored.nearest);
    CHECK(mirrored.name == "colours");
    CHECK(plain.wrapU == TextureWrap::kRepeat);
    CHECK(plain.wrapV == TextureWrap::kRepeat);
    CHECK(!plain.nearest);
    CHECK(plain.rgba == mirrored.rgba);
    b.root["samplers"][0]["wrapS"] = 1;
    checkRefused(b.glb(), ErrorCode::kBadInput, {"samplers[0].wrapS", "10497"});
}

TEST_CASE("what is ignored is said once")
{
    GltfBuilder b = quadBuilder({{"name", "lamp"}, {"emissiveFactor", {1, 0, 0}}});
    b.add("materials", {{"emissiveFactor", {1, 1, 1}}});
    b.add("materials", {{"name", "flat"}, {"extensions", {{"KHR_materials_unlit", json::object()}}}});
    b.add("materials", {{"name", "old"}, {"extensions", {{"KHR_materials_pbrSpecularGlossiness", json::object()}}}});
    b.root["extensionsUsed"] = {"KHR_materials_unlit", "KHR_materials_pbrSpecularGlossiness", "KHR_materials_sheen", "KHR_lights_punctual", "ACME_x"};
    b.root["animations"] = b.root["cameras"] = json::array({json::object()});
    b.root["extensions"]["KHR_lights_punctual"] = {{"lights", json::array()}};
    const MeshScene scene = load(b.glb());
    const char* const kExpected[] = {"emission",   "material 'flat'", "material 'old'", "extensions KHR_materials_sheen (cloth has no sheen), ACME_x", "animations",
                                     "cameras", "ignored: lights"};
    for (const char* part : kExpected) {
        INFO(part);
        CHECK(warns(scene, part));
    }
    CHECK(scene.warnings.size() == std::size(kExpected));
}

TEST_CASE("a required extension that is not supported is named, with what to try")
{
    const auto requiring = [](const char* extension) {
        GltfBuilder b = quadBuilder();
        b.root["extensionsRequired"] = {extension};
        return b.glb();
    };
    checkRefused(requiring("EXT_meshopt_compression"), ErrorCode::kUnsupported, {"EXT_meshopt_compression", "export without"});
    checkRefused(requiring("KHR_texture_basisu"), ErrorCode::kUnsupported, {"KHR_texture_basisu", "PNG or JPEG"});
    checkRefused(requiring("KHR_materials_pbrSpecularGlossiness"), ErrorCode::kUnsupported, {"metallic-roughness"});
    checkRefused(requiring("ACME_x\n\x1b[2J"), ErrorCode::kUnsupported, {"ACME_x"});
    CHECK(decode(requiring("KHR_mesh_quantization")));

    GltfBuilder b = quadBuilder({{"normalTexture", {{"index", 0}}}});
    b.add("textures", {{"extensions", {{"KHR_texture_basisu", {{"source", 0}}}}}});
    checkRefused(b.glb(), ErrorCode::kBadInput, {"textures[0]", "KHR_texture_basisu"});
}

TEST_CASE("a texture whose coordinates the mesh lacks is said")
{
    GltfBuilder b = texturedQuad({{"name", "paint"}, {"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}, {"texCoord", 1}}}}}});
    CHECK(warns(load(b.glb()), "TEXCOORD_1, which the textures of material 'paint' need"));
    b.attributes()["TEXCOORD_1"] = b.floats(kQuadTexcoords);
    CHECK(load(b.glb()).warnings.empty());
}

TEST_CASE("JPEG: grey is grey; cut off at any byte it is an error, and so is a size the file cannot hold")
{
    const Bytes grey = jpegOf(9, 5, 1, std::vector<uint8_t>(45, 77));
    const Result<Image8> image = decodeJpeg(grey, "grey.jpg");
    REQUIRE(image);
    CHECK(image->width == 9);
    CHECK(image->height == 5);
    for (size_t i = 0; i < 45; i++) {
        CHECK(std::abs(int(image->rgba[4 * i]) - 77) <= 2);
        CHECK(image->rgba[4 * i + 1] == image->rgba[4 * i]);
        CHECK(image->rgba[4 * i + 3] == 255);
    }
    for (size_t n = 0; n < grey.size(); n++) CHECK(!decodeJpeg(std::span(grey).first(n), "cut.jpg"));

    Bytes huge = grey;
    for (size_t i = 0; i + 9 < huge.size(); i++)
        if (huge[i] == std::byte(0xff) && huge[i + 1] == std::byte(0xc0)) std::fill_n(huge.begin() + ptrdiff_t(i) + 5, 4, std::byte(0x3f));
    const Result<Image8> refused = decodeJpeg(huge, "huge.jpg");
    REQUIRE(!refused);
    CHECK(mentions(refused.error().message, "16191 x 16191"));
}
