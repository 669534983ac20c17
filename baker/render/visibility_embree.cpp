// Gaussians as user geometry of Embree 3: one box per Gaussian around the ellipsoid where its alpha is kMinAlpha.
//
//   u = toLocal (origin - center),  v = toLocal direction
//   q = |u x v|^2 / |v|^2 where the line comes closest ahead of the origin (u.v < 0), else |u|^2
//   alpha = opacity exp(-q / 2) if q <= reach = 2 ln(opacity / kMinAlpha)
//
// The cross product, unlike |u|^2 - (u.v)^2 / |v|^2, does not cancel for thin Gaussians. Along a whole line this is the density
// that an orthographic EWA projection without low-pass gives, so the maps of light_visibility.cpp have the same limit.
//
// Optical depths -ln(1 - alpha) are added up as integers: sums do not depend on the order in which the tree brings Gaussians, nor
// on how many threads have built it.
#include "render/visibility_embree.h"

#include "base/spherical_harmonics.h"
#include "splat/light_visibility.h"
#include "splats/blend.h"

#include <embree3/rtcore.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <numeric>

namespace nacre {

namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kMostCoordinate = 1e18f; // Embree ignores boxes that reach beyond 1.8e18
constexpr float kBoxSlack = 2e-6f;       // of the largest coordinate: some 30 units in the last place
constexpr float kLeastScale = 1e-30f;    // its inverse is still a float
constexpr double kDepthUnit = 0x1p-32;
const int64_t kOpaque = std::llround(-std::log(double(kMinTransmittance)) / kDepthUnit);

/// In kDepthUnit, at most kOpaque.
int64_t opticalDepth(double alpha)
{
    return alpha < 1 - double(kMinTransmittance) ? std::llround(-std::log1p(-alpha) / kDepthUnit) : kOpaque;
}

float transmittanceOf(int64_t depth) { return depth >= kOpaque ? 0.0f : float(std::exp(-double(depth) * kDepthUnit)); }

bool isAhead(const RayGaussian& g, const glm::vec3& origin, const glm::vec3& direction, float bias)
{
    return glm::dot(glm::vec3(g.center[0], g.center[1], g.center[2]) - origin, direction) > bias;
}

/// A ray on its way; the callback finds it behind Embree's context.
struct Query {
    RTCIntersectContext context;
    float bias;
    int64_t depth;
};

/// What Embree's callbacks see.
struct Gaussians {
    std::vector<RayGaussian> all;
    float slack = 0; // of every box: Embree loses some bits of a ray's origin, as of all coordinates
};

void boxOf(const RTCBoundsFunctionArguments* a)
{
    const Gaussians& gaussians = *static_cast<const Gaussians*>(a->geometryUserPtr);
    const RayGaussian& g = gaussians.all[a->primID];
    // The ellipsoid's half-widths are the lengths of the rows of sqrt(reach) R S; toLocal = (R S)^-1 has rows r / s.
    double half[3] = {}, longest = 0;
    for (int j = 0; j < 3; ++j) {
        const float* row = &g.toLocal[3 * j];
        const double inverse = double(row[0]) * row[0] + double(row[1]) * row[1] + double(row[2]) * row[2]; // 1 / s_j^2
        const double s = g.reach / (inverse * inverse);
        for (int k = 0; k < 3; ++k) half[k] += s * row[k] * row[k]; // (s_j r_jk)^2 reach
        longest = std::max(longest, s * inverse);
    }
    const double slack = 1e-6 * std::sqrt(longest) + gaussians.slack; // float32 rows: axes are off by 1e-7 radians
    float lower[3], upper[3];
    for (int k = 0; k < 3; ++k) {
        const double width = std::sqrt(half[k]) + slack;
        lower[k] = float(std::max(g.center[k] - width, -double(kMostCoordinate)));
        upper[k] = float(std::min(g.center[k] + width, double(kMostCoordinate)));
    }
    *a->bounds_o = {lower[0], lower[1], lower[2], 0, upper[0], upper[1], upper[2], 0};
}

/// Never reports a hit, so that Embree goes on to the next Gaussian, until nothing is left of the ray.
void addDepth(const RTCOccludedFunctionNArguments* a)
{
    assert(a->N == 1);
    if (!a->valid[0]) return;
    const RayGaussian& g = static_cast<const Gaussians*>(a->geometryUserPtr)->all[a->primID];
    RTCRay& ray = *reinterpret_cast<RTCRay*>(a->ray);
    Query& query = *reinterpret_cast<Query*>(a->context);
    const glm::vec3 origin(ray.org_x, ray.org_y, ray.org_z), direction(ray.dir_x, ray.dir_y, ray.dir_z);
    if (!isAhead(g, origin, direction, query.bias)) return;
    const double alpha = alphaOnRay(g, origin, direction);
    if (alpha > 0) query.depth += opticalDepth(alpha);
    if (query.depth >= kOpaque) ray.tfar = -kInfinity;
}

} // namespace

