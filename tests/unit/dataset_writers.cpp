// The inverse of every loader: what is written in a convention loads as it was, to the precision of the format.
#include "dataset_support.h"

#include "dataset/dataset_writer.h"

#include <algorithm>
#include <map>
#include <random>
#include <set>

using namespace nacre;

namespace {

constexpr int kSize = 12;

Light pointLight(glm::dvec3 position, glm::vec3 intensity)
{
    Light light;
    light.position = glm::vec3(position);
    light.intensity = intensity;
    return light;
}

/// Train: each of 4 lights under 3 of 6 cameras; test: one light and camera each; and every other type of light.
OlatDataset makeDataset(const TempFolder& folder, bool variedIntrinsics)
{
    std::mt19937 random(7);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    const auto direction = [&] { return glm::normalize(glm::dvec3(uniform(random), uniform(random), 0.6 + 0.5 * uniform(random))); };
    const auto camera = [&](size_t i) {
        Camera c = lookAtOrigin(3.2 * direction(), kSize);
        if (variedIntrinsics) c.fx += 0.1 * double(i), c.fy = c.fx + 0.5, c.cx -= 0.25, c.cy += 1.0;
        return c;
    };
    const auto color = [&] { return glm::vec3(60 + 20 * uniform(random), 60 + 20 * uniform(random), 60 + 20 * uniform(random)); };
    OlatDataset d;
    d.path = folder.path.string();
    d.up = {0, 0, 1};
    const auto addSplit = [&](const char* name, size_t cameras) -> OlatSplit& {
        d.splits.emplace_back();
        d.splits.back().name = name;
        for (size_t i = 0; i < cameras; ++i) d.splits.back().cameras.push_back(camera(i));
        return d.splits.back();
    };
    std::vector<Light> stage;
    for (int i = 0; i < 4; ++i) stage.push_back(pointLight(5.0 * direction(), color()));
    OlatSplit& train = addSplit("train", 6);
    for (uint32_t c = 0; c < 6; ++c)
        for (uint32_t l = 0; l < 2; ++l) train.images.push_back({c, stage[(2 * c + l) % 4], ""});
    for (const char* name : {"near", "test"}) {
        OlatSplit& split = addSplit(name, 3);
        for (uint32_t c = 0; c < 3; ++c) split.images.push_back({c, pointLight((*name == 'n' ? 2.0 : 5.0) * direction(), color()), ""});
    }
    Light sun;
    sun.type = LightType::kDirectional;
    sun.directionToLight = glm::vec3(glm::normalize(glm::dvec3(1, -2, 2)));
    sun.intensity = {1, 2, 3};
    addSplit("directional", 1).images.push_back({0, sun, ""});
    Light sky;
    sky.type = LightType::kEnvironment;
    sky.environmentPath = folder.file("sky.exr");
    REQUIRE(writeExr(Image{2, 1, std::vector<float>(8, 1.0f)}, sky.environmentPath));
    addSplit("environment", 1).images.push_back({0, sky, ""});
    Light all;
    all.type = LightType::kGroup;
    stage.push_back(sun);
    all.group = std::make_shared<const std::vector<Light>>(stage);
    OlatSplit& allOn = addSplit("all_on", 2);
    for (uint32_t c = 0; c < 2; ++c) allOn.images.push_back({c, all, ""});
    return d;
}

/// Soft alpha, coloured, premultiplied.
Image makeImage(size_t seed)
{
    std::mt19937 random{unsigned(seed)};
    std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
    Image image{kSize, kSize, std::vector<float>(kSize * kSize * 4)};
    for (size_t i = 0; i < image.rgba.size(); i += 4) {
        const float alpha = i % 3 == 0 ? 0.0f : i % 3 == 1 ? 1.0f : uniform(random);
        for (size_t c = 0; c < 3; ++c) image.rgba[i + c] = alpha * uniform(random);
        image.rgba[i + 3] = alpha;
    }
    return image;
}

OlatDataset writeAll(OlatDataset dataset, const std::string& convention)
{
    auto fitted = fitToConvention(std::move(dataset), convention);
    if (!fitted) FAIL(fitted.error().message);
    size_t seed = 0;
    for (const OlatSplit& split : fitted->splits) {
        for (const OlatImage& image : split.images) {
            const std::filesystem::path path = std::filesystem::path(fitted->path) / image.path;
            std::filesystem::create_directories(path.parent_path());
            REQUIRE(writeDatasetImage(*fitted, makeImage(seed++), path.string()));
        }
        for (const DescriptionFile& file : describeSplit(*fitted, split, R"({"object": "thing", "seed": 3})")) {
            std::filesystem::create_directories((std::filesystem::path(fitted->path) / file.path).parent_path());
            REQUIRE(writeFileAtomically((std::filesystem::path(fitted->path) / file.path).string(), std::as_bytes(std::span(file.text))));
        }
    }
    return *fitted;
}

void checkSameLight(const Light& a, const Light& b, bool hasIntensity = true)
{
    REQUIRE(a.type == b.type);
    // 1e-5: the intensity passes through a factor in double and back to float
    for (int c = 0; c < 3 && hasIntensity; ++c) CHECK(b.intensity[c] == doctest::Approx(a.intensity[c]).epsilon(1e-5));
    if (a.type == LightType::kPoint) CHECK(glm::distance(a.position, b.position) < 1e-6f);
    if (a.type == LightType::kDirectional) CHECK(glm::distance(a.directionToLight, b.directionToLight) < 1e-6f);
    if (a.type == LightType::kEnvironment) CHECK(a.environmentPath == b.environmentPath);
    if (a.type != LightType::kGroup) return;
    REQUIRE(a.group->size() == b.group->size());
    for (size_t i = 0; i < a.group->size(); ++i) checkSameLight((*a.group)[i], (*b.group)[i]);
}

void checkSameCamera(const Camera& a, const Camera& b)
{
    CHECK(a.width == b.width);
    CHECK(a.height == b.height);
    // 1e-12: an angle and its tangent in double
    for (double Camera::*k : {&Camera::fx, &Camera::fy, &Camera::cx, &Camera::cy}) CHECK(b.*k == doctest::Approx(a.*k).epsilon(1e-12));
    for (int c = 0; c < 4; ++c)
        for (int r = 0; r < 4; ++r) CHECK(std::fabs(a.worldFromCamera[c][r] - b.worldFromCamera[c][r]) < 1e-12);
}

void checkSamePixels(const Image& a, const Image& b, bool eightBit)
{
    REQUIRE(a.rgba.size() == b.rgba.size());
    for (size_t i = 0; i < a.rgba.size(); ++i) {
        const double x = a.rgba[i], y = b.rgba[i];
        // half has 11 bits, and straight alpha rounds twice; 8 bits step by 1/255 in display space
        const double error = eightBit && i % 4 != 3 ? std::fabs(srgbFromLinear(x) - srgbFromLinear(y)) : std::fabs(x - y);
        if (error > (eightBit ? 0.51 / 255 : 1.6e-3)) FAIL("pixel value ", x, " came back as ", y);
    }
}

/// Everything of `written` is in `loaded`, by image file.
void checkSame(const OlatDataset& written, const OlatDataset& loaded)
{
    CHECK(loaded.convention == written.convention);
    CHECK(loaded.up == written.up);
    CHECK(loaded.colorSpace == written.colorSpace);
    CHECK(loaded.premultiplied == written.premultiplied);
    ImageCache cache(loaded, 1 << 20);
    size_t seed = 0;
    for (const OlatSplit& split : written.splits) {
        const OlatSplit* other = loaded.find(split.name);
        if (!other) {
            CHECK(written.convention == "bigs"); // its loader passes over olat_all_on
            CHECK(split.name == "all_on");
            seed += split.images.size();
            continue;
        }
        CHECK(other->images.size() == split.images.size());
        CHECK(other->cameras.size() == split.cameras.size());
        std::map<std::string, size_t> imageOfPath;
        for (size_t i = 0; i < other->images.size(); ++i) imageOfPath[other->images[i].path] = i;
        for (const OlatImage& image : split.images) {
            const std::string path = (std::filesystem::path(loaded.path) / image.path).string();
            INFO(path);
            REQUIRE(imageOfPath.count(path) == 1);
            const OlatImage& found = other->images[imageOfPath[path]];
            checkSameCamera(split.cameras[image.camera], other->cameras[found.camera]);
            checkSameLight(image.light, found.light, written.convention != "rene"); // it has no words for intensities
            const auto pixels = cache.load(*other, imageOfPath[path]);
            REQUIRE(pixels);
            checkSamePixels(makeImage(seed++), **pixels, written.colorSpace == ColorSpace::kSrgb);
        }
    }
}

std::set<std::string> splitNames(const OlatDataset& d)
{
    std::set<std::string> names;
    for (const OlatSplit& s : d.splits) names.insert(s.name);
    return names;
}

} // namespace

