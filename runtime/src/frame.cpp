// Turns the host's matrices into what the passes need, and rejects what the runtime cannot draw.
#include "frame.h"

#include "base/finite.h"
#include "base/text.h"

#include <glm/gtc/type_ptr.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace nacre {

// Hosts compose, drift and invert matrices in float, so nothing is tested for an exact value. A deliberate stretch, shear or perspective
// is larger than these.
constexpr double kShapeTolerance = 5e-3;       // 1e4 products of float quaternions, never normalised, drift by 1e-3
constexpr double kPerspectiveTolerance = 1e-4; // per unit of the result: inverses of matrices whose translation is 1000 round by 6e-5

/// Rotation, mirrored or not, times a uniform scale, affine: true if `m` is one but for rounding, and then exactly affine afterwards.
/// `*scale` is the scale, positive.
static bool isSimilarity(glm::dmat4& m, double* scale)
{
    // An inverse is a matrix of cofactors over the determinant, whose rounding multiplies all elements alike: divided out.
    if (!(std::abs(m[3][3] - 1.0) < kShapeTolerance)) return false;
    m /= m[3][3];
    const glm::dmat3 a(m);
    const double k = std::cbrt(std::abs(glm::determinant(a)));
    *scale = k;
    if (!(k > 1e-12)) return false;
    for (int i = 0; i < 3; ++i) {
        if (!(std::abs(m[i][3]) < kPerspectiveTolerance * k)) return false;
        m[i][3] = 0;
    }
    const glm::dmat3 gram = glm::transpose(a) * a / (k * k);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            if (!(std::abs(gram[i][j] - (i == j ? 1.0 : 0.0)) < kShapeTolerance)) return false;
    return true;
}

/// Clip w grows with -z and, but for rounding, with nothing else; the eye may be shifted.
static bool isPerspective(const glm::dmat4& p)
{
    constexpr double kFarthestEye = 1e6; // an orthographic matrix that was inverted twice has its eye at 1e7 or farther
    const double perDepth = -p[2][3];
    return perDepth > 0 && std::abs(p[0][3]) < kShapeTolerance * perDepth && std::abs(p[1][3]) < kShapeTolerance * perDepth &&
           std::abs(p[3][3]) < kFarthestEye * perDepth;
}

/// Clip w is constant but for rounding; exactly 1 afterwards.
static bool isOrthographic(glm::dmat4& p)
{
    if (!(p[3][3] > 0)) return false;
    p /= p[3][3];
    for (int i = 0; i < 3; ++i) {
        const double size = std::max({std::abs(p[i][0]), std::abs(p[i][1]), std::abs(p[i][2])});
        if (!(std::abs(p[i][3]) <= kPerspectiveTolerance * size)) return false;
        p[i][3] = 0;
    }
    return true;
}

// A projection is taken as it comes: off centre, with the eye shifted in the projection (stereo), with a tilted near plane (mirrors and
// water cut their frustum there), reversed. Rows 0, 1 and 3 give (x, y, w) of clip space as M p + m; the rest follows from them.

/// M of the rows 0, 1 and 3.
static glm::dmat3 xywFromView(const glm::dmat4& p)
{
    return {glm::dvec3(p[0].x, p[0].y, p[0].w), glm::dvec3(p[1].x, p[1].y, p[1].w), glm::dvec3(p[2].x, p[2].y, p[2].w)};
}

/// Where all rays meet: x = y = w = 0.
static glm::dvec3 eyeOfProjection(const glm::dmat4& p) { return -(glm::inverse(xywFromView(p)) * glm::dvec3(p[3].x, p[3].y, p[3].w)); }

/// Along every ray from the eye z / w is a + b / w with one b = row 2 at the eye. Usually it grows, and the near plane is z = -w (or 0);
/// reversed, it is z = w.
static glm::dvec4 nearPlane(const glm::dmat4& p, const glm::dvec3& eye, bool zeroToOne)
{
    const glm::dmat4 rows = glm::transpose(p);
    if (glm::dot(rows[2], glm::dvec4(eye, 1)) > 0) return rows[3] - rows[2];
    return zeroToOne ? rows[2] : rows[2] + rows[3];
}

