// Any unit of length, any origin and any unit of light is the same dataset to a bake.
#include "dataset_support.h"

#include "dataset/normalise.h"

#include <random>

using namespace nacre;

namespace {

struct Random {
    std::mt19937 engine{11};
    double unit() { return double(engine()) / 4294967296.0; }
    glm::dvec3 upper(double radius)
    {
        const double phi = 6.28318530718 * unit(), z = 0.1 + 0.8 * unit(), r = std::sqrt(1 - z * z);
        return radius * glm::dvec3(r * std::cos(phi), r * std::sin(phi), z);
    }
};

/// A canonical dataset on disk: a sphere at the origin, with the world and its lights changed as told; the images stay the same.
struct Variant {
    double scale = 1, intensity = 1;
    glm::dvec3 offset{0.0};
};

void writeVariant(const TempFolder& folder, const std::string& name, const Variant& v)
{
    Random random;
    json frames = json::array();
    std::filesystem::create_directories(folder.path / name);
    for (int i = 0; i < 12; ++i) {
        Camera camera = lookAtOrigin(random.upper(2.5), 24);
        const glm::dvec3 light = random.upper(4.0);
        const std::string file = std::to_string(i) + ".exr";
        REQUIRE(writeExr(renderSphere(camera, light, 40), folder.file(name + "/" + file)));
        camera.worldFromCamera[3] = glm::dvec4(v.scale * camera.position() + v.offset, 1);
        frames.push_back({{"file_path", file},
                          {"transform_matrix", toJson(camera.worldFromCamera)},
                          {"light", {{"type", "point"}, {"position", toJson(v.scale * light + v.offset)}, {"intensity", 40 * v.scale * v.scale * v.intensity}}}});
    }
    const json text = {{"fl_x", 1.4 * 24}, {"width", 24}, {"height", 24}, {"color_space", "linear"}, {"frames", frames}};
    folder.writeText(name + "/transforms_train.json", text.dump());
}

OlatDataset load(const TempFolder& folder, const std::string& name)
{
    Result<OlatDataset> dataset = loadDataset(folder.file(name));
    if (!dataset) FAIL(dataset.error().message);
    return *dataset;
}

OlatDataset normalisedVariant(const TempFolder& folder, const std::string& name, const Variant& v)
{
    writeVariant(folder, name, v);
    Result<OlatDataset> out = normalised(load(folder, name));
    REQUIRE(out);
    return *out;
}

} // namespace

TEST_CASE("a dataset of about unit size at the origin stays as it is")
{
    TempFolder folder;
    CHECK(normalisedVariant(folder, "base", {}).frame == AssetFrame{});
    CHECK(normalisedVariant(folder, "brighter", {1, 3}).frame == AssetFrame{});
}

TEST_CASE("whatever the world's scale and origin, normalised datasets are the same to float32, and their frame leads back")
{
    TempFolder folder;
    const OlatDataset expected = normalisedVariant(folder, "a", {1000});
    const OlatDataset stated = load(folder, "a");
    for (const Variant& v : {Variant{1e-3}, Variant{1, 1, {500, 500, 500}}, Variant{1, 1, {5e5, -5e6, 30}}, Variant{1e6, 1, {1e7, 0, 0}}, Variant{2e-6, 1, {0, 0, 3e-3}}}) {
        CAPTURE(v.scale);
        CAPTURE(v.offset.x);
        const OlatDataset found = normalisedVariant(folder, "b", v);
        CHECK(found.frame.scale == doctest::Approx(expected.frame.scale * v.scale / 1000).epsilon(1e-6));
        for (size_t i = 0; i < expected.splits[0].images.size(); ++i) {
            const OlatSplit &a = expected.splits[0], &b = found.splits[0];
            CHECK(glm::distance(a.cameras[i].position(), b.cameras[i].position()) < 1e-6);     // 1e-9 of text at 5e6
            CHECK(glm::distance(a.images[i].light.position, b.images[i].light.position) < 1e-5f); // float32 of about 4, and the above
            CHECK(a.images[i].light.intensity.x == doctest::Approx(b.images[i].light.intensity.x).epsilon(1e-6));
        }
    }
    for (size_t i = 0; i < expected.splits[0].images.size(); ++i) {
        const Light back = lightInDataset(expected.frame, expected.splits[0].images[i].light), &light = stated.splits[0].images[i].light;
        CHECK(glm::distance(back.position, light.position) < 1e-3f); // float32 of 4000
        CHECK(back.intensity.x == doctest::Approx(light.intensity.x).epsilon(1e-6));
    }
    const Result<OlatDataset> again = normalised(expected);
    REQUIRE(again);
    CHECK(again->frame == expected.frame);
}

