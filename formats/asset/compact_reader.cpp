#include "asset/compact_reader.h"

#include "appearance/model_table.h"
#include "asset/codec/columns.h"
#include "asset/compact.h"
#include "asset/glb_layout.h"

#include <algorithm>
#include <cstring>

namespace nacre::glb {

namespace {

/// Bounds for what is not known yet: a block of the largest channel.
constexpr size_t kMostNumbers = 8192, kMostBlocks = 256;

bool flag(const json& object, const char* key, const std::string& where)
{
    const json* value = find(object, key);
    if (value && !value->is_boolean()) bad(where + "." + key + " is neither true nor false");
    return value && value->get<bool>();
}

BlockTransform transformOf(const std::string& name, const std::string& where)
{
    for (const BlockTransform t : {BlockTransform::kLinear, BlockTransform::kExp, BlockTransform::kRotation, BlockTransform::kDirection})
        if (name == blockTransformName(t)) return t;
    unsupported(where + " has the unknown transform '" + name + "'");
}

template <class T> void takeArray(std::span<const std::byte>& bytes, size_t size, std::vector<T>& out, const std::string& where)
{
    if (size > bytes.size() / sizeof(T)) bad(where + " ends before its parameters do");
    out.resize(size);
    if (size > 0) std::memcpy(out.data(), bytes.data(), size * sizeof(T));
    bytes = bytes.subspan(size * sizeof(T));
}

/// The layout, and in `bytes` what follows it: the columns.
BlockLayout readLayout(const json& entry, std::span<const std::byte>& bytes, const std::string& where)
{
    BlockLayout layout;
    const json& targets = need(entry, "targets", where);
    if (!targets.is_array() || targets.empty() || targets.size() > 16) bad(where + ".targets is not an array of 1 to 16 entries");
    for (const json& t : targets) {
        const size_t first = sizeOr(t, "first", 0, where), count = needSize(t, "count", where);
        if (first > kMostNumbers || count > kMostNumbers) bad(where + " has more than " + std::to_string(kMostNumbers) + " components");
        layout.targets.push_back({needName(t, "name", where), uint32_t(first), uint32_t(count)});
    }
    layout.transform = find(entry, "transform") ? transformOf(needString(entry, "transform", where), where) : BlockTransform::kLinear;
    const size_t numbers = needSize(entry, "numbers", where), columns = sizeOr(entry, "columns", numbers, where);
    if (numbers == 0 || numbers > kMostNumbers || columns == 0 || columns > kMostNumbers) bad(where + " has no numbers or columns, or more than " + std::to_string(kMostNumbers));
    if (columns > 2 * numbers || columns > bytes.size() / codec::kLeastColumnBytes) bad(where + " has " + std::to_string(columns) + " columns, more than its bytes or numbers allow");
    layout.numbers = uint32_t(numbers), layout.columns = uint32_t(columns);
    takeArray(bytes, numbers, layout.offset, where);
    takeArray(bytes, columns, layout.step, where);
    if (flag(entry, "basis", where)) takeArray(bytes, numbers, layout.scale, where), takeArray(bytes, columns * numbers, layout.basis, where);
    return layout;
}

} // namespace

std::vector<Channel> declaredChannels(const json& relight, const std::string& modelName, size_t count)
{
    const AppearanceModel* model = findAppearanceModel(modelName);
    if (!model) return {}; // validation says so
    const json& entries = need(relight, "channels", kRelightExtension);
    if (!entries.is_array() || entries.size() > 64) bad("channels is not an array of at most 64 entries");
    std::vector<Channel> channels;
    for (const json& entry : entries) {
        const std::string where = "channels[" + std::to_string(channels.size()) + "]";
        Channel channel;
        channel.name = needName(entry, "name", where);
        const size_t components = needSize(entry, "components", where);
        const auto named = [&](const auto& other) { return channel.name == other.name; };
        const auto spec = std::find_if(model->channels.begin(), model->channels.end(), named);
        if (spec == model->channels.end()) bad(where + " (" + channel.name + ") does not belong to model '" + modelName + "'");
        if (std::find(spec->components.begin(), spec->components.end(), components) == spec->components.end() || components == 0)
            bad(where + " (" + channel.name + ") has " + std::to_string(components) + " components, which the model does not have");
        if (std::any_of(channels.begin(), channels.end(), named)) bad(where + " (" + channel.name + ") occurs twice");
        channel.components = uint32_t(components);
        channel.perAsset = spec->perAsset;
        if (find(entry, "leading")) {
            channel.leading = needSize(entry, "leading", where);
            if (channel.leading == 0 || channel.leading >= count || !spec->mayLead) bad(where + ".leading is " + std::to_string(channel.leading) + ", out of range");
        }
        channels.push_back(std::move(channel));
    }
    return channels;
}

int drawnVisibility(const json& relight)
{
    const size_t drawn = sizeOr(relight, "drawnVisibility", 0, kRelightExtension);
    if (drawn != 0 && drawn != 16 && drawn != 32) unsupported("drawnVisibility is " + std::to_string(drawn) + ", expected 16 or 32");
    return int(drawn);
}

void readCompact(const json& document, std::span<const std::byte> bin, const json& relight, size_t count, SplatAsset& asset)
{
    // An entropy coder needs no bytes for what never changes: this bounds what a file can ask for.
    if (count == 0 || count / kSplatsPerByte > bin.size())
        bad("the file claims " + std::to_string(count) + " splats, " + std::to_string(bin.size()) + " bytes hold at most " + std::to_string(kSplatsPerByte * bin.size()));
    asset.channels = declaredChannels(relight, asset.model, count);
    asset.cloud.count = count;
    asset.cloud.positions.resize(count), asset.cloud.rotations.resize(count), asset.cloud.scales.resize(count), asset.cloud.opacities.resize(count);
    asset.drawnVisibility = drawnVisibility(relight);

    const json& blocks = need(relight, "blocks", kRelightExtension);
    if (!blocks.is_array() || blocks.size() > kMostBlocks) bad("blocks is not an array of at most " + std::to_string(kMostBlocks) + " entries");
    std::vector<BlockLayout> layouts;
    std::vector<std::span<const std::byte>> columns;
    for (const json& entry : blocks) {
        const std::string where = "blocks[" + std::to_string(layouts.size()) + "]";
        std::span<const std::byte> bytes = bufferView(document, bin, needSize(entry, "bufferView", where)).bytes;
        layouts.push_back(readLayout(entry, bytes, where));
        columns.push_back(bytes);
    }
    if (Status s = checkComplete(asset, layouts); !s) throw Fault{s.error().code, s.error().message}; // before values are allocated
    std::vector<int32_t> codes, left;
    for (size_t b = 0; b < layouts.size(); ++b) {
        const std::string where = "blocks[" + std::to_string(b) + "] (" + layouts[b].targets[0].name + ")";
        Result<BlockWriter> writer = BlockWriter::create(asset, std::move(layouts[b]));
        if (!writer) throw Fault{writer.error().code, writer.error().message};
        codec::ColumnDecoder decoder(columns[b]);
        codes.resize(writer->rows());
        left.clear();
        for (uint32_t k = 0; k < writer->layout().columns; ++k) {
            if (!decoder.next(codes, left) || !writer->column(k, codes)) bad(where + ": column " + std::to_string(k) + " is damaged");
            left.resize(codes.size());
            left.swap(codes);
        }
        if (decoder.rest() != 0) bad(where + " has " + std::to_string(decoder.rest()) + " bytes after its columns");
        writer->finish();
    }
}

} // namespace nacre::glb
