// Which light reaches each splat past the others, on a device: what splat/light_visibility.h draws, many views at a time. A view is a direction,
// or a face of the cube around a light. In each, a splat is an event twice: where it reads the image (behind what lies `bias` before it) and
// where it is drawn. Events are sorted by depth, listed per tile of the image, and a block draws a tile, its pixels in registers.
#pragma once

#include "device/radix_sort.h"
#include "device/tiles.h"
#include "splat/light_visibility.h"

#include <bit>

namespace nacre::NACRE_BACKEND {

constexpr int kShadowTile = 16, kShadowTilesX = kShadowSize / kShadowTile, kShadowTiles = kShadowTilesX * kShadowTilesX;

struct ShadowItem {
    glm::vec3 position;
    glm::mat3 axes;
    float opacity;
};

struct ShadowView {
    ShadowDirection direction;
    glm::vec3 light;
    int face; // -1: a direction
    NACRE_HD float margin() const { return face < 0 ? kShadowMargin : 0.0f; }
};

/// A number that orders like the depth (base/radix_sort.h).
NACRE_DEVICE inline uint32_t depthKey(float depth)
{
    uint32_t bits;
    memcpy(&bits, &depth, sizeof bits);
    return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
}

/// A thread a splat of a view: reads 52 bytes, which views share, and writes 44. Events: reads [view][splat], then as many that draw, so that of
/// equal depths reading comes first.
struct FlattenShadows {
    static constexpr uint32_t kThreads = 128;
    const ShadowItem* items;
    const ShadowView* views;
    uint32_t splats, count; // splats times views
    float bias;
    FlatSplat* flat;
    uint32_t *keys, *events;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        const uint32_t i = uint32_t(t.index());
        if (i >= count) return;
        const ShadowItem& item = items[i % splats];
        const ShadowView& view = views[i / splats];
        FlatSplat s{-1000, -1000, 0, 0, 0, 0, 0}; // outside, and nothing
        if (view.face < 0) s = flatAlong(view.direction, item.position, item.axes, item.opacity);
        else flatInFace(view.light, view.face, item.position, item.axes, item.opacity, s);
        flat[i] = s;
        keys[i] = depthKey(s.depth - bias), keys[count + i] = depthKey(s.depth);
        events[i] = i, events[count + i] = count + i;
    }
};

struct ShadowRect {
    int x0, x1, y0, y1; // in tiles
    NACRE_DEVICE uint32_t count() const { return x1 < x0 || y1 < y0 ? 0 : uint32_t((x1 - x0 + 1) * (y1 - y0 + 1)); }
};

/// What finds the tiles of events.
struct ShadowEvents {
    const FlatSplat* flat;
    const ShadowView* views;
    uint32_t splats, count;

    NACRE_DEVICE uint32_t slot(uint32_t event) const { return event < count ? event : event - count; }
    NACRE_DEVICE ShadowRect rect(uint32_t event) const
    {
        const FlatSplat& s = flat[slot(event)];
        if (event < count) {
            if (!insideShadow(s, views[event / splats].margin())) return {0, -1, 0, -1};
            const ShadowPlace at = shadowPlace(s.x, s.y);
            return {at.x / kShadowTile, (at.x + 1) / kShadowTile, at.y / kShadowTile, (at.y + 1) / kShadowTile};
        }
        const ShadowReach r = shadowReach(s);
        if (r.x1 < r.x0 || r.y1 < r.y0) return {0, -1, 0, -1};
        return {r.x0 / kShadowTile, r.x1 / kShadowTile, r.y0 / kShadowTile, r.y1 / kShadowTile};
    }
};

/// A thread an event, in the order of depth: reads 4 bytes and 28 elsewhere, writes 4.
struct CountShadowTiles {
    static constexpr uint32_t kThreads = 256;
    ShadowEvents all;
    const uint32_t* events;
    uint32_t* tiles;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        if (t.index() < 2 * size_t(all.count)) tiles[t.index()] = all.rect(events[t.index()]).count();
    }
};

