// What reports and tuning go by: fronts, spreads, and what one machine's times say of another.
#include "base/file.h"
#include "report/device_profile.h"
#include "report/fronts.h"

#include <doctest/doctest.h>

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <random>

using namespace nacre;
using namespace nacre::report;

TEST_CASE("a point is dominated if another is as good in both and better in one; of equals neither is")
{
    std::mt19937 random(7);
    for (int run = 0; run < 200; ++run) {
        std::vector<double> costs, qualities;
        for (int i = 0; i < 12; ++i) costs.push_back(double(random() % 6)), qualities.push_back(double(random() % 6)); // with ties
        const std::vector<bool> worse = dominated(costs, qualities);
        CHECK(std::find(worse.begin(), worse.end(), false) != worse.end());
        for (size_t i = 0; i < costs.size(); ++i) {
            // What is dominated is so by a point of the front; what is not has the best quality of all that cost as little.
            bool beaten = false;
            for (size_t k = 0; k < costs.size(); ++k) {
                if (!worse[k] && costs[k] <= costs[i] && qualities[k] >= qualities[i] && (costs[k] != costs[i] || qualities[k] != qualities[i])) beaten = true;
                if (!worse[i] && costs[k] <= costs[i]) CHECK(qualities[k] <= qualities[i]);
            }
            CHECK(beaten == worse[i]);
        }
    }
    CHECK(dominated({}, {}).empty());
}

TEST_CASE("a time is the median of its rounds, within the range of nine in ten and what drifts between runs")
{
    std::vector<RenderTimes> rounds;
    for (int i = 0; i <= 20; ++i) rounds.push_back({1, 2, 3, double((8 * i) % 21)}); // 0 to 20 in another order
    const VariantTime t = summarise(rounds, 0.5);
    CHECK(t.ms == doctest::Approx(10.5));
    CHECK(t.low == doctest::Approx(0.95 + 0.5));
    CHECK(t.high == doctest::Approx(1.05 * 19 + 0.5));
    const VariantTime one = summarise({{1, 2, 3, 6}}, 0);
    CHECK(one.ms == 6);
    CHECK(one.low < 6);
    CHECK(one.high > 6);
}

TEST_CASE("a scaled camera sees the same through other pixels")
{
    Camera camera;
    camera.width = 200, camera.height = 100, camera.fx = 150, camera.fy = 140, camera.cx = 90, camera.cy = 55;
    for (const double scale : {0.003, 0.5, 0.71, 2.0}) {
        const Camera c = scaledCamera(camera, scale);
        CHECK(c.width >= 1);
        CHECK(c.height >= 1);
        CHECK(c.fx / c.width == doctest::Approx(camera.fx / camera.width));
        CHECK(c.cy / c.height == doctest::Approx(camera.cy / camera.height));
    }
}

TEST_CASE("a device profile comes back as it was written, scales each part of a frame, and refuses what is none")
{
    const DeviceProfile here{"a \"machine\"", "renderer", {50, 15, 40}, {2000, 15, 140}}, there{"b", "r", {5, 30, 10}, {200, 15, 14}};
    const std::string path = (std::filesystem::temp_directory_path() / ("nacre-profile-" + std::to_string(getpid()) + ".json")).string();
    const auto write = [&](const std::string& text) { REQUIRE(writeFileAtomically(path, std::as_bytes(std::span(text)))); };
    write(profileJson(here));
    const auto read = readProfile(path);
    REQUIRE(read);
    CHECK(read->machine == here.machine);
    CHECK(read->sss.relightNs == here.sss.relightNs);
    CHECK(read->bigs.rasterNs == here.bigs.rasterNs);

    const VariantTime t{60, 50, 70, 10, 10, 40};
    CHECK(onDevice(t, "bigs", here, here).ms == doctest::Approx(60));
    const VariantTime other = onDevice(t, "bigs", here, there);
    CHECK(other.relightMs == doctest::Approx(1));
    CHECK(other.sortMs == doctest::Approx(20));
    CHECK(other.rasterMs == doctest::Approx(10));
    CHECK(other.ms == doctest::Approx(31));
    CHECK(other.low / other.ms == doctest::Approx(50.0 / 60));

    for (const char* bad : {"", "{}", "[1]", R"({"machine":1})", R"({"machine":"a","renderer":"b","bigs":{},"sss":{}})"}) {
        write(bad);
        const auto refused = readProfile(path);
        REQUIRE(!refused);
        CHECK(refused.error().code == ErrorCode::kBadInput);
    }
    std::string zero = profileJson(here);
    zero.replace(zero.find("50.0"), 4, "0.00");
    write(zero);
    CHECK(!readProfile(path));
    std::filesystem::remove(path);
    CHECK(!readProfile(path));
}

TEST_CASE("a variant is told by what differs from everything")
{
    CHECK(variantText({}) == "everything");
    CHECK(variantText({{0.25f}, 1}) == "25 % of the splats");
    CHECK(variantText({{}, 0.5f}) == "50 % of the width and height");
    CHECK(variantText({{0.5f, kPartLobe | kPartVisibility, 9, 16}, 0.71f}) == "50 % of the splats, no visibility, no lobe, 9 transport functions, visibility maps of 16 x 16, 71 % of the width and height");
}
