// Tile lists of a device: those of the CPU (render/tiles.h), bit for bit and in the same order.
#include "device/tiles.h"
#include "render/tiles.h"

#include <doctest/doctest.h>

#include <random>
#include <vector>

using namespace nacre;
using namespace nacre::emulated;

namespace {

constexpr Emulation kOrders[] = {{ThreadOrder::kForward}, {ThreadOrder::kReverse}, {ThreadOrder::kRandom, 13}};

View<float> viewOf(int width, int height)
{
    Camera camera;
    camera.width = uint32_t(width), camera.height = uint32_t(height);
    camera.fx = camera.fy = 0.9 * height, camera.cx = 0.5 * width, camera.cy = 0.48 * height;
    camera.worldFromCamera[3] = {0.1, -0.2, 3, 1};
    return makeView<float>(camera, 0.3);
}

/// Some are behind the camera, beside the image, too faint, very long, or so small that they pass between the pixels' centres.
std::vector<GaussianGeometry<float>> randomSplats(size_t count, uint32_t seed)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(-1, 1);
    std::vector<GaussianGeometry<float>> splats(count);
    for (GaussianGeometry<float>& g : splats) {
        const float size = std::exp(1.5f * uniform(random) - 3);
        for (int k = 0; k < 3; ++k) g.position[k] = 1.6f * uniform(random), g.scale[k] = size * std::exp(1.5f * uniform(random));
        if (random() % 8 == 0) g.position[2] = 4; // behind
        for (float& q : g.rotation) q = uniform(random);
        g.opacity = random() % 9 == 0 ? 0.001f : 0.5f + 0.49f * uniform(random);
    }
    return splats;
}

template <class T>
std::vector<T> fetched(Device& device, const T* data, size_t count)
{
    std::vector<T> out(count);
    device.copyOut(out.data(), data, count * sizeof(T));
    return out;
}

template <class T>
bool same(const std::vector<T>& a, const std::vector<T>& b)
{
    return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

/// Of the pairs in the lists. `tiles`: may have been used before.
uint32_t checkTiles(Device& device, Tiles& tiles, const View<float>& view, const std::vector<GaussianGeometry<float>>& splats)
{
    TileBuilder builder;
    builder.build(view, splats);
    const size_t visible = builder.visible.count(), entries = builder.tiles.entries.size();

    Buffer<GaussianGeometry<float>> onDevice;
    onDevice.upload(device, std::span(splats));
    const TileView t = tiles.build(device, view, onDevice.data(), uint32_t(splats.size()));
    REQUIRE(t.visibleCount == visible);
    REQUIRE(t.entryCount == entries);
    CHECK(t.width == builder.tiles.width);
    CHECK(t.height == builder.tiles.height);
    CHECK(t.tilesX == builder.tiles.tilesX);
    CHECK(t.tilesY == builder.tiles.tilesY);
    CHECK(fetched(device, t.splatFromVisible, visible) == builder.visible.splatFromVisible);
    CHECK(same(fetched(device, t.projected, visible), builder.visible.projected));
    CHECK(fetched(device, t.tileStart, builder.tiles.tileStart.size()) == builder.tiles.tileStart);
    CHECK(same(fetched(device, t.entries, entries), builder.tiles.entries));
    CHECK(fetched(device, t.pairStart, visible + 1) == builder.tiles.pairStart);
    CHECK(fetched(device, t.entryFromPair, entries) == builder.tiles.entryFromPair);
    std::vector<uint32_t> visibleFromSplat(splats.size(), ~0u);
    for (size_t v = 0; v < visible; ++v) visibleFromSplat[builder.visible.splatFromVisible[v]] = uint32_t(v);
    CHECK(fetched(device, t.visibleFromSplat, splats.size()) == visibleFromSplat);
    return t.entryCount;
}

uint32_t checkTiles(const View<float>& view, const std::vector<GaussianGeometry<float>>& splats)
{
    uint32_t pairs = 0;
    for (const Emulation& order : kOrders) {
        Device device(order);
        Tiles tiles;
        pairs = checkTiles(device, tiles, view, splats);
    }
    return pairs;
}

} // namespace

TEST_CASE("tile lists of random splats are those of the CPU, for images of any size")
{
    for (const auto& [width, height] : {std::pair(40, 30), std::pair(16, 16), std::pair(1, 1), std::pair(7, 131), std::pair(257, 65)}) {
        CAPTURE(width);
        CHECK(checkTiles(viewOf(width, height), randomSplats(700, uint32_t(width))) > 0);
    }
}

TEST_CASE("tile lists without splats, without visible ones, and of one")
{
    const View<float> view = viewOf(50, 33);
    CHECK(checkTiles(view, {}) == 0);
    std::vector<GaussianGeometry<float>> splats = randomSplats(200, 4);
    for (GaussianGeometry<float>& g : splats) g.position[2] = 5;
    CHECK(checkTiles(view, splats) == 0);
    splats.resize(1), splats[0] = {{0, 0, 0}, {0.05f, 0.05f, 0.05f}, {1, 0, 0, 0}, 0.9f};
    CHECK(checkTiles(view, splats) > 0);
}

TEST_CASE("equal distances are in the order of the splats")
{
    std::vector<GaussianGeometry<float>> splats = randomSplats(300, 6);
    for (size_t i = 0; i < splats.size(); ++i)
        if (i % 3) std::copy_n(splats[i / 100].position, 3, splats[i].position);
    CHECK(checkTiles(viewOf(40, 30), splats) > 0);
}

TEST_CASE("splats that cover all tiles, and long thin ones across them, are among the others")
{
    std::vector<GaussianGeometry<float>> splats = randomSplats(70, 8);
    splats[3] = {{0, 0, 0}, {50, 50, 50}, {1, 0, 0, 0}, 0.99f};
    splats[40] = {{0, 0, 0.5f}, {40, 0.002f, 0.002f}, {0.9f, 0, 0, 0.3f}, 0.99f};
    splats[41] = {{0.1f, 0, 0.5f}, {0.002f, 40, 0.002f}, {1, 0, 0, 0.05f}, 0.99f};
    splats[69] = {{0.3f, 0, 0.1f}, {9, 9, 9}, {1, 0, 0, 0}, 0.5f};
    const View<float> view = viewOf(90, 1100); // more rows of tiles than lanes of a warp
    CHECK(checkTiles(view, splats) > 2 * 6 * 69);
}

TEST_CASE("memory of an earlier view does not show in the next")
{
    Device device(kOrders[2]);
    Tiles tiles;
    checkTiles(device, tiles, viewOf(120, 90), randomSplats(500, 1));
    checkTiles(device, tiles, viewOf(40, 30), randomSplats(90, 2));
    checkTiles(device, tiles, viewOf(130, 100), randomSplats(900, 3));
    checkTiles(device, tiles, viewOf(31, 17), {});
}