/// As above, and writes 8 bytes a pair of event and tile.
struct WriteShadowPairs {
    static constexpr uint32_t kThreads = 256;
    ShadowEvents all;
    const uint32_t *events, *starts;
    uint32_t *tiles, *pairs;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        if (t.index() >= 2 * size_t(all.count)) return;
        const uint32_t event = events[t.index()], firstTile = all.slot(event) / all.splats * kShadowTiles;
        const ShadowRect rect = all.rect(event);
        uint32_t to = starts[t.index()];
        for (int y = rect.y0; y <= rect.y1; ++y)
            for (int x = rect.x0; x <= rect.x1; ++x, ++to) tiles[to] = firstTile + uint32_t(y * kShadowTilesX + x), pairs[to] = event;
    }
};

/// A block a tile of a view, a thread four pixels below each other. Reads 32 bytes a pair; writes 4 bytes for each of the pixels that a splat reads.
struct DrawShadowTiles {
    static constexpr uint32_t kThreads = 64;
    static constexpr int kPixels = 4;
    struct Shared {
        FlatSplat splat[kThreads];
        float reach[kThreads]; // negative: it reads
        int x[kThreads], y[kThreads];
        uint32_t slot[kThreads];
    };
    ShadowEvents all;
    const uint32_t *tileStart, *pairs;
    float* corners; // [4][count]

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        const int tile = int(t.block() % kShadowTiles);
        const int x = tile % kShadowTilesX * kShadowTile + int(t.thread()) % kShadowTile;
        const int y0 = tile / kShadowTilesX * kShadowTile + int(t.thread()) / kShadowTile * kPixels;
        float lit[kPixels];
        for (float& l : lit) l = 1;
        const uint32_t end = tileStart[t.block() + 1];
        for (uint32_t first = tileStart[t.block()]; first < end; first += kThreads) {
            const uint32_t here = end - first < kThreads ? end - first : kThreads;
            if (t.thread() < here) {
                const uint32_t event = pairs[first + t.thread()], slot = all.slot(event);
                const FlatSplat splat = all.flat[slot];
                s.splat[t.thread()] = splat, s.slot[t.thread()] = slot;
                if (event < all.count) {
                    const ShadowPlace at = shadowPlace(splat.x, splat.y);
                    s.reach[t.thread()] = -1, s.x[t.thread()] = at.x, s.y[t.thread()] = at.y;
                } else {
                    s.reach[t.thread()] = shadowReach(splat).reach;
                }
            }
            t.sync();
            for (uint32_t k = 0; k < here; ++k) {
                const float reach = s.reach[k];
                if (reach < 0) {
                    const int right = x - s.x[k];
                    if (right != 0 && right != 1) continue;
                    for (int p = 0; p < kPixels; ++p) {
                        const int below = y0 + p - s.y[k];
                        if (below == 0 || below == 1) corners[size_t(2 * below + right) * all.count + s.slot[k]] = lit[p];
                    }
                    continue;
                }
                const FlatSplat splat = s.splat[k];
                const float dx = 0.5f - splat.x + float(x);
                for (int p = 0; p < kPixels; ++p) {
                    const float dy = float(y0 + p) + 0.5f - splat.y, q = (splat.a * dx + splat.b * dy) * dx + splat.c * dy * dy;
                    if (!(q < reach)) continue;
                    const float alpha = splat.opacity * std::exp(-q);
                    lit[p] *= 1 - (alpha < kShadowMostAlpha ? alpha : kShadowMostAlpha);
                }
            }
            t.sync();
        }
    }
};

/// What has been read in one view.
struct ShadowReads {
    const FlatSplat* flat;
    const float* corners; // [4][count]
    uint32_t splats, count;

    NACRE_DEVICE bool read(uint32_t view, uint32_t splat, float margin, float& value) const
    {
        const size_t slot = size_t(view) * splats + splat;
        const FlatSplat& s = flat[slot];
        if (!insideShadow(s, margin)) return false;
        const float* c = corners + slot;
        value = shadowPlace(s.x, s.y).value(c[0], c[count], c[2 * size_t(count)], c[3 * size_t(count)]);
        return true;
    }
};

/// A thread a splat and a texel: reads 24 bytes a view and writes one.
struct TexelsFromReads {
    static constexpr uint32_t kThreads = 256;
    ShadowReads reads;
    uint32_t texels, viewsPerTexel; // of this batch
    uint32_t firstTexel, mapTexels;
    uint8_t* maps; // [splat][mapTexels]

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        if (t.index() >= size_t(texels) * reads.splats) return;
        const uint32_t splat = uint32_t(t.index() % reads.splats), texel = uint32_t(t.index() / reads.splats);
        float sum = 0;
        for (uint32_t k = 0; k < viewsPerTexel; ++k) {
            float value = 1;
            reads.read(texel * viewsPerTexel + k, splat, kShadowMargin, value);
            sum += value;
        }
        maps[size_t(splat) * mapTexels + firstTexel + texel] = uint8_t(std::lround(sum * (255.0f / float(viewsPerTexel))));
    }
};

