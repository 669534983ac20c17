// Materials: metallic-roughness (glTF 2.0, section 3.9) and the KHR_materials extensions, with their defaults.
//
// Left out without a word: occlusionTexture (baked shadows; a path tracer finds its own) and thicknessTexture (for renderers that do
// not follow rays through the volume).
#include "interchange/gltf_material.h"

#include "base/text.h"
#include "interchange/jpeg.h"
#include "interchange/png.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

namespace nacre::gltf {
namespace {

// ---- textures -------------------------------------------------------------------------------------------------------------------

Image8 readImage(File& file, const JsonNode& image)
{
    std::vector<std::byte> fetched;
    std::span<const std::byte> bytes;
    if (image["uri"].exists()) {
        fetched = file.fetch(image["uri"]);
        bytes = fetched;
    } else {
        bytes = file.view(image["bufferView"]).bytes;
    }
    const bool isPng = looksLikePng(bytes);
    if (!isPng && !looksLikeJpeg(bytes)) bad(image.where() + " is neither PNG nor JPEG; convert it");
    Result<Image8> decoded = isPng ? decodePng8(bytes, image.where()) : decodeJpeg(bytes, image.where());
    if (!decoded) throw Fault{decoded.error().code, decoded.error().message};
    file.take(decoded->rgba.size(), 1, image.where());
    return std::move(*decoded);
}

TextureWrap readWrap(const JsonNode& wrap)
{
    if (!wrap.exists()) return TextureWrap::kRepeat;
    const int value = wrap.integer(0, 65535);
    if (value == 33071) return TextureWrap::kClamp;
    if (value == 33648) return TextureWrap::kMirror;
    if (value != 10497) wrap.fail("33071, 33648 or 10497", std::to_string(value));
    return TextureWrap::kRepeat;
}

/// Decodes each image once for each way of sampling it.
class TextureTable {
public:
    TextureTable(File& file, MeshScene& scene) : file_(file), scene_(scene) {}

    /// Index into MeshScene::textures of a texture of the file.
    int load(const JsonNode& textureIndex)
    {
        const JsonNode& texture = file_.at(file_.textures, textureIndex);
        if (!texture["source"].exists()) {
            const std::vector<std::string> extensions = texture["extensions"].exists() ? texture["extensions"].keys() : std::vector<std::string>();
            bad(texture.where() + " has no PNG or JPEG image" + (extensions.empty() ? "" : ", only " + inQuotes(extensions[0])) +
                "; convert its image");
        }
        const size_t imageIndex = file_.index(file_.images, texture["source"]);
        const JsonNode& image = file_.images[imageIndex];
        MeshTexture made;
        if (texture["sampler"].exists()) {
            const JsonNode& sampler = file_.at(file_.samplers, texture["sampler"]);
            made.wrapU = readWrap(sampler["wrapS"]);
            made.wrapV = readWrap(sampler["wrapT"]);
            made.nearest = sampler["magFilter"].exists() && sampler["magFilter"].integer(0, 65535) == 9728;
        }
        file_.check();

        const auto [known, isNew] = byUse_.try_emplace({imageIndex, made.wrapU, made.wrapV, made.nearest}, int(scene_.textures.size()));
        if (!isNew) return known->second;
        if (const auto same = byImage_.find(imageIndex); same != byImage_.end()) {
            const MeshTexture& first = scene_.textures[size_t(same->second)];
            file_.take(first.rgba.size(), 1, image.where());
            made.name = first.name, made.width = first.width, made.height = first.height, made.rgba = first.rgba;
        } else {
            made.name = image["name"].exists() ? image["name"].string() : image.where();
            Image8 decoded = readImage(file_, image);
            made.width = decoded.width, made.height = decoded.height, made.rgba = std::move(decoded.rgba);
            byImage_[imageIndex] = known->second;
        }
        scene_.textures.push_back(std::move(made));
        return known->second;
    }

private:
    File& file_;
    MeshScene& scene_;
    std::map<std::tuple<size_t, TextureWrap, TextureWrap, bool>, int> byUse_;
    std::map<size_t, int> byImage_; // the first texture with the image's pixels
};

// ---- materials ------------------------------------------------------------------------------------------------------------------

/// Reads one material; a property that is absent leaves its default alone.
class MaterialReader {
public:
    MaterialReader(File& file, TextureTable& textures) : file_(file), textures_(textures) {}

    MeshMaterial read(const JsonNode& node)
    {
        MeshMaterial m;
        if (node["name"].exists()) m.name = node["name"].string();
        readCore(node, m);
        readExtensions(node, m);
        file_.check();
        return m;
    }

private:
    /// Clamps to the range the specification gives, with a warning: exporters write 1.0000001.
    void factor(const JsonNode& node, float& value, float lowest = 0.0f, float highest = 1.0f)
    {
        if (!node.exists()) return;
        const double x = node.number(1e39);
        value = float(std::clamp(x, double(lowest), double(highest)));
        if (x < lowest || x > highest) file_.warn(node.where() + " is out of range and becomes " + std::to_string(value));
    }

