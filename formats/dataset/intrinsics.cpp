// Image sizes, focal lengths, principal points and lens distortion: reading what a description says, and what in it cannot be meant.
#include "dataset/develop.h"
#include "dataset/loader.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

namespace nacre {
namespace {

constexpr double kSameFocal = 0.01;      // two keys that say the same differ by the digits they are written with
constexpr double kNoDistortion = 1e-6;   // a coefficient that moves no pixel: f k r^3 stays below 1/100 of a pixel
constexpr double kShortestFocal = 0.1;   // of the image's longer side: a field of view of 157 degrees
constexpr double kLongestFocal = 1e3;    // of it, too: a telescope's
constexpr double kUsualFocal = 0.25;     // 127 degrees: as far as lenses go that draw straight lines straight
constexpr double kOffCentre = 0.15;      // of the image: lenses and crops stay well below in practice
constexpr double kMostUnseen = 0.3;      // of the picture; the pincushion of a lens that magnifies the edge by a tenth loses 0.17
constexpr double kSquare = 1.25;         // fx / fy of pixels that are taken for square; anamorphic video reaches 1.46 and gets a word

std::string brief(double x)
{
    char text[32];
    std::snprintf(text, sizeof text, "%.4g", x);
    return text;
}

bool isZero(double coefficient) { return std::fabs(coefficient) < kNoDistortion; }

/// What a description says of the lens, top level and frame together.
struct Lens {
    double k[6] = {}, p[2] = {};
    bool isPinhole() const { return std::all_of(std::begin(k), std::end(k), isZero) && std::all_of(std::begin(p), std::end(p), isZero); }
};

constexpr CameraModel kCameraModels[] = {{"SIMPLE_PINHOLE", 0, 3, 3}, {"PINHOLE", 1, 4, 4}, {"SIMPLE_RADIAL", 2, 4, 3},
                                         {"RADIAL", 3, 5, 3},         {"OPENCV", 4, 8, 4},  {"FULL_OPENCV", 6, 12, 4}};

std::string pixels(int width, int height) { return std::to_string(width) + " x " + std::to_string(height); }

double focalFromAngle(double angle, int pixelCount) { return 0.5 * pixelCount / std::tan(0.5 * angle); }

/// A field of view in radians; 0 after a mismatch.
double readAngle(const JsonNode& node)
{
    const double a = node.number();
    if (a > 0 && a < std::numbers::pi) return a;
    node.fail("a field of view between 0 and pi radians", brief(a) + (a >= std::numbers::pi && a < 180 ? "; is it in degrees?" : ""));
    return 0;
}

void refuse(const JsonNode& node, const std::string& found)
{
    node.fail("a lens of the models k1..k6, p1, p2 of OpenCV", found + "; undistort the images to a pinhole camera first", ErrorCode::kUnsupported);
}

double readCoefficient(const JsonNode& node)
{
    constexpr double kLargest = 1e6; // those of the rational model are large together, and still far below
    return node.number(kLargest);
}

/// Coefficients of a list, in the order that its name and length stand for.
void readList(const JsonNode& node, std::span<double* const> order)
{
    const std::vector<JsonNode> all = node.items();
    for (double* c : order) *c = 0;
    for (size_t i = 0; i < all.size(); ++i) {
        const double c = readCoefficient(all[i]);
        if (i < order.size()) *order[i] = c;
        else if (!isZero(c)) refuse(node, "lens distortion " + brief(c) + " as number " + std::to_string(i + 1) + " of the list");
    }
}

/// What a scope says of the lens, over what `lens` holds from a wider one.
void readLens(const JsonNode& scope, Lens& lens)
{
    double *k = lens.k, *p = lens.p;
    double* const opencv[] = {&k[0], &k[1], &p[0], &p[1], &k[2], &k[3], &k[4], &k[5]};
    double* const nerfstudio[] = {&k[0], &k[1], &k[2], &k[3], &p[0], &p[1]}; // the one list of six
    double* const radial[] = {&k[0], &k[1], &k[2]};
    if (scope["camera"].isObject()) readLens(scope["camera"], lens);
    for (const char* key : {"distortion_params", "distortion", "distortion_coefficients", "dist_coeffs", "distCoeffs", "D"}) {
        const JsonNode all = scope[key];
        if (all.isObject()) readLens(all, lens);
        if (!all.isArray()) continue;
        const bool isNerfstudio = all.items().size() == 6;
        readList(all, isNerfstudio ? std::span<double* const>(nerfstudio) : opencv);
        if (isNerfstudio && !isZero(k[3])) refuse(all, "lens distortion " + brief(k[3]) + " as the fourth radial term");
    }
    if (scope["radial_distortion"].isArray()) readList(scope["radial_distortion"], radial);
    if (scope["tangential_distortion"].isArray()) readList(scope["tangential_distortion"], std::span(opencv).subspan(2, 2));

    std::string model;
    for (const char* key : {"camera_model", "camera_type"}) {
        const JsonNode node = scope[key];
        if (!node.isString()) continue;
        model = node.string();
        for (char& c : model) c = char(std::toupper(static_cast<unsigned char>(c)));
        const char* const others[] = {"PERSPECTIVE", "PERSP", "BROWN", ""}; // names of the same by programs that write the coefficients by name
        if (!findCameraModel(model) && std::none_of(std::begin(others), std::end(others), [&](const char* o) { return model == o; }))
            refuse(node, "the camera model " + inQuotes(node.string()));
    }
    if (const JsonNode parameters = scope["camera_params"]; parameters.isArray()) { // as COLMAP has them, focal lengths first
        const std::vector<JsonNode> all = parameters.items();
        const CameraModel* known = findCameraModel(model);
        if (known && all.size() == known->count) {
            std::vector<double> numbers;
            for (size_t i = 0; i < all.size(); ++i) numbers.push_back(i < known->lensAt ? 0.0 : readCoefficient(all[i]));
            setLens(*known, numbers, k, p);
        } else {
            for (size_t i = 4; i < all.size(); ++i)
                if (all[i].isNumber() && !isZero(all[i].number()))
                    parameters.fail(known ? std::to_string(known->count) + " numbers of " + model : "camera_model beside camera_params that has a lens",
                                    known ? std::to_string(all.size()) : "none of COLMAP's", ErrorCode::kUnsupported);
        }
    }

    for (size_t i = 0; i < 6; ++i) {
        const char* const keys[] = {"k1", "k2", "k3", "k4", "k5", "k6"};
        if (const JsonNode node = scope[keys[i]]; node.exists()) k[i] = readCoefficient(node);
    }
    for (size_t i = 0; i < 2; ++i)
        if (const JsonNode node = scope[i ? "p2" : "p1"]; node.exists()) p[i] = readCoefficient(node);
    // With two meanings: the last term of a polynomial in some programs, the denominator in OpenCV, which has all three of them.
    if (const JsonNode k4 = scope["k4"]; k4.exists() && !isZero(k[3]) && !scope["k5"].exists() && !scope["k6"].exists())
        k4.fail("k5 and k6 beside k4, which is of OpenCV's rational model", "k4 " + brief(k[3]) + " alone; undistort the images, or write k5 and k6 as 0 if that is meant",
                ErrorCode::kUnsupported);
    for (const char* key : {"p3", "p4", "s1", "s2", "s3", "s4"})
        if (const JsonNode node = scope[key]; node.exists() && !isZero(node.number())) refuse(node, "lens distortion " + brief(node.number()));
    for (const char* key : {"radial", "kdist"})
        if (scope[key].isArray() || scope[key].isObject())
            for (const JsonNode& c : scope[key].items())
                if (c.isNumber() && !isZero(c.number())) refuse(c, "lens distortion " + brief(c.number()));
    if (scope["is_fisheye"].exists() && scope["is_fisheye"].boolean()) refuse(scope["is_fisheye"], "a fisheye lens");
    if ((model == "PINHOLE" || model == "SIMPLE_PINHOLE") && !lens.isPinhole()) // which of the two is meant?
        (scope["camera_model"].isString() ? scope["camera_model"] : scope["camera_type"]).fail("a camera model with a lens, or no distortion", inQuotes(model) + " beside lens distortion");
}

/// `camera_intrinsics`, in the order of the convention and of no other.
void readMatrix(const JsonNode& node, Camera& camera)
{
    const std::vector<double> k = node.numbers(4);
    camera.cx = k[0], camera.cy = k[1], camera.fx = k[2], camera.fy = k[3];
    const double w = camera.width, h = camera.height;
    const double offX = std::fabs(k[0] / w - 0.5), offY = std::fabs(k[1] / h - 0.5), swapped = std::max(std::fabs(k[2] / w - 0.5), std::fabs(k[3] / h - 0.5));
    // Half the image is where a principal point is, and a rare focal length: 90 degrees.
    if (swapped < 0.05 && std::min(offX, offY) > 0.03 + 2 * swapped)
        node.fail("[cx, cy, fx, fy] in pixels", std::string("[").append(brief(k[0])) + ", " + brief(k[1]) + ", " + brief(k[2]) + ", " + brief(k[3]) + "] for an image of " +
                                                    pixels(camera.width, camera.height) + ", which looks like [fx, fy, cx, cy]; change the order");
}

/// Two keys of one scope for one focal length.
void compare(const JsonNode& node, double here, double there, const char* other)
{
    if (!(std::fabs(here - there) <= kSameFocal * there))
        node.fail("the same focal length as " + std::string(other) + " (" + brief(there) + " pixels)", brief(here) + "; remove the key that is wrong");
}

/// True if the scope has focal lengths. `source` becomes the key that gave them.
bool readFocal(const JsonNode& scope, Camera& camera, JsonNode& source)
{
    const JsonNode all = scope["camera_intrinsics"], focalX = scope["fl_x"], focalY = scope["fl_y"], angleX = scope["camera_angle_x"],
                   angleY = scope["camera_angle_y"];
    if (all.exists()) {
        readMatrix(all, camera);
        source = all;
        return true;
    }
    if (focalX.exists()) {
        source = focalX;
        camera.fx = focalX.number();
        if (angleX.exists())
            if (const double a = readAngle(angleX); a > 0) compare(focalX, camera.fx, focalFromAngle(a, camera.width), "camera_angle_x");
    } else if (angleX.exists()) {
        source = angleX;
        const double a = readAngle(angleX);
        if (!(a > 0)) return true;
        camera.fx = focalFromAngle(a, camera.width);
    }
    bool hasY = true;
    if (focalY.exists()) {
        camera.fy = focalY.number();
        if (angleY.exists())
            if (const double a = readAngle(angleY); a > 0) compare(focalY, camera.fy, focalFromAngle(a, camera.height), "camera_angle_y");
    } else if (angleY.exists()) {
        const double a = readAngle(angleY);
        if (!(a > 0)) return true;
        camera.fy = focalFromAngle(a, camera.height);
    } else {
        hasY = false;
    }
    const bool hasX = focalX.exists() || angleX.exists();
    if (!hasX && hasY) source = focalY.exists() ? focalY : angleY;
    if (!hasX) camera.fx = camera.fy; // square pixels
    if (!hasY) camera.fy = camera.fx;
    return hasX || hasY;
}

} // namespace

std::optional<Mismatch> cameraFault(const Camera& camera)
{
    const double size = std::max(camera.width, camera.height);
    const std::string image = " for an image of " + pixels(camera.width, camera.height);
    if (!(size >= 1 && size <= 65536 && std::min(camera.width, camera.height) >= 1)) return Mismatch{"an image size from 1 to 65536", pixels(camera.width, camera.height)};
    const auto isFocal = [&](double f) { return f > kShortestFocal * size && f < kLongestFocal * size; };
    if (!isFocal(camera.fx) || !isFocal(camera.fy))
        return Mismatch{"positive focal lengths of about the image size in pixels", brief(camera.fx) + ", " + brief(camera.fy) + image};
    if (!(std::fabs(camera.cx) <= 10 * size && std::fabs(camera.cy) <= 10 * size))
        return Mismatch{"a principal point near the image", brief(camera.cx) + ", " + brief(camera.cy) + image};
    return std::nullopt;
}

std::span<const CameraModel> cameraModels() { return kCameraModels; }

const CameraModel* findCameraModel(const std::string& name)
{
    for (const CameraModel& model : kCameraModels)
        if (name == model.name) return &model;
    return nullptr;
}

void setLens(const CameraModel& model, std::span<const double> parameters, double k[6], double p[2])
{
    double* const order[] = {&k[0], &k[1], &p[0], &p[1], &k[2], &k[3], &k[4], &k[5]};
    std::fill_n(k, 6, 0.0), std::fill_n(p, 2, 0.0);
    for (size_t i = model.lensAt; i < std::min(parameters.size(), size_t(model.count)); ++i) *order[i - model.lensAt] = parameters[i];
}

std::optional<FileCamera> fileCamera(const Camera& camera, const double k[6], const double p[2])
{
    FileCamera file{camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy};
    std::copy_n(k, 6, file.k), std::copy_n(p, 2, file.p);
    if (std::all_of(k, k + 6, isZero) && std::all_of(p, p + 2, isZero)) return std::nullopt;
    return file;
}

std::optional<FileCamera> readIntrinsics(const JsonNode& frame, const JsonNode& top, Camera& camera)
{
    camera.cx = 0.5 * camera.width;
    camera.cy = 0.5 * camera.height;
    JsonNode source = frame["camera_angle_x"];
    if (!readFocal(frame, camera, source) && !readFocal(top, camera, source))
        source.fail("camera_angle_x, fl_x or camera_intrinsics in the frame or at top level", "none of them");
    for (const JsonNode* scope : {&top, &frame}) {
        if ((*scope)["cx"].exists()) camera.cx = (*scope)["cx"].number();
        if ((*scope)["cy"].exists()) camera.cy = (*scope)["cy"].number();
    }
    const double size = std::max(camera.width, camera.height), shortest = std::min(camera.fx, camera.fy);
    if (!(shortest > kShortestFocal * size && std::max(camera.fx, camera.fy) < kLongestFocal * size))
        source.fail("positive focal lengths of about the image size in pixels",
                    brief(camera.fx) + ", " + brief(camera.fy) + " for an image of " + pixels(camera.width, camera.height) +
                        (shortest > 0 && shortest < kShortestFocal * size
                             ? "; if they are normalised, multiply them by the width, if in millimetres, by pixels per millimetre" : ""));
    if (!(std::fabs(camera.cx) <= 10 * size && std::fabs(camera.cy) <= 10 * size))
        source.fail("a principal point near the image", brief(camera.cx) + ", " + brief(camera.cy));
    if (size > 16 && camera.cx > 0 && camera.cx < 1 && camera.cy > 0 && camera.cy < 1)
        source.fail("a principal point in pixels", brief(camera.cx) + ", " + brief(camera.cy) + ", which look normalised; multiply them by width and height");
    Lens lens;
    readLens(top, lens), readLens(frame, lens);
    return fileCamera(camera, lens.k, lens.p);
}

bool readSize(const DatasetSource& source, const JsonNode& frame, const JsonNode& top, const std::string& imagePath, Camera& camera)
{
    const auto read = [&](const char* name, const char* shortName, int& size) {
        size = 0;
        for (const JsonNode* scope : {&frame, &top}) {
            const JsonNode node = (*scope)[name], other = (*scope)[shortName];
            if (!node.exists() && !other.exists()) continue;
            size = (node.exists() ? node : other).integer(1, 65536);
            if (node.exists() && other.exists() && other.integer(1, 65536) != size)
                other.fail(std::to_string(size) + " like " + name, std::to_string(other.integer(1, 65536)));
            return;
        }
    };
    read("width", "w", camera.width);
    read("height", "h", camera.height);
    if (camera.width > 0 && camera.height > 0) return true;
    const Result<Image> size = source.readImageSize(imagePath);
    if (size) source.lastSize = {size->width, size->height}; // else the size of the image before: it is not this file's turn to be refused
    camera.width = source.lastSize[0], camera.height = source.lastSize[1];
    if (camera.width == 0 && source.missing.count == 0) frame.fail("an image that can be read", size.error().message);
    return camera.width > 0;
}

Status checkSizes(const DatasetSource& source, const OlatDataset& dataset)
{
    constexpr size_t kMaxHeaders = 64; // of a split, evenly picked
    for (const OlatSplit& split : dataset.splits) {
        size_t read = 0, wrong = 0;
        std::string first;
        const size_t count = std::min(split.images.size(), kMaxHeaders);
        for (size_t k = 0; k < count; ++k) {
            const OlatImage& image = split.images[k * split.images.size() / count];
            const Camera& camera = split.cameras[image.camera];
            const Result<Image> size = source.readImageSize(image.path);
            if (!size) continue;
            ++read;
            if (size->width == camera.width && size->height == camera.height) continue;
            if (wrong++ == 0)
                first = "image " + inQuotes(image.path) + " is " + pixels(size->width, size->height) + " pixels, its description says " +
                        pixels(camera.width, camera.height);
        }
        if (2 * wrong > read) // a few odd ones are told apart when they are loaded
            return Error{ErrorCode::kBadInput, first + " (so do " + std::to_string(wrong) + " of " + std::to_string(read) + " looked at in split " +
                                                   inQuotes(split.name) + "); give the size of the files, and scale focal lengths and principal point to it"};
    }
    return ok();
}

/// Of what the pinhole camera sees: what the file does not show, or the lens bends back.
static double shareUnseen(const FileCamera& file, const Camera& camera)
{
    constexpr int kSide = 16;
    int unseen = 0;
    for (int k = 0; k < kSide * kSide; ++k) {
        const glm::dvec2 at = positionInFile(file, camera, (k % kSide + 0.5) / kSide * camera.width, (k / kSide + 0.5) / kSide * camera.height);
        unseen += !(at.x >= 0 && at.y >= 0 && at.x <= file.width && at.y <= file.height);
    }
    return double(unseen) / (kSide * kSide);
}

void checkIntrinsics(OlatDataset& dataset)
{
    size_t off = 0, wide = 0, oblong = 0, bent = 0, count = 0;
    std::string offFirst, wideFirst, oblongFirst, bentFirst;
    for (const OlatSplit& split : dataset.splits)
        for (size_t i = 0; i < split.cameras.size(); ++i) {
            const Camera& c = split.cameras[i];
            const double unseen = split.files.empty() ? 0 : shareUnseen(split.files[i], c);
            if (unseen > kMostUnseen && bent++ == 0)
                bentFirst = brief(100 * unseen) + " % of the picture: those pixels count nowhere; check k1 ... k6, p1, p2 (of normalised coordinates?) and the focal length";
            ++count;
            const double x = c.cx / c.width, y = c.cy / c.height, size = std::max(c.width, c.height);
            if ((std::fabs(x - 0.5) > kOffCentre || std::fabs(y - 0.5) > kOffCentre) && off++ == 0) {
                const bool outside = !(x > 0 && x < 1 && y > 0 && y < 1);
                offFirst = std::string("(").append(brief(c.cx)) + ", " + brief(c.cy) + ") " + (outside ? "outside" : "far from the centre of") + " an image of " + pixels(c.width, c.height);
                if (std::fabs(x - y) < 0.02) // both coordinates are off by one factor
                    offFirst += ": these look like intrinsics of images of about " + pixels(int(std::lround(2 * c.cx)), int(std::lround(2 * c.cy))) +
                                ", scale focal lengths and principal point";
                else offFirst += ": right for cropped images only; look at order and unit";
            }
            if (std::min(c.fx, c.fy) < kUsualFocal * size && wide++ == 0)
                wideFirst = brief(std::min(c.fx, c.fy)) + " pixels for an image of " + pixels(c.width, c.height) + ": is it in millimetres, or of a smaller image?";
            if (std::max(c.fx, c.fy) > kSquare * std::min(c.fx, c.fy) && oblong++ == 0)
                oblongFirst = "fx " + brief(c.fx) + " and fy " + brief(c.fy) + ": pixels are not square; right for anamorphic images only";
        }
    const auto warn = [&](size_t n, const std::string& what, const std::string& first) {
        if (n) dataset.warnings.push_back(std::to_string(n) + " of " + std::to_string(count) + " cameras have " + what + first);
    };
    warn(off, "a principal point at ", offFirst);
    warn(wide, "a very short focal length, ", wideFirst);
    warn(oblong, "", oblongFirst);
    warn(bent, "a lens that does not show ", bentFirst);
}

} // namespace nacre
