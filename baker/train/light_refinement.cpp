// Gauss-Newton with a prior, one light at a time; rows of pixels in parallel, their sums added in row order.
#include "train/light_refinement.h"

#include "appearance/trainable.h"
#include "base/color.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <map>
#include <numbers>
#include <tuple>

namespace nacre {

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kSigma[3] = {0.03, kDegree, kDegree}; // how wrong a light usually is
constexpr double kSamplesPerView = 20; // against the prior: a model's errors are as wide as its parts, however many pixels show them
constexpr double kForget = 0.9;       // per view of the light
constexpr double kProbe = 2 * kDegree; // displacement of the differences: wider than the noise of a render, narrower than a shadow's blur
constexpr double kMostGain = 0.02, kMostTurn = 0.5 * kDegree; // of one solution: the splats have to follow
constexpr float kSmallError = 0.02f;  // display values; below it the error counts squared

struct RowSums { double hessian[6] = {}, gradient[3] = {}, error = 0, samples = 0; };

struct ViewPlanes { // first channel of one image
    const float* render;
    const float* shifted[4];
    const uint16_t* reference;
    size_t pixels;
};

// Pixels that are saturated in the reference or mostly background tell nothing.
RowSums observeRow(const ViewPlanes& v, size_t begin, size_t end, const double at[3])
{
    RowSums sums;
    for (int c = 0; c < 3; ++c)
        for (size_t p = begin; p < end; ++p) {
            const size_t i = c * v.pixels + p;
            if (v.reference[3 * v.pixels + p] < 32768 || v.reference[i] == 65535) continue;
            const float linear = std::clamp(v.render[i], 0.0f, 1.0f), encoded = srgbFromLinear(linear);
            const float slope = linear <= 0.0031308f ? 12.92f : (encoded + 0.055f) / (2.4f * linear);
            const float r = float(v.reference[i]) / 65535.0f - encoded, w = 1.0f / (std::abs(r) + kSmallError);
            const float perRadian = slope / float(2 * kProbe);
            const double j[3] = {slope * linear, perRadian * (v.shifted[0][i] - v.shifted[1][i]), perRadian * (v.shifted[2][i] - v.shifted[3][i])};
            const double target = w * (r + j[0] * at[0] + j[1] * at[1] + j[2] * at[2]);
            for (int a = 0, k = 0; a < 3; ++a) {
                for (int b = a; b < 3; ++b) sums.hessian[k++] += w * j[a] * j[b];
                sums.gradient[a] += j[a] * target;
            }
            sums.error += std::abs(r), ++sums.samples;
        }
    return sums;
}

} // namespace

LightRefinement::LightRefinement(const OlatSplit& split, const glm::vec3& center) : split_(split), center_(center)
{
    std::map<std::tuple<LightType, float, float, float>, uint32_t> known;
    for (const OlatImage& image : split.images) {
        const Light& l = image.light;
        if (!l.isPunctual()) {
            placeOfImage_.push_back(~0u);
            continue;
        }
        const bool point = l.type == LightType::kPoint;
        const glm::vec3 at = point ? l.position : l.directionToLight;
        const auto [entry, isNew] = known.try_emplace({l.type, at.x, at.y, at.z}, uint32_t(places_.size()));
        placeOfImage_.push_back(entry->second);
        if (!isNew) continue;
        const glm::dvec3 offset = point ? glm::dvec3(at) - center_ : glm::dvec3(at);
        const double distance = glm::length(offset);
        const glm::dvec3 d = distance > 0 ? offset / distance : glm::dvec3(0, 0, 1); // a light at the centre has nowhere to turn
        const glm::dvec3 other = std::abs(d.z) < 0.7 ? glm::dvec3(0, 0, 1) : glm::dvec3(1, 0, 0);
        const glm::dvec3 u = glm::normalize(glm::cross(other, d));
        places_.push_back({l, d, {u, glm::cross(d, u)}, distance});
    }
    evidence_.resize(places_.size());
}

Light LightRefinement::moved(const Light& light, size_t place, const double x[3]) const
{
    Light out = light;
    out.intensity *= float(std::exp(x[0]));
    const double angle = std::hypot(x[1], x[2]);
    if (angle == 0) return out;
    const Place& p = places_[place];
    const glm::dvec3 axis = (x[1] * p.tangents[0] + x[2] * p.tangents[1]) / angle, d = std::cos(angle) * p.direction + std::sin(angle) * axis;
    if (light.type == LightType::kPoint) out.position = glm::vec3(center_ + p.distance * d);
    else out.directionToLight = glm::vec3(d);
    return out;
}

Light LightRefinement::light(uint32_t image) const
{
    const uint32_t place = placeOfImage_[image];
    assert(place != ~0u);
    return moved(split_.images[image].light, place, evidence_[place].x);
}

