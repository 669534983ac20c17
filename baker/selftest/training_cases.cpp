// The optimiser at its ends, and bakes from data that nobody should have.
//
// Objects are learnt from images of a cloud of splats, drawn with the scalar formulas. What counts is that a bake ends in a valid asset or with
// one error that says why.
#include "appearance/bigs/bigs_training.h"
#include "appearance/model_table.h"
#include "base/fibonacci_sphere.h"
#include "base/file.h"
#include "selftest/cases.h"
#include "selftest/scalar_image.h"
#include "train/bake.h"
#include "train/trainer.h"

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>

namespace nacre::selftest {

namespace {

constexpr int kSize = 24;

Scene teacher()
{
    Scene scene = bigsScene(60, 0, 21);
    for (size_t i = 0; i < 60; ++i) scene.asset.cloud.scales[i] = glm::vec3(0.12f), scene.asset.cloud.opacities[i] = 0.95f;
    return scene;
}

/// A folder that goes when this does.
struct Folder {
    std::string path;
    Folder()
    {
        std::string name = (std::filesystem::temp_directory_path() / "nacre-selftest-XXXXXX").string();
        if (mkdtemp(name.data())) path = name;
    }
    ~Folder()
    {
        std::error_code ignored;
        if (!path.empty()) std::filesystem::remove_all(path, ignored);
    }
    Folder(const Folder&) = delete;
};

/// An uncompressed EXR of floats. Nacre's own writer refuses what the loaders have to refuse.
Status writePlainExr(const Image& image, const std::string& path)
{
    std::string out;
    const auto put = [&](const auto& value) { out.append(reinterpret_cast<const char*>(&value), sizeof value); };
    const auto text = [&](const char* s) { out.append(s, std::strlen(s) + 1); };
    const auto attribute = [&](const char* name, const char* type, uint32_t bytes) { text(name), text(type), put(bytes); };
    const int32_t last[4] = {0, 0, image.width - 1, image.height - 1};
    put(uint32_t(20000630)), put(uint32_t(2));
    attribute("channels", "chlist", 4 * 18 + 1);
    for (const char* name : {"A", "B", "G", "R"}) text(name), put(int32_t(2)), put(uint32_t(0)), put(int32_t(1)), put(int32_t(1));
    out += '\0';
    attribute("compression", "compression", 1), out += '\0';
    attribute("dataWindow", "box2i", 16), put(last);
    attribute("displayWindow", "box2i", 16), put(last);
    attribute("lineOrder", "lineOrder", 1), out += '\0';
    attribute("pixelAspectRatio", "float", 4), put(1.0f);
    attribute("screenWindowCenter", "v2f", 8), put(0.0f), put(0.0f);
    attribute("screenWindowWidth", "float", 4), put(1.0f);
    out += '\0';
    const uint32_t lineBytes = uint32_t(16 * image.width);
    out.append(size_t(image.height) * 8, '\0'); // where each line begins
    const size_t first = out.size();
    for (int y = 0; y < image.height; ++y) {
        const uint64_t at = out.size();
        std::memcpy(&out[first - size_t(image.height - y) * 8], &at, sizeof at);
        put(int32_t(y)), put(lineBytes);
        for (const int c : {3, 2, 1, 0})
            for (int x = 0; x < image.width; ++x) put(image.pixel(x, y)[c]);
    }
    return writeFileAtomically(path, std::as_bytes(std::span(out)));
}

/// What is wrong with a capture of the teacher, and how it is baked.
struct Capture {
    int views = 6, lights = 3;
    std::function<void(Image&, size_t)> spoil = [](Image&, size_t) {}; // the n-th image
    std::function<void(Light&)> tell = [](Light&) {};                  // what the description says of a light
    std::string model = "bigs";
    int maxSplats = 40;
};

Image imageOf(const Values& drawn)
{
    Image image{kSize, kSize, {}};
    for (size_t p = 0; p < size_t(kSize) * kSize; ++p) {
        for (size_t c = 0; c < 3; ++c) image.rgba.push_back(float(drawn[0].values[3 * p + c]));
        image.rgba.push_back(float(drawn[1].values[p]));
    }
    return image;
}

Result<OlatDataset> photograph(const Capture& capture, const Folder& folder)
{
    if (folder.path.empty()) return Error{ErrorCode::kIo, "cannot make a temporary folder"};
    OlatDataset dataset;
    dataset.path = folder.path, dataset.convention = "canonical";
    OlatSplit split{"train", {}, {}};
    for (int v = 0; v < capture.views; ++v) {
        Scene scene = teacher();
        scene.camera = cameraAt(2.5 * fibonacciDirection(v, std::max(capture.views, 2)), glm::dvec3(0), kSize, 1.3 * kSize);
        for (int l = 0; l < capture.lights; ++l) {
            scene.lights = {pointLight(glm::vec3(3.0 * fibonacciDirection(l, std::max(capture.lights, 2))), 9)};
            const Values drawn = drawScalar<float>(scene, {});
            Image image = imageOf(drawn);
            capture.spoil(image, split.images.size());
            OlatImage entry{uint32_t(v), scene.lights[0], folder.path + "/" + std::to_string(split.images.size()) + ".exr"};
            capture.tell(entry.light);
            if (Status s = writePlainExr(image, entry.path); !s) return s.error();
            split.images.push_back(std::move(entry));
        }
        split.cameras.push_back(scene.camera);
    }
    dataset.splits = {std::move(split)};
    return dataset;
}

/// 0 if the bake ends in a valid asset of finite figures, or with an error that has a message; 1 if not.
Result<Values> bakeOf(const Capture& capture)
{
    const Folder folder;
    const auto dataset = photograph(capture, folder);
    if (!dataset) return dataset.error();
    BakeOptions options;
    options.model = capture.model, options.maxSplats = capture.maxSplats, options.iterations = 40, options.sFunctions = 1;
    const auto result = bake(*dataset, options, {}, nullptr);
    std::string fault;
    if (!result && result.error().message.empty()) fault = "an error without a message";
    if (result && !std::isfinite(result->psnrTrain)) fault = "the PSNR of training is not finite";
    if (result)
        if (const Status valid = validate(result->asset); !valid) fault = valid.error().message;
    return Values{{fault, {fault.empty() ? 0.0 : 1.0}, 1}};
}

/// Of a bake's steps at `rate` times their rates, from the teacher's splats in a neutral colour: 1 if a loss or the asset is unsound, and with
/// `still` how far its coverage has changed (colours do: visibility and normals are drawn from the geometry on the way).
Result<Values> stepsAt(double rate, const std::string& model, bool still)
{
    constexpr int kSteps = 60;
    const Scene scene = teacher();
    TrainerOptions options;
    options.maxSplats = 60;
    Trainer trainer(options, makeTrainableAppearance(model, {.scatterFunctions = 4}));
    trainer.initialize(scene.asset.cloud, std::vector<glm::vec3>(scene.asset.cloud.count, glm::vec3(1)));
    const Light light = pointLight({1, 2, 3}, 9);
    std::vector<float> before, after;
    trainer.render(scene.camera, {&light, 1}, before);
    std::string fault;
    for (int step = 1; step <= kSteps; ++step) {
        Scene seen = scene;
        seen.camera = cameraAt(2.5 * fibonacciDirection(step % 6, 6), glm::dvec3(0), kSize, 1.3 * kSize);
        seen.lights = {pointLight(glm::vec3(3.0 * fibonacciDirection(step % 5, 5)), 9)};
        const Values drawn = drawScalar<float>(seen, {});
        const PreparedImage reference = prepareImage(imageOf(drawn));
        const PreparedImage* references[] = {&reference};
        const LossStats stats = trainer.step(seen.camera, seen.lights, references, {step, double(step) / kSteps, rate});
        if (!std::isfinite(stats.loss)) fault = "the loss of step " + std::to_string(step) + " is not finite";
    }
    trainer.render(scene.camera, {&light, 1}, after);
    SplatAsset asset;
    asset.model = model;
    trainer.exportTo(asset);
    if (const Status valid = validate(asset); !valid) fault = valid.error().message;
    Values out = {{fault, {fault.empty() ? 0.0 : 1.0}, 1}};
    if (!still) return out;
    ValueGroup moved{"change of coverage", {}, 1};
    for (size_t i = before.size() / 4 * 3; i < before.size(); ++i) moved.values.push_back(double(after[i]) - double(before[i]));
    out.push_back(std::move(moved));
    return out;
}

// ---- the product T_dir * (rho + s), with the steps of the engine --------------------------------------------------------------------

struct Product {
    float direct, scatter; // T_dir and rho at the start
    float rate;            // of both; 1 is that of bakes
    int steps;
};

/// Largest error left of splats that learn one colour from the start that is given, in units of the colour; infinite if not finite.
double errorLeft(const Product& start)
{
    constexpr size_t kCount = 16;
    constexpr float kTarget = 0.5f;
    BigsParameters p;
    p.resize(kCount);
    std::vector<GaussianGeometry<float>> geometry(kCount, GaussianGeometry<float>{});
    std::vector<uint32_t> visible(kCount);
    for (size_t i = 0; i < kCount; ++i) {
        p.value[p.index(i, kTDir)] = 3.5449077f * start.direct, p.value[p.index(i, kShadow)] = 1;
        for (int c = 0; c < 3; ++c) p.value[p.index(i, kRho + c)] = start.scatter;
        visible[i] = uint32_t(i);
    }
    LitView lit;
    lit.eye[2] = 2, lit.lightCount = 1, lit.lights[0] = directionalLight({0, 0, 1}, 1);
    const VisibleView view{geometry, visible, kCount};
    const BigsBands bands{1, 1, 0, false, false};
    std::vector<float> colors(kCount * kColorStride), dColors(colors.size());
    std::vector<uint8_t> active(kCount, 1);
    AlignedVector<float> terms(p.blocks() * kBigsTermStride * kLanes16);
    BigsLobeGradients lobe, forward;
    double worst = 0;
    for (int step = 1; step <= start.steps + 1; ++step) {
        bigsForward(p, view, lit, bands, {}, colors.data(), terms.data());
        worst = 0;
        for (size_t i = 0; i < kCount; ++i)
            for (size_t c = 0; c < 3; ++c) {
                const float error = colors[i * kColorStride + c] - kTarget;
                dColors[i * kColorStride + c] = error;
                worst = std::isfinite(error) ? std::max(worst, double(std::abs(error) / kTarget)) : std::numeric_limits<double>::infinity();
            }
        BigsUpdate update;
        for (float& r : update.rate) r = 5e-3f * start.rate * float(1 - 0.99 * step / (start.steps + 1)); // falls as in bakes
        update.step = step;
        bigsBackwardAndStep(p, view, lit, bands, {}, active.data(), dColors.data(), terms.data(), update, lobe, forward);
    }
    return worst;
}

} // namespace

std::vector<Case> trainingCases()
{
    std::vector<Case> cases;
    const auto learns = [&](const char* name, Bound bound, Product start) {
        cases.push_back({.name = std::string("training: ") + name, .quantity = "error left", .kind = Kind::kTraining, .bound = bound,
                         .train = [start]() -> Result<Values> { return Values{{"error left of a colour", {errorLeft(start)}, 1}}; }});
    };
    const auto bakes = [&](const char* name, Capture capture) {
        cases.push_back({.name = std::string("bake: ") + name, .quantity = "unsound", .kind = Kind::kTraining, .bound = {0, "a valid asset, or a message that says why there is none"},
                         .train = [capture] { return bakeOf(capture); }});
    };

    learns("T_dir x rho from 1 x 0.3", {1e-3, "the last steps, 5e-5, are the error"}, {1, 0.3f, 1, 400});
    learns("T_dir x rho from 30 x 0.003: stiff", {0.01, "the last steps of rho, 5e-5, move the colour by 30 times that"}, {30, 0.003f, 1, 400});
    learns("T_dir x rho from 1e3 x 1e-4: very stiff", {0.2, "the last steps of rho, 5e-5, move the colour by 1e3 times that"}, {1000, 1e-4f, 1, 400});
    learns("T_dir x rho from 0.003 x 1: a dark start", {0.2, "T_dir must go a hundred times its start, in steps that fall to a hundredth"}, {0.003f, 1, 1, 400});
    learns("rates 1e-6 times: nothing moves, nothing breaks", {0.5, "the error of the start, 0.4, stays"}, {1, 0.3f, 1e-6f, 100});
    learns("rates 1e3 times: stays finite", {1, "steps of 5 overshoot a colour of 0.5, the last are of 0.05"}, {1, 0.3f, 1e3f, 100});

    const auto steps = [&](const char* name, Bound bound, double rate, const char* model, bool still) {
        cases.push_back({.name = std::string("training: ") + name, .quantity = still ? "unsound, change" : "unsound", .kind = Kind::kTraining, .bound = bound,
                         .train = [=] { return stepsAt(rate, model, still); }});
    };
    for (const char* model : {"bigs", "sss"}) {
        const std::string of = std::string(", ") + model;
        steps(("steps of 1e-6 times the rate" + of).c_str(), {1e-4, "60 steps of geometry, 1e-6 times some pixels each"}, 1e-6, model, true);
        steps(("steps of 100 times the rate" + of).c_str(), {0, "losses are finite and the asset is valid, whatever it looks like"}, 100, model, false);
        steps(("steps of 1e6 times the rate" + of).c_str(), {0, "losses are finite and the asset is valid, whatever it looks like"}, 1e6, model, false);
    }

    bakes("sound data", {});
    bakes("pixels that are NaN", {.spoil = [](Image& image, size_t) { for (size_t i = 400; i < 480; ++i) image.rgba[i] = std::numeric_limits<float>::quiet_NaN(); }});
    bakes("pixels that are NaN in one image", {.spoil = [](Image& image, size_t n) { if (n == 4) image.rgba[1000] = std::numeric_limits<float>::quiet_NaN(); }});
    bakes("pixels that are infinite", {.spoil = [](Image& image, size_t n) { if (n == 4) image.rgba[1000] = std::numeric_limits<float>::infinity(); }});
    bakes("radiance of 1e30", {.spoil = [](Image& image, size_t) { for (size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] *= i % 4 == 3 ? 1.0f : 1e30f; }});
    bakes("radiance of 1e-38", {.spoil = [](Image& image, size_t) { for (size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] *= i % 4 == 3 ? 1.0f : 1e-38f; }});
    bakes("saturated: every pixel is white", {.spoil = [](Image& image, size_t) { for (float& v : image.rgba) v = 1; }});
    bakes("saturated: the object is white", {.spoil = [](Image& image, size_t) { for (size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] = image.rgba[i | 3]; }});
    bakes("alpha 0 everywhere", {.spoil = [](Image& image, size_t) { for (size_t i = 3; i < image.rgba.size(); i += 4) image.rgba[i] = 0; }});
    bakes("noise instead of images", {.spoil = [](Image& image, size_t n) { Random random(31, n); for (float& v : image.rgba) v = random.uniform(); }});
    bakes("one view", {.views = 1});
    bakes("one image", {.views = 1, .lights = 1});
    bakes("lights on the other side", {.tell = [](Light& light) { light.position = -light.position; }});
    bakes("lights in the middle of the object", {.tell = [](Light& light) { light.position *= 1e-6f; }});
    bakes("lights at 1e8 with 1e15", {.tell = [](Light& light) { light.position *= 3e7f, light.intensity = glm::vec3(1e15f); }});
    bakes("lights that are told to be 1e12 times as bright", {.tell = [](Light& light) { light.intensity *= 1e12f; }});
    bakes("lights that are told to be off", {.tell = [](Light& light) { light.intensity = glm::vec3(0); }});
    bakes("one splat", {.maxSplats = 1});
    bakes("sss, sound data", {.model = "sss"});
    bakes("sss, radiance of 1e30", {.spoil = [](Image& image, size_t) { for (size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] *= i % 4 == 3 ? 1.0f : 1e30f; }, .model = "sss"});
    bakes("sss, lights in the middle of the object", {.tell = [](Light& light) { light.position *= 1e-6f; }, .model = "sss"});
    return cases;
}

} // namespace nacre::selftest
