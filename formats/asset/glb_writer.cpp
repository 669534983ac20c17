// SplatAsset -> .glb bytes, through tinygltf (the only file that knows it; Debian ships its implementation as a shared library,
// so no TINYGLTF_IMPLEMENTATION here). Layout: formats/SPEC.md. Deterministic: maps are ordered, floats print as shortest text.
#include "asset/glb_layout.h"
#include "base/base64.h"
#include "base/color.h"

#include <tiny_gltf.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <exception>
#include <limits>
#include <sstream>

namespace nacre::glb {
namespace {

using tinygltf::Value;

/// The double that prints as the shortest text which still reads back as `x` (0.1, not 0.10000000149011612).
double shortest(float x)
{
    char text[32];
    const auto end = std::to_chars(text, text + sizeof text, x).ptr;
    double d = 0;
    std::from_chars(text, end, d);
    return float(d) == x ? d : double(x);
}

/// Builds the one buffer and everything that points into it.
class Writer {
public:
    Writer(const SplatAsset& asset, bool interop) : asset_(asset), interop_(interop), count_(asset.cloud.count) { model_.buffers.emplace_back(); }

    tinygltf::Model build()
    {
        writeGeometry();
        writeNeutralLook();
        writeRelightData();
        writeScene();
        return std::move(model_);
    }

private:
    /// A new zeroed bufferView at the end of the buffer; returns its index. All sizes are multiples of 4.
    int addView(const std::string& name, size_t byteLength, size_t byteStride)
    {
        std::vector<unsigned char>& data = model_.buffers[0].data;
        tinygltf::BufferView view;
        view.name = name;
        view.buffer = 0;
        view.byteOffset = data.size();
        view.byteLength = byteLength;
        view.byteStride = byteStride;
        if (byteStride) view.target = TINYGLTF_TARGET_ARRAY_BUFFER; // vertex attributes only
        data.resize(data.size() + byteLength);
        model_.bufferViews.push_back(std::move(view));
        return int(model_.bufferViews.size()) - 1;
    }

    /// Valid until the next addView.
    float* floatsOf(int view)
    {
        return reinterpret_cast<float*>(model_.buffers[0].data.data() + model_.bufferViews[size_t(view)].byteOffset);
    }

    tinygltf::Accessor& addAttribute(const std::string& name, int view, size_t byteOffset, int type, int componentType = kFloat)
    {
        tinygltf::Accessor accessor;
        accessor.bufferView = view;
        accessor.byteOffset = byteOffset;
        accessor.componentType = componentType;
        accessor.type = type;
        accessor.count = count_;
        primitive_.attributes[name] = int(model_.accessors.size());
        return model_.accessors.emplace_back(std::move(accessor));
    }

    /// One tight attribute of `components` floats per splat; `at(i)` gives the address of splat i's.
    template <class At> tinygltf::Accessor& writeAttribute(const char* name, int components, int type, At at)
    {
        const size_t bytes = 4 * size_t(components);
        const int view = addView(name, bytes * count_, bytes);
        float* out = floatsOf(view);
        for (size_t i = 0; i < count_; ++i) std::memcpy(out + i * size_t(components), at(i), bytes);
        return addAttribute(name, view, 0, type);
    }

    void writeGeometry()
    {
        const SplatCloud& cloud = asset_.cloud;
        glm::vec3 lo = cloud.positions[0], hi = lo;
        for (const glm::vec3& p : cloud.positions) {
            lo = glm::min(lo, p);
            hi = glm::max(hi, p);
        }
        tinygltf::Accessor& position =
            writeAttribute(kPosition, 3, TINYGLTF_TYPE_VEC3, [&](size_t i) { return &cloud.positions[i].x; });
        position.minValues = {lo.x, lo.y, lo.z};
        position.maxValues = {hi.x, hi.y, hi.z};

        glm::vec4 xyzw;
        writeAttribute(kRotation, 4, TINYGLTF_TYPE_VEC4, [&](size_t i) {
            const glm::quat& q = cloud.rotations[i];
            xyzw = {q.x, q.y, q.z, q.w};
            return &xyzw.x;
        });
        writeAttribute(kScale, 3, TINYGLTF_TYPE_VEC3, [&](size_t i) { return &cloud.scales[i].x; });
        writeAttribute(kOpacity, 1, TINYGLTF_TYPE_SCALAR, [&](size_t i) { return &cloud.opacities[i]; });
    }

