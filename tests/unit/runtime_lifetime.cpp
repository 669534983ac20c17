// From decoding to destruction: assets that are decoded elsewhere and uploaded in slices, what outlives what, and nothing left at the end.
#include "runtime_fixture.h"

#include "counting_gl.h"
#include "own_heap.h"

#include <thread>

using namespace nacre;
using namespace nacre::test;

namespace {

const Camera kCamera = lookAt({0.3, 0.2, 2}, {0, 0, 0}, 33, 33, 40);
const std::vector<Light> kLamp = {pointLight({1, 1, 2}, glm::vec3(3))};

std::vector<SplatAsset> bothModels() { return {withSharp(randomAsset(300, 9, 4), kAllSharp, 4), randomSss(300, kAllSss, 4)}; }

size_t ownHeap() { return ownHeapBytes(reinterpret_cast<const void*>(&nacreContextCreate)); }

} // namespace

TEST_CASE("hundreds of assets, instances and views come and go, and objects and memory of the GL and the heap stay flat")
{
    if (!haveGl()) return;
    liveObjects = 0;
    {
        Host host(countingGl);
        std::vector<std::vector<std::byte>> files;
        for (const SplatAsset& asset : {withSharp(randomAsset(20, 4, 4), kAllSharp, 4), randomSss(20, kAllSss, 4)}) files.push_back(*encodeAsset(asset));
        host.setLights(kLamp);
        const auto cycle = [&](int i) {
            NacreInstanceDesc desc{};
            desc.structSize = sizeof desc;
            REQUIRE(nacreAssetCreate(host.context, files[size_t(i % 2)].data(), files[size_t(i % 2)].size(), &desc.asset) == NACRE_OK);
            NacreInstance instance{};
            REQUIRE(nacreInstanceCreate(&desc, &instance) == NACRE_OK);
            const NacreView view = host.addView();
            const NacreDrawDesc draw = describe(kCamera);
            REQUIRE(nacreViewDraw(view, &draw) == NACRE_OK);
            CHECK(host.stats(view).splatsDrawn == 20);
            if (i % 3 == 0) nacreViewDestroy(view); // in any order
            nacreAssetDestroy(desc.asset);
            nacreInstanceDestroy(instance);
            nacreViewDestroy(view);
        };
        REQUIRE(host.gl->beginFrame(33, 33));
        ownHeap(); // from here on
        int i = 0;
        for (; i < 24; ++i) cycle(i);
        glFinish();
        const int64_t objects = liveObjects;
        const uint64_t gpu = host.contextInfo().gpuBytes;
        const size_t heap = ownHeap(); // of the runtime and of this test, not of the driver, whose pools come and go
        CHECK(heap > 0);
        for (; i < 124; ++i) cycle(i);
        glFinish();
        CHECK(liveObjects == objects);
        CHECK(host.contextInfo().gpuBytes == gpu);
        CHECK(host.contextInfo().assets + host.contextInfo().instances + host.contextInfo().views == 1); // the host's own view
        CHECK(ownHeap() < heap + 100 * 32); // 32 bytes a cycle: whatever is leaked takes more
    }
    CHECK(liveObjects == 0);
}

TEST_CASE("contexts come and go with all that is in them")
{
    if (!haveGl()) return;
    const auto gl = HeadlessGl::create();
    REQUIRE(gl);
    const auto bytes = encodeAsset(randomSss(20, kAllSss, 4));
    liveObjects = 0;
    for (int i = 0; i < 6; ++i) {
        NacreContextDesc desc{};
        desc.structSize = sizeof desc, desc.getProcAddress = countingGl;
        NacreContext context{};
        REQUIRE(nacreContextCreate(&desc, &context) == NACRE_OK);
        NacreInstanceDesc instanceDesc{};
        instanceDesc.structSize = sizeof instanceDesc;
        NacreInstance instance{};
        NacreView view{};
        REQUIRE(nacreAssetCreate(context, bytes->data(), bytes->size(), &instanceDesc.asset) == NACRE_OK);
        REQUIRE(nacreInstanceCreate(&instanceDesc, &instance) == NACRE_OK);
        REQUIRE(nacreViewCreate(context, nullptr, &view) == NACRE_OK);
        const NacreLight lamp = toNacre(kLamp[0]);
        REQUIRE(nacreContextSetLights(context, &lamp, 1) == NACRE_OK);
        REQUIRE((*gl)->beginFrame(33, 33));
        const NacreDrawDesc draw = describe(kCamera);
        REQUIRE(nacreViewDraw(view, &draw) == NACRE_OK);
        CHECK(largest((*gl)->readFrame()) > 0.1f);
        CHECK(liveObjects > 5);
        nacreContextDestroy(context);
        CHECK(liveObjects == 0);
    }
}

