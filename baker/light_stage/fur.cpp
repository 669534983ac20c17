// Roots: strand i of N takes the surface point at area (i + jitter) / N of the total, triangles lined up one after the other, so every
// triangle gets its share to within one strand; within it, points follow the R2 low-discrepancy sequence (Roberts 2018).
// Shape: a cubic Bezier curve that leaves along the normal and bends over. Its tip direction is the sum of the normal, gravity in the tangent
// plane, a slow vector wave over space (fur lies in swirls) and a random part; tufts draw tips towards jittered points of a grid.
#include "light_stage/fur.h"

#include "base/hash.h"
#include "base/random.h"
#include "base/text.h"
#include "light_stage/texture_sampling.h"
#include "mesh/material_names.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

namespace nacre {

namespace {

constexpr float kPi = std::numbers::pi_v<float>;

std::string number(double x)
{
    char text[32];
    std::snprintf(text, sizeof text, "%.6g", x);
    return text;
}

Error bad(std::string message) { return {ErrorCode::kBadInput, "fur: " + std::move(message)}; }

Status checkSettings(const FurSettings& s)
{
    const auto wants = [](const char* what, float value, const char* expected) {
        return bad(std::string(what) + " is " + number(value) + ", expected " + expected);
    };
    // Positive tests, so that NaN fails.
    if (!(s.density > 0 && std::isfinite(s.density))) return wants("density", s.density, "a positive number of strands per square metre of surface");
    if (!(s.length > 1e-15f && s.length < 1e15f)) return wants("length", s.length, "a positive length in metres, such as 0.02");
    if (!(s.radius > 0 && s.radius < s.length)) return wants("radius", s.radius, "a positive radius in metres below the length, such as 0.0001");
    if (!(s.lengthVariation >= 0 && s.lengthVariation < 1)) return wants("length variation", s.lengthVariation, "0 to below 1");
    for (const auto& [what, value] : {std::pair("tip radius", s.tipRadius), {"lean", s.lean}, {"disorder", s.disorder}, {"clump", s.clump}})
        if (!(value >= 0 && value <= 1)) return wants(what, value, "0 to 1");
    return ok();
}

/// Which materials fur grows on.
Result<std::vector<bool>> chooseMaterials(const MeshScene& scene, const std::string& filter)
{
    std::vector<bool> chosen(scene.materials.size());
    for (size_t i = 0; i < chosen.size(); ++i) chosen[i] = filter.empty() || namesMaterial(filter, scene, i);
    if (std::find(chosen.begin(), chosen.end(), true) != chosen.end()) return chosen;
    return bad("no material " + inQuotes(filter) + "; the mesh has " + listMaterials(scene));
}

struct Triangle {
    uint32_t mesh, index;
    double areaBefore; // of all triangles in front of this one
};

struct Root {
    glm::vec3 position, normal;
    glm::vec4 color;
};

/// Twice the area along the normal. In f64: edges of an f32 mesh can neither overflow nor vanish in it.
glm::dvec3 areaVector(const TriangleMesh& mesh, const glm::uvec3& t)
{
    const glm::dvec3 a(mesh.positions[t.x]);
    return glm::cross(glm::dvec3(mesh.positions[t.y]) - a, glm::dvec3(mesh.positions[t.z]) - a);
}

/// The surface at barycentric weights of one triangle.
Root rootAt(const MeshScene& scene, const TriangleMesh& mesh, const glm::uvec3& t, const glm::vec3& weights)
{
    const auto at = [&](const auto& rows) { return rows[t.x] * weights.x + rows[t.y] * weights.y + rows[t.z] * weights.z; };
    Root root;
    root.position = at(mesh.positions);
    root.normal = glm::vec3(glm::normalize(areaVector(mesh, t)));
    if (!mesh.normals.empty()) { // unless they point behind the triangle
        const glm::vec3 shading = at(mesh.normals);
        const float size = glm::length(shading);
        if (glm::dot(shading, root.normal) > 0.1f * size && std::isfinite(size)) root.normal = shading / size;
    }
    const MeshMaterial& material = scene.materials[size_t(mesh.material)];
    root.color = material.baseColor;
    if (const TextureSlot& slot = material.baseColorTexture; slot && !mesh.texcoords[slot.texcoord].empty())
        root.color *= stage::sampleTexture(scene.textures[size_t(slot.texture)],
                                           slot.uvScaleRotate * at(mesh.texcoords[slot.texcoord]) + slot.uvOffset, true);
    if (!mesh.colors.empty()) root.color *= at(mesh.colors);
    root.color = glm::clamp(root.color, 0.0f, 1.0f);
    return root;
}

glm::vec3 randomInBall(Random& random)
{
    const float z = 2 * random.uniform() - 1, phi = 2 * kPi * random.uniform(), r = std::sqrt(1 - z * z);
    return std::cbrt(random.uniform()) * glm::vec3(r * std::cos(phi), r * std::sin(phi), z);
}

glm::vec3 inPlane(const glm::vec3& v, const glm::vec3& normal) { return v - normal * glm::dot(v, normal); }

/// The two fields over space that neighbours share: waves and tufts.
class Grooming {
public:
    explicit Grooming(const FurSettings& s) : tuft_(0.5f * s.length), seed_(s.seed)
    {
        Random random(s.seed, 0x67726f6f6dull);
        for (Wave& w : waves_) {
            const glm::vec3 k = randomInBall(random);
            w = {k * (2 * kPi / (4 * s.length)), randomInBall(random), 2 * kPi * random.uniform()}; // four lengths or more from crest to crest
        }
    }