    /// KHR demands degree 0, so an asset without a neutral look gets a zero coefficient (mid grey in other viewers) and the
    /// extension's neutralFunctions = 0 tells our reader.
    void writeNeutralLook()
    {
        const NeutralLook& look = asset_.neutral;
        const std::vector<glm::vec3> none(look.shFunctions == 0 ? count_ : 0, glm::vec3(0.0f));
        const std::vector<glm::vec3>& sh = look.shFunctions == 0 ? none : look.sh;
        const size_t functions = std::max<size_t>(1, size_t(look.shFunctions));

        const size_t stride = functions * sizeof(glm::vec3); // interleaved: at most 192 bytes
        const int view = addView("neutral look SH", stride * count_, stride);
        std::memcpy(floatsOf(view), sh.data(), stride * count_);
        for (size_t f = 0; f < functions; ++f) addAttribute(shAttribute(int(f)), view, f * sizeof(glm::vec3), TINYGLTF_TYPE_VEC3);

        // For viewers that know no splats at all: coloured points.
        glm::vec4 color;
        writeAttribute(kColor, 4, TINYGLTF_TYPE_VEC4, [&](size_t i) {
            glm::vec3 rgb = glm::clamp(0.5f + 0.28209479177387814f * sh[i * functions], 0.0f, 1.0f);
            for (int c = 0; interop_ && c < 3; ++c) rgb[c] = linearFromSrgb(rgb[c]); // COLOR_0 is linear whatever the look is
            color = glm::vec4(rgb, asset_.cloud.opacities[i]);
            return &color.x;
        });
    }

    /// Channels in buffer views of their own, in the order of the splats.
    Value::Array writeChannels(int* version)
    {
        Value::Array channels;
        for (const Channel& channel : asset_.channels) {
            const bool floats = channel.bytes.empty();
            const size_t bytes = channel.sizeInBytes();
            const int view = addView(channel.name, bytes, 0);
            std::memcpy(floatsOf(view), floats ? static_cast<const void*>(channel.values.data()) : channel.bytes.data(), bytes);
            Value::Object entry{{"name", Value(channel.name)},
                                {"components", Value(int(channel.components))},
                                {"componentType", Value(floats ? kFloat : kUnorm8)},
                                {"bufferView", Value(view)}};
            if (channel.perAsset) entry["perAsset"] = Value(true);
            if (channel.leading > 0) entry["leading"] = Value(int(channel.leading)), *version = kLeadingVersion;
            channels.emplace_back(std::move(entry));
        }
        return channels;
    }

    /// Four numbers of a splat to an attribute, so that whatever moves the splats takes them along.
    void writeParts(const std::string& name, const std::vector<float>& values, size_t components)
    {
        constexpr int kTypes[] = {TINYGLTF_TYPE_SCALAR, TINYGLTF_TYPE_VEC2, TINYGLTF_TYPE_VEC3, TINYGLTF_TYPE_VEC4};
        for (size_t k = 0; k < components; k += 4) {
            const size_t n = std::min<size_t>(4, components - k);
            writeAttribute(relightAttribute(name, k / 4).c_str(), int(n), kTypes[n - 1], [&](size_t i) { return &values[i * components + k]; });
        }
    }

    template <class At> void writeBytes(const std::string& name, At at)
    {
        const int view = addView(name, 4 * count_, 4);
        for (size_t i = 0; i < count_; ++i) {
            const uint32_t word = at(i);
            std::memcpy(floatsOf(view) + i, &word, 4);
        }
        addAttribute(name, view, 0, TINYGLTF_TYPE_VEC4, kUnorm8);
    }

