// The ReNe dataset (Relight My NeRF): photographs of a table under one light at a time, a folder per light.
//
//   lset<light>/camera.yml                  OpenCV: camera_matrix, distortion coefficients (the middle of the first pixel is (0, 0))
//   lset<light>/light.txt                   4x4 light-to-world: its last column is the position
//   lset<light>/data/<view>_image.png       8-bit sRGB, opaque, the surroundings in view
//   lset<light>/data/<view>_pose.txt        4x4 camera-to-world, OpenCV axes, world +Z up
// There are no intensities: by convention. The published images of the benchmark's views (4, 8, 15) are black, so these are left out. Held out as
// "test": every tenth view (9, 19, ...) under the benchmark's hard lights (2, 21, 34), or under all lights if those are not there. "train" has
// neither these views nor these lights.
#include "dataset/loader.h"

#include "base/exact_position.h"
#include "interchange/image_file.h"
#include "interchange/matrix_file.h"
#include "interchange/text_lines.h"

#include <algorithm>

namespace nacre {
namespace {

constexpr int kBenchmarkViews[] = {4, 8, 15}, kTestLights[] = {2, 21, 34};

bool isOneOf(int i, std::span<const int> numbers) { return std::find(numbers.begin(), numbers.end(), i) != numbers.end(); }

/// The number behind a prefix; nothing if that is not all.
std::optional<int> numberBehind(const std::string& name, const std::string& prefix)
{
    return name.starts_with(prefix) ? integerOf<int>(std::string_view(name).substr(prefix.size())) : std::nullopt;
}

/// Focal lengths, principal point and lens of camera.yml. The size is the images'.
Status readCamera(const DatasetSource& source, const std::string& path, Camera& camera, std::optional<FileCamera>& file)
{
    const auto bytes = source.readFile(path);
    if (!bytes) return bytes.error();
    auto numbers = decodeYamlNumbers(*bytes, path);
    if (!numbers) return numbers.error();
    const std::vector<double>* matrix = nullptr;
    for (const char* key : {"camera_matrix", "cameraMatrix", "K", "mtx", "matrix", "intrinsics"})
        if (!matrix && (*numbers)[key].size() == 9) matrix = &(*numbers)[key];
    if (!matrix) return Error{ErrorCode::kBadInput, path + ": expected camera_matrix with 9 numbers"};
    const std::vector<double>& m = *matrix;
    if (std::fabs(m[1]) > 1e-6 * std::fabs(m[0])) return Error{ErrorCode::kUnsupported, path + ": camera_matrix has a skew of " + numberText(m[1]) + ", expected 0"};
    camera.fx = m[0], camera.fy = m[4], camera.cx = m[2] + 0.5, camera.cy = m[5] + 0.5;
    if (const auto wrong = cameraFault(camera)) return Error{ErrorCode::kBadInput, path + ": expected " + wrong->expected + ", found " + wrong->found};

    std::vector<double> lens;
    for (const char* key : {"distortion_coefficients", "dist_coeffs", "dist_coeff", "distCoeffs", "distortion", "dist"})
        if (lens.empty()) lens = (*numbers)[key];
    for (size_t i = 0; i < lens.size(); ++i)
        if (!(std::fabs(lens[i]) <= (i < 8 ? 1e6 : 1e-6)))
            return Error{ErrorCode::kUnsupported, path + ": expected a lens of k1..k6, p1, p2, found " + numberText(lens[i]) + " as coefficient " + std::to_string(i + 1)};
    lens.resize(8);
    const double k[6] = {lens[0], lens[1], lens[4], lens[5], lens[6], lens[7]}, p[2] = {lens[2], lens[3]};
    file = fileCamera(camera, k, p);
    return ok();
}

Result<Matrix> readMatrix(const DatasetSource& source, const std::string& path)
{
    const auto bytes = source.readFile(path);
    if (!bytes) return bytes.error();
    return decodeTextMatrix(*bytes, path);
}

struct View {
    int light, view;
    Camera camera;
    std::optional<FileCamera> file;
    OlatImage image;
};

/// The views of one light.
Status readLightSet(const DatasetSource& source, const std::string& folder, int number, std::vector<View>& views)
{
    const Result<Matrix> place = readMatrix(source, source.pathOf(folder + "/light.txt"));
    if (!place) return place.error();
    Light light;
    if (place->rows < 3 || place->columns != 4)
        return Error{ErrorCode::kBadInput, source.pathOf(folder + "/light.txt") + ": " + std::to_string(place->rows) + " x " + std::to_string(place->columns) + " numbers, expected 4 x 4"};
    const glm::dvec3 position(place->at(0, 3), place->at(1, 3), place->at(2, 3));
    for (int k = 0; k < 3; ++k)
        if (!(std::fabs(position[k]) < 1e9)) return Error{ErrorCode::kBadInput, source.pathOf(folder + "/light.txt") + ": expected coordinates below 1e9"};
    setExactPosition(light, position);

    Camera camera;
    std::optional<FileCamera> file;
    for (const std::string& name : source.list(source.pathOf(folder + "/data"))) {
        const size_t mark = name.find("_image.");
        if (mark == std::string::npos || imageKind(name) == ImageKind::kNone) continue;
        const auto view = integerOf<int>(std::string_view(name).substr(0, mark));
        if (!view || isOneOf(*view, kBenchmarkViews)) continue;
        const std::string path = source.pathOf(folder + "/data/" + name), posePath = source.pathOf(folder + "/data/" + name.substr(0, mark) + "_pose.txt");
        if (camera.width == 0) { // one camera for all views of a light
            const Result<Image> size = source.readImageSize(path);
            if (!size) continue;
            camera.width = size->width, camera.height = size->height;
            if (Status s = readCamera(source, source.pathOf(folder + "/camera.yml"), camera, file); !s) return s;
        }
        const Result<Matrix> matrix = readMatrix(source, posePath);
        if (!matrix) return matrix.error();
        const Result<glm::dmat4> pose = poseOf(*matrix, posePath);
        if (!pose) return pose.error();
        camera.worldFromCamera = fromOpenCv(*pose);
        views.push_back({number, *view, camera, file, OlatImage{0, light, path}});
    }
    return ok();
}

} // namespace

bool isRene(const DatasetSource& source)
{
    for (const std::string& name : source.list(source.path))
        if (numberBehind(name, "lset")) return source.fileExists(source.pathOf(name + "/camera.yml"));
    return false;
}

Status loadRene(const DatasetSource& source, OlatDataset& out)
{
    std::vector<View> views;
    for (const std::string& name : source.list(source.path))
        if (const auto number = numberBehind(name, "lset"))
            if (Status s = readLightSet(source, name, *number, views); !s) return s;
    const auto isHeldView = [](const View& v) { return v.view % 10 == 9; };
    const auto isTestLight = [](const View& v) { return isOneOf(v.light, kTestLights); };
    const bool hasTestLights = std::any_of(views.begin(), views.end(), [&](const View& v) { return isHeldView(v) && isTestLight(v); });
    SplitBuilder train("train"), test("test");
    size_t unused = 0;
    for (View& v : views) {
        const bool isTest = isHeldView(v) && (isTestLight(v) || !hasTestLights), isTrain = !isHeldView(v) && !isTestLight(v);
        if (isTest || isTrain) (isTest ? test : train).add(v.camera, std::move(v.image), v.file);
        else ++unused;
    }
    for (SplitBuilder* builder : {&train, &test})
        if (!builder->split.images.empty()) out.splits.push_back(std::move(builder->split));
    if (out.splits.empty()) return Error{ErrorCode::kBadInput, source.path + ": no images lset<light>/data/<view>_image.png"};
    out.colorSpace = ColorSpace::kSrgb;
    out.backgroundInView = true;
    out.up = {0, 0, 1};
    scaleByConvention(out);
    out.warnings.push_back(std::string("views 4, 8 and 15 (the benchmark's, black as published) left out; 'test' is every tenth view under ") +
                           (hasTestLights ? "lights 2, 21 and 34" : "all lights") + ", and " + std::to_string(unused) + " images with only one of the two held out are in no split");
    return ok();
}

} // namespace nacre
