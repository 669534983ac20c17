// DiLiGenT-MV: an object on a turntable before a fixed camera and far lights.
//
//   Calib_Results.mat                       Bouguet's toolbox: KK 3x3 (the middle of the first pixel is (0, 0)); Rc_<i> 3x3, Tc_<i> 3x1 of view i, world to
//                                           camera, OpenCV axes, millimetres
//   view_<i>/001.png ...                    16-bit linear, an image per light; mask.png
//   view_<i>/light_directions.txt           a direction towards the light for each, in the camera's frame (x right, y up, z towards the camera)
//   view_<i>/light_intensities.txt          its irradiance, r g b
// The convention states no split: every tenth view (10, 20) is held out as "test"; its lights, which stand still beside the camera, turn with it.
#include "dataset/loader.h"

#include "interchange/matrix_file.h"
#include "interchange/text_lines.h"

namespace nacre {
namespace {

constexpr const char* kCalibration = "Calib_Results.mat";

std::optional<int> viewNumber(const std::string& name)
{
    return name.starts_with("view_") ? integerOf<int>(std::string_view(name).substr(5)) : std::nullopt;
}

Result<Matrix> readRows(const DatasetSource& source, const std::string& path)
{
    const auto bytes = source.readFile(path);
    if (!bytes) return bytes.error();
    Result<Matrix> rows = decodeTextMatrix(*bytes, path);
    if (rows && rows->columns != 3) return Error{ErrorCode::kBadInput, path + ": " + std::to_string(rows->columns) + " numbers in a line, expected 3"};
    return rows;
}

/// Nothing without a matrix of that size.
const Matrix* findMatrix(const std::map<std::string, Matrix>& all, const std::string& name, size_t rows, size_t columns)
{
    const auto it = all.find(name);
    return it != all.end() && it->second.rows == rows && it->second.columns == columns ? &it->second : nullptr;
}

Result<Camera> readView(const std::map<std::string, Matrix>& calibration, int view, const std::string& path)
{
    const auto bad = [&](const std::string& what) { return Error{ErrorCode::kBadInput, path + ": " + what}; };
    const std::string number = std::to_string(view);
    const Matrix *k = findMatrix(calibration, "KK", 3, 3), *r = findMatrix(calibration, "Rc_" + number, 3, 3), *t = findMatrix(calibration, "Tc_" + number, 3, 1);
    if (!k) return bad("no matrix KK of 3 x 3");
    if (!r || !t) return bad("no matrix Rc_" + number + " of 3 x 3 and Tc_" + number + " of 3 x 1 for view " + number);
    if (!(std::fabs(k->at(0, 1)) <= 1e-3 * std::fabs(k->at(0, 0)))) return bad("KK has a skew of " + numberText(k->at(0, 1)) + ", expected 0");
    Matrix pose{4, 4, std::vector<double>(16)};
    for (size_t i = 0; i < 3; ++i)
        for (size_t j = 0; j < 3; ++j) {
            pose.values[i * 4 + j] = r->at(j, i);
            pose.values[i * 4 + 3] -= r->at(j, i) * t->at(j, 0);
        }
    pose.values[15] = 1;
    const Result<glm::dmat4> worldFromCamera = poseOf(pose, path + ": Rc_" + number);
    if (!worldFromCamera) return worldFromCamera.error();
    Camera camera;
    camera.fx = k->at(0, 0), camera.fy = k->at(1, 1), camera.cx = k->at(0, 2) + 0.5, camera.cy = k->at(1, 2) + 0.5;
    camera.worldFromCamera = fromOpenCv(*worldFromCamera);
    return camera;
}

} // namespace

bool isDiligent(const DatasetSource& source) { return source.fileExists(source.pathOf(kCalibration)); }

Status loadDiligent(const DatasetSource& source, OlatDataset& out)
{
    const std::string path = source.pathOf(kCalibration);
    const auto bytes = source.readFile(path);
    if (!bytes) return bytes.error();
    const auto calibration = decodeMat(*bytes, path);
    if (!calibration) return calibration.error();

    SplitBuilder train("train"), test("test");
    for (const std::string& folder : source.list(source.path)) {
        const std::optional<int> view = viewNumber(folder);
        if (!view) continue;
        Result<Camera> camera = readView(*calibration, *view, path);
        if (!camera) return camera.error();
        const std::string directionsPath = source.pathOf(folder + "/light_directions.txt"), intensitiesPath = source.pathOf(folder + "/light_intensities.txt");
        const Result<Matrix> directions = readRows(source, directionsPath), intensities = readRows(source, intensitiesPath);
        if (!directions) return directions.error();
        if (!intensities) return intensities.error();
        if (directions->rows != intensities->rows)
            return Error{ErrorCode::kBadInput, intensitiesPath + ": " + std::to_string(intensities->rows) + " lines, expected " + std::to_string(directions->rows) +
                                                   " as in light_directions.txt"};
        const std::string mask = source.pathOf(folder + "/mask.png");
        for (const std::string& name : source.list(source.pathOf(folder))) {
            const size_t dot = name.find(".png");
            const auto number = dot + 4 == name.size() ? integerOf<size_t>(std::string_view(name).substr(0, dot)) : std::nullopt;
            if (!number) continue; // masks and the like
            const std::string file = source.pathOf(folder + "/" + name);
            if (*number < 1 || *number > directions->rows)
                return Error{ErrorCode::kBadInput, directionsPath + ": " + std::to_string(directions->rows) + " lights, expected one for " + inQuotes(name)};
            if (camera->width == 0) {
                const Result<Image> size = source.readImageSize(file);
                if (!size) continue;
                camera->width = size->width, camera->height = size->height;
                if (const auto wrong = cameraFault(*camera)) return Error{ErrorCode::kBadInput, path + ": KK: expected " + wrong->expected + ", found " + wrong->found};
            }
            const size_t row = *number - 1;
            const glm::dvec3 direction(directions->at(row, 0), directions->at(row, 1), directions->at(row, 2));
            const double length = glm::length(direction);
            OlatImage image{0, {}, file};
            image.light.type = LightType::kDirectional;
            if (!(std::fabs(length - 1) < 0.05)) return Error{ErrorCode::kBadInput, directionsPath + ": light " + std::to_string(*number) + ": length " + numberText(length) + ", expected 1"};
            // the camera's frame has the axes of OpenGL's
            image.light.directionToLight = glm::vec3(glm::dmat3(camera->worldFromCamera) * (direction / length));
            for (size_t c = 0; c < 3; ++c) {
                const double intensity = intensities->at(row, c);
                if (!(intensity > 0 && intensity < 1e15)) return Error{ErrorCode::kBadInput, intensitiesPath + ": light " + std::to_string(*number) + ": " + numberText(intensity) + ", expected a number above 0"};
                image.light.intensity[int(c)] = float(intensity);
            }
            if (source.fileExists(mask)) image.maskPath = mask;
            (*view % 10 == 0 ? test : train).add(*camera, std::move(image), std::nullopt);
        }
    }
    for (SplitBuilder* builder : {&train, &test})
        if (!builder->split.images.empty()) out.splits.push_back(std::move(builder->split));
    if (out.splits.empty()) return Error{ErrorCode::kBadInput, source.path + ": no images view_<i>/001.png"};
    out.colorSpace = ColorSpace::kLinear;
    out.up = upFromCameras(out.splits);
    out.warnings.push_back("no splits are stated: every tenth view is held out as 'test'");
    if (const auto kc = calibration->find("kc"); kc != calibration->end())
        for (const double c : kc->second.values)
            if (std::fabs(c) > 1e-6) {
                out.warnings.push_back("the lens distortion kc of Calib_Results.mat is not applied: the images of this convention are pinhole images");
                break;
            }
    return ok();
}

} // namespace nacre