TEST_CASE("a dataset written in any convention loads with the same cameras, lights and pixels")
{
    for (const char* convention : writableConventions())
        for (const bool varied : {false, true}) {
            INFO(convention << (varied ? ", cameras differ" : ", one camera model"));
            TempFolder folder;
            if (varied && std::string(convention) == "rene") {
                checkError(fitToConvention(makeDataset(folder, varied), convention).error(), ErrorCode::kBadInput, {"rene", "one camera model"});
                continue;
            }
            const OlatDataset written = writeAll(makeDataset(folder, varied), convention);
            const auto loaded = loadDataset(folder.path.string());
            if (!loaded) FAIL(loaded.error().message);
            checkSame(written, *loaded);
        }
}

TEST_CASE("splits that a convention has no words for are left out and named")
{
    const std::map<std::string, std::set<std::string>> expected{{"canonical", {"train", "test", "near", "directional", "environment", "all_on"}},
                                                                {"plpos", {"train", "test", "near"}},
                                                                {"sssgs", {"train", "test", "near"}},
                                                                {"bigs", {"train", "test", "all_on"}},
                                                                {"colmap", {"train", "test", "near", "directional"}},
                                                                {"rene", {"train", "test"}}};
    for (const char* convention : writableConventions()) {
        INFO(convention);
        TempFolder folder;
        const OlatDataset dataset = makeDataset(folder, false);
        auto fitted = fitToConvention(dataset, convention);
        REQUIRE(fitted);
        CHECK(splitNames(*fitted) == expected.at(convention));
        for (const OlatSplit& split : dataset.splits) {
            const bool named = std::any_of(fitted->warnings.begin(), fitted->warnings.end(),
                                           [&](const std::string& w) { return mentions(w, ("'" + split.name + "'").c_str()); });
            CHECK(named == (expected.at(convention).count(split.name) == 0));
        }
        OlatDataset onlySky = dataset;
        std::erase_if(onlySky.splits, [](const OlatSplit& s) { return s.name != "environment"; });
        const auto nothing = fitToConvention(onlySky, convention);
        if (std::string(convention) == "canonical") CHECK(nothing);
        else checkError(nothing.error(), ErrorCode::kBadInput, {convention});
    }
}

