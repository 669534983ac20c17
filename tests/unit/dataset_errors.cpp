// Broken descriptions: one clear line each, and never a crash.
#include "dataset_support.h"

#include <functional>

using namespace nacre;

namespace {

struct OneFrame {
    TempFolder folder;
    json top;
    OneFrame()
    {
        REQUIRE(writeExr(Image{4, 4, std::vector<float>(64, 0.5f)}, folder.file("a.exr")));
        top = {{"camera_angle_x", 0.7}, {"width", 4}, {"height", 4}, {"color_space", "linear"}};
        top["frames"].push_back({{"file_path", "a.exr"}, {"transform_matrix", toJson(lookAtOrigin({2, 0, 1}, 4).worldFromCamera)},
                                 {"light", {{"type", "point"}, {"position", {0, 0, 4}}, {"intensity", {1, 1, 1}}}}});
    }
    Result<OlatDataset> load()
    {
        folder.writeText("transforms_train.json", top.dump());
        return loadDataset(folder.path.string());
    }
    json& frame() { return top["frames"][0]; }
};

} // namespace

TEST_CASE("a mistake in a description is reported with its place, what was expected and what was found")
{
    struct Case {
        const char* what;
        std::function<void(json& top, json& frame)> damage;
        std::initializer_list<const char*> words;
    };
    const Case cases[] = {
        {"light position is text", [](json&, json& f) { f["light"]["position"] = "here"; }, {"frames[0].light.position", "3 numbers", "string"}},
        {"light position is short", [](json&, json& f) { f["light"]["position"] = {1, 2}; }, {"frames[0].light.position", "array of 2"}},
        {"light position is huge", [](json&, json& f) { f["light"]["position"] = {1e10, 0, 0}; }, {"frames[0].light.position"}},
        {"intensity is negative", [](json&, json& f) { f["light"]["intensity"] = {1, -1, 1}; }, {"frames[0].light.intensity", "negative"}},
        {"light type is unknown", [](json&, json& f) { f["light"]["type"] = "spot"; }, {"frames[0].light.type", "spot"}},
        {"direction is zero", [](json&, json& f) { f["light"] = {{"type", "directional"}, {"direction_to_light", {0, 0, 0}}, {"irradiance", 1}}; },
         {"direction_to_light", "unit"}},
        {"environment map is missing", [](json&, json& f) { f["light"] = {{"type", "environment"}, {"map", "sky.exr"}}; }, {"sky.exr"}},
        {"image is missing", [](json&, json& f) { f["file_path"] = "no such.exr"; }, {"frames[0].file_path", "no such.exr"}},
        {"image name has line breaks", [](json&, json& f) { f["file_path"] = "a\nb\nc" + std::string(3000, 'x'); }, {"frames[0].file_path"}},
        {"pose is missing", [](json&, json& f) { f.erase("transform_matrix"); }, {"frames[0].transform_matrix", "nothing"}},
        {"pose is scaled", [](json&, json& f) { f["transform_matrix"][0][0] = 7.0; }, {"frames[0].transform_matrix", "rigid"}},
        {"pose is mirrored", [](json&, json& f) { for (auto& row : f["transform_matrix"]) row[0] = -row[0].get<double>(); }, {"mirrored"}},
        {"pose is projective", [](json&, json& f) { f["transform_matrix"][3] = {0, 0, 1, 1}; }, {"last row"}},
        {"pose has a null", [](json&, json& f) { f["transform_matrix"][1][3] = nullptr; }, {"transform_matrix[1][3]", "null"}},
        {"pose is far away", [](json&, json& f) { f["transform_matrix"][1][3] = 1e12; }, {"1e9"}},
        {"field of view is negative", [](json& t, json&) { t["camera_angle_x"] = -0.7; }, {"camera_angle_x"}},
        {"field of view is missing", [](json& t, json&) { t.erase("camera_angle_x"); }, {"camera_angle_x", "none of them"}},
        {"focal length is negative", [](json&, json& f) { f["fl_x"] = -100; }, {"fl_x", "positive"}},
        {"principal point is absurd", [](json&, json& f) { f["fl_x"] = 4, f["cx"] = 1e20; }, {"principal point"}},
        {"width is absurd", [](json& t, json&) { t["width"] = 1e9; }, {"width", "65536"}},
        {"width is fractional", [](json& t, json&) { t["width"] = 4.5; }, {"width", "whole"}},
        {"colour space is unknown", [](json& t, json&) { t["color_space"] = "acescg"; }, {"color_space", "acescg"}},
        {"EXR is said to be sRGB", [](json& t, json&) { t["color_space"] = "srgb"; }, {"EXR is linear"}},
        {"background is white", [](json& t, json&) { t["background"] = "white"; }, {"background", "white"}},
        {"no frames", [](json& t, json&) { t["frames"] = json::array(); }, {"transforms_train.json", "empty split"}},
        {"frames is a number", [](json& t, json&) { t["frames"] = 5; }, {"frames", "number 5"}},
        {"frames are numbers", [](json& t, json&) { t["frames"] = {1, 2}; }, {"unknown dataset convention"}},
        {"a later frame is not a frame", [](json& t, json&) { t["frames"].push_back(3); }, {"frames[1]"}},
        {"the top is an array", [](json& t, json&) { t = json::array({1}); }, {"frames"}},
    };
    for (const Case& c : cases) {
        INFO(c.what);
        OneFrame data;
        REQUIRE(data.load());
        c.damage(data.top, data.frame());
        Result<OlatDataset> dataset = data.load();
        REQUIRE(!dataset);
        checkError(dataset.error(), ErrorCode::kBadInput, c.words);
    }
}