/// A thread a splat and a light: the face that it is in, or all light. Reads 24 bytes or more, writes one.
struct ArrivesFromReads {
    static constexpr uint32_t kThreads = 256;
    ShadowReads reads;
    uint32_t lights;
    uint8_t* arrives; // [light][splat]

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        if (t.index() >= size_t(lights) * reads.splats) return;
        const uint32_t splat = uint32_t(t.index() % reads.splats), light = uint32_t(t.index() / reads.splats);
        float value = 1;
        for (uint32_t face = 0; face < 6; ++face) reads.read(6 * light + face, splat, 0, value);
        arrives[t.index()] = uint8_t(std::lround(255 * value));
    }
};

/// A block a splat, a thread some lights: the four texels that it looks up towards each light become the mean over the lights that share them.
struct LookAtLights {
    static constexpr uint32_t kThreads = 128;
    struct Shared { uint32_t sum[kVisibilityTexels], lights[kVisibilityTexels]; };
    const ShadowItem* items;
    const glm::vec3* lights;
    const uint8_t* arrives; // [light][splat]
    uint32_t lightCount, splats;
    int size; // texels a side of the maps, at most kVisibilitySize
    float bias;
    uint8_t* maps;

    NACRE_DEVICE void operator()(const Thread& t) const
    {
        Shared& s = t.shared<Shared>();
        const uint32_t texels = uint32_t(size * size), splat = t.block();
        for (uint32_t k = t.thread(); k < texels; k += kThreads) s.sum[k] = s.lights[k] = 0;
        t.sync();
        for (uint32_t l = t.thread(); l < lightCount; l += kThreads) {
            int looked[4];
            if (!texelsTowards(lights[l] - items[splat].position, bias, size, looked)) continue;
            for (const int texel : looked) deviceAdd(&s.sum[texel], uint32_t(arrives[size_t(l) * splats + splat])), deviceAdd(&s.lights[texel], 1u);
        }
        t.sync();
        for (uint32_t k = t.thread(); k < texels; k += kThreads)
            if (s.lights[k] > 0) maps[size_t(splat) * texels + k] = uint8_t((s.sum[k] + s.lights[k] / 2) / s.lights[k]);
    }
};

class DeviceVisibility {
public:
    /// As lightVisibility (splat/light_visibility.h): maps within one of 255 of its. `size`: at most kVisibilitySize.
    std::vector<uint8_t> draw(Device& device, std::span<const GaussianGeometry<float>> splats, int size, int oversample, std::span<const glm::vec3> lights = {})
    {
        const uint32_t n = uint32_t(splats.size()), texels = uint32_t(size * size), perTexel = uint32_t(oversample * oversample);
        if (n == 0) return {};
        const ShadowScene scene = shadowScene(splats);
        std::vector<ShadowItem> items;
        for (uint32_t i = 0; i < n; ++i) items.push_back({scene.positions[i], scene.axes[i], scene.opacities[i]});
        items_.upload(device, std::span<const ShadowItem>(items));
        maps_.reserve(device, size_t(n) * texels);

        const uint32_t texelsAtOnce = atOnce(n, perTexel, texels);
        for (uint32_t first = 0; first < texels; first += texelsAtOnce) {
            const uint32_t count = std::min(texelsAtOnce, texels - first);
            std::vector<ShadowView> views;
            for (uint32_t texel = first; texel < first + count; ++texel)
                forTexelDirections(size, int(texel), oversample,
                                   [&](const glm::vec3& w) { views.push_back(ShadowView{shadowDirection(scene.center, scene.radius, w), glm::vec3(0), -1}); });
            const ShadowReads reads = drawViews(device, views, n, scene.bias);
            launch(device, blocksFor(size_t(n) * count, TexelsFromReads::kThreads), TexelsFromReads{reads, count, perTexel, first, texels, maps_.data()});
        }

        const std::vector<glm::vec3> among = lightsAmong(scene, lights);
        if (const uint32_t lightCount = uint32_t(among.size()); lightCount > 0) {
            lights_.upload(device, std::span(among)), arrives_.reserve(device, size_t(lightCount) * n);
            const uint32_t lightsAtOnce = atOnce(n, 6, lightCount);
            for (uint32_t first = 0; first < lightCount; first += lightsAtOnce) {
                const uint32_t count = std::min(lightsAtOnce, lightCount - first);
                std::vector<ShadowView> views;
                for (uint32_t l = first; l < first + count; ++l)
                    for (int face = 0; face < 6; ++face) views.push_back(ShadowView{ShadowDirection(), among[l], face});
                const ShadowReads reads = drawViews(device, views, n, scene.bias);
                launch(device, blocksFor(size_t(n) * count, ArrivesFromReads::kThreads), ArrivesFromReads{reads, count, arrives_.data() + size_t(first) * n});
            }
            launch(device, n, LookAtLights{items_.data(), lights_.data(), arrives_.data(), lightCount, n, size, scene.bias, maps_.data()});
        }
        std::vector<uint8_t> maps(size_t(n) * texels);
        maps_.download(device, std::span(maps));
        return maps;
    }

private:
    /// How many of `all` fit into the memory of a batch, each of `views` views.
    static uint32_t atOnce(uint32_t splats, uint32_t views, uint32_t all)
    {
        constexpr uint64_t kItems = 1 << 21, kViews = 1 << 12; // about 80 bytes an item and 16 a pair, of which there are about three an item
        return uint32_t(std::clamp<uint64_t>(std::min(kItems / splats, kViews) / views, 1, all));
    }

