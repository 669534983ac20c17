#include "splat/stereo.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace nacre {
namespace {

constexpr int kReach = 2, kSide = 2 * kReach + 1, kPatch = kSide * kSide; // pixels compared
constexpr int kStride = 2;               // of the pixels that are looked at
constexpr int kDepths = 80;
constexpr size_t kNeighbours = 4, kAgree = 2; // views beside each, and how many of them have to agree: others may not see the point
constexpr double kLeastAngle = 0.06, kBestAngle = 0.25, kMostAngle = 0.7; // between views of the middle
constexpr float kAlike = 0.8f;           // correlation
constexpr float kContrast = 0.02f;       // standard deviation that is more than noise
constexpr float kBehind = 3.0f;          // radii
constexpr float kCell = 0.05f;           // radii: so near are points that confirm each other

using Patch = std::array<float, kPatch>;

/// Mean 0, length 1; false if there is nothing to see.
bool normalise(Patch& p)
{
    float mean = 0, squares = 0;
    for (float x : p) mean += x / kPatch;
    for (float& x : p) x -= mean, squares += x * x;
    if (!(squares > kContrast * kContrast * kPatch)) return false;
    const float scale = 1 / std::sqrt(squares);
    for (float& x : p) x *= scale;
    return true;
}

struct Projector {
    glm::dmat4 cameraFromWorld;
    const StereoView* view;
    bool project(const glm::dvec3& world, double& x, double& y) const
    {
        const glm::dvec3 p(cameraFromWorld * glm::dvec4(world, 1.0));
        if (!(p.z < -1e-6)) return false;
        const Camera& c = view->camera;
        x = c.cx + c.fx * p.x / -p.z, y = c.cy - c.fy * p.y / -p.z;
        return true;
    }
    bool sample(double x, double y, float& out) const
    {
        const Camera& c = view->camera;
        x -= 0.5, y -= 0.5;
        if (!(x >= 0 && y >= 0 && x < c.width - 1 && y < c.height - 1)) return false;
        const int i = int(x), j = int(y);
        const float u = float(x - i), v = float(y - j);
        const float* p = &view->luma[size_t(j) * size_t(c.width) + size_t(i)];
        if (std::min({p[0], p[1], p[c.width], p[c.width + 1]}) < 0) return false;
        out = (1 - v) * ((1 - u) * p[0] + u * p[1]) + v * ((1 - u) * p[c.width] + u * p[c.width + 1]);
        return true;
    }
};

std::vector<size_t> neighboursOf(size_t view, std::span<const StereoView> views, const glm::dvec3& center)
{
    const auto direction = [&](size_t i) { return glm::normalize(views[i].camera.position() - center); };
    std::vector<std::pair<double, size_t>> found;
    for (size_t i = 0; i < views.size(); ++i) {
        const double angle = std::acos(std::clamp(glm::dot(direction(i), direction(view)), -1.0, 1.0));
        if (i != view && angle > kLeastAngle && angle < kMostAngle) found.push_back({std::abs(std::log(angle / kBestAngle)), i});
    }
    std::sort(found.begin(), found.end());
    if (found.size() > kNeighbours) found.resize(kNeighbours);
    std::vector<size_t> out;
    for (const auto& [cost, i] : found) out.push_back(i);
    return out;
}

/// How alike the patch around a pixel is to what the neighbours see if it lies `depth` in front of the camera, facing it.
float likeness(const StereoView& view, const std::vector<Projector>& neighbours, const Patch& patch, int x, int y, double depth)
{
    const Camera& c = view.camera;
    const auto at = [&](double px, double py) {
        return glm::dvec3(c.worldFromCamera * glm::dvec4((px - c.cx) / c.fx * depth, (c.cy - py) / c.fy * depth, -depth, 1.0));
    };
    const glm::dvec3 middle = at(x + 0.5, y + 0.5), right = at(x + 1.5, y + 0.5), down = at(x + 0.5, y + 1.5);
    std::vector<float> alike;
    for (const Projector& n : neighbours) {
        double u[3], v[3];
        if (!n.project(middle, u[0], v[0]) || !n.project(right, u[1], v[1]) || !n.project(down, u[2], v[2])) continue;
        Patch other;
        bool whole = true;
        for (int j = -kReach, k = 0; j <= kReach && whole; ++j)
            for (int i = -kReach; i <= kReach && whole; ++i, ++k)
                whole = n.sample(u[0] + i * (u[1] - u[0]) + j * (u[2] - u[0]), v[0] + i * (v[1] - v[0]) + j * (v[2] - v[0]), other[size_t(k)]);
        if (!whole || !normalise(other)) continue;
        float sum = 0;
        for (size_t k = 0; k < kPatch; ++k) sum += patch[k] * other[k];
        alike.push_back(sum);
    }
    if (alike.size() < kAgree) return -1;
    std::nth_element(alike.begin(), alike.begin() + (kAgree - 1), alike.end(), std::greater<>());
    return alike[kAgree - 1];
}

std::vector<glm::vec3> pointsOf(size_t index, std::span<const StereoView> views, const glm::dvec3& center, double radius)
{
    const StereoView& view = views[index];
    const Camera& c = view.camera;
    std::vector<Projector> neighbours;
    for (size_t i : neighboursOf(index, views, center)) neighbours.push_back({glm::inverse(views[i].camera.worldFromCamera), &views[i]});
    std::vector<glm::vec3> points;
    if (neighbours.size() < kAgree) return points;
    const double middle = glm::dot(center - c.position(), -glm::dvec3(c.worldFromCamera[2]));
    const double nearest = std::max(middle - 1.1 * radius, 0.05 * std::abs(middle)), farthest = std::max(middle, nearest) + kBehind * radius;
    for (int y = kReach; y + kReach < c.height; y += kStride)
        for (int x = kReach; x + kReach < c.width; x += kStride) {
            Patch patch;
            bool known = true;
            for (int j = -kReach, k = 0; j <= kReach; ++j)
                for (int i = -kReach; i <= kReach; ++i, ++k) {
                    patch[size_t(k)] = view.luma[size_t(y + j) * size_t(c.width) + size_t(x + i)];
                    known = known && patch[size_t(k)] >= 0;
                }
            if (!known || !normalise(patch)) continue;
            const auto depthOf = [&](double k) { return 1 / (1 / nearest + k / (kDepths - 1) * (1 / farthest - 1 / nearest)); };
            float score[kDepths];
            for (int k = 0; k < kDepths; ++k) score[k] = likeness(view, neighbours, patch, x, y, depthOf(k));
            const int best = int(std::max_element(score, score + kDepths) - score);
            if (!(score[best] > kAlike) || best == 0 || best == kDepths - 1) continue;
            bool alone = true; // a pattern that repeats matches at many depths
            for (int k = 0; k < kDepths; ++k) alone = alone && (std::abs(k - best) <= 4 || score[k] < score[best] - 0.05f);
            if (!alone) continue;
            const float a = score[best - 1], b = score[best], d = score[best + 1], curve = a - 2 * b + d;
            const double shift = curve < 0 ? std::clamp(0.5 * double((a - d) / curve), -0.5, 0.5) : 0.0, depth = depthOf(best + shift);
            points.push_back(glm::vec3(c.worldFromCamera * glm::dvec4((x + 0.5 - c.cx) / c.fx * depth, (c.cy - y - 0.5) / c.fy * depth, -depth, 1.0)));
        }
    return points;
}

} // namespace

