// Parts of an asset as pictures: those of the light add up to the image, and what is not there is refused.
#include "eval/channel_pictures.h"
#include "eval/label.h"
#include "eval/splat_renderer.h"

#include "formats_fixtures.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <utility>

using namespace nacre;

namespace {

Camera frontCamera()
{
    Camera camera;
    camera.width = camera.height = 40;
    camera.fx = camera.fy = 30;
    camera.cx = camera.cy = 20;
    camera.worldFromCamera[3] = glm::dvec4(0, 0, 4, 1);
    return camera;
}

std::vector<Light> twoLights()
{
    Light point, directional;
    point.position = {2, 1, 4}, point.intensity = glm::vec3(20, 15, 10);
    directional.type = LightType::kDirectional, directional.directionToLight = {0, 0.6, 0.8}, directional.intensity = glm::vec3(1, 2, 3);
    return {point, directional};
}

Image draw(const Result<std::unique_ptr<SplatRenderer>>& renderer)
{
    REQUIRE_MESSAGE(renderer, (renderer ? "" : renderer.error().message));
    const auto image = (*renderer)->render(frontCamera(), twoLights());
    REQUIRE(image);
    return *image;
}

void checkSum(const SplatAsset& asset, const std::vector<const char*>& names)
{
    const Image whole = draw(makeReferenceRenderer(asset));
    std::vector<double> sum(whole.rgba.size());
    std::vector<double> largest(whole.rgba.size()); // the parts' rounding is relative to the largest of them
    for (const char* name : names) {
        const Image part = draw(makePartRenderer(asset, name));
        double power = 0;
        for (size_t i = 0; i < sum.size(); ++i) {
            sum[i] += part.rgba[i], largest[i] = std::max(largest[i], std::abs(double(part.rgba[i])));
            if (i % 4 < 3) power += std::abs(part.rgba[i]);
        }
        CAPTURE(std::string(name));
        CHECK(power > 0);
    }
    double worst = 0;
    for (size_t i = 0; i < sum.size(); ++i)
        if (i % 4 < 3) worst = std::max(worst, std::abs(sum[i] - whole.rgba[i]) / (largest[i] + 1e-6));
    CHECK(worst < 1e-5);
}

/// With normals towards the lights, so that there is light to see.
SplatAsset litSss(bool all)
{
    SplatAsset asset = test::makeSss(40, all);
    for (Channel& c : asset.channels)
        if (c.name == "normal")
            for (float& x : c.values) x = std::abs(x);
    return asset;
}

SplatAsset bigsWithForward()
{
    SplatAsset asset = test::makeAsset(40, 9, 1, true);
    Channel forward{"forward", 4, {}, {}};
    for (size_t i = 0; i < asset.cloud.count; ++i) forward.values.insert(forward.values.end(), {2.0f, 0.5f, 0.25f, 0.125f});
    asset.channels.push_back(std::move(forward));
    return asset;
}

} // namespace

TEST_CASE("parts of the light add up to the image")
{
    checkSum(bigsWithForward(), {"direct", "indirect", "lobe", "forward"});
    checkSum(test::makeAsset(40, 4, 1), {"direct", "indirect"});
    checkSum(litSss(true), {"specular", "diffuse", "scattered"});
    checkSum(litSss(false), {"specular", "diffuse"});
}

TEST_CASE("every part that an asset has can be drawn, is finite and knows the object's outline")
{
    for (const SplatAsset& asset : {bigsWithForward(), test::makeAsset(40, 0, 1), litSss(true), litSss(false)}) {
        const Image whole = draw(makeReferenceRenderer(asset));
        for (const PartInfo& part : partsOf(asset)) {
            CAPTURE(std::string(part.name));
            const Image image = draw(makePartRenderer(asset, part.name));
            bool good = true, some = false;
            for (size_t i = 0; i < image.rgba.size(); ++i) {
                good = good && std::isfinite(image.rgba[i]) && (i % 4 < 3 || image.rgba[i] == whole.rgba[i]);
                some = some || (i % 4 < 3 && image.rgba[i] != 0);
            }
            CHECK(good);
            CHECK(some);
        }
    }
}

TEST_CASE("depth is in units of the dataset, normals are unit, overdraw counts")
{
    SplatAsset asset = test::makeSss(1, false);
    asset.cloud.positions = {{0, 0, 0}};
    asset.cloud.scales = {{0.5f, 0.5f, 0.5f}};
    asset.cloud.opacities = {0.5f};
    asset.frame.scale = 2;
    const auto middle = [&](const char* name) {
        const Image image = draw(makePartRenderer(asset, name));
        const float* p = &image.rgba[4 * (20 * 40 + 20)];
        return glm::vec3(p[0], p[1], p[2]);
    };
    CHECK(middle("depth").x == doctest::Approx(4.0));
    CHECK(glm::length(middle("normal")) == doctest::Approx(1.0));
    CHECK(middle("overdraw").x == 1.0f);
}

