#include "report/device_profile.h"

#include "appearance/bigs/bigs.h"
#include "appearance/model_table.h"
#include "appearance/sss/sss_asset.h"
#include "asset/asset_io.h"
#include "base/fibonacci_sphere.h"
#include "base/file.h"
#include "eval/splat_renderer.h"
#include "report/measure.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nacre::report {

namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kSplats = 12000;
constexpr int kSize = 400; // pixels a side

/// Flat discs on a unit ball, of both models the simplest that run all their passes.
SplatAsset ballOf(const std::string& model)
{
    SplatAsset asset;
    asset.model = model;
    SplatCloud& cloud = asset.cloud;
    cloud.count = kSplats;
    std::vector<glm::vec3> normals;
    for (size_t i = 0; i < kSplats; ++i) {
        const glm::vec3 n(fibonacciDirection(int(i), int(kSplats)));
        normals.push_back(n);
        cloud.positions.push_back(n);
        cloud.rotations.push_back(glm::normalize(glm::quat(1 + n.z, -n.y, n.x, 0))); // turns z to n; at n.z = -1 any will do
        if (n.z < -0.999f) cloud.rotations.back() = glm::quat(0, 1, 0, 0);
        cloud.scales.push_back({0.01f, 0.01f, 0.001f});
        cloud.opacities.push_back(0.7f);
    }
    const auto channel = [&](const char* name, uint32_t components, auto value) {
        Channel c{name, components};
        for (size_t i = 0; i < kSplats; ++i)
            for (uint32_t k = 0; k < components; ++k) c.values.push_back(value(i, k));
        asset.channels.push_back(std::move(c));
    };
    if (model == "bigs") {
        channel("tDir", 25, [](size_t, uint32_t k) { return 0.3f / float(1 + k); });
        channel("tInd", 75, [](size_t, uint32_t k) { return 0.1f / float(1 + k / 3); });
        channel("rho", 3, [](size_t, uint32_t) { return 0.5f; });
        return asset;
    }
    channel("baseColor", 3, [](size_t, uint32_t) { return 0.5f; });
    channel("material", 3, [](size_t, uint32_t k) { return k == 0 ? 0.5f : k == 1 ? 0.0f : 0.5f; });
    channel("normal", 3, [&](size_t i, uint32_t k) { return normals[i][int(k)]; });
    Channel network{"network", uint32_t(kSssNetworkFloats), std::vector<float>(size_t(kSssNetworkFloats), 0.01f), {}, true};
    for (int k = 0; k < 3; ++k) network.values[size_t(kSssFrame + k)] = 0;
    network.values[kSssFrame + 3] = 1;
    asset.channels.push_back(std::move(network));
    return asset;
}

Result<DeviceSlopes> slopesOf(const std::string& model, std::string* description)
{
    const SplatAsset ball = ballOf(model);
    const Result<std::vector<std::byte>> bytes = encodeAsset(ball);
    if (!bytes) return bytes.error();
    const Result<std::unique_ptr<SplatRenderer>> renderer = makeGlRenderer(*bytes);
    if (!renderer) return renderer.error();
    *description = (*renderer)->description();
    Camera camera;
    constexpr double kDistance = 4;
    camera.width = camera.height = kSize;
    camera.cx = camera.cy = 0.5 * kSize;
    camera.fx = camera.fy = 150 * std::sqrt(kDistance * kDistance - 1); // 300 pixels wide
    camera.worldFromCamera = glm::dmat4(1);
    camera.worldFromCamera[3] = glm::dvec4(0, 0, kDistance, 1);
    std::vector<Light> lights;
    constexpr int kLights = 4;
    for (int i = 0; i < kLights; ++i) {
        Light light;
        light.type = LightType::kPoint, light.position = 5.0f * glm::vec3(fibonacciDirection(i, kLights)), light.intensity = glm::vec3(10.0f);
        lights.push_back(light);
    }
    std::vector<RenderTimes> rounds;
    for (int r = 0; r < 8; ++r) {
        const Result<RenderTimes> t = (*renderer)->time(camera, lights, r == 0 ? 3 : 1, 4);
        if (!t) return t.error();
        rounds.push_back(*t);
    }
    const VariantTime t = summarise(std::move(rounds), 0);
    // A disc of deviation s covers, to where its alpha is 1/255, pi r^2 s^2 pixels, r^2 = 2 ln(255 * 0.7), less where it is seen aslant: half on average.
    const double pixels = double(kSplats) * 0.5 * std::numbers::pi * 2 * std::log(255 * 0.7) * (0.01 * 150) * (0.01 * 150);
    return DeviceSlopes{1e6 * t.relightMs / double(kSplats * kLights), 1e6 * t.sortMs / double(kSplats), 1e6 * t.rasterMs / pixels};
}

