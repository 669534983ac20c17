// Helpers that all dataset loaders share: poses, intrinsics, lights, files.
#include "dataset/loader.h"

#include "base/exact_position.h"
#include "dataset/normalise.h"
#include "interchange/image_file.h"
#include "interchange/matrix_file.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>

namespace nacre {

constexpr double kRigidTolerance = 1e-3; // poses come from text with few digits and from float32 optimisers
constexpr double kMaxCoordinate = 1e9;   // float32 still resolves such a scene to 64 units; beyond is garbage

static std::string brief(double x)
{
    char text[32];
    std::snprintf(text, sizeof text, "%.4g", x);
    return text;
}

bool anyFrameHas(const DatasetSource& source, const char* key)
{
    return std::any_of(source.descriptions.begin(), source.descriptions.end(),
                       [&](const Description& d) { return d.frames().firstItem()[key].exists(); });
}

std::string extensionOf(const std::string& path)
{
    std::string e = std::filesystem::path(path).extension().string();
    for (char& c : e) c = char(std::tolower(static_cast<unsigned char>(c)));
    return e;
}

std::string DatasetSource::pathOf(const std::string& relative) const { return (std::filesystem::path(path) / relative).lexically_normal().string(); }

std::vector<const Description*> DatasetSource::topLevels() const
{
    std::vector<const Description*> out;
    for (const Description& d : descriptions) out.push_back(&d);
    if (lights) out.push_back(&*lights);
    return out;
}

Status DatasetSource::firstMismatch() const
{
    for (const Description* d : topLevels())
        if (d->json.failed()) return d->json.error();
    return ok();
}

glm::dmat4 fromOpenCv(glm::dmat4 pose)
{
    pose[1] = -pose[1], pose[2] = -pose[2];
    return pose;
}

glm::dmat4 readPose(const JsonNode& frame, const JsonNode& top)
{
    const JsonNode matrix = frame["transform_matrix"], axes = frame["camera_axes"].exists() ? frame["camera_axes"] : top["camera_axes"];
    const std::vector<JsonNode> rows = matrix.items();
    if (rows.size() != 4) {
        matrix.fail("4 rows of 4 numbers", std::to_string(rows.size()) + " rows");
        return glm::dmat4(1.0);
    }
    glm::dmat4 pose(1.0);
    for (int r = 0; r < 4; r++) {
        const std::vector<double> row = rows[size_t(r)].numbers(4);
        for (int c = 0; c < 4; c++) pose[c][r] = row[size_t(c)];
    }
    pose = rigidPose(pose, matrix);
    if (!axes.exists()) return pose;
    const std::string name = axes.string();
    if (name != "opengl" && name != "opencv") axes.fail("\"opengl\" or \"opencv\"", inQuotes(name));
    return name == "opencv" ? fromOpenCv(pose) : pose;
}

glm::dmat4 rigidPose(const glm::dmat4& given, const JsonNode& node)
{
    glm::dmat4 pose = given;
    const std::optional<Mismatch> wrong = makeRigid(pose);
    if (!wrong) return pose;
    node.fail(wrong->expected, wrong->found);
    return glm::dmat4(1.0);
}

Result<glm::dmat4> poseOf(const Matrix& m, const std::string& name)
{
    if (m.rows != 4 || m.columns != 4)
        return Error{ErrorCode::kBadInput, name + ": " + std::to_string(m.rows) + " x " + std::to_string(m.columns) + " numbers, expected a pose of 4 x 4"};
    glm::dmat4 pose;
    for (size_t r = 0; r < 4; ++r)
        for (size_t c = 0; c < 4; ++c) pose[int(c)][int(r)] = m.at(r, c);
    if (const auto wrong = makeRigid(pose)) return Error{ErrorCode::kBadInput, name + ": expected " + wrong->expected + ", found " + wrong->found};
    return pose;
}

std::optional<Mismatch> makeRigid(glm::dmat4& given)
{
    const auto isLast = [](const glm::dvec4& v) { // (0, 0, 0, w); positive tests, so NaN fails
        return std::fabs(v.x) < kRigidTolerance && std::fabs(v.y) < kRigidTolerance && std::fabs(v.z) < kRigidTolerance && std::fabs(v.w - 1) < kRigidTolerance;
    };
    const glm::dmat4 transposed = glm::transpose(given); // its columns are the rows
    if (!isLast(transposed[3])) {
        const bool swapped = isLast(given[3]);
        std::string found;
        for (int c = 0; c < 4; c++) found.append(c ? " " : "").append(brief(given[c][3]));
        return Mismatch{"last row 0 0 0 1", found + (swapped ? ", and 0 0 0 1 in the last column: the matrix is transposed" : "")};
    }
    const glm::dmat4 pose = given * (1.0 / given[3][3]);
    glm::dmat3 r(pose);
    const glm::dmat3 gram = glm::transpose(r) * r;
    const double scale2 = (gram[0][0] + gram[1][1] + gram[2][2]) / 3;
    double worst = 0, worstScaled = 0; // against the unit matrix, and against a multiple of it
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            worst = std::max(worst, std::fabs(gram[i][j] - (i == j ? 1.0 : 0.0)));
            worstScaled = std::max(worstScaled, std::fabs(gram[i][j] / scale2 - (i == j ? 1.0 : 0.0)));
        }
    if (!(worst < 2 * kRigidTolerance)) {
        if (worstScaled < 2 * kRigidTolerance)
            return Mismatch{"a rigid pose (orthonormal rotation)", "a rotation scaled by " + brief(std::sqrt(scale2)) +
                                                                       "; divide the first three columns by it, and check that positions of cameras and lights share one unit"};
        return Mismatch{"a rigid pose (orthonormal rotation)", "columns that are off by " + brief(worst) + "; remove scale and shear from the camera"};
    }
    if (!(glm::determinant(r) > 0)) return Mismatch{"a rotation with determinant +1", "a mirrored pose; one axis is flipped"};
    const glm::dvec3 position(pose[3]);
    for (int i = 0; i < 3; i++)
        if (!(std::fabs(position[i]) < kMaxCoordinate)) return Mismatch{"a camera position below 1e9", brief(position[i])};
    // Nearest rotation by Newton's iteration for the polar decomposition; quadratic, so two steps from 1e-3 are exact.
    for (int i = 0; i < 3; i++) r = r * (glm::dmat3(3.0) - glm::transpose(r) * r) * 0.5;
    given = glm::dmat4(r);
    given[3] = glm::dvec4(position, 1.0);
    return std::nullopt;
}

