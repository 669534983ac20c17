// The two forms of COLMAP's models.
//
//   cameras.txt  a line per camera: ID MODEL WIDTH HEIGHT parameters
//   images.txt   two lines per image: ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then the points that it sees (x y id ...), which may be none
//   cameras.bin  u64 count, then: u32 id, i32 model, u64 width, u64 height, f64 parameters[of the model]
//   images.bin   u64 count, then: u32 id, f64 q[4], f64 t[3], u32 camera, name with a NUL behind it, u64 points, 24 bytes for each
// q and t take the world to the camera, whose axes are OpenCV's. Lines that begin with # are comments.
#include "dataset/colmap_model.h"

#include "base/byte_stream.h"
#include "interchange/text_lines.h"

#include <glm/gtc/quaternion.hpp>

#include <array>

namespace nacre {
namespace {

struct OtherModel {
    const char* name;
    int id;
    size_t count;
};
constexpr OtherModel kOtherModels[] = {{"OPENCV_FISHEYE", 5, 8},        {"FOV", 7, 5},
                                       {"SIMPLE_RADIAL_FISHEYE", 8, 4}, {"RADIAL_FISHEYE", 9, 5},
                                       {"THIN_PRISM_FISHEYE", 10, 12},  {"RAD_TAN_THIN_PRISM_FISHEYE", 11, 16}};

Error bad(const std::string& where, const std::string& what) { return {ErrorCode::kBadInput, where + ": " + what}; }

/// Nothing if q is no rotation.
std::optional<Mismatch> setPose(ColmapImage& image, const double q[4], const double t[3])
{
    const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(std::fabs(length - 1) < 1e-2)) return Mismatch{"a quaternion of length 1", numberText(length)};
    const glm::dmat3 worldFromCamera = glm::transpose(glm::mat3_cast(glm::dquat(q[0] / length, q[1] / length, q[2] / length, q[3] / length)));
    glm::dmat4 pose(worldFromCamera);
    pose[3] = glm::dvec4(worldFromCamera * -glm::dvec3(t[0], t[1], t[2]), 1.0);
    image.worldFromCamera = fromOpenCv(pose);
    return makeRigid(image.worldFromCamera);
}

Status addCamera(ColmapModel& model, uint32_t id, ColmapCamera camera, uint64_t width, uint64_t height, const std::string& where)
{
    if (width < 1 || width > 65536 || height < 1 || height > 65536)
        return bad(where, "a camera of " + std::to_string(width) + " x " + std::to_string(height) + " pixels, expected 1 to 65536");
    camera.width = int(width), camera.height = int(height);
    if (!model.cameras.emplace(id, std::move(camera)).second) return bad(where, "camera " + std::to_string(id) + " is there twice");
    return ok();
}

Status checkImages(const ColmapModel& model, const std::string& imagesName)
{
    if (model.images.empty()) return bad(imagesName, "no images; expected those that COLMAP registered");
    for (const ColmapImage& image : model.images)
        if (!model.cameras.count(image.camera)) return bad(imagesName, "image " + inQuotes(image.name) + " has camera " + std::to_string(image.camera) + ", which cameras lack");
    return ok();
}

/// The lines of a file, without comments and empty ones.
struct Entries {
    std::string_view text;
    const std::string& name;
    size_t number = 0; // of the line
    bool next(std::string_view& line)
    {
        while (nextLine(text, line)) {
            ++number;
            if (!trimmed(line).empty() && !trimmed(line).starts_with('#')) return true;
        }
        return false;
    }
    void skipLine()
    {
        std::string_view line;
        nextLine(text, line), ++number;
    }
    std::string where() const { return name + ": line " + std::to_string(number); }
};

Status readCamerasText(std::span<const std::byte> bytes, const std::string& name, ColmapModel& model)
{
    Entries entries{asText(bytes), name};
    for (std::string_view line; entries.next(line);) {
        const std::string where = entries.where();
        const auto id = integerOf<uint32_t>(nextWord(line));
        ColmapCamera camera;
        camera.modelName = oneLine(nextWord(line), 64);
        const auto width = integerOf<uint64_t>(nextWord(line)), height = integerOf<uint64_t>(nextWord(line));
        const auto parameters = numbersOf(line);
        if (!id || !width || !height || !parameters) return bad(where, "expected a camera: number, model, width, height, parameters");
        camera.model = findCameraModel(camera.modelName);
        if (camera.model && parameters->size() != camera.model->count)
            return bad(where, std::to_string(parameters->size()) + " parameters, expected " + std::to_string(camera.model->count) + " of " + camera.modelName);
        camera.parameters = *parameters;
        if (Status s = addCamera(model, *id, std::move(camera), *width, *height, where); !s) return s;
    }
    return ok();
}

Status readImagesText(std::span<const std::byte> bytes, const std::string& name, ColmapModel& model)
{
    Entries entries{asText(bytes), name};
    for (std::string_view line; entries.next(line);) {
        const std::string where = entries.where();
        ColmapImage image;
        const auto id = integerOf<uint32_t>(nextWord(line));
        double v[7];
        bool isGood = id.has_value();
        for (double& x : v) {
            const std::optional<double> read = numberOf(nextWord(line));
            isGood = isGood && read;
            x = read.value_or(0);
        }
        const auto camera = integerOf<uint32_t>(nextWord(line));
        image.name = std::string(trimmed(line));
        if (!isGood || !camera || image.name.empty()) return bad(where, "expected an image: number, quaternion, translation, camera, name");
        if (image.name.size() > 4096) return bad(where, "a name of " + std::to_string(image.name.size()) + " bytes");
        image.camera = *camera;
        if (const auto wrong = setPose(image, v, v + 4)) return bad(where, "expected " + wrong->expected + ", found " + wrong->found);
        model.images.push_back(std::move(image));
        entries.skipLine(); // the points, an empty line among them
    }
    return checkImages(model, name);
}

Status readCamerasBinary(std::span<const std::byte> bytes, const std::string& name, ColmapModel& model)
{
    ByteReader in(bytes);
    const uint64_t count = in.value<uint64_t>();
    for (uint64_t i = 0; i < count && !in.failed; ++i) {
        const std::string where = name + ": camera " + std::to_string(i + 1) + " of " + std::to_string(count);
        const auto id = in.value<uint32_t>();
        const auto modelId = in.value<int32_t>();
        const auto width = in.value<uint64_t>(), height = in.value<uint64_t>();
        if (in.failed) break;
        ColmapCamera camera;
        size_t parameters = 0;
        for (const CameraModel& m : cameraModels())
            if (m.id == modelId) camera.model = &m, camera.modelName = m.name, parameters = m.count;
        for (const OtherModel& m : kOtherModels)
            if (m.id == modelId) camera.modelName = m.name, parameters = m.count;
        if (parameters == 0) return bad(where, "camera model " + std::to_string(modelId) + ", which no version of COLMAP that is known has");
        for (size_t k = 0; k < parameters; ++k) camera.parameters.push_back(in.value<double>());
        if (in.failed) break;
        if (Status s = addCamera(model, id, std::move(camera), width, height, where); !s) return s;
    }
    if (in.failed) return bad(name, "cut off: it says " + std::to_string(count) + " cameras and has " + std::to_string(model.cameras.size()));
    return ok();
}

Status readImagesBinary(std::span<const std::byte> bytes, const std::string& name, ColmapModel& model)
{
    constexpr size_t kPointBytes = 24, kLongestName = 4096;
    ByteReader in(bytes);
    const uint64_t count = in.value<uint64_t>();
    for (uint64_t i = 0; i < count && !in.failed; ++i) {
        const std::string where = name + ": image " + std::to_string(i + 1) + " of " + std::to_string(count);
        ColmapImage image;
        in.value<uint32_t>(); // its number
        const auto v = in.value<std::array<double, 7>>();
        image.camera = in.value<uint32_t>();
        while (const char c = in.value<char>()) {
            image.name.push_back(c);
            if (image.name.size() > kLongestName) return bad(where, "a name without an end");
        }
        if (!in.failed && image.name.empty()) return bad(where, "an empty name");
        const auto points = in.value<uint64_t>();
        in.failed = in.failed || points > in.remaining() / kPointBytes;
        if (in.failed) break;
        in = ByteReader(bytes.last(in.remaining() - size_t(points) * kPointBytes));
        if (const auto wrong = setPose(image, v.data(), v.data() + 4)) return bad(where, "expected " + wrong->expected + ", found " + wrong->found);
        model.images.push_back(std::move(image));
    }
    if (in.failed) return bad(name, "cut off: it says " + std::to_string(count) + " images and has " + std::to_string(model.images.size()));
    return checkImages(model, name);
}

} // namespace

Result<ColmapModel> readColmapText(std::span<const std::byte> cameras, std::span<const std::byte> images, const std::string& camerasName, const std::string& imagesName)
{
    ColmapModel model;
    if (Status s = readCamerasText(cameras, camerasName, model); !s) return s.error();
    if (Status s = readImagesText(images, imagesName, model); !s) return s.error();
    return model;
}

Result<ColmapModel> readColmapBinary(std::span<const std::byte> cameras, std::span<const std::byte> images, const std::string& camerasName, const std::string& imagesName)
{
    ColmapModel model;
    if (Status s = readCamerasBinary(cameras, camerasName, model); !s) return s.error();
    if (Status s = readImagesBinary(images, imagesName, model); !s) return s.error();
    return model;
}

} // namespace nacre