TEST_CASE("a part that an asset has not is refused with those it has")
{
    const auto refused = [](const SplatAsset& asset, const char* name, const char* listed) {
        const auto renderer = makePartRenderer(asset, name);
        REQUIRE(!renderer);
        CAPTURE(renderer.error().message);
        CHECK(renderer.error().code == ErrorCode::kBadInput);
        CHECK(renderer.error().message.find(listed) != std::string::npos);
        CHECK(renderer.error().message.find('\n') == std::string::npos);
    };
    refused(test::makeAsset(4, 0, 1), "lobe", "image, direct, indirect, T_dir, T_ind, rho, normal, depth, overdraw");
    refused(test::makeAsset(4, 0, 1), "roughness", "rho");
    refused(test::makeSss(4, false), "scattered", "image, specular, diffuse, basecolor, roughness, metalness, normal");
    refused(test::makeSss(4, true), "T_dir", "residual, incident");
}

TEST_CASE("a part that depends on the light is its mean over lights, weighted by irradiance, whatever their colour")
{
    const SplatAsset bigs = test::makeAsset(40, 0, 1, true), sss = litSss(true);
    for (const auto& [asset, name] : {std::pair(&bigs, "T_dir"), std::pair(&bigs, "visibility"), std::pair(&sss, "incident"), std::pair(&sss, "residual")}) {
        CAPTURE(std::string(name));
        Light a, b;
        a.type = b.type = LightType::kDirectional;
        a.directionToLight = {0, 0.6, 0.8}, b.directionToLight = {0.6, 0, 0.8};
        a.intensity = {3, 0, 0}, b.intensity = {0, 0.5f, 0.5f};
        const auto at = [&, asset = asset, name = name](std::vector<Light> lights) { return *(*makePartRenderer(*asset, name))->render(frontCamera(), lights); };
        const Image ofA = at({a}), ofB = at({b}), both = at({a, b});
        double worst = 0, apart = 0;
        for (size_t i = 0; i < both.rgba.size(); ++i) {
            worst = std::max(worst, std::abs(0.75 * ofA.rgba[i] + 0.25 * ofB.rgba[i] - double(both.rgba[i])));
            apart = std::max(apart, std::abs(double(ofA.rgba[i]) - ofB.rgba[i]));
        }
        CHECK(worst < 1e-5); // values of order one, float32
        CHECK(apart > 1e-3);
        const Image dark = at({});
        for (size_t i = 0; i < dark.rgba.size(); i += 4) CHECK_UNARY(dark.rgba[i] == 0.0f);
    }
}

TEST_CASE("pictures of channels: named, scaled as they say, one sheet with room for every label")
{
    const SplatAsset asset = litSss(true);
    const auto channels = channelPictures(asset, frontCamera(), twoLights());
    REQUIRE(channels);
    REQUIRE(channels->size() == partsOf(asset).size());
    for (const ChannelPicture& c : *channels) {
        CAPTURE(c.name);
        CHECK(!c.scale.empty());
        CHECK(c.picture.width == 40);
        CHECK(c.picture.rgb.size() == 3 * c.values.rgba.size() / 4);
        if (c.name != "depth") continue; // what is nearest is white, what is not there black, and nothing that is there is black
        uint8_t nearest = 0;
        for (size_t i = 0; i < c.values.rgba.size() / 4; ++i) {
            CHECK_UNARY((c.picture.rgb[3 * i] > 0) == (c.values.rgba[4 * i + 3] > 0));
            nearest = std::max(nearest, c.picture.rgb[3 * i]);
        }
        CHECK(nearest == 255);
    }
    const Picture sheet = channelSheet(*channels);
    CHECK(sheet.rgb.size() == size_t(3) * sheet.width * sheet.height);
    CHECK(sheet.width > 4 * 40);

    const std::string line[] = {"T_dir"};
    const Picture small{1, 1, {7, 8, 9}}, label = labelled(small, line);
    CHECK(std::vector<uint8_t>(&label.rgb[size_t(3) * label.width * (label.height - 1)], &label.rgb[size_t(3) * label.width * (label.height - 1)] + 3) == small.rgb);
    CHECK(std::count(label.rgb.begin(), label.rgb.end(), uint8_t(255)) > 30);
}