Json slopesJson(const DeviceSlopes& s) { return {{"relight_ns_per_splat_and_light", s.relightNs}, {"sort_ns_per_splat", s.sortNs}, {"raster_ns_per_covered_pixel", s.rasterNs}}; }

DeviceSlopes slopesFrom(const Json& json)
{
    return {json.at("relight_ns_per_splat_and_light").get<double>(), json.at("sort_ns_per_splat").get<double>(), json.at("raster_ns_per_covered_pixel").get<double>()};
}

bool positive(const DeviceSlopes& s)
{
    const auto good = [](double x) { return x > 0 && x < 1e12; };
    return good(s.relightNs) && good(s.sortNs) && good(s.rasterNs);
}

} // namespace

Result<DeviceProfile> measureDevice(const Says& says)
{
    DeviceProfile profile;
    profile.machine = machineText();
    for (const auto& [model, slopes] : {std::pair("bigs", &profile.bigs), std::pair("sss", &profile.sss)}) {
        if (!findAppearanceModel(model)) continue; // left out of this build
        if (!says(std::string("measuring this machine, model ") + model)) return Error{ErrorCode::kCancelled, "stopped"};
        const Result<DeviceSlopes> measured = slopesOf(model, &profile.renderer);
        if (!measured) return measured.error();
        *slopes = *measured;
    }
    return profile;
}

std::string profileJson(const DeviceProfile& p)
{
    return Json{{"machine", p.machine}, {"renderer", p.renderer}, {"bigs", slopesJson(p.bigs)}, {"sss", slopesJson(p.sss)}}.dump(2) + "\n";
}

Result<DeviceProfile> readProfile(const std::string& path)
{
    const auto bytes = readFile(path);
    if (!bytes) return bytes.error();
    const auto* text = reinterpret_cast<const char*>(bytes->data());
    const Json json = Json::parse(text, text + bytes->size(), nullptr, false);
    DeviceProfile profile;
    try {
        profile.machine = json.at("machine").get<std::string>(), profile.renderer = json.at("renderer").get<std::string>();
        profile.bigs = slopesFrom(json.at("bigs")), profile.sss = slopesFrom(json.at("sss"));
    } catch (const Json::exception&) {
        return Error{ErrorCode::kBadInput, "'" + path + "' is not a device profile, as nacre report --profile-only writes it: machine and renderer are texts; bigs and sss each have the numbers relight_ns_per_splat_and_light, sort_ns_per_splat and raster_ns_per_covered_pixel"};
    }
    if (!positive(profile.bigs) || !positive(profile.sss)) return Error{ErrorCode::kBadInput, "'" + path + "': slopes of a device profile must be above 0 and below 1e12 ns"};
    return profile;
}

VariantTime onDevice(const VariantTime& time, const std::string& model, const DeviceProfile& here, const DeviceProfile& there)
{
    const DeviceSlopes &a = model == "bigs" ? here.bigs : here.sss, &b = model == "bigs" ? there.bigs : there.sss;
    VariantTime out = time;
    out.relightMs *= b.relightNs / a.relightNs, out.sortMs *= b.sortNs / a.sortNs, out.rasterMs *= b.rasterNs / a.rasterNs;
    const double parts = time.relightMs + time.sortMs + time.rasterMs;
    const double factor = parts > 0 ? (out.relightMs + out.sortMs + out.rasterMs) / parts : 1;
    out.ms *= factor, out.low *= factor, out.high *= factor;
    return out;
}

} // namespace nacre::report