    /// What is per splat goes into attributes, the rest as text into the extension: no index of it is left for a tool to renumber.
    void writeInteropData(Value::Object& relight)
    {
        uint64_t shared = fnv1a(asset_.model.data(), asset_.model.size());
        const auto text = [&shared](const std::vector<float>& values) {
            shared = fnv1a(values.data(), values.size() * sizeof(float), shared);
            return Value(toBase64(values.data(), values.size() * sizeof(float)));
        };
        Value::Array channels, coded;
        for (const Channel& channel : asset_.channels) {
            Value::Object entry{{"name", Value(channel.name)}, {"components", Value(int(channel.components))}};
            if (channel.perAsset) entry["data"] = text(channel.values);
            else if (!channel.values.empty()) writeParts(channel.name, channel.values, channel.components);
            channels.emplace_back(std::move(entry));
        }
        for (size_t g = 0; g < asset_.coded.size(); ++g) {
            const CodedChannels& group = asset_.coded[g];
            Value::Array names;
            for (const std::string& name : group.channels) names.emplace_back(name);
            Value::Object entry{{"channels", Value(std::move(names))}, {"codes", Value(int(group.codes))}};
            entry["offset"] = text(group.offset), entry["basis"] = text(group.basis);
            coded.emplace_back(std::move(entry));
            for (size_t k = 0; k < group.codes; k += 4)
                writeBytes(relightAttribute(codesName(g), k / 4), [&](size_t i) {
                    uint32_t word = 0;
                    for (size_t c = k; c < k + 4; ++c) word |= uint32_t(c < group.codes ? group.values[i * group.codes + c] + 128 : 128) << 8 * (c - k);
                    return word;
                });
        }
        writeBytes(kStamp, [&](size_t i) { return stampOf(shared, asset_.cloud.positions[i]); });
        relight["channels"] = Value(std::move(channels));
        if (!coded.empty()) relight["coded"] = Value(std::move(coded));
        if (asset_.drawnVisibility > 0) relight["drawnVisibility"] = Value(asset_.drawnVisibility);
    }

    static Value presetValue(const Preset& p)
    {
        Value::Object object{{"name", Value(p.name)}};
        if (p.detail.splats != 1) object["splats"] = Value(shortest(p.detail.splats));
        Value::Array parts;
        for (const DetailPartName& part : kDetailParts)
            if (p.detail.leaveOut & part.part) parts.emplace_back(std::string(part.name));
        if (!parts.empty()) object["leaveOut"] = Value(std::move(parts));
        const auto whole = [&](const char* key, uint32_t value) {
            if (value > 0) object[key] = Value(int(value));
        };
        whole("transportFunctions", p.detail.transportFunctions), whole("visibilitySize", p.detail.visibilitySize), whole("environmentDirections", p.environmentDirections);
        if (p.resolutionScale != 1) object["resolutionScale"] = Value(shortest(p.resolutionScale));
        if (p.milliseconds != 0) object["milliseconds"] = Value(p.milliseconds);
        if (p.psnrMasked != 0) object["psnrMasked"] = Value(p.psnrMasked);
        if (!p.measuredOn.empty()) object["measuredOn"] = Value(p.measuredOn);
        return Value(std::move(object));
    }

    void writeRelightData()
    {
        int version = kPlainVersion; // readers of older versions can read what does not need a newer one
        const AssetFrame& frame = asset_.frame;
        const bool placed = frame != AssetFrame{};
        Value::Object relight{
            {"model", Value(asset_.model)},
            {"profile", Value(std::string(interop_ ? kInteropProfile : kLosslessProfile))},
            {"screenFilter",
             Value(Value::Object{{"type", Value(std::string("mip"))}, {"variance", Value(shortest(asset_.lowPassVariance))}})},
            {"lightUnits", Value(std::string("KHR_lights_punctual"))},
            {"bakedWith", Value(asset_.bakedWith)}};
        if (interop_) {
            writeInteropData(relight);
            version = kRelightVersion;
        } else {
            relight["count"] = Value(int(count_));
            relight["positionHash"] = Value(positionHash(asset_.cloud.positions));
            relight["neutralFunctions"] = Value(asset_.neutral.shFunctions);
            relight["channels"] = Value(writeChannels(&version));
            if (placed) version = kFrameVersion;
        }
        relight["version"] = Value(version);
        Value::Array presets;
        for (const Preset& p : asset_.presets) presets.push_back(presetValue(p));
        if (!presets.empty()) relight["presets"] = Value(std::move(presets));
        if (placed)
            relight["datasetFrame"] = Value(Value::Object{
                {"scale", Value(frame.scale)},
                {"translation", Value(Value::Array{Value(frame.translation.x), Value(frame.translation.y), Value(frame.translation.z)})},
                {"lightGain", Value(frame.lightGain)}});
        primitive_.extensions[kSplatExtension] =
            Value(Value::Object{{"kernel", Value(std::string("ellipse"))},
                                {"colorSpace", Value(std::string(interop_ ? kSrgbSpace : kLinearSpace))},
                                {"projection", Value(std::string("perspective"))},
                                {"sortingMethod", Value(std::string("cameraDistance"))},
                                {"extensions", Value(Value::Object{{kRelightExtension, Value(std::move(relight))}})}});
    }