std::vector<glm::vec3> stereoPoints(std::span<const StereoView> views, const glm::vec3& center, float radius, const std::function<bool()>& goOn)
{
    std::vector<std::vector<glm::vec3>> found(views.size());
    constexpr size_t kAtOnce = 16; // between two looks at the clock
    for (size_t first = 0; first < views.size(); first += kAtOnce) {
        if (goOn && !goOn()) return {};
        tbb::parallel_for(first, std::min(first + kAtOnce, views.size()), [&](size_t i) { found[i] = pointsOf(i, views, glm::dvec3(center), double(radius)); });
    }
    // Confirmed by points of other views nearby.
    using Cell = std::array<int, 3>;
    const auto cellOf = [&](const glm::vec3& p) {
        const glm::vec3 u = glm::floor((p - center) / (kCell * radius));
        return Cell{int(u.x), int(u.y), int(u.z)};
    };
    std::map<Cell, std::vector<uint32_t>> viewsOfCell;
    for (uint32_t i = 0; i < found.size(); ++i)
        for (const glm::vec3& p : found[i]) {
            std::vector<uint32_t>& seen = viewsOfCell[cellOf(p)];
            if (seen.empty() || seen.back() != i) seen.push_back(i);
        }
    std::vector<glm::vec3> out;
    for (uint32_t i = 0; i < found.size(); ++i)
        for (const glm::vec3& p : found[i]) {
            const Cell cell = cellOf(p);
            size_t others = 0;
            for (int dz = -1; dz <= 1; ++dz)
                for (int dy = -1; dy <= 1; ++dy)
                    for (int dx = -1; dx <= 1; ++dx) {
                        const auto near = viewsOfCell.find({cell[0] + dx, cell[1] + dy, cell[2] + dz});
                        if (near == viewsOfCell.end()) continue;
                        others += size_t(std::count_if(near->second.begin(), near->second.end(), [&](uint32_t v) { return v != i; }));
                    }
            if (others >= 3) out.push_back(p);
        }
    return out;
}

} // namespace nacre
