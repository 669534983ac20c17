// Alpha that means something else than coverage of premultiplied colour is told apart, and sound data is left in peace.
#include "dataset_support.h"

#include <functional>

using namespace nacre;

namespace {

constexpr int kSize = 48;

/// Views of a sphere with soft edges whose stored pixels went through `store`; 0 to 11 are their indices.
OlatDataset spheres(const TempFolder& folder, const std::function<void(float* rgba, int image)>& store)
{
    OlatDataset dataset;
    dataset.splits.push_back({"train", {}, {}});
    for (uint32_t i = 0; i < 12; ++i) {
        const double phi = 0.5 * i;
        const Camera camera = lookAtOrigin(2.6 * glm::normalize(glm::dvec3(std::cos(phi), std::sin(phi), 0.4)), kSize);
        Light light;
        light.position = {float(4 * std::cos(phi + 0.5)), float(4 * std::sin(phi + 0.5)), 2.0f};
        Image image = renderSphere(camera, light.position, 60);
        for (size_t p = 0; p < image.rgba.size(); p += 4) store(image.rgba.data() + p, int(i));
        const std::string path = folder.file(std::to_string(i) + ".exr");
        REQUIRE(writeExr(image, path));
        dataset.splits[0].cameras.push_back(camera);
        dataset.splits[0].images.push_back({i, light, path});
    }
    return dataset;
}

std::vector<std::string> look(const OlatDataset& dataset)
{
    ImageCache cache(dataset, 64 << 20);
    return checkAlpha(dataset, cache);
}

void straighten(float* p)
{
    for (int c = 0; c < 3; ++c) p[c] /= std::max(p[3], 0.25f); // alpha is 0 or at least 1/4
}

void expectOne(const OlatDataset& dataset, std::initializer_list<const char*> words)
{
    const std::vector<std::string> found = look(dataset);
    REQUIRE(found.size() == 1);
    CAPTURE(found[0]);
    for (const char* word : words) {
        CAPTURE(word);
        CHECK(mentions(found[0], word));
    }
}

} // namespace

TEST_CASE("sound alpha raises no suspicion: premultiplied, straight that is said to be, none, glow without coverage in a corner")
{
    TempFolder folder;
    CHECK(look(spheres(folder, [](float*, int) {})).empty());
    OlatDataset straight = spheres(folder, [](float* p, int) {
        straighten(p);
        if (p[3] == 0) p[0] = p[1] = p[2] = 1.0f; // white under it, as many editors write
    });
    straight.premultiplied = false;
    CHECK(look(straight).empty());
    CHECK(look(spheres(folder, [](float* p, int) { p[3] = 1; })).empty());
}

TEST_CASE("straight colours taken for premultiplied are named, by what lies under alpha 0 or by their edges; the key mends them")
{
    TempFolder folder;
    for (const float under : {1.0f, 0.2f}) {
        OlatDataset dataset = spheres(folder, [&](float* p, int) {
            straighten(p);
            if (p[3] == 0) p[0] = p[1] = p[2] = under;
        });
        expectOne(dataset, {"colour where alpha is 0", "12 of 12", "\"alpha\": \"straight\""});
        dataset.premultiplied = false;
        CHECK(look(dataset).empty());
    }
    expectOne(spheres(folder, [](float* p, int) { straighten(p); }), {"alpha is straight", "\"alpha\": \"straight\""});
    OlatDataset twice = spheres(folder, [](float*, int) {});
    twice.premultiplied = false;
    expectOne(twice, {"premultiplied already", "\"alpha\": \"premultiplied\""});
}

TEST_CASE("masks that are inverted, faint or empty are named and counted")
{
    TempFolder folder;
    expectOne(spheres(folder, [](float* p, int) { p[3] = 1 - p[3]; }), {"inverted", "12 of 12"});
    OlatDataset straight = spheres(folder, [](float* p, int) { straighten(p), p[3] = 1 - p[3]; });
    straight.premultiplied = false;
    expectOne(straight, {"inverted"});
    for (const float factor : {0.45f, 0.1f})
        expectOne(spheres(folder, [&](float* p, int) {
                      for (int c = 0; c < 4; ++c) p[c] *= factor;
                  }), {"alpha nowhere exceeds", factor == 0.45f ? "0.45" : "0.1"});
    expectOne(spheres(folder, [](float* p, int i) {
                  for (int c = 0; i % 6 == 1 && c < 4; ++c) p[c] = 0;
              }), {"2 of 12", "1.exr", "empty or faint"});
    expectOne(spheres(folder, [](float* p, int) { p[3] = 0; }), {"alpha is 0 everywhere"});
}
