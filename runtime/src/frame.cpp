// Turns the host's matrices into what the passes need, and rejects what the runtime cannot draw.
#include "asset.h"

#include <glm/gtc/type_ptr.hpp>

#include <cmath>

namespace nacre {

static bool allFinite(const float* m)
{
    float sum = 0;
    for (int i = 0; i < 16; ++i) sum += m[i] * 0.0f; // NaN for NaN and infinity
    return sum == 0.0f;
}

/// Rotation times a positive uniform scale, affine. `*scale` is the scale.
static bool isSimilarity(const glm::dmat4& m, double* scale)
{
    constexpr double kTolerance = 1e-3; // hosts compose float matrices; a deliberate stretch is larger
    const glm::dmat3 a(m);
    const double k = std::cbrt(glm::determinant(a));
    *scale = k;
    if (!(k > 1e-12) || m[0][3] != 0 || m[1][3] != 0 || m[2][3] != 0 || m[3][3] != 1) return false;
    const glm::dmat3 gram = glm::transpose(a) * a / (k * k);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            if (!(std::abs(gram[i][j] - (i == j ? 1.0 : 0.0)) < kTolerance)) return false;
    return true;
}

/// View distance of the nearer of the two planes z = +-w of a perspective projection (reversed depth swaps them), times w per distance.
static double nearW(const glm::dmat4& p)
{
    double nearest = 0;
    for (const double side : {-1.0, 1.0}) {
        const double distance = p[3][2] / (p[2][2] + side * p[2][3] * -1.0);
        if (std::isfinite(distance) && distance > 0 && (nearest == 0 || distance < nearest)) nearest = distance;
    }
    return -p[2][3] * nearest;
}

Failure makeFrame(const NacreDrawDesc& desc, DrawFrame* frame)
{
    const auto invalid = [](std::string text) { return Failure{NACRE_ERROR_INVALID_ARGUMENT, std::move(text)}; };
    const struct { const char* name; const float* m; } matrices[] = {
        {"worldFromAsset", desc.worldFromAsset}, {"viewFromWorld", desc.viewFromWorld}, {"clipFromView", desc.clipFromView}};
    for (const auto& [name, m] : matrices)
        if (!allFinite(m)) return invalid(std::string(name) + " has a value that is not finite");
    if (desc.viewportWidth <= 0 || desc.viewportHeight <= 0)
        return invalid("the viewport is " + std::to_string(desc.viewportWidth) + " x " + std::to_string(desc.viewportHeight) +
                       " pixels, both must be positive");

    const glm::dmat4 worldFromAsset(glm::make_mat4(desc.worldFromAsset)), viewFromWorld(glm::make_mat4(desc.viewFromWorld));
    const glm::dmat4 clipFromView(glm::make_mat4(desc.clipFromView));
    double worldScale = 0, viewScale = 0;
    if (!isSimilarity(worldFromAsset, &worldScale))
        return invalid("worldFromAsset must be a rotation, a translation and one positive uniform scale");
    if (!isSimilarity(viewFromWorld, &viewScale) || std::abs(viewScale - 1) > 1e-3)
        return invalid("viewFromWorld must be rigid: a rotation and a translation");
    if (!(clipFromView[2][3] < 0) || clipFromView[3][3] != 0 || clipFromView[0][3] != 0 || clipFromView[1][3] != 0)
        return invalid("clipFromView must be a perspective projection with clip w = -z (column-major, see nacre.h)");

    const glm::dmat4 viewFromAsset = viewFromWorld * worldFromAsset;
    frame->viewFromAsset = glm::mat3(viewFromAsset);
    frame->viewTranslation = glm::vec3(viewFromAsset[3]);
    frame->clipFromView = glm::make_mat4(desc.clipFromView);
    frame->assetFromWorld = glm::inverse(worldFromAsset);
    frame->cameraAsset = glm::vec3(glm::inverse(viewFromAsset)[3]);
    frame->worldScale = float(worldScale);
    frame->nearW = float(nearW(clipFromView));
    frame->viewport = {float(desc.viewportWidth), float(desc.viewportHeight)};
    return {};
}

// Inverts ndc.xy * w = P.xx (x, y, z) at z = -1, where w = -P[2][3].
WindowRays windowRays(const DrawFrame& frame, const float viewport[4])
{
    const glm::dmat4 p(frame.clipFromView);
    const glm::dmat2 inverse = glm::inverse(glm::dmat2(glm::dvec2(p[0]), glm::dvec2(p[1])));
    const glm::dmat3 assetFromView = glm::transpose(glm::dmat3(frame.viewFromAsset)); // times a scale, which does not matter
    const double w = -p[2][3];
    const glm::dvec2 step(2.0 * w / viewport[2], 2.0 * w / viewport[3]);
    const glm::dvec2 start = glm::dvec2(-w, -w) - step * glm::dvec2(viewport[0], viewport[1]) + glm::dvec2(p[2]);
    const auto ray = [&](glm::dvec2 ndcTimesW, double z) { return glm::vec3(assetFromView * glm::dvec3(inverse * ndcTimesW, z)); };
    return {ray(start, -1.0), ray({step.x, 0.0}, 0.0), ray({0.0, step.y}, 0.0)};
}

} // namespace nacre