void LightRefinement::observe(std::span<const uint32_t> images, const PreparedImage* const* references, const Render& render)
{
    assert(images.size() <= kMaxLightsPerStep);
    Light lights[kMaxLightsPerStep];
    const std::span<const Light> used(lights, images.size());
    for (size_t i = 0; i < images.size(); ++i) lights[i] = light(images[i]);
    render(used, planes_);
    for (int s = 0; s < 4; ++s) { // + and - along the first tangent, then along the second
        for (size_t i = 0; i < images.size(); ++i) {
            const uint32_t place = placeOfImage_[images[i]];
            double x[3];
            std::copy_n(evidence_[place].x, 3, x);
            x[1 + s / 2] += s % 2 ? -kProbe : kProbe;
            lights[i] = moved(split_.images[images[i]].light, place, x);
        }
        render(used, shifted_[s]);
    }

    for (size_t i = 0; i < images.size(); ++i) {
        LightEvidence& e = evidence_[placeOfImage_[images[i]]];
        const PreparedImage& reference = *references[i];
        const size_t width = size_t(reference.width), pixels = width * size_t(reference.height), first = 3 * i * pixels;
        ViewPlanes view{planes_.data() + first, {}, reference.planes.data(), pixels};
        for (int s = 0; s < 4; ++s) view.shifted[s] = shifted_[s].data() + first;
        std::vector<RowSums> rows(size_t(reference.height));
        tbb::parallel_for(size_t(0), rows.size(), [&](size_t y) { rows[y] = observeRow(view, y * width, (y + 1) * width, e.x); });

        for (double& h : e.hessian) h *= kForget;
        for (double& g : e.gradient) g *= kForget;
        e.error *= kForget, e.recent *= kForget;
        RowSums sum;
        for (const RowSums& row : rows) {
            for (int k = 0; k < 6; ++k) sum.hessian[k] += row.hessian[k];
            for (int k = 0; k < 3; ++k) sum.gradient[k] += row.gradient[k];
            sum.error += row.error, sum.samples += row.samples;
        }
        if (sum.samples == 0) continue;
        for (int k = 0; k < 6; ++k) e.hessian[k] += sum.hessian[k] / sum.samples;
        for (int k = 0; k < 3; ++k) e.gradient[k] += sum.gradient[k] / sum.samples;
        e.error += sum.error / sum.samples;
        ++e.recent, ++e.views;
        solve(e);
    }
    removeCommon();
}

// The prior's scale is the mean error: that of noise, and of what the splats do not hold yet.
void LightRefinement::solve(LightEvidence& e) const
{
    const double prior = (e.error / e.recent + 1e-4) / kSamplesPerView; // images without any error leave the prior a little
    const double* h = e.hessian;
    const auto ridge = [&](int k) { return prior / (kSigma[k] * kSigma[k]); };
    const glm::dmat3 normal(h[0] + ridge(0), h[1], h[2], h[1], h[3] + ridge(1), h[4], h[2], h[4], h[5] + ridge(2));
    const glm::dvec3 x = glm::inverse(normal) * glm::dvec3(e.gradient[0], e.gradient[1], e.gradient[2]);
    const double gain = x[0] - e.x[0], turn[2] = {x[1] - e.x[1], x[2] - e.x[2]};
    if (!std::isfinite(gain + turn[0] + turn[1])) return; // a render that is not finite: the training loss reports it
    const double slower = std::min(1.0, kMostTurn / std::max(std::hypot(turn[0], turn[1]), 1e-12));
    e.x[0] += std::clamp(gain, -kMostGain, kMostGain);
    e.x[1] += slower * turn[0], e.x[2] += slower * turn[1];
}

// Takes the mean log gain and the rotation that fits the turns best (least squares over the lights that were seen) out of them.
void LightRefinement::removeCommon()
{
    double gain = 0, count = 0;
    glm::dmat3 normal(1e-9); // all lights in one direction leave the turn about it free
    glm::dvec3 moment(0);
    for (size_t i = 0; i < places_.size(); ++i) {
        const LightEvidence& e = evidence_[i];
        if (e.views == 0) continue;
        const Place& p = places_[i];
        gain += e.x[0], ++count;
        normal += glm::dmat3(1) - glm::outerProduct(p.direction, p.direction);
        moment += glm::cross(p.direction, e.x[1] * p.tangents[0] + e.x[2] * p.tangents[1]);
    }
    if (count == 0) return;
    const glm::dvec3 rotation = glm::inverse(normal) * moment;
    for (size_t i = 0; i < places_.size(); ++i) {
        LightEvidence& e = evidence_[i];
        if (e.views == 0) continue;
        const glm::dvec3 turn = glm::cross(rotation, places_[i].direction);
        e.x[0] -= gain / count;
        for (int k = 0; k < 2; ++k) e.x[1 + k] -= glm::dot(turn, places_[i].tangents[k]);
    }
}

std::vector<RefinedLight> LightRefinement::lights() const
{
    std::vector<RefinedLight> out;
    for (size_t i = 0; i < places_.size(); ++i) {
        const double* x = evidence_[i].x;
        out.push_back({places_[i].stated, moved(places_[i].stated, i, x), std::hypot(x[1], x[2]) / kDegree, std::exp(x[0]), int(evidence_[i].views)});
    }
    return out;
}

bool LightRefinement::restore(std::vector<LightEvidence> evidence)
{
    if (evidence.size() != places_.size()) return false;
    for (const LightEvidence& e : evidence) {
        double sum = e.error + e.recent + e.views;
        for (double v : e.x) sum += v;
        for (double v : e.hessian) sum += v;
        for (double v : e.gradient) sum += v;
        if (!std::isfinite(sum)) return false;
    }
    evidence_ = std::move(evidence);
    return true;
}

} // namespace nacre