    ShadowReads drawViews(Device& device, const std::vector<ShadowView>& views, uint32_t splats, float bias)
    {
        if (uint64_t(views.size()) * splats > 1u << 30) throw DeviceError("visibility of " + std::to_string(splats) + " splats: more than there is room for");
        const uint32_t count = uint32_t(views.size()) * splats, tileCount = uint32_t(views.size()) * kShadowTiles;
        views_.upload(device, std::span(views));
        flat_.reserve(device, count), keys_.reserve(device, 2 * size_t(count)), events_.reserve(device, 2 * size_t(count));
        launch(device, blocksFor(count, FlattenShadows::kThreads), FlattenShadows{items_.data(), views_.data(), splats, count, bias, flat_.data(), keys_.data(), events_.data()});
        sort_.run(device, keys_, events_, 32);

        const ShadowEvents all{flat_.data(), views_.data(), splats, count};
        starts_.reserve(device, 2 * size_t(count) + 1);
        launch(device, blocksFor(2 * size_t(count), CountShadowTiles::kThreads), CountShadowTiles{all, events_.data(), starts_.data()});
        scan_.run(device, starts_.data(), starts_.data(), 2 * count);
        uint32_t pairs = 0;
        device.copyOut(&pairs, starts_.data() + 2 * size_t(count), sizeof pairs);
        if (pairs > 1u << 31) throw DeviceError("visibility of " + std::to_string(splats) + " splats, so large: more than there is room for");
        tiles_.reserve(device, pairs), pairs_.reserve(device, pairs), tileStart_.reserve(device, size_t(tileCount) + 1), corners_.reserve(device, 4 * size_t(count));
        launch(device, blocksFor(2 * size_t(count), WriteShadowPairs::kThreads), WriteShadowPairs{all, events_.data(), starts_.data(), tiles_.data(), pairs_.data()});
        pairSort_.run(device, tiles_, pairs_, uint32_t(std::bit_width(tileCount - 1)));
        launch(device, blocksFor(size_t(tileCount) + 1, FindTileStarts::kThreads), FindTileStarts{tiles_.data(), pairs, tileCount, tileStart_.data()});
        launch(device, tileCount, DrawShadowTiles{all, tileStart_.data(), pairs_.data(), corners_.data()});
        return {flat_.data(), corners_.data(), splats, count};
    }

    Buffer<ShadowItem> items_;
    Buffer<ShadowView> views_;
    Buffer<glm::vec3> lights_;
    Buffer<FlatSplat> flat_;
    Buffer<uint32_t> keys_, events_, starts_, tiles_, pairs_, tileStart_;
    Buffer<float> corners_;
    Buffer<uint8_t> maps_, arrives_;
    Scan scan_;
    RadixSort sort_, pairSort_;
};

} // namespace nacre::NACRE_BACKEND