TEST_CASE("bigs: cameras and lights turn together to +Y up, lights lie in Mitsuba's frame, alpha is straight")
{
    TempFolder folder;
    const OlatDataset zUp = makeDataset(folder, false);
    const OlatDataset written = writeAll(zUp, "bigs");
    CHECK(written.up == glm::vec3(0, 1, 0));
    const OlatSplit &before = *zUp.find("train"), &after = *written.find("train");
    for (size_t i = 0; i < before.images.size(); ++i) {
        const glm::dvec3 c0 = before.cameras[before.images[i].camera].position(), c1 = after.cameras[after.images[i].camera].position();
        CHECK(glm::distance(c1, glm::dvec3(c0.x, c0.z, -c0.y)) < 1e-12);
        const glm::vec3 l0 = before.images[i].light.position, l1 = after.images[i].light.position;
        CHECK(glm::distance(l1, glm::vec3(l0.x, l0.z, -l0.y)) < 1e-6f);
    }
    std::ifstream file(folder.file("olat_1/transforms_train.json"));
    const json description = json::parse(file);
    const glm::vec3 position = after.images[0].light.position;
    CHECK(after.images[0].path.starts_with("olat_1/img/"));
    CHECK(description["frames"][0]["light"]["position"][0].get<float>() == doctest::Approx(-position.x));
    CHECK(description["frames"][0]["light"]["position"][1].get<float>() == doctest::Approx(position.y));
    CHECK(description["frames"][0]["light"]["position"][2].get<float>() == doctest::Approx(-position.z));
    CHECK(description["object"] == "thing");
    CHECK(std::filesystem::exists(folder.file("olat_all_on/img/r_0001.exr")));
    CHECK(std::filesystem::exists(folder.file("olat_all_on/transforms_train.json")));
}

TEST_CASE("bigs leaves out train lights with one camera, and refuses test lights with several: they would read as the other split")
{
    TempFolder folder;
    OlatDataset dataset = makeDataset(folder, false);
    dataset.splits[0].images.resize(5); // lights 0 1 2 3 0
    dataset = writeAll(dataset, "bigs");
    CHECK(dataset.find("train")->images.size() == 2);
    CHECK(std::any_of(dataset.warnings.begin(), dataset.warnings.end(), [](const std::string& w) { return mentions(w, "3 train images left out"); }));
    const auto loaded = loadDataset(folder.path.string());
    REQUIRE(loaded);
    CHECK(loaded->find("train")->images.size() == 2);
    CHECK(loaded->find("test")->images.size() == 3);
    dataset = makeDataset(folder, false);
    OlatSplit* test = nullptr;
    for (OlatSplit& s : dataset.splits)
        if (s.name == "test") test = &s;
    test->images[1].light = test->images[0].light;
    checkError(fitToConvention(dataset, "bigs").error(), ErrorCode::kBadInput, {"test", "one camera"});
}

TEST_CASE("canonical refuses two image sizes in a split, which its description cannot say")
{
    TempFolder folder;
    OlatDataset dataset = makeDataset(folder, false);
    dataset.splits[0].cameras[2].width = 7;
    checkError(fitToConvention(dataset, "canonical").error(), ErrorCode::kBadInput, {"'train'", "7x12"});
    CHECK_FALSE(fitToConvention(makeDataset(folder, false), "nosuch"));
}

TEST_CASE("all_on without lights, or with an environment among them, is an error")
{
    TempFolder folder;
    writeAll(makeDataset(folder, false), "canonical");
    const std::string path = folder.file("transforms_all_on.json");
    std::ifstream file(path);
    json description = json::parse(file);
    json without = description;
    without.erase("lights");
    folder.writeText("transforms_all_on.json", without.dump());
    checkError(loadDataset(folder.path.string()).error(), ErrorCode::kBadInput, {"transforms_all_on.json", "lights"});
    for (const json& bad : {json{{"type", "environment"}, {"map", "sky.exr"}}, json{{"type", "all_on"}}}) {
        json with = description;
        with["lights"][0] = bad;
        folder.writeText("transforms_all_on.json", with.dump());
        CHECK_FALSE(loadDataset(folder.path.string()));
    }
}