    glm::vec3 wave(const glm::vec3& p) const // of length about 1
    {
        glm::vec3 sum(0.0f);
        for (const Wave& w : waves_) sum += w.amplitude * std::sin(glm::dot(w.vector, p) + w.phase);
        return sum;
    }

    /// The nearest of one jittered point per grid cell.
    glm::vec3 tuftCenter(const glm::vec3& p) const
    {
        const glm::vec3 cell = glm::floor(p / tuft_);
        glm::vec3 best = p;
        float bestDistance = INFINITY;
        for (int i = 0; i < 27; ++i) {
            const glm::vec3 c = cell + glm::vec3(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1); // + turns -0 into 0: one name per cell
            Random random(seed_, fnv1a(&c, sizeof c));
            const glm::vec3 center = (c + glm::vec3(random.uniform(), random.uniform(), random.uniform())) * tuft_;
            const glm::vec3 d = center - p;
            if (const float distance = glm::dot(d, d); distance < bestDistance) bestDistance = distance, best = center;
        }
        return best;
    }

private:
    struct Wave {
        glm::vec3 vector, amplitude;
        float phase;
    };
    Wave waves_[5];
    float tuft_;
    uint64_t seed_;
};

float curveLength(const glm::vec3 (&p)[4])
{
    constexpr int kSteps = 24; // chords fall short of a quarter circle by 2e-4
    glm::vec3 before = p[0];
    float sum = 0;
    for (int i = 1; i <= kSteps; ++i) {
        const float t = float(i) / kSteps, s = 1 - t;
        const glm::vec3 at = s * s * s * p[0] + 3 * s * s * t * p[1] + 3 * s * t * t * p[2] + t * t * t * p[3];
        sum += glm::length(at - before);
        before = at;
    }
    return sum;
}

void appendStrand(const Root& root, const FurSettings& s, const Grooming& grooming, Random& random, HairStrands& out)
{
    const float length = s.length * (1 - s.lengthVariation * random.uniform());
    const glm::vec3& n = root.normal;
    const glm::vec3 stray = inPlane(randomInBall(random), n) * s.disorder;
    const glm::vec3 comb = inPlane(glm::vec3(0, -1, 0) + 0.7f * grooming.wave(root.position), n);
    const glm::vec3 first = glm::normalize(n + 0.5f * stray + 0.3f * s.lean * comb);
    const glm::vec3 last = glm::normalize(n + 1.5f * stray + 2.0f * s.lean * comb); // all parts beside n are in the tangent plane: never inwards
    const float third = length / 3;
    glm::vec3 p[4] = {glm::vec3(0.0f), third * first, third * (first + glm::normalize(first + last)), glm::vec3(0.0f)};
    p[3] = p[2] + third * last;
    if (s.clump > 0) {
        const glm::vec3 together = s.clump * inPlane(grooming.tuftCenter(root.position) - root.position, n);
        p[2] += 0.4f * together;
        p[3] += together;
    }
    const float stretch = length / curveLength(p);
    for (int i = 0; i < 4; ++i)
        out.controlPoints.emplace_back(root.position + stretch * p[i], s.radius * (1 + (s.tipRadius - 1) * float(i) / 3));
    out.colors.emplace_back(root.color);
}

} // namespace

Result<HairStrands> growFur(const MeshScene& scene, const FurSettings& settings)
{
    if (Status valid = checkSettings(settings); !valid) return valid.error();
    auto chosen = chooseMaterials(scene, settings.material);
    if (!chosen) return chosen.error();

    std::vector<Triangle> triangles;
    double area = 0;
    for (size_t m = 0; m < scene.meshes.size(); ++m) {
        const TriangleMesh& mesh = scene.meshes[m];
        if (!(*chosen)[size_t(mesh.material)]) continue;
        for (size_t i = 0; i < mesh.triangles.size(); ++i) {
            const double size = glm::length(areaVector(mesh, mesh.triangles[i]));
            if (!(size > 0 && std::isfinite(size))) continue; // no normal to grow along
            triangles.push_back({uint32_t(m), uint32_t(i), area});
            area += 0.5 * size;
        }
    }
    if (triangles.empty()) return bad("the chosen surface has no area; choose another material or leave the material out");

    const double wanted = double(settings.density) * area;
    if (wanted > double(kMaxFurStrands))
        return bad(number(settings.density) + " strands per square metre on " + number(area) + " square metres are " + number(std::round(wanted)) +
                   " strands, at most " + std::to_string(kMaxFurStrands) + " can be grown; try a density below " +
                   number(std::floor(double(kMaxFurStrands) / area)) + " with thicker fibres, or choose one material");
    const auto count = size_t(std::llround(wanted));
    if (count == 0)
        return bad(number(settings.density) + " strands per square metre on " + number(area) + " square metres are none; try a density above " +
                   number(1 / area));

    HairStrands out;
    out.controlPoints.reserve(4 * count);
    out.colors.reserve(count);
    const Grooming grooming(settings);
    size_t at = 0;
    for (size_t i = 0; i < count; ++i) {
        Random random(settings.seed, i);
        const double target = (double(i) + random.uniform()) / double(count) * area;
        while (at + 1 < triangles.size() && triangles[at + 1].areaBefore <= target) ++at;
        const TriangleMesh& mesh = scene.meshes[triangles[at].mesh];
        // R2: powers of the plastic number; the unit square is folded onto the triangle.
        double u = std::fmod(0.5 + double(i) * 0.7548776662466927, 1.0), v = std::fmod(0.5 + double(i) * 0.5698402909980532, 1.0);
        if (u + v > 1) u = 1 - u, v = 1 - v;
        const Root root = rootAt(scene, mesh, mesh.triangles[triangles[at].index], {float(1 - u - v), float(u), float(v)});
        const MeshMaterial& material = scene.materials[size_t(mesh.material)];
        if (material.alphaMode == AlphaMode::kMask && root.color.a < material.alphaCutoff) continue;
        appendStrand(root, settings, grooming, random, out);
    }
    return out;
}

} // namespace nacre