/// Smallest clip w of the near plane within the frustum: of a plane it lies in a corner. Infinite if the plane hides the whole frustum.
static double nearW(const glm::dmat4& p, const glm::dvec3& eye, const glm::dvec4& plane)
{
    const glm::dmat3 viewFromXyw = glm::inverse(xywFromView(p));
    const double atEye = glm::dot(plane, glm::dvec4(eye, 1)); // not positive
    double nearest = std::numeric_limits<double>::infinity();
    for (const double x : {-1.0, 1.0})
        for (const double y : {-1.0, 1.0}) {
            const double slope = glm::dot(glm::dvec3(plane), viewFromXyw * glm::dvec3(x, y, 1.0)); // per w
            if (slope > 0) nearest = std::min(nearest, std::max(-atEye / slope, 0.0));
        }
    return nearest;
}

Failure makePlacement(const float m[16], Placement* placement)
{
    if (!allFinite(m, 16)) return invalid("worldFromAsset has a value that is not finite");
    glm::dmat4 world(glm::make_mat4(m));
    if (world == glm::dmat4(0)) world = glm::dmat4(1);
    double scale = 0;
    constexpr double kSmallest = 1e-12, kLargest = 1e12; // distances squared and their falloff stay in float
    const double size = std::cbrt(std::abs(glm::determinant(glm::dmat3(world))));
    if (size != 0 && !(size > kSmallest && size < kLargest)) return invalid("the scale of worldFromAsset is " + numberText(float(size)) + ", it must be from 1e-12 to 1e12");
    if (!isSimilarity(world, &scale)) return invalid("worldFromAsset must be a rotation (or a mirrored one), a translation and one uniform scale");
    *placement = {world, glm::inverse(world), scale};
    return {};
}

/// Orthographic rays are parallel: along z of view space, but for an oblique projection, whose x and y also change with z.
static Failure makeOrthographic(glm::dmat4 p, ViewFrame* frame)
{
    const glm::dmat2 xy(p[0].x, p[0].y, p[1].x, p[1].y);
    if (!(std::abs(glm::determinant(xy)) > 0)) return invalid("clipFromView flattens the picture: its first two rows do not span the plane");
    const glm::dvec2 slope = glm::inverse(xy) * glm::dvec2(p[2].x, p[2].y); // view x, y that a step in z looks like
    const glm::dvec3 towards = glm::normalize(glm::dvec3(-slope.x, -slope.y, 1.0));
    const glm::dmat4 worldFromView = glm::inverse(frame->viewFromWorld);
    const glm::dmat4 rows = glm::transpose(p);
    frame->orthographic = true;
    frame->towardsEye = glm::normalize(glm::dmat3(worldFromView) * towards);
    frame->eye = glm::dvec3(worldFromView[3]);
    const bool reversed = glm::dot(glm::dvec3(rows[2]), towards) > 0; // depth grows towards the camera
    frame->nearPlane = glm::vec4(reversed ? rows[3] - rows[2] : frame->clip.zeroToOne ? rows[2] : rows[2] + rows[3]);
    frame->nearW = 0;
    frame->clipFromView = glm::mat4(p);
    return {};
}