bool prepareRayGaussian(const GaussianGeometry<float>& g, RayGaussian& out)
{
    float unit[4], m[9];
    detail::normalizeQuaternion(g.rotation, unit);
    detail::rotationMatrix(unit, m);
    out.opacity = std::min(g.opacity, 1.0f);
    out.reach = 2 * std::log(out.opacity / kMinAlpha);
    bool good = g.opacity > kMinAlpha; // positive tests: NaN fails
    for (int j = 0; j < 3; ++j) {
        const float scale = std::max(g.scale[j], kLeastScale);
        for (int k = 0; k < 3; ++k) {
            out.toLocal[3 * j + k] = m[3 * k + j] / scale;
            good = good && std::isfinite(m[3 * k + j]);
        }
        out.center[j] = g.position[j];
        good = good && std::abs(g.position[j]) < kMostCoordinate && scale < kMostCoordinate;
    }
    return good;
}

double alphaOnRay(const RayGaussian& g, const glm::vec3& origin, const glm::vec3& direction)
{
    // In float64: squares of 1 / scale overflow float32.
    double u[3], v[3], c[3];
    const double d[3] = {double(origin.x) - g.center[0], double(origin.y) - g.center[1], double(origin.z) - g.center[2]};
    for (int j = 0; j < 3; ++j) {
        const float* row = &g.toLocal[3 * j];
        u[j] = row[0] * d[0] + row[1] * d[1] + row[2] * d[2];
        v[j] = double(row[0]) * direction.x + double(row[1]) * direction.y + double(row[2]) * direction.z;
    }
    detail::cross3(u, v, c);
    const double q = detail::dot3(u, v) < 0 ? detail::dot3(c, c) / detail::dot3(v, v) : detail::dot3(u, u);
    return q <= g.reach ? g.opacity * std::exp(-0.5 * q) : 0.0;
}

struct GaussianRayScene::State {
    RTCDevice device = nullptr;
    RTCScene scene = nullptr;
    Gaussians gaussians;              // those that count
    std::vector<glm::vec3> positions; // of all
    float bias = 0;
};