    void writeScene()
    {
        primitive_.mode = TINYGLTF_MODE_POINTS;
        tinygltf::Mesh mesh;
        mesh.primitives.push_back(std::move(primitive_));
        model_.meshes.push_back(std::move(mesh));

        const glm::quat& q = asset_.yUpFromAsset;
        tinygltf::Node node;
        node.mesh = 0;
        node.rotation = {shortest(q.x), shortest(q.y), shortest(q.z), shortest(q.w)};
        model_.nodes.push_back(std::move(node));
        tinygltf::Scene scene;
        scene.nodes = {0};
        model_.scenes.push_back(std::move(scene));
        model_.defaultScene = 0;
        model_.asset.version = "2.0";
        model_.asset.generator = "Nacre";
        model_.extensionsUsed = {kSplatExtension, kRelightExtension};
    }

    const SplatAsset& asset_;
    const bool interop_;
    const size_t count_;
    tinygltf::Model model_;
    tinygltf::Primitive primitive_;
};

/// Collects the stream in the vector we return, without the extra copy of an ostringstream.
class VectorBuffer : public std::streambuf {
public:
    std::vector<std::byte> bytes;

private:
    std::streamsize xsputn(const char* s, std::streamsize n) override
    {
        const auto* p = reinterpret_cast<const std::byte*>(s);
        bytes.insert(bytes.end(), p, p + n);
        return n;
    }
    int_type overflow(int_type c) override
    {
        bytes.push_back(std::byte(c));
        return c;
    }
};

/// Chunk lengths of a .glb are 32 bit and tinygltf counts some things in int; 64 MiB are kept for the JSON and the headers.
uint64_t bufferBytes(const SplatAsset& asset)
{
    uint64_t bytes = 4 * asset.cloud.count * (3 + 4 + 3 + 1 + 4 + 3 * uint64_t(std::max(1, asset.neutral.shFunctions)));
    for (const Channel& channel : asset.channels) bytes += channel.sizeInBytes();
    for (const CodedChannels& coded : asset.coded) bytes += asset.cloud.count * (coded.codes + 3) / 4 * 4;
    return bytes + 4 * asset.cloud.count; // stamps of profile interop
}
constexpr uint64_t kMaxBufferBytes = std::numeric_limits<uint32_t>::max() - (uint64_t(64) << 20);

Result<std::vector<std::byte>> serialise(const SplatAsset& asset, bool interop)
{
    if (bufferBytes(asset) > kMaxBufferBytes)
        return Error{ErrorCode::kUnsupported, "the asset needs " + std::to_string(bufferBytes(asset) >> 20) +
                                                  " MiB, a .glb holds at most 4 GiB; bake with fewer splats (--max-splats)"};
    try {
        const tinygltf::Model model = Writer(asset, interop).build();
        VectorBuffer buffer;
        buffer.bytes.reserve(model.buffers[0].data.size() + (size_t(1) << 16));
        std::ostream stream(&buffer);
        tinygltf::TinyGLTF gltf;
        if (!gltf.WriteGltfSceneToStream(&model, stream, /*prettyPrint*/ false, /*writeBinary*/ true) || !stream)
            return Error{ErrorCode::kIo, "tinygltf could not serialise the asset"};
        return std::move(buffer.bytes);
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::kIo, "out of memory while serialising an asset of " + std::to_string(bufferBytes(asset) >> 20) + " MiB"};
    } catch (const std::exception& e) { // a name that is not UTF-8
        return Error{ErrorCode::kBadInput, std::string("cannot serialise the asset: ") + e.what()};
    }
}

} // namespace

Result<std::vector<std::byte>> write(const SplatAsset& asset) { return serialise(asset, false); }
Result<std::vector<std::byte>> writeInterop(const SplatAsset& asset) { return serialise(asset, true); }

} // namespace nacre::glb