    template <int N>
    void color(const JsonNode& node, glm::vec<N, float>& value, float highest = 1.0f)
    {
        if (!node.exists()) return;
        const std::vector<double> numbers = node.numbers(N);
        bool outside = false;
        for (int i = 0; i < N; ++i) {
            value[i] = float(std::clamp(numbers[size_t(i)], 0.0, double(highest)));
            outside = outside || numbers[size_t(i)] < 0 || numbers[size_t(i)] > highest;
        }
        if (outside) file_.warn(node.where() + " is out of range and is clamped");
    }

    /// Into a scattering medium it is how light gets into the body. On its own it would be a sheet that glows on both sides.
    void readDiffuseTransmission(const JsonNode& node, MeshMaterial& m)
    {
        if (!node.exists()) return;
        if (!m.hasVolumeScatter) {
            file_.warn("KHR_materials_diffuse_transmission without KHR_materials_volume_scatter is ignored: material " + inQuotes(m.name));
            return;
        }
        factor(node["diffuseTransmissionFactor"], m.diffuseTransmission);
        if (node["diffuseTransmissionTexture"].exists() || node["diffuseTransmissionColorTexture"].exists() ||
            node["diffuseTransmissionColorFactor"].exists())
            file_.warn("KHR_materials_diffuse_transmission: its textures and colour are ignored: material " + inQuotes(m.name));
    }

    void slot(const JsonNode& node, TextureSlot& slot)
    {
        if (!node.exists()) return;
        slot.texture = textures_.load(node["index"]);
        JsonNode texcoord = node["texCoord"];
        const JsonNode transform = File::extension(node, "KHR_texture_transform");
        if (transform.exists()) {
            if (transform["texCoord"].exists()) texcoord = transform["texCoord"];
            readTransform(transform, slot);
        }
        slot.texcoord = texcoord.exists() ? texcoord.integer(0, 255) : 0;
        if (slot.texcoord > 1)
            unsupported(texcoord.where() + " is " + std::to_string(slot.texcoord) +
                        ", only TEXCOORD_0 and TEXCOORD_1 are supported; export with fewer sets of texture coordinates");
    }

    /// uv' = offset + R S uv with R = [c s; -s c]: a counter-clockwise turn where v points down. The GLSL of the extension's text
    /// has the other sign (KhronosGroup/glTF issue 1563); its example, its test model and the other readers agree with this one.
    void readTransform(const JsonNode& node, TextureSlot& slot)
    {
        const auto pair = [](const JsonNode& n, glm::vec2 absent) {
            if (!n.exists()) return absent;
            const std::vector<double> v = n.numbers(2);
            return glm::vec2(v[0], v[1]);
        };
        const double angle = node["rotation"].exists() ? node["rotation"].number() : 0.0;
        const float c = float(std::cos(angle)), s = float(std::sin(angle));
        const glm::vec2 scale = pair(node["scale"], glm::vec2(1.0f));
        slot.uvOffset = pair(node["offset"], glm::vec2(0.0f));
        slot.uvScaleRotate = glm::mat2(glm::vec2(c, -s) * scale.x, glm::vec2(s, c) * scale.y); // columns
    }

    void number(const JsonNode& node, float& value)
    {
        if (node.exists()) value = float(node.number());
    }

    void readCore(const JsonNode& node, MeshMaterial& m)
    {
        const JsonNode pbr = node["pbrMetallicRoughness"];
        color(pbr["baseColorFactor"], m.baseColor);
        slot(pbr["baseColorTexture"], m.baseColorTexture);
        factor(pbr["metallicFactor"], m.metallic);
        factor(pbr["roughnessFactor"], m.roughness);
        slot(pbr["metallicRoughnessTexture"], m.metallicRoughnessTexture);
        slot(node["normalTexture"], m.normalTexture);
        number(node["normalTexture"]["scale"], m.normalScale);
        if (node["alphaMode"].exists()) {
            const std::string mode = node["alphaMode"].string();
            if (mode == "MASK") m.alphaMode = AlphaMode::kMask;
            else if (mode == "BLEND") m.alphaMode = AlphaMode::kBlend;
            else if (mode != "OPAQUE") node["alphaMode"].fail("OPAQUE, MASK or BLEND", inQuotes(mode));
        }
        factor(node["alphaCutoff"], m.alphaCutoff, 0.0f, 1e30f); // above 1: everything is cut out
        if (node["doubleSided"].exists()) m.doubleSided = node["doubleSided"].boolean();

        glm::vec3 emissive(0.0f);
        color(node["emissiveFactor"], emissive);
        if (emissive != glm::vec3(0.0f)) file_.warn("ignored: emission of materials (the light stage lights the scene)");
    }