glm::vec3 readVec3(const JsonNode& node)
{
    const std::vector<double> v = node.numbers(3);
    for (double x : v)
        if (!(std::fabs(x) < kMaxCoordinate)) node.fail("coordinates below 1e9", brief(x));
    return {float(v[0]), float(v[1]), float(v[2])};
}

void readLightPosition(const JsonNode& node, Light& light)
{
    const std::vector<double> v = node.numbers(3);
    readVec3(node); // checks them
    setExactPosition(light, {v[0], v[1], v[2]});
}

glm::vec3 readIntensity(const JsonNode& node)
{
    std::vector<double> v = node.isNumber() ? std::vector<double>(3, node.number()) : node.numbers(3);
    for (double x : v)
        if (!(x >= 0)) node.fail("an intensity that is not negative", brief(x));
    return {float(v[0]), float(v[1]), float(v[2])};
}

std::string findImage(const DatasetSource& source, const std::string& folder, const std::string& file, const JsonNode& node, const std::string& assumed)
{
    const auto pathOf = [&](const std::string& name) { return source.pathOf((std::filesystem::path(folder) / name).string()); };
    std::vector<std::string> endings = {""};
    if (!assumed.empty()) endings.insert(endings.begin(), assumed);
    if (imageKind(file) == ImageKind::kNone)
        for (const char* usual : {".png", ".exr", ".jpg", ".jpeg", ".PNG", ".EXR", ".JPG", ".JPEG"}) endings.push_back(usual);
    for (const std::string& ending : endings)
        if (!file.empty() && source.fileExists(pathOf(file + ending))) return pathOf(file + ending);
    for (const std::string& name : {file + assumed, file}) // but for capitals in the extension
        for (const bool upper : {false, true}) {
            std::filesystem::path other(name);
            std::string extension = other.extension().string();
            for (char& c : extension) c = char(upper ? std::toupper(static_cast<unsigned char>(c)) : std::tolower(static_cast<unsigned char>(c)));
            const std::string path = pathOf(other.replace_extension(extension).string());
            if (!file.empty() && !extension.empty() && source.fileExists(path)) return path;
        }
    const std::string path = pathOf(file + (extensionOf(file).empty() ? assumed : ""));
    if (source.missing.count++ == 0) source.missing.first = node, source.missing.path = path;
    return path;
}

