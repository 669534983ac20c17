// Looks for a misread convention: from geometry alone, then from at most kMaxImages images.
//
// Cameras.  The point x nearest to all optical axes solves sum_i (1 - d_i d_i^T) (x - p_i) = 0. It does not depend on the sign of the
//           axes, so cameras whose forward vector points away from it have a flipped axis. Of poses that are world-to-camera by
//           mistake the axes do not meet, or only in the cameras, which then all stand in one place; those of their inverses do meet.
// Lights.   A point light that projects into the silhouette of every sampled view lies in the visual hull: inside the object.
// Shading.  Each silhouette is inflated to a smooth blob of normals n (an ellipse as wide as its second moments). Least squares of
//           brightness on (1, n) gives a direction g_i that got brighter: the image's own vote for where its light is. The votes
//           are compared with the light directions l_i of the description under all 48 signed axis permutations P,
//           score(P) = mean_i g_i . P l_i; a frame that is right beats the others. Crude normals are enough: only the axis
//           permutation is in question.
#include "dataset/olat_dataset.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace nacre {
namespace {

constexpr size_t kMaxImages = 24;       // keeps `nacre info` fast
constexpr size_t kMinShadedImages = 6;  // fewer votes can agree by accident
constexpr size_t kMinPixels = 50;
constexpr int kMaxSamplesPerSide = 64;
// On path-traced wax, marble, metal and paint the right frame scored 0.80 to 0.94 and was the best of the 48; a wrong one lost at
// least 0.31. Half of that gap is the margin, and half of the right frame's score is enough to speak at all.
constexpr double kScoreMargin = 0.15;
constexpr double kMinBestScore = 0.4;
constexpr double kMeetingMiss = 0.1;    // of the distance; a rig aimed at an object misses its middle by less than the object is wide
constexpr float kInside = 0.5f;         // alpha of the silhouette

struct View {
    const Camera* camera;
    const OlatImage* image;
    std::shared_ptr<const Image> pixels;
};

std::string vec(const glm::vec3& v)
{
    char text[96];
    std::snprintf(text, sizeof text, "(%.3g, %.3g, %.3g)", double(v.x), double(v.y), double(v.z));
    return text;
}

/// The point nearest to all optical axes, if the axes differ enough to have one.
std::optional<glm::dvec3> commonPoint(const std::vector<glm::dmat4>& poses)
{
    glm::dmat3 a(0.0);
    glm::dvec3 b(0.0);
    for (const glm::dmat4& pose : poses) {
        const glm::dvec3 d(pose[2]);
        const glm::dmat3 m = glm::dmat3(1.0) - glm::outerProduct(d, d);
        a += m;
        b += m * glm::dvec3(pose[3]);
    }
    if (poses.size() < 2 || !(glm::determinant(a) > 1e-6 * std::pow(double(poses.size()), 3))) return std::nullopt;
    return glm::inverse(a) * b;
}

/// Whether the axes pass close to one point that is not where the cameras themselves stand.
bool axesMeet(const std::vector<glm::dmat4>& poses)
{
    const std::optional<glm::dvec3> point = commonPoint(poses);
    if (!point) return false;
    double miss2 = 0, distance2 = 0, origin2 = 0;
    for (const glm::dmat4& pose : poses) {
        const glm::dvec3 position(pose[3]), toPoint = *point - position;
        const double along = glm::dot(toPoint, glm::dvec3(pose[2]));
        miss2 += std::max(0.0, glm::dot(toPoint, toPoint) - along * along);
        distance2 += glm::dot(toPoint, toPoint);
        origin2 += glm::dot(position, position);
    }
    return miss2 < kMeetingMiss * kMeetingMiss * distance2 && distance2 > 1e-10 * origin2; // 1e-5: digits that poses have as text
}

/// True if the poses cannot be used for the other checks.
bool checkCameras(const std::vector<glm::dmat4>& poses, const std::optional<glm::dvec3>& centre, std::vector<std::string>& out)
{
    if (!centre) return false;
    std::vector<glm::dmat4> inverses;
    for (const glm::dmat4& pose : poses) inverses.push_back(glm::inverse(pose));
    if (!axesMeet(poses) && axesMeet(inverses)) {
        out.push_back("the axes of the " + std::to_string(poses.size()) +
                      " cameras meet only after inverting the poses: they are probably world-to-camera, invert them");
        return true;
    }
    size_t away = 0;
    for (const glm::dmat4& pose : poses)
        if (glm::dot(-glm::dvec3(pose[2]), *centre - glm::dvec3(pose[3])) < 0) away++;
    const std::string of = std::to_string(away) + " of " + std::to_string(poses.size());
    if (2 * away > poses.size()) {
        out.push_back(of + " cameras look away from the object: their axes are probably OpenCV's, flip y and z of the poses (columns 1 and 2)");
        return true;
    }
    if (10 * away > poses.size()) out.push_back(of + " cameras look away from the point that most of them look at: check their poses");
    return false;
}

/// Alpha at the pixel that sees `world`; 0 outside the frame and behind the camera.
float alphaAt(const View& view, const glm::dvec3& world)
{
    const glm::dvec3 p(glm::inverse(view.camera->worldFromCamera) * glm::dvec4(world, 1.0));
    if (!(p.z < 0)) return 0.0f;
    const double x = view.camera->cx + view.camera->fx * p.x / -p.z, y = view.camera->cy - view.camera->fy * p.y / -p.z;
    if (!(x >= 0 && y >= 0 && x < view.pixels->width && y < view.pixels->height)) return 0.0f;
    return view.pixels->pixel(int(x), int(y))[3];
}

void checkLightsOutside(const OlatDataset& dataset, const std::vector<View>& views, std::vector<std::string>& out)
{
    size_t inside = 0;
    const OlatImage* first = nullptr;
    for (const OlatSplit& split : dataset.splits)
        for (const OlatImage& image : split.images) {
            if (image.light.type != LightType::kPoint) continue;
            const glm::dvec3 position(image.light.position);
            if (!std::all_of(views.begin(), views.end(), [&](const View& v) { return alphaAt(v, position) > kInside; })) continue;
            if (inside++ == 0) first = &image;
        }
    if (inside > 0)
        out.push_back("light inside the object: " + std::to_string(inside) + " of the point lights, the first at " + vec(first->light.position) + " for " +
                      first->path + ": check the light frame and scale");
}

/// The world direction towards which the object of this image gets brighter; nothing if the image does not say.
std::optional<glm::dvec3> brighterDirection(const View& view)
{
    const Image& image = *view.pixels;
    const int step = 1 + (std::max(image.width, image.height) - 1) / kMaxSamplesPerSide;
    struct Sample {
        glm::dvec2 at; // pixels, y up
        double brightness;
    };
    std::vector<Sample> samples;
    std::vector<double> sorted;
    glm::dvec2 mean(0.0);
    for (int y = step / 2; y < image.height; y += step)
        for (int x = step / 2; x < image.width; x += step) {
            const float* p = image.pixel(x, y);
            if (!(p[3] > kInside)) continue;
            const double luminance = std::max(0.0, 0.2126 * double(p[0]) + 0.7152 * double(p[1]) + 0.0722 * double(p[2]));
            samples.push_back({{double(x), double(-y)}, luminance});
            sorted.push_back(luminance);
            mean += samples.back().at;
        }
    if (samples.size() < kMinPixels) return std::nullopt;
    mean /= double(samples.size());
    const auto bright = sorted.begin() + ptrdiff_t(sorted.size() * 19 / 20); // highlights must not decide
    std::nth_element(sorted.begin(), bright, sorted.end());
    if (!(*bright > 0)) return std::nullopt;

    double xx = 0, xy = 0, yy = 0;
    for (const Sample& s : samples) {
        const glm::dvec2 d = s.at - mean;
        xx += d.x * d.x, xy += d.x * d.y, yy += d.y * d.y;
    }
    // A filled ellipse has covariance (semi-axis)^2 / 4: the symmetric root of 4 * covariance maps the unit disk to it.
    const double n = double(samples.size());
    const glm::dmat2 covariance = glm::dmat2(xx, xy, xy, yy) * (4.0 / n);
    const double s = std::sqrt(std::max(glm::determinant(covariance), 0.0)), t = std::sqrt(covariance[0][0] + covariance[1][1] + 2 * s);
    const glm::dmat2 root = (covariance + glm::dmat2(s)) * (1.0 / t);
    if (!(glm::determinant(root) > 1.0)) return std::nullopt; // a line or a dot has no shape to shade
    const glm::dmat2 diskFromPixels = glm::inverse(root);

    glm::dmat4 a(1e-9);
    glm::dvec4 b(0.0);
    for (const Sample& sample : samples) {
        glm::dvec2 u = diskFromPixels * (sample.at - mean);
        const double r2 = glm::dot(u, u);
        if (r2 > 1.0) u /= std::sqrt(r2);
        const glm::dvec4 row(1.0, u.x, u.y, std::sqrt(std::max(0.0, 1.0 - r2)));
        a += glm::outerProduct(row, row);
        b += row * std::sqrt(std::min(sample.brightness / *bright, 1.0));
    }
    const glm::dvec4 fit = glm::inverse(a) * b;
    const glm::dvec3 g(fit.y, fit.z, fit.w);
    if (!(glm::length(g) > 1e-6)) return std::nullopt;
    return glm::dmat3(view.camera->worldFromCamera) * glm::normalize(g);
}

std::array<glm::dmat3, 48> signedPermutations()
{
    static constexpr int kOrders[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    std::array<glm::dmat3, 48> out; // the identity comes first
    for (int o = 0; o < 6; o++)
        for (int signs = 0; signs < 8; signs++) {
            glm::dmat3 m(0.0);
            for (int row = 0; row < 3; row++) m[kOrders[o][row]][row] = (signs >> row) & 1 ? -1.0 : 1.0;
            out[size_t(o * 8 + signs)] = m;
        }
    return out;
}

std::string axesOf(const glm::dmat3& m)
{
    std::string out = "(";
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++)
            if (m[column][row] != 0) out += std::string(row ? ", " : "") + (m[column][row] < 0 ? "-" : "") + "xyz"[column];
    return out + ")";
}

void checkShading(const std::vector<View>& views, const glm::dvec3& centre, std::vector<std::string>& out)
{
    const std::array<glm::dmat3, 48> frames = signedPermutations();
    std::array<double, 48> score{};
    size_t votes = 0;
    for (const View& view : views) {
        const Light& light = view.image->light;
        const std::optional<glm::dvec3> g = brighterDirection(view);
        if (!g) continue;
        votes++;
        for (size_t f = 0; f < frames.size(); f++) {
            const bool isPoint = light.type == LightType::kPoint;
            const glm::dvec3 l = frames[f] * glm::dvec3(isPoint ? light.position : light.directionToLight) - (isPoint ? centre : glm::dvec3(0.0));
            score[f] += glm::dot(*g, l) / std::max(glm::length(l), 1e-12);
        }
    }
    if (votes < kMinShadedImages) return;
    const size_t best = size_t(std::max_element(score.begin(), score.end()) - score.begin());
    const double scale = 1.0 / double(votes);
    if (score[best] * scale < kMinBestScore || (score[best] - score[0]) * scale < kScoreMargin) return;
    char numbers[64];
    std::snprintf(numbers, sizeof numbers, "%.2f against %.2f", score[best] * scale, score[0] * scale);
    out.push_back("shading disagrees with the light frame: the images look lit from " + axesOf(frames[best]) +
                  " of the given lights (agreement " + numbers + "); light axes are probably flipped or swapped");
}

} // namespace

