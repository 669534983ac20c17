// What the order of importance is made of, and files of less than everything.
#include "detail_fixtures.h"
#include "formats_fixtures.h"

#include "appearance/detail.h"
#include "pack/importance.h"
#include "pack/pack.h"
#include "pack/pack_views.h"

#include <doctest/doctest.h>
#include <tbb/global_control.h>

#include <cmath>

using namespace nacre;
using namespace nacre::test;

namespace {

/// Grey and coloured splats on a ball, as many again within, which hardly show; with lobe and maps.
SplatAsset makeBall(size_t count)
{
    SplatAsset asset = makeAsset(count, 0, 0, true);
    for (size_t i = 0; i < count; ++i) {
        const size_t shell = count / 2;
        const float z = 1 - 2 * (float(i % shell) + 0.5f) / float(shell), r = std::sqrt(1 - z * z), phi = 2.39996f * float(i);
        asset.cloud.positions[i] = (i < shell ? 1.0f : 0.4f) * glm::vec3(r * std::cos(phi), r * std::sin(phi), z);
        asset.cloud.rotations[i] = glm::quat(1, 0, 0, 0);
        asset.cloud.scales[i] = glm::vec3(i < shell ? 0.1f : 0.04f);
        asset.cloud.opacities[i] = 0.9f;
        for (Channel& c : asset.channels) {
            for (size_t k = 0; k < c.components && (c.name == "tDir" || c.name == "tInd"); ++k) c.values[i * c.components + k] *= c.name == "tDir" && k == 0 ? 0.0f : 0.1f;
            if (c.name == "tDir") c.values[25 * i] = 1;
            for (size_t k = 0; k < 3 && c.name == "rho"; ++k) c.values[3 * i + k] = 0.3f + 0.2f * asset.cloud.positions[i][int(k)];
            if (c.name == "lobe") c.values[7 * i + 6] = 0.25f;
        }
    }
    return asset;
}

std::string refusal(const Status& status) { return status ? "" : status.error().message; }

} // namespace

TEST_CASE("what shows is more important than what does not, whatever the number of threads; a share of it errs less than one that shows less")
{
    SplatAsset asset = makeBall(400);
    const auto views = viewsAround(asset, 12);
    REQUIRE(views);
    REQUIRE(refusal(addImportance(asset, *views)) == "");
    REQUIRE(refusal(validate(asset)) == "");
    const std::vector<float>& importance = asset.find("importance")->values;
    double shell = 0, core = 0;
    for (size_t i = 0; i < 400; ++i) (i < 200 ? shell : core) += importance[i] / 200;
    CHECK(shell > core + 3); // factors of two
    const float growth = asset.find("growth")->values[0];
    CHECK((growth > 0.1f && growth < 0.5f));

    SplatAsset again = asset;
    {
        tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
        REQUIRE(refusal(addImportance(again, *views)) == "");
    }
    CHECK(identical(again, asset)); // what was there is replaced
    REQUIRE(refusal(ensureImportance(again, nullptr)) == "");
    CHECK(identical(again, asset));

    const auto reference = PackReference::render(asset, *views);
    REQUIRE(reference);
    SplatAsset contrary = asset;
    for (Channel& c : contrary.channels)
        for (size_t i = 0; i < c.values.size() && c.name == "importance"; ++i) c.values[i] = -c.values[i];
    REQUIRE(refusal(reduceDetail(again, {0.5f})) == "");
    REQUIRE(refusal(reduceDetail(contrary, {0.5f})) == "");
    CHECK(*reference->error(again) < 0.5 * *reference->error(contrary));
}

TEST_CASE("files of less than everything hold what was asked for, and fewer bytes the coarser they are")
{
    SplatAsset asset = makeBall(120);
    REQUIRE(refusal(ensureImportance(asset, nullptr)) == "");
    asset.presets = somePresets();
    const Detail details[] = {{}, {0.5f, kPartLobe, 9, 16}, {0.25f, kPartVisibility | kPartIndirect}, {1, kPartLobe | kPartVisibility}};
    const double rates[] = {0, 6};
    const auto versions = packVersions(asset, nullptr, details, rates, [](const std::string&) { return true; });
    REQUIRE_MESSAGE(bool(versions), (versions ? "" : versions.error().message));
    REQUIRE(versions->size() == 8);
    for (size_t v = 0; v < 8; ++v) {
        CAPTURE(v);
        const PackedVersion& version = (*versions)[v];
        CHECK(version.detail == details[v / 2]);
        CHECK(version.rate == rates[v % 2]);
        const Result<SplatAsset> read = decodeAsset(version.file);
        REQUIRE_MESSAGE(bool(read), (read ? "" : read.error().message));
        CHECK(read->cloud.count == version.asset.cloud.count);
        CHECK(read->cloud.count <= size_t(std::lround(double(version.detail.splats) * 120)));
        CHECK(bool(read->find("lobe")) == !(version.detail.leaveOut & kPartLobe));
        CHECK(read->drawnVisibility == (version.detail.leaveOut & kPartVisibility ? 0 : version.detail.visibilitySize == 16 ? 16 : 32));
        CHECK(read->presets == (v < 2 ? asset.presets : std::vector<Preset>())); // of others they would say wrong figures
        CHECK(refusal(validate(version.asset)) == "");
        if (v % 2) CHECK(version.file.size() < (*versions)[v - 1].file.size());
        if (v >= 2) CHECK(version.file.size() < (*versions)[v % 2].file.size());
    }
    CHECK(packVersions(asset, nullptr, details, rates, [](const std::string&) { return false; }).error().code == ErrorCode::kCancelled);
}
