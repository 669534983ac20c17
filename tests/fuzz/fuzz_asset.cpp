// Any bytes into the asset reader: an error, or a valid asset that survives another round trip.
#include "appearance/coded_channels.h"
#include "appearance/detail.h"
#include "asset/compact.h"
#include "detail_fixtures.h"
#include "formats_fixtures.h"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <iterator>

using namespace nacre;

namespace {

void check(bool condition)
{
    if (!condition) std::abort();
}

void decodeOnce(std::span<const std::byte> bytes)
{
    auto asset = decodeAsset(bytes);
    if (!asset) {
        check(!asset.error().message.empty());
        check(asset.error().message.find('\n') == std::string::npos);
        return;
    }
    check(bool(validate(*asset)));
    expandChannels(*asset);
    asset->drawnVisibility = 0; // takes too long
    if (!validate(*asset)) return; // codes that stand for numbers beyond what a channel may hold
    check(!summarizeAsset(*asset).channels.empty());
    const auto again = encodeAsset(*asset);
    check(bool(again));
    const auto back = decodeAsset(*again);
    check(back && test::identical(*asset, *back) && back->presets == asset->presets);
    if (asset->cloud.count > 1000) return;
    const Detail less{0.5f, 0, 9, 16};
    if (asset->find("importance")) check(reduceDetail(*asset, less) && validate(*asset));
}

/// Most mutations only make the GLB lengths disagree. The same content with lengths that agree reaches the code behind them.
std::vector<std::byte> withRepairedLengths(std::span<const std::byte> bytes)
{
    std::vector<std::byte> out(bytes.begin(), bytes.end());
    out.resize(std::max<size_t>(out.size() / 4 * 4, 28));
    constexpr char kBin[] = "BIN";
    const auto bin = std::search(out.begin() + 20, out.end(), reinterpret_cast<const std::byte*>(kBin),
                                 reinterpret_cast<const std::byte*>(kBin) + 4);
    const size_t binType = bin == out.end() ? 0 : size_t(bin - out.begin());
    const auto put = [&](size_t offset, size_t value) {
        const uint32_t v = uint32_t(value);
        std::memcpy(out.data() + offset, &v, 4);
    };
    put(0, 0x46546C67), put(4, 2), put(16, 0x4E4F534A);
    if (binType >= 24 && binType % 4 == 0) {
        put(12, binType - 4 - 20);
        put(binType - 4, out.size() - binType - 4);
    } else {
        put(12, out.size() - 20);
    }
    put(8, out.size());
    return out;
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
    const std::span bytes(reinterpret_cast<const std::byte*>(data), size);
    decodeOnce(bytes);
    decodeOnce(withRepairedLengths(bytes));
    return 0;
}

extern "C" size_t nacreFuzzSeed(uint8_t* out, size_t cap, unsigned i)
{
    struct {
        size_t count;
        int sFunctions, neutralFunctions;
    } const kSeeds[] = {{1, 0, 0}, {2, 1, 1}, {3, 4, 4}, {2, 9, 16}, {9, 25, 9}};
    const unsigned bigs = std::size(kSeeds);
    if (i >= bigs + 5) return 0;
    SplatAsset ordered = test::withOrder(test::makeAsset(4, 1, 1, true));
    ordered.presets = test::somePresets();
    const auto bytes = i == bigs + 4  ? encodeAsset(ordered)
                       : i < bigs     ? encodeAsset(test::makeAsset(kSeeds[i].count, kSeeds[i].sFunctions, kSeeds[i].neutralFunctions))
                       : i < bigs + 2 ? encodeAsset(test::makeSss(2, i > bigs))
                                      : encodeCompact(test::makeQuantised(i == bigs + 2 ? 3 : 300, i == bigs + 3));
    check(bytes && bytes->size() <= cap);
    std::memcpy(out, bytes->data(), bytes->size());
    return bytes->size();
}