FileColors readFileColors(const DatasetSource& source)
{
    FileColors out;
    for (const Description* description : source.topLevels()) {
        const JsonNode top = description->json.root(), space = top["color_space"], alpha = top["alpha"];
        if (space.exists()) {
            const std::string name = space.string();
            if (name != "linear" && name != "srgb") space.fail("\"linear\" or \"srgb\"", inQuotes(name));
            const ColorSpace here = name == "srgb" ? ColorSpace::kSrgb : ColorSpace::kLinear;
            if (out.colorSpace.value_or(here) != here) space.fail("the same color_space in every split", "another one");
            out.colorSpace = here;
        }
        if (alpha.exists()) {
            const std::string name = alpha.string();
            if (name != "straight" && name != "premultiplied") alpha.fail("\"straight\" or \"premultiplied\"", inQuotes(name));
            const bool here = name == "premultiplied";
            if (out.premultiplied.value_or(here) != here) alpha.fail("the same alpha in every split", "another one");
            out.premultiplied = here;
        }
    }
    return out;
}

void SplitBuilder::add(const Camera& camera, const Light& light, std::string path) { add(camera, OlatImage{0, light, std::move(path)}, std::nullopt); }

void SplitBuilder::add(const Camera& camera, OlatImage image, const std::optional<FileCamera>& file)
{
    std::array<double, 36> key{double(camera.width), double(camera.height), camera.fx, camera.fy, camera.cx, camera.cy};
    std::copy_n(&camera.worldFromCamera[0][0], 16, key.begin() + 6);
    const FileCamera taken = file.value_or(FileCamera{camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy});
    const double more[] = {double(taken.width), double(taken.height), taken.fx, taken.fy, taken.cx, taken.cy};
    std::copy(std::begin(more), std::end(more), key.begin() + 22);
    std::copy(std::begin(taken.k), std::end(taken.k), key.begin() + 28);
    std::copy(std::begin(taken.p), std::end(taken.p), key.begin() + 34);
    const auto [it, isNew] = indexOfCamera_.try_emplace(key, uint32_t(split.cameras.size()));
    if (isNew && file && split.files.empty()) // those before are as their cameras say
        for (const Camera& c : split.cameras) split.files.push_back({c.width, c.height, c.fx, c.fy, c.cx, c.cy});
    if (isNew) split.cameras.push_back(camera);
    if (isNew && (file || !split.files.empty())) split.files.push_back(taken);
    image.camera = it->second;
    split.images.push_back(std::move(image));
}

void scaleByConvention(OlatDataset& dataset)
{
    const float intensity = conventionalIntensity(dataset.splits);
    for (OlatSplit& split : dataset.splits)
        for (OlatImage& image : split.images)
            image.light.intensity *= image.light.type == LightType::kDirectional ? std::numbers::pi_v<float> : intensity;
    dataset.warnings.push_back("no calibrated light intensity: a multiplier of 1 means a radiance of about 1 (intensity " + brief(intensity) +
                               " of a point, pi x mean light distance squared), so the asset's brightness is a convention, not a measurement");
}

float conventionalIntensity(const std::vector<OlatSplit>& splits)
{
    const Framing framing = frameCameras(splits);
    const glm::dvec3 centre = framing.met ? framing.centre : glm::dvec3(0.0); // lights of one view are mostly stated about the object
    double sum = 0;
    size_t count = 0;
    for (const OlatSplit& split : splits) {
        for (const OlatImage& image : split.images)
            if (image.light.type == LightType::kPoint) sum += glm::distance(glm::dvec3(image.light.position) + glm::dvec3(image.light.positionRest), centre), count++;
        if (count) break;
    }
    const double mean = count ? sum / double(count) : 0.0;
    return float(std::numbers::pi * (mean > 0 ? mean * mean : 1.0));
}

glm::vec3 upFromCameras(const std::vector<OlatSplit>& splits)
{
    glm::dvec3 sum(0.0);
    for (const OlatSplit& split : splits)
        for (const Camera& camera : split.cameras) sum += glm::dvec3(camera.worldFromCamera[1]);
    return sum.y > sum.z ? glm::vec3(0, 1, 0) : glm::vec3(0, 0, 1);
}

} // namespace nacre