TEST_CASE("lights in an impossible unit are brought to a plausible one, by the factor that the frame keeps")
{
    TempFolder folder;
    const OlatDataset base = normalisedVariant(folder, "base", {});
    ImageCache images(base, 0);
    const auto reflectance = apparentReflectance(base, base.splits[0], frameCameras(base.splits), images);
    REQUIRE(reflectance);
    REQUIRE(reflectance->has_value());
    CHECK(**reflectance > 0.05); // a diffuse ball of albedo 0.55, of which a part is lit
    CHECK(**reflectance < 0.4);
    for (const double factor : {1e-6, 0.005, 500.0, 1e5}) {
        CAPTURE(factor);
        const OlatDataset found = normalisedVariant(folder, "b", {1, factor});
        CHECK(found.frame.lightGain == doctest::Approx(**reflectance / factor / kUsualReflectance).epsilon(1e-4));
        CHECK(found.splits[0].images[3].light.intensity.x == doctest::Approx(base.splits[0].images[3].light.intensity.x * **reflectance / kUsualReflectance).epsilon(1e-4));
    }
}

TEST_CASE("a few cameras that look elsewhere do not move the middle of a dataset")
{
    Random random;
    std::vector<OlatSplit> splits{{"train", {}, {}}};
    for (int i = 0; i < 30; ++i) splits[0].cameras.push_back(lookAtOrigin(random.upper(3.0), 32));
    const Framing good = frameCameras(splits);
    CHECK(glm::length(good.centre) < 1e-9);
    CHECK(good.halfSize == doctest::Approx(3.0 * 0.5 / 1.4));
    for (int i = 0; i < 4; ++i) splits[0].cameras[size_t(7 * i)].worldFromCamera[3] += glm::dvec4(20, 3 * i, 5, 0);
    const Framing bad = frameCameras(splits);
    CHECK(glm::length(bad.centre) < 0.05);
    CHECK(bad.halfSize == doctest::Approx(good.halfSize).epsilon(0.05));
}

TEST_CASE("one viewpoint, or parallel cameras: the object is in front of them, as far away as the lights")
{
    double step = 0;
    SUBCASE("one place") {}
    SUBCASE("parallel") { step = 0.1; }
    std::vector<OlatSplit> splits{{"train", {}, {}}};
    for (int i = 0; i < 3; ++i) {
        splits[0].cameras.push_back(lookAtOrigin({0, -3, 1}, 32));
        splits[0].cameras.back().worldFromCamera[3] += glm::dvec4(step * i, 0, 0, 0);
        Light light;
        light.position = {1, -3.0f + 0.5f * float(i), 3};
        splits[0].images.push_back({uint32_t(i), light, ""});
    }
    const Framing framing = frameCameras(splits);
    CHECK(framing.halfSize > 0.3);
    CHECK(framing.halfSize < 3);
    for (OlatSplit& split : splits) {
        for (Camera& c : split.cameras) c.worldFromCamera[3] = glm::dvec4(1000.0 * c.position() + 300.0, 1);
        for (OlatImage& i : split.images) i.light.position = 1000.0f * i.light.position + 300.0f;
    }
    const Framing larger = frameCameras(splits);
    CHECK(larger.halfSize == doctest::Approx(1000 * framing.halfSize).epsilon(1e-4));
    CHECK(glm::distance(larger.centre, 1000.0 * framing.centre + 300.0) < 0.1);
}

TEST_CASE("units that no capture has are an error before the bake, not an asset that cannot be written after it")
{
    TempFolder folder;
    for (const double intensity : {1e-30, 1e28}) {
        writeVariant(folder, "odd", {1, intensity});
        const auto out = normalised(load(folder, "odd"));
        REQUIRE_FALSE(out);
        checkError(out.error(), ErrorCode::kBadInput, {"odd", "as bright", "exposure", "unit of the lights"});
    }
}