TEST_CASE("a pose off by rounding is accepted and made exactly rigid")
{
    OneFrame data;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            json& v = data.frame()["transform_matrix"][size_t(r)][size_t(c)];
            v = std::round(v.get<double>() * 1e4) / 1e4;
        }
    Result<OlatDataset> dataset = data.load();
    if (!dataset) FAIL(dataset.error().message);
    const glm::dmat3 r(dataset->splits[0].cameras[0].worldFromCamera);
    const glm::dmat3 gram = glm::transpose(r) * r;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) CHECK(std::fabs(gram[i][j] - (i == j ? 1.0 : 0.0)) < 1e-14);
}

TEST_CASE("a description cut off at any byte is an error")
{
    OneFrame data;
    const std::string text = data.top.dump();
    for (size_t n = 0; n < text.size(); n++) {
        data.folder.writeText("transforms_train.json", text.substr(0, n));
        Result<OlatDataset> dataset = loadDataset(data.folder.path.string());
        REQUIRE(!dataset);
        CHECK(mentions(dataset.error().message, "transforms_train.json"));
        CHECK(dataset.error().message.size() < 300);
    }
}

TEST_CASE("JSON that is hostile rather than wrong is an error")
{
    OneFrame data;
    for (const std::string& text : {std::string(200000, '['), std::string("{\"frames\": 1e999}"), std::string("{\"frames\": [NaN]}"),
                                    std::string("\xff\xfe\x00\x01", 4), "{\"frames\": " + std::string(100000, '[') + std::string(100000, ']') + "}"}) {
        data.folder.writeText("transforms_train.json", text);
        Result<OlatDataset> dataset = loadDataset(data.folder.path.string());
        REQUIRE(!dataset);
        checkError(dataset.error(), ErrorCode::kBadInput, {});
    }
}

TEST_CASE("folders that are no dataset say so")
{
    TempFolder folder;
    Result<OlatDataset> empty = loadDataset(folder.path.string());
    REQUIRE(!empty);
    checkError(empty.error(), ErrorCode::kBadInput, {"transforms_"});
    Result<OlatDataset> missing = loadDataset(folder.file("missing"));
    REQUIRE(!missing);
    checkError(missing.error(), ErrorCode::kBadInput, {"missing", "not a folder"});
    std::filesystem::create_directories(folder.path / "olat_1");
    Result<OlatDataset> noDescription = loadDataset(folder.path.string());
    REQUIRE(!noDescription);
    checkError(noDescription.error(), ErrorCode::kBadInput, {"olat_1"});
}

TEST_CASE("BiGS data with a fisheye or 8-bit images is unsupported, not misread")
{
    TempFolder folder;
    std::filesystem::create_directories(folder.path / "olat_1");
    REQUIRE(writeExr(Image{4, 4, std::vector<float>(64, 0.5f)}, folder.file("olat_1/a.exr")));
    REQUIRE(writePng(folder.file("olat_1/a.png"), 1, 1, 3, std::vector<uint8_t>(3)));
    json top = {{"camera_angle_x", 0.7}};
    top["frames"].push_back({{"file_path", "a.exr"}, {"transform_matrix", toJson(lookAtOrigin({2, 0, 1}, 4).worldFromCamera)},
                             {"light", {{"position", {0, 0, 4}}, {"intensity", 2}}}});
    const auto load = [&] {
        folder.writeText("olat_1/transforms_train.json", top.dump());
        return loadDataset(folder.path.string());
    };
    Result<OlatDataset> good = load();
    if (!good) FAIL(good.error().message);
    CHECK(good->up == glm::vec3(0, 1, 0));
    top["camera_model"] = "OPENCV_FISHEYE";
    Result<OlatDataset> distorted = load();
    REQUIRE(!distorted);
    checkError(distorted.error(), ErrorCode::kUnsupported, {"OPENCV_FISHEYE", "undistort"});
    top.erase("camera_model");
    top["frames"][0]["file_path"] = "a.png";
    Result<OlatDataset> png = load();
    REQUIRE(!png);
    checkError(png.error(), ErrorCode::kUnsupported, {"a.png", ".exr"});
}
