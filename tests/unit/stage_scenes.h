// Small analytic scenes for the path tracer's tests.
#pragma once

#include "base/image.h"
#include "interchange/exr.h"
#include "light_stage/path_tracer.h"

#include <doctest/doctest.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <string>

#include <unistd.h>

namespace nacre::test {

/// Diffuse only: no specular layer.
inline MeshMaterial lambert(const glm::vec3& albedo)
{
    MeshMaterial m;
    m.name = "m";
    m.baseColor = {albedo.r, albedo.g, albedo.b, 1.0f};
    m.metallic = 0.0f;
    m.specular = 0.0f;
    return m;
}

/// z = 0, facing +Z, half a side `half`.
inline TriangleMesh plane(float half, int material = 0)
{
    TriangleMesh m;
    m.material = material;
    m.positions = {{-half, -half, 0}, {half, -half, 0}, {half, half, 0}, {-half, half, 0}};
    m.triangles = {{0, 1, 2}, {0, 2, 3}};
    return m;
}

/// A box with its top at z = 0, outward winding.
inline TriangleMesh slab(float half, float depth, int material = 0)
{
    TriangleMesh m;
    m.material = material;
    for (int i = 0; i < 8; ++i) m.positions.push_back({i & 1 ? half : -half, i & 2 ? half : -half, i & 4 ? 0.0f : -depth});
    const glm::uvec4 quads[6] = {{4, 5, 7, 6}, {0, 2, 3, 1}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (const glm::uvec4& q : quads) {
        m.triangles.push_back({q.x, q.y, q.z});
        m.triangles.push_back({q.x, q.z, q.w});
    }
    return m;
}

/// An octahedron subdivided `levels` times, radius 1, smooth normals.
inline TriangleMesh sphere(int levels, float radius = 1.0f, const glm::vec3& centre = glm::vec3(0.0f), int material = 0)
{
    TriangleMesh m;
    m.material = material;
    std::vector<glm::vec3> p = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    std::vector<glm::uvec3> t = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
    for (int level = 0; level < levels; ++level) {
        std::map<std::pair<unsigned, unsigned>, unsigned> middles;
        const auto middle = [&](unsigned a, unsigned b) {
            const auto [at, added] = middles.try_emplace({std::min(a, b), std::max(a, b)}, unsigned(p.size()));
            if (added) p.push_back(glm::normalize(p[a] + p[b]));
            return at->second;
        };
        std::vector<glm::uvec3> next;
        for (const glm::uvec3& f : t) {
            const unsigned a = middle(f.x, f.y), b = middle(f.y, f.z), c = middle(f.z, f.x);
            next.insert(next.end(), {{f.x, a, c}, {f.y, b, a}, {f.z, c, b}, {a, b, c}});
        }
        t = next;
    }
    for (const glm::vec3& d : p) {
        m.positions.push_back(centre + radius * d);
        m.normals.push_back(d);
    }
    m.triangles = t;
    return m;
}

inline StageScene sceneOf(std::vector<TriangleMesh> meshes, std::vector<MeshMaterial> materials)
{
    StageScene s;
    s.mesh.meshes = std::move(meshes);
    s.mesh.materials = std::move(materials);
    return s;
}

/// Square image, looking from `eye` at `target`.
inline Camera cameraAt(const glm::dvec3& eye, const glm::dvec3& target, int size, double fovRadians)
{
    Camera c;
    c.width = c.height = size;
    c.fx = c.fy = 0.5 * size / std::tan(0.5 * fovRadians);
    c.cx = c.cy = 0.5 * size;
    const glm::dvec3 back = glm::normalize(eye - target);
    const glm::dvec3 up = std::fabs(back.z) > 0.9 ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
    const glm::dvec3 right = glm::normalize(glm::cross(up, back));
    c.worldFromCamera = glm::dmat4(glm::dvec4(right, 0), glm::dvec4(glm::cross(back, right), 0), glm::dvec4(back, 0), glm::dvec4(eye, 1));
    return c;
}

inline Light pointLight(const glm::vec3& position, float intensity)
{
    Light l;
    l.position = position;
    l.intensity = glm::vec3(intensity);
    return l;
}

inline Light directionalLight(const glm::vec3& direction, float irradiance)
{
    Light l;
    l.type = LightType::kDirectional;
    l.directionToLight = glm::normalize(direction);
    l.intensity = glm::vec3(irradiance);
    return l;
}

/// A folder of the test's own that goes away with it, with environment maps in it.
struct MapFolder {
    std::filesystem::path path = std::filesystem::temp_directory_path() / ("nacre-stage-" + std::to_string(getpid()));
    MapFolder() { std::filesystem::create_directories(path); }
    ~MapFolder() { std::filesystem::remove_all(path); }
    Light light(const Image& map, const std::string& name) const
    {
        const std::string file = (path / (name + ".exr")).string();
        REQUIRE(writeExr(map, file));
        Light l;
        l.type = LightType::kEnvironment;
        l.environmentPath = file;
        return l;
    }
    Light constant(const glm::vec3& radiance) const
    {
        Image map;
        map.width = 8, map.height = 4;
        for (int i = 0; i < 32; ++i) map.rgba.insert(map.rgba.end(), {radiance.r, radiance.g, radiance.b, 1.0f});
        return light(map, "constant");
    }
};

/// Mean of one channel over pixels that are wholly covered, and its standard error from the spread of the pixels.
struct Measured {
    double mean = 0, error = 0;
    int pixels = 0;
    /// Within the 99 % confidence interval. Where many intervals are checked, the caller says how many, for the family as a whole.
    bool is(double expected, double families = 1.0) const
    {
        const double z = families > 1.0 ? 3.5 : 2.576;
        return std::fabs(mean - expected) <= z * error + 1e-6 * std::fabs(expected); // float sums of equal values
    }
};
inline Measured measure(const Image& image, int channel)
{
    Measured m;
    double sum = 0, squares = 0;
    for (size_t p = 0; p < size_t(image.width) * size_t(image.height); ++p) {
        if (image.rgba[4 * p + 3] < 1.0f) continue;
        const double v = image.rgba[4 * p + size_t(channel)];
        sum += v, squares += v * v, m.pixels++;
    }
    if (m.pixels < 2) return m;
    m.mean = sum / m.pixels;
    m.error = std::sqrt(std::max(0.0, squares / m.pixels - m.mean * m.mean) / (m.pixels - 1));
    return m;
}

inline std::vector<Image> renderOrFail(const StageScene& scene, const Camera& camera, const std::vector<Light>& lights, int spp,
                                       RenderStats* stats = nullptr, int threads = 0, float indirectRoughness = 0.0f /* exact */)
{
    StageScene copy = scene;
    Result<PathTracer> tracer = PathTracer::create(std::move(copy));
    REQUIRE(tracer);
    RenderSettings settings;
    settings.samplesPerPixel = spp;
    settings.threads = threads;
    settings.indirectRoughness = indirectRoughness;
    Result<std::vector<Image>> images = tracer->render(camera, lights, settings, stats);
    REQUIRE(images);
    return std::move(*images);
}

} // namespace nacre::test