Failure makeViewFrame(const NacreDrawDesc& desc, const ClipControl& clip, ViewFrame* frame)
{
    const struct { const char* name; const float* m; } matrices[] = {{"viewFromWorld", desc.viewFromWorld}, {"clipFromView", desc.clipFromView}};
    for (const auto& [name, m] : matrices)
        if (!allFinite(m, 16)) return invalid(std::string(name) + " has a value that is not finite");
    *frame = {};
    frame->clip = clip;
    frame->viewport = {float(desc.viewportWidth), float(desc.viewportHeight)};
    frame->viewFromWorld = glm::make_mat4(desc.viewFromWorld);
    if (!isSimilarity(frame->viewFromWorld, &frame->viewScale))
        return invalid("viewFromWorld must be a rotation (or a mirrored one), a translation and one uniform scale");
    glm::dmat4 clipFromView(glm::make_mat4(desc.clipFromView));
    if (!isPerspective(clipFromView)) {
        if (isOrthographic(clipFromView)) return makeOrthographic(clipFromView, frame);
        return invalid("clipFromView must be a perspective projection with clip w = -z, or an orthographic one (column-major, see nacre.h)");
    }
    if (!(std::abs(glm::determinant(xywFromView(clipFromView))) > 0))
        return invalid("clipFromView flattens the picture: its first, second and fourth row do not span space");
    const glm::dvec3 eye = eyeOfProjection(clipFromView);
    const glm::dvec4 plane = nearPlane(clipFromView, eye, clip.zeroToOne);
    frame->clipFromView = glm::make_mat4(desc.clipFromView);
    frame->eye = glm::dvec3(glm::inverse(frame->viewFromWorld) * glm::dvec4(eye, 1));
    frame->nearPlane = glm::vec4(plane);
    frame->nearW = float(nearW(clipFromView, eye, plane));
    return {};
}

InstanceFrame makeInstanceFrame(const ViewFrame& view, const Placement& placement)
{
    const glm::dmat4 viewFromAsset = view.viewFromWorld * placement.worldFromAsset;
    InstanceFrame frame;
    frame.viewFromAsset = glm::mat3(viewFromAsset);
    frame.worldFromAsset = glm::mat3(placement.worldFromAsset);
    frame.viewTranslation = glm::vec3(viewFromAsset[3]);
    frame.fromEye = glm::vec3(glm::dvec3(placement.worldFromAsset[3]) - view.eye);
    frame.camera = view.orthographic ? glm::vec4(glm::normalize(glm::dmat3(placement.assetFromWorld) * view.towardsEye), 0)
                                     : glm::vec4(placement.assetFromWorld * glm::dvec4(view.eye, 1));
    frame.worldScale = float(placement.scale);
    frame.viewScale = float(placement.scale * view.viewScale);
    return frame;
}

// The ray of (x, y, w) in clip space is M^-1 (x, y, w); here w = 1, so x and y are those of ndc. Orthographic rays differ in where they
// start instead.
WindowRays windowRays(const ViewFrame& frame, const float viewport[4])
{
    const double up = frame.clip.upperLeft ? -1.0 : 1.0; // of ndc, in the window
    const glm::dvec2 step(2.0 / viewport[2], up * 2.0 / viewport[3]);
    const glm::dvec2 start = glm::dvec2(-1.0, -up) - step * glm::dvec2(viewport[0], viewport[1]);
    const glm::dmat3 worldFromView = glm::inverse(glm::dmat3(frame.viewFromWorld));
    const glm::dmat4 p(frame.clipFromView);
    WindowRays rays{};
    if (frame.orthographic) {
        const glm::dmat2 viewFromNdc = glm::inverse(glm::dmat2(p[0].x, p[0].y, p[1].x, p[1].y));
        const auto along = [&](glm::dvec2 ndc) { return glm::vec3(worldFromView * glm::dvec3(viewFromNdc * ndc, 0.0)); };
        rays.origin = along(start - glm::dvec2(p[3].x, p[3].y)); // the eye is the origin of view space
        rays.originRight = along({step.x, 0}), rays.originUp = along({0, step.y});
        rays.ray = glm::vec3(-frame.towardsEye);
        return rays;
    }
    const glm::dmat3 worldFromNdc = worldFromView * glm::inverse(xywFromView(p));
    const auto ray = [&](double x, double y, double w) { return glm::vec3(worldFromNdc * glm::dvec3(x, y, w)); };
    rays.ray = ray(start.x, start.y, 1), rays.rayRight = ray(step.x, 0, 0), rays.rayUp = ray(0, step.y, 0);
    return rays;
}

} // namespace nacre
