// Helpers that all dataset loaders share: poses, intrinsics, lights, files.
#include "dataset/loader.h"

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

glm::dmat4 readPose(const JsonNode& matrix)
{
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
    return rigidPose(pose, matrix);
}

glm::dmat4 rigidPose(const glm::dmat4& pose, const JsonNode& node)
{
    for (int c = 0; c < 4; c++)
        if (!(std::fabs(pose[c][3] - (c == 3 ? 1.0 : 0.0)) < 1e-6)) { // positive test, so NaN fails
            node.fail("last row 0 0 0 1", brief(pose[c][3]) + " in column " + std::to_string(c));
            return glm::dmat4(1.0);
        }
    glm::dmat3 r(pose);
    const glm::dmat3 gram = glm::transpose(r) * r;
    double worst = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) worst = std::max(worst, std::fabs(gram[i][j] - (i == j ? 1.0 : 0.0)));
    if (!(worst < 2 * kRigidTolerance)) {
        node.fail("a rigid pose (orthonormal rotation)", "columns that are off by " + brief(worst) + "; remove scale and shear from the camera");
        return glm::dmat4(1.0);
    }
    if (!(glm::determinant(r) > 0)) {
        node.fail("a rotation with determinant +1", "a mirrored pose; one axis is flipped");
        return glm::dmat4(1.0);
    }
    const glm::dvec3 position(pose[3]);
    for (int i = 0; i < 3; i++)
        if (!(std::fabs(position[i]) < kMaxCoordinate)) {
            node.fail("a camera position below 1e9", brief(position[i]));
            return glm::dmat4(1.0);
        }
    // Nearest rotation by Newton's iteration for the polar decomposition; quadratic, so two steps from 1e-3 are exact.
    for (int i = 0; i < 3; i++) r = r * (glm::dmat3(3.0) - glm::transpose(r) * r) * 0.5;
    glm::dmat4 out(r);
    out[3] = glm::dvec4(position, 1.0);
    return out;
}

void readIntrinsics(const JsonNode& frame, const JsonNode& top, Camera& camera)
{
    camera.cx = 0.5 * camera.width;
    camera.cy = 0.5 * camera.height;
    JsonNode source = frame["camera_angle_x"];
    for (const JsonNode* scope : {&frame, &top}) {
        const JsonNode all = (*scope)["camera_intrinsics"], focal = (*scope)["fl_x"], angle = (*scope)["camera_angle_x"];
        if (all.exists()) {
            const std::vector<double> k = all.numbers(4);
            camera.cx = k[0], camera.cy = k[1], camera.fx = k[2], camera.fy = k[3];
            source = all;
        } else if (focal.exists()) {
            camera.fx = focal.number();
            camera.fy = (*scope)["fl_y"].exists() ? (*scope)["fl_y"].number() : camera.fx;
            source = focal;
        } else if (angle.exists()) {
            const double a = angle.number();
            if (!(a > 0 && a < std::numbers::pi)) {
                angle.fail("a field of view between 0 and pi radians", brief(a));
                return;
            }
            camera.fx = camera.fy = 0.5 * camera.width / std::tan(0.5 * a);
            source = angle;
        } else {
            if (scope == &top) source.fail("camera_angle_x, fl_x or camera_intrinsics in the frame or at top level", "none of them");
            continue;
        }
        break;
    }
    for (const JsonNode* scope : {&top, &frame}) {
        if ((*scope)["cx"].exists()) camera.cx = (*scope)["cx"].number();
        if ((*scope)["cy"].exists()) camera.cy = (*scope)["cy"].number();
    }
    // 1e-3 and 1e3 image widths: from a fisheye's to a telescope's focal length.
    const double size = std::max(camera.width, camera.height);
    if (!(std::min(camera.fx, camera.fy) > 1e-3 * size && std::max(camera.fx, camera.fy) < 1e3 * size))
        source.fail("positive focal lengths of about the image size in pixels", brief(camera.fx) + ", " + brief(camera.fy));
    if (!(std::fabs(camera.cx) <= 10 * size && std::fabs(camera.cy) <= 10 * size))
        source.fail("a principal point near the image", brief(camera.cx) + ", " + brief(camera.cy));
}

glm::vec3 readVec3(const JsonNode& node)
{
    const std::vector<double> v = node.numbers(3);
    for (double x : v)
        if (!(std::fabs(x) < kMaxCoordinate)) node.fail("coordinates below 1e9", brief(x));
    return {float(v[0]), float(v[1]), float(v[2])};
}

glm::vec3 readIntensity(const JsonNode& node)
{
    std::vector<double> v = node.isNumber() ? std::vector<double>(3, node.number()) : node.numbers(3);
    for (double x : v)
        if (!(x >= 0)) node.fail("an intensity that is not negative", brief(x));
    return {float(v[0]), float(v[1]), float(v[2])};
}

std::string findImage(const DatasetSource& source, const std::string& folder, const std::string& file, const JsonNode& node)
{
    const std::string path = (std::filesystem::path(source.path) / folder / file).lexically_normal().string();
    if (file.empty() || !source.fileExists(path)) node.fail("an existing file", "no file " + inQuotes(path));
    return path;
}

Status SizeFromFirstImage::apply(const std::string& imagePath, Camera& camera)
{
    if (width_ == 0) {
        const Result<Image> size = source_.readImageSize(imagePath);
        if (!size) return size.error();
        width_ = size->width;
        height_ = size->height;
    }
    camera.width = width_;
    camera.height = height_;
    return ok();
}

void SplitBuilder::add(const Camera& camera, const Light& light, std::string path)
{
    std::array<double, 22> key{double(camera.width), double(camera.height), camera.fx, camera.fy, camera.cx, camera.cy};
    std::copy_n(&camera.worldFromCamera[0][0], 16, key.begin() + 6);
    const auto [it, isNew] = indexOfCamera_.try_emplace(key, uint32_t(split.cameras.size()));
    if (isNew) split.cameras.push_back(camera);
    split.images.push_back({it->second, light, std::move(path)});
}

float conventionalIntensity(const std::vector<OlatSplit>& splits)
{
    double sum = 0;
    size_t count = 0;
    for (const OlatSplit& split : splits) {
        for (const OlatImage& image : split.images) sum += glm::length(glm::dvec3(image.light.position)), count++;
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