Result<std::vector<std::string>> checkConventions(const OlatDataset& dataset, ImageCache& images)
{
    std::vector<std::string> out = checkAlpha(dataset, images);
    std::vector<glm::dmat4> poses;
    std::vector<std::pair<const OlatSplit*, size_t>> candidates;
    for (const OlatSplit& split : dataset.splits) {
        for (const Camera& camera : split.cameras) poses.push_back(camera.worldFromCamera);
        for (size_t i = 0; i < split.images.size(); i++)
            if (split.images[i].light.isPunctual()) candidates.emplace_back(&split, i);
    }
    const std::optional<glm::dvec3> centre = commonPoint(poses);
    if (checkCameras(poses, centre, out)) return out;

    std::vector<View> views;
    std::vector<std::string> unreadable;
    bool hasBackground = false;
    const size_t count = std::min(candidates.size(), kMaxImages);
    for (size_t k = 0; k < count; k++) {
        const auto [split, index] = candidates[k * candidates.size() / count];
        Result<std::shared_ptr<const Image>> image = images.load(*split, index);
        if (!image) { // says who needs it; here others will do
            unreadable.push_back(image.error().message);
            continue;
        }
        const OlatImage& entry = split->images[index];
        views.push_back({&split->cameras[entry.camera], &entry, *image});
        for (size_t i = 3; i < (*image)->rgba.size(); i += 4) hasBackground |= !((*image)->rgba[i] > kInside);
    }
    if (views.empty() && !unreadable.empty()) return Error{ErrorCode::kBadInput, unreadable[0] + " (and none of " + std::to_string(count) + " images looked at can be used)"};
    if (!unreadable.empty())
        out.push_back(std::to_string(unreadable.size()) + " of " + std::to_string(count) + " images looked at cannot be used; the first: " + unreadable[0]);
    if (views.empty()) return out;
    if (!hasBackground) {
        out.push_back("lights and shading not checked: the images have no alpha that tells the object from the background");
        return out;
    }
    if (views.size() >= 3) checkLightsOutside(dataset, views, out);
    checkShading(views, centre.value_or(glm::dvec3(0.0)), out);
    return out;
}

} // namespace nacre