    void readExtensions(const JsonNode& node, MeshMaterial& m)
    {
        const JsonNode ior = File::extension(node, "KHR_materials_ior")["ior"];
        if (ior.exists() && ior.number() == 0) m.ior = 0;
        else factor(ior, m.ior, 1.0f, 1e3f);

        const JsonNode specular = File::extension(node, "KHR_materials_specular");
        factor(specular["specularFactor"], m.specular);
        color(specular["specularColorFactor"], m.specularColor, 1e6f); // may exceed 1 (the extension clamps F0 afterwards)
        slot(specular["specularTexture"], m.specularTexture);
        slot(specular["specularColorTexture"], m.specularColorTexture);

        const JsonNode anisotropy = File::extension(node, "KHR_materials_anisotropy");
        factor(anisotropy["anisotropyStrength"], m.anisotropy);
        number(anisotropy["anisotropyRotation"], m.anisotropyRotation);
        slot(anisotropy["anisotropyTexture"], m.anisotropyTexture);

        const JsonNode clearcoat = File::extension(node, "KHR_materials_clearcoat");
        factor(clearcoat["clearcoatFactor"], m.clearcoat);
        factor(clearcoat["clearcoatRoughnessFactor"], m.clearcoatRoughness);
        slot(clearcoat["clearcoatTexture"], m.clearcoatTexture);
        slot(clearcoat["clearcoatRoughnessTexture"], m.clearcoatRoughnessTexture);
        slot(clearcoat["clearcoatNormalTexture"], m.clearcoatNormalTexture);
        number(clearcoat["clearcoatNormalTexture"]["scale"], m.clearcoatNormalScale);

        const JsonNode iridescence = File::extension(node, "KHR_materials_iridescence");
        factor(iridescence["iridescenceFactor"], m.iridescence);
        factor(iridescence["iridescenceIor"], m.iridescenceIor, 1.0f, 1e3f);
        factor(iridescence["iridescenceThicknessMinimum"], m.iridescenceThicknessMinimum, 0.0f, 1e9f);
        factor(iridescence["iridescenceThicknessMaximum"], m.iridescenceThicknessMaximum, 0.0f, 1e9f);
        slot(iridescence["iridescenceTexture"], m.iridescenceTexture);
        slot(iridescence["iridescenceThicknessTexture"], m.iridescenceThicknessTexture);

        const JsonNode transmission = File::extension(node, "KHR_materials_transmission");
        factor(transmission["transmissionFactor"], m.transmission);
        slot(transmission["transmissionTexture"], m.transmissionTexture);

        const JsonNode volume = File::extension(node, "KHR_materials_volume");
        factor(volume["thicknessFactor"], m.thickness, 0.0f, 1e30f);
        color(volume["attenuationColor"], m.attenuationColor);
        if (const JsonNode distance = volume["attenuationDistance"]; distance.exists()) {
            const double d = distance.number(1e39); // exporters write the largest float for "infinite"
            if (!(d > 0)) distance.fail("number above 0", std::to_string(d));
            m.attenuationDistance = d >= 1e30 ? std::numeric_limits<float>::infinity() : float(d);
        }

        const JsonNode scatter = File::extension(node, "KHR_materials_volume_scatter");
        m.hasVolumeScatter = scatter.exists();
        // The draft's name for the colour, and the newer one.
        color(scatter["multiscatterColor"], m.multiscatterColor);
        color(scatter["multiscatterColorFactor"], m.multiscatterColor);
        factor(scatter["scatterAnisotropy"], m.scatterAnisotropy, -0.999f, 0.999f);

        readDiffuseTransmission(File::extension(node, "KHR_materials_diffuse_transmission"), m);
        if (File::extension(node, "KHR_materials_unlit").exists())
            file_.warn("KHR_materials_unlit is ignored: material " + inQuotes(m.name) + " is lit like any other");
        if (File::extension(node, "KHR_materials_pbrSpecularGlossiness").exists())
            file_.warn("KHR_materials_pbrSpecularGlossiness is ignored: material " + inQuotes(m.name) +
                       " uses its metallic-roughness values; convert it if it has none");
    }

    File& file_;
    TextureTable& textures_;
};

} // namespace

void readMaterials(File& file, MeshScene& scene)
{
    TextureTable textures(file, scene);
    MaterialReader reader(file, textures);
    for (const JsonNode& node : file.materials) scene.materials.push_back(reader.read(node));
}

} // namespace nacre::gltf