TEST_CASE("an asset lives on in its instances, and its data goes with the last of them")
{
    if (!haveGl()) return;
    for (const SplatAsset& source : bothModels()) {
        CAPTURE(source.model);
        Host host(source);
        const Image expected = host.draw(kCamera, kLamp);
        host.unload();
        const uint64_t empty = host.contextInfo().gpuBytes;
        host.load(source);
        nacreAssetDestroy(host.asset);
        NacreAssetInfo info{};
        info.structSize = sizeof info;
        CHECK(nacreAssetGetInfo(host.asset, &info) == NACRE_ERROR_INVALID_ARGUMENT);
        NacreInstanceDesc desc{};
        desc.structSize = sizeof desc, desc.asset = host.asset;
        NacreInstance none{};
        CHECK(nacreInstanceCreate(&desc, &none) == NACRE_ERROR_INVALID_ARGUMENT);
        CHECK(largestDifference(host.draw(kCamera), expected) == 0.0f);
        CHECK(host.contextInfo().gpuBytes > empty);
        nacreInstanceDestroy(host.instance);
        CHECK(host.contextInfo().gpuBytes == empty);
        CHECK(largest(host.draw(kCamera)) == 0.0f);
    }
}

TEST_CASE("a view that has drawn an instance forgets it when it goes, and draws another one in its place right")
{
    if (!haveGl()) return;
    for (const SplatAsset& source : bothModels()) {
        CAPTURE(source.model);
        Host host(source), fresh;
        const glm::dmat4 aside = glm::translate(glm::dmat4(1), glm::dvec3(0.2, 0.1, 0));
        host.draw(kCamera, kLamp);
        nacreInstanceDestroy(host.instance);
        host.instance = host.place(host.asset, aside); // the same slot, another instance
        fresh.place(source, aside);
        CHECK(largestDifference(host.draw(kCamera), fresh.draw(kCamera, kLamp)) == 0.0f);
    }
}

TEST_CASE("an asset decoded on another thread and uploaded in slices shows what one shows that is created at once; not before it is whole")
{
    if (!haveGl()) return;
    for (const SplatAsset& source : bothModels()) {
        CAPTURE(source.model);
        const auto bytes = encodeAsset(source);
        REQUIRE(bytes);
        Host whole(source), host(withSharp(randomAsset(60, 4, 1), kAllSharp, 1));
        const Image expected = whole.draw(kCamera, kLamp), before = host.draw(kCamera, kLamp);

        NacreAsset assets[3]{};
        NacreResult results[3]{};
        std::vector<std::thread> threads;
        for (int t = 0; t < 3; ++t)
            threads.emplace_back([&, t] { results[t] = nacreAssetDecode(host.context, bytes->data(), bytes->size(), &assets[t]); });
        for (int i = 0; i < 5; ++i) CHECK(largestDifference(host.draw(kCamera), before) == 0.0f); // meanwhile
        for (std::thread& t : threads) t.join();
        for (const NacreResult r : results) REQUIRE_MESSAGE(r == NACRE_OK, host.lastMessage());
        CHECK(host.contextInfo().assets == 4);

        NacreAssetInfo info{};
        info.structSize = sizeof info;
        CHECK(nacreAssetGetInfo(assets[1], &info) == NACRE_OK);
        CHECK(info.splatCount == 300);
        const NacreInstance instance = host.place(assets[1]); // stands there before there is anything to see
        uint64_t left = ~0ull;
        int steps = 0;
        while (left > 0 && steps < 1000) {
            CHECK(largestDifference(host.draw(kCamera), before) == 0.0f);
            CHECK(host.stats().instancesDrawn == 1);
            const uint64_t last = left;
            REQUIRE(nacreAssetUploadStep(assets[1], 20000, &left) == NACRE_OK);
            CHECK(left < last);
            ++steps;
        }
        CHECK(left == 0);
        CHECK(steps > 4);
        CHECK(largestDifference(host.draw(describe(kCamera, {&instance, 1})), expected) == 0.0f);
        CHECK(nacreAssetUploadStep(assets[1], 1, &left) == NACRE_OK); // nothing left to do
        CHECK(left == 0);

        REQUIRE(nacreAssetUploadStep(assets[0], ~0ull, &left) == NACRE_OK);
        CHECK(left == 0);
        REQUIRE(nacreAssetUploadStep(assets[2], 1, &left) == NACRE_OK); // gone half way
        const NacreInstance half = host.place(assets[2]);
        nacreAssetDestroy(assets[2]);
        CHECK(allFinite(host.draw(kCamera)));
        nacreInstanceDestroy(half);
        CHECK(host.messages.empty());
    }
}

TEST_CASE("damaged bytes fail on the thread that decodes them, with a message")
{
    if (!haveGl()) return;
    Host host;
    const auto bytes = encodeAsset(randomSss(20, kAllSss, 4));
    NacreResult result = NACRE_OK;
    NacreAsset asset{~0ull};
    std::thread([&] { result = nacreAssetDecode(host.context, bytes->data(), bytes->size() / 2, &asset); }).join();
    CHECK(result == NACRE_ERROR_BAD_ASSET);
    CHECK(asset.id == 0);
    CHECK(host.messages.size() == 1);
    CHECK(host.contextInfo().assets == 0);
}