GaussianRayScene::GaussianRayScene(std::span<const GaussianGeometry<float>> splats) : state_(new State)
{
    State& s = *state_;
    for (const GaussianGeometry<float>& g : splats) {
        s.positions.emplace_back(g.position[0], g.position[1], g.position[2]);
        RayGaussian r;
        if (!prepareRayGaussian(g, r)) continue;
        s.gaussians.all.push_back(r);
        for (int k = 0; k < 3; ++k)
            s.gaussians.slack = std::max(s.gaussians.slack, kBoxSlack * (std::abs(r.center[k]) + 4 * g.scale[k]));
    }
    if (!splats.empty()) s.bias = visibilityBias(splats);
    s.device = rtcNewDevice(nullptr);
    s.scene = rtcNewScene(s.device);
    rtcSetSceneBuildQuality(s.scene, RTC_BUILD_QUALITY_HIGH);
    RTCGeometry geometry = rtcNewGeometry(s.device, RTC_GEOMETRY_TYPE_USER);
    rtcSetGeometryUserPrimitiveCount(geometry, unsigned(s.gaussians.all.size()));
    rtcSetGeometryUserData(geometry, &s.gaussians);
    rtcSetGeometryBoundsFunction(geometry, boxOf, nullptr);
    rtcSetGeometryOccludedFunction(geometry, addDepth);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(s.scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(s.scene);
}

GaussianRayScene::~GaussianRayScene()
{
    rtcReleaseScene(state_->scene);
    rtcReleaseDevice(state_->device);
}

GaussianRayScene::Box GaussianRayScene::box() const
{
    RTCBounds b;
    rtcGetSceneBounds(state_->scene, &b);
    return {{b.lower_x, b.lower_y, b.lower_z}, {b.upper_x, b.upper_y, b.upper_z}};
}

size_t GaussianRayScene::count() const { return state_->positions.size(); }
float GaussianRayScene::bias() const { return state_->bias; }

float GaussianRayScene::transmittance(const glm::vec3& origin, const glm::vec3& direction, float bias) const
{
    for (int k = 0; k < 3; ++k)
        if (!(std::abs(origin[k]) < kMostCoordinate && std::abs(direction[k]) <= 2)) return 1; // Embree aborts on NaN
    Query query{};
    rtcInitIntersectContext(&query.context);
    query.bias = bias;
    RTCRay ray;
    ray.org_x = origin.x, ray.org_y = origin.y, ray.org_z = origin.z;
    ray.dir_x = direction.x, ray.dir_y = direction.y, ray.dir_z = direction.z;
    ray.tnear = 0, ray.tfar = kInfinity;
    ray.time = 0, ray.mask = ~0u, ray.id = 0, ray.flags = 0;
    rtcOccluded1(state_->scene, &query.context, &ray);
    return transmittanceOf(query.depth);
}

float GaussianRayScene::transmittanceFrom(size_t splat, const glm::vec3& direction) const
{
    return transmittance(state_->positions[splat], direction, state_->bias);
}

float GaussianRayScene::transmittanceReference(const glm::vec3& origin, const glm::vec3& direction, float bias) const
{
    int64_t depth = 0;
    for (const RayGaussian& g : state_->gaussians.all)
        if (depth < kOpaque && isAhead(g, origin, direction, bias)) depth += opticalDepth(alphaOnRay(g, origin, direction));
    return transmittanceOf(depth);
}

std::vector<float> traceVisibility(const GaussianRayScene& scene, std::span<const uint32_t> which,
                                   std::span<const glm::vec3> directions)
{
    std::vector<float> values(which.size() * directions.size());
    tbb::parallel_for(size_t(0), which.size(), [&](size_t i) {
        for (size_t k = 0; k < directions.size(); ++k)
            values[i * directions.size() + k] = scene.transmittanceFrom(which[i], directions[k]);
    });
    return values;
}

std::vector<uint8_t> embreeVisibility(const GaussianRayScene& scene, std::span<const uint32_t> which, int size, int oversample)
{
    const int fine = size * oversample, perTexel = oversample * oversample;
    const size_t texels = size_t(size) * size_t(size);
    std::vector<glm::vec3> directions; // [texel][oversample^2]
    for (int t = 0; t < int(texels); ++t)
        for (int k = 0; k < perTexel; ++k) {
            const int i = t % size * oversample + k % oversample, j = t / size * oversample + k / oversample;
            directions.push_back(octahedralDirection((2 * float(i) + 1) / float(fine) - 1, (2 * float(j) + 1) / float(fine) - 1));
        }
    std::vector<uint8_t> maps(which.size() * texels);
    tbb::parallel_for(size_t(0), which.size(), [&](size_t i) {
        for (size_t t = 0; t < texels; ++t) {
            float sum = 0;
            for (int k = 0; k < perTexel; ++k)
                sum += scene.transmittanceFrom(which[i], directions[t * size_t(perTexel) + size_t(k)]);
            maps[i * texels + t] = uint8_t(std::lround(255.0f / float(perTexel) * sum));
        }
    });
    return maps;
}

std::vector<uint8_t> embreeVisibility(std::span<const GaussianGeometry<float>> splats, int size, int oversample)
{
    std::vector<uint32_t> all(splats.size());
    std::iota(all.begin(), all.end(), 0u);
    return embreeVisibility(GaussianRayScene(splats), all, size, oversample);
}

/// Lower triangle L with L L' = the normal matrix of the directions.
static std::array<double, kVisibilityShFunctions * kVisibilityShFunctions> factorNormalMatrix(std::span<const double> basis)
{
    constexpr int n = kVisibilityShFunctions;
    std::array<double, n * n> a{};
    for (size_t row = 0; row < basis.size(); row += n)
        for (int i = 0; i < n; ++i)
            for (int j = 0; j <= i; ++j) a[size_t(n * i + j)] += basis[row + size_t(i)] * basis[row + size_t(j)];
    for (int i = 0; i < n; ++i)
        for (int j = 0; j <= i; ++j) {
            double sum = a[size_t(n * i + j)];
            for (int k = 0; k < j; ++k) sum -= a[size_t(n * i + k)] * a[size_t(n * j + k)];
            // directions that do not tell two functions apart: neither gets a huge coefficient
            a[size_t(n * i + j)] =
                i == j ? std::sqrt(std::max(sum, 1e-9 * double(basis.size() / n))) : sum / a[size_t(n * j + j)];
        }
    return a;
}

VisibilityShFit fitVisibilitySh3(std::span<const glm::vec3> directions, std::span<const float> values)
{
    constexpr int n = kVisibilityShFunctions;
    assert(directions.size() >= size_t(n) && values.size() % directions.size() == 0);
    std::vector<double> basis(directions.size() * n);
    for (size_t d = 0; d < directions.size(); ++d)
        shBasis<double>(n, directions[d].x, directions[d].y, directions[d].z, &basis[d * n]);
    const auto factor = factorNormalMatrix(basis);
    VisibilityShFit fit;
    fit.coefficients.resize(values.size() / directions.size()), fit.rmsError.resize(fit.coefficients.size());
    tbb::parallel_for(size_t(0), fit.coefficients.size(), [&](size_t s) {
        const float* value = &values[s * directions.size()];
        double x[n] = {};
        for (size_t d = 0; d < directions.size(); ++d)
            for (int i = 0; i < n; ++i) x[i] += basis[d * n + size_t(i)] * double(value[d]);
        for (int i = 0; i < n; ++i) {
            for (int k = 0; k < i; ++k) x[i] -= factor[size_t(n * i + k)] * x[k];
            x[i] /= factor[size_t(n * i + i)];
        }
        for (int i = n - 1; i >= 0; --i) {
            for (int k = i + 1; k < n; ++k) x[i] -= factor[size_t(n * k + i)] * x[k];
            x[i] /= factor[size_t(n * i + i)];
        }
        std::copy(x, x + n, fit.coefficients[s].begin());
        double squared = 0;
        for (size_t d = 0; d < directions.size(); ++d) {
            const double off = double(evaluateVisibilitySh3(fit.coefficients[s], directions[d])) - double(value[d]);
            squared += off * off;
        }
        fit.rmsError[s] = float(std::sqrt(squared / double(directions.size())));
    });
    return fit;
}

float evaluateVisibilitySh3(const std::array<float, kVisibilityShFunctions>& coefficients, const glm::vec3& direction)
{
    float y[kVisibilityShFunctions], sum = 0;
    shBasis(kVisibilityShFunctions, direction.x, direction.y, direction.z, y);
    for (int i = 0; i < kVisibilityShFunctions; ++i) sum += coefficients[size_t(i)] * y[i];
    return std::clamp(sum, 0.0f, 1.0f);
}

} // namespace nacre
