#include "asset/compact.h"

#include "appearance/model_table.h"
#include "base/octahedral.h"

#include <algorithm>
#include <cmath>

namespace nacre {

namespace {

constexpr const char* kGeometry[] = {"POSITION", "ROTATION", "SCALE", "OPACITY"};
constexpr uint32_t kGeometryComponents[] = {3, 4, 3, 1};

Error bad(const std::string& what) { return {ErrorCode::kBadInput, "block " + what}; }

int geometryOf(const std::string& name)
{
    for (int g = 0; g < 4; ++g)
        if (name == kGeometry[g]) return g;
    return -1;
}

Channel* channelOf(SplatAsset& asset, const std::string& name)
{
    for (Channel& c : asset.channels)
        if (c.name == name) return &c;
    return nullptr;
}

bool isBytes(const SplatAsset& asset, const Channel& channel)
{
    const AppearanceModel* model = findAppearanceModel(asset.model);
    for (const ChannelSpec& spec : model->channels)
        if (channel.name == spec.name) return spec.type == ChannelType::kUnorm8;
    return false;
}

} // namespace

const char* blockTransformName(BlockTransform transform)
{
    switch (transform) {
    case BlockTransform::kLinear: return "linear";
    case BlockTransform::kExp: return "exp";
    case BlockTransform::kRotation: return "rotation";
    case BlockTransform::kDirection: return "direction";
    }
    return "";
}

Result<BlockWriter> BlockWriter::create(SplatAsset& asset, BlockLayout layout)
{
    if (layout.targets.empty()) return bad("without targets");
    const std::string& name = layout.targets[0].name;
    uint32_t components = 0;
    size_t rows = 0;
    bool perAsset = false, whole = true, bytes = false;
    for (const BlockTarget& t : layout.targets) {
        const int geometry = geometryOf(t.name);
        Channel* channel = channelOf(asset, t.name);
        if (geometry < 0 && !channel) return bad("of '" + t.name + "', which is neither geometry nor a channel of the asset");
        const uint32_t most = geometry >= 0 ? kGeometryComponents[geometry] : channel->components;
        if (t.count == 0 || t.first > most || t.count > most - t.first)
            return bad("of '" + t.name + "' has components " + std::to_string(t.first) + " + " + std::to_string(t.count) + ", there are " + std::to_string(most));
        const bool once = channel && channel->perAsset;
        const size_t rowsHere = once ? t.count : channel ? channel->rows(asset.cloud.count) : asset.cloud.count;
        if (&t != &layout.targets[0] && (rowsHere != rows || once)) return bad("of '" + name + "' and '" + t.name + "' joins what has different rows");
        rows = rowsHere, perAsset |= once, components += t.count;
        whole &= channel && t.count == channel->components;
        bytes |= channel && isBytes(asset, *channel);
    }
    const bool basis = !layout.basis.empty();
    uint32_t numbers = perAsset ? 1 : components;
    switch (layout.transform) {
    case BlockTransform::kLinear:
    case BlockTransform::kExp: break;
    case BlockTransform::kRotation:
        if (name != "ROTATION" || components != 4) return bad("of '" + name + "' has the transform of rotations");
        numbers = 3;
        break;
    case BlockTransform::kDirection:
        if (components != 3 || geometryOf(name) >= 0 || perAsset) return bad("of '" + name + "' has the transform of directions, which takes 3 components");
        numbers = 2;
        break;
    }
    if (name == "ROTATION" && layout.transform != BlockTransform::kRotation) return bad("of rotations without their transform");
    if (layout.transform != BlockTransform::kLinear && (layout.targets.size() > 1 || basis)) return bad("of '" + name + "' has a transform that takes one target and no basis");
    if (layout.numbers != numbers || layout.offset.size() != numbers || layout.step.size() != layout.columns || layout.columns == 0 ||
        layout.scale.size() != (basis ? numbers : 0) ||
        (basis ? layout.basis.size() != size_t(layout.columns) * numbers || layout.columns > 2 * numbers || !whole || perAsset : layout.columns != numbers || bytes))
        return bad("of '" + name + "' has " + std::to_string(layout.columns) + " columns for " + std::to_string(layout.numbers) + " numbers, expected " +
                   std::to_string(numbers) + (basis ? " and at most twice as many columns" : bytes ? " and a basis" : ""));
    const auto finite = [](float x) { return std::abs(x) <= 1e15f; };
    for (const std::vector<float>* parameters : {&layout.offset, &layout.step, &layout.scale})
        if (!std::all_of(parameters->begin(), parameters->end(), finite)) return bad("of '" + name + "' has an offset, step or scale that is not finite or beyond 1e15");

    for (const BlockTarget& t : layout.targets)
        if (Channel* channel = channelOf(asset, t.name); channel && !basis)
            channel->values.resize(channel->rows(asset.cloud.count) * channel->components);
    BlockWriter writer(asset, std::move(layout), rows);
    if (basis) writer.codes_.resize(rows * writer.layout_.columns);
    return writer;
}

/// Where number `number` of the first row goes, and how many floats on the next one's.
float* BlockWriter::destination(uint32_t number, size_t* stride)
{
    for (const BlockTarget& t : layout_.targets) {
        if (number >= t.count) {
            number -= t.count;
            continue;
        }
        SplatCloud& cloud = asset_->cloud;
        switch (geometryOf(t.name)) {
        case 0: return *stride = 3, &cloud.positions[0].x + t.first + number;
        case 1: return *stride = 4, number == 0 ? &cloud.rotations[0].x : number == 1 ? &cloud.rotations[0].y : &cloud.rotations[0].z;
        case 2: return *stride = 3, &cloud.scales[0].x + t.first + number;
        case 3: return *stride = 1, &cloud.opacities[0];
        default: break;
        }
        Channel& channel = *channelOf(*asset_, t.name);
        *stride = channel.perAsset ? 1 : channel.components;
        return channel.values.data() + t.first + number;
    }
    return nullptr;
}

bool BlockWriter::column(uint32_t k, std::span<const int32_t> codes)
{
    if (!codes_.empty()) {
        bool fits = true;
        for (size_t i = 0; i < rows_; ++i) {
            fits &= codes[i] >= -127 && codes[i] <= 127;
            codes_[i * layout_.columns + k] = int8_t(codes[i]);
        }
        return fits;
    }
    size_t stride = 0;
    float* out = destination(k, &stride);
    const float offset = layout_.offset[k], step = layout_.step[k];
    for (size_t i = 0; i < rows_; ++i) out[i * stride] = offset + step * float(codes[i]);
    return true;
}

void BlockWriter::finish()
{
    const auto forEach = [&](auto&& change) {
        size_t stride = 0;
        for (uint32_t d = 0; d < layout_.numbers; ++d) {
            float* out = destination(d, &stride);
            for (size_t i = 0; i < rows_; ++i) change(out[i * stride]);
        }
    };
    switch (layout_.transform) {
    case BlockTransform::kLinear: break;
    case BlockTransform::kExp: forEach([](float& x) { x = std::exp(x); }); break;
    case BlockTransform::kRotation:
        for (glm::quat& q : asset_->cloud.rotations) {
            const float rest = 1 - (q.x * q.x + q.y * q.y + q.z * q.z);
            q.w = std::sqrt(std::max(rest, 0.0f));
            if (rest < 0) q = glm::normalize(q);
        }
        break;
    case BlockTransform::kDirection: {
        size_t stride = 0;
        float* out = destination(0, &stride);
        for (size_t i = 0; i < rows_; ++i) {
            const glm::vec3 n = octahedralDirection(std::clamp(out[i * stride], -1.0f, 1.0f), std::clamp(out[i * stride + 1], -1.0f, 1.0f));
            for (int c = 0; c < 3; ++c) out[i * stride + size_t(c)] = n[c];
        }
        break;
    }
    }
    if (layout_.targets[0].name == "OPACITY") forEach([](float& x) { x = std::clamp(x, 0.0f, 1.0f); });
    if (codes_.empty()) return;

    CodedChannels coded;
    for (const BlockTarget& t : layout_.targets) coded.channels.push_back(t.name);
    coded.numbers = layout_.numbers, coded.codes = layout_.columns, coded.offset = layout_.offset, coded.values = std::move(codes_);
    coded.basis.resize(layout_.basis.size());
    for (size_t i = 0; i < coded.basis.size(); ++i) coded.basis[i] = layout_.scale[i % layout_.numbers] * layout_.step[i / layout_.numbers] * float(layout_.basis[i]);
    asset_->coded.push_back(std::move(coded));
}

Status checkComplete(const SplatAsset& asset, std::span<const BlockLayout> layouts)
{
    const auto covered = [&](const std::string& name, uint32_t components) -> Status {
        std::vector<uint8_t> times(components);
        for (const BlockLayout& layout : layouts)
            for (const BlockTarget& t : layout.targets)
                if (t.name == name)
                    for (uint32_t c = t.first; c < t.first + t.count && c < components; ++c) times[c] = uint8_t(std::min(2, times[c] + 1));
        for (uint32_t c = 0; c < components; ++c)
            if (times[c] != 1)
                return Error{ErrorCode::kBadInput, "component " + std::to_string(c) + " of '" + name + "' is in " + (times[c] ? "several blocks" : "no block") + ", expected one"};
        return ok();
    };
    for (int g = 0; g < 4; ++g)
        if (Status s = covered(kGeometry[g], kGeometryComponents[g]); !s) return s;
    for (const Channel& channel : asset.channels)
        if (Status s = covered(channel.name, channel.components); !s) return s;
    return ok();
}

Result<SplatAsset> dequantise(const QuantisedAsset& quantised)
{
    SplatAsset asset = quantised.frame;
    const size_t n = asset.cloud.count;
    asset.profile = "compact";
    asset.cloud.positions.resize(n), asset.cloud.rotations.resize(n), asset.cloud.scales.resize(n), asset.cloud.opacities.resize(n);
    const std::vector<BlockLayout> layouts(quantised.blocks.begin(), quantised.blocks.end());
    if (Status s = checkComplete(asset, layouts); !s) return s.error();
    for (const Block& block : quantised.blocks) {
        Result<BlockWriter> writer = BlockWriter::create(asset, block);
        if (!writer) return writer.error();
        const size_t rows = writer->rows();
        if (block.codes.size() != rows * block.columns) return bad("of '" + block.targets[0].name + "' has " + std::to_string(block.codes.size()) + " integers");
        for (uint32_t k = 0; k < block.columns; ++k)
            if (!writer->column(k, std::span(block.codes).subspan(k * rows, rows))) return bad("of '" + block.targets[0].name + "' has integers beyond 127");
        writer->finish();
    }
    if (Status s = validate(asset); !s) return s.error();
    return asset;
}

} // namespace nacre
