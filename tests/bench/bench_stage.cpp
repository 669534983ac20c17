// The light stage's speed: rays per second against the ray library alone on the same rays, seconds per camera, and what sharing paths
// between lights gains over one light per pass at equal noise.
//   bench_stage MESH.glb [lights=112] [size=256] [spp=64]
// The first two figures use a grey diffuse version of the mesh and the mesh as it is.
#include "base/fibonacci_sphere.h"
#include "interchange/gltf.h"
#include "light_stage/path_tracer.h"
#include "light_stage/placement.h"
#include "light_stage/ray_scene.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>

using namespace nacre;

static double secondsOf(const std::function<void()>& work)
{
    const auto start = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

static Camera benchCamera(int size)
{
    Camera c;
    c.width = c.height = size;
    c.fx = c.fy = 0.5 * size / std::tan(0.5 * 0.691);
    c.cx = c.cy = 0.5 * size;
    const glm::dvec3 eye = 3.2 * glm::normalize(glm::dvec3(-0.6, -0.7, 0.4)), back = glm::normalize(eye);
    const glm::dvec3 right = glm::normalize(glm::cross(glm::dvec3(0, 0, 1), back));
    c.worldFromCamera = glm::dmat4(glm::dvec4(right, 0), glm::dvec4(glm::cross(back, right), 0), glm::dvec4(back, 0), glm::dvec4(eye, 1));
    return c;
}

static StageScene sceneFrom(const MeshScene& mesh, bool grey)
{
    StageScene scene;
    scene.mesh = mesh;
    if (grey)
        for (MeshMaterial& m : scene.mesh.materials) {
            m = MeshMaterial{};
            m.baseColor = {0.8f, 0.8f, 0.8f, 1.0f};
            m.metallic = m.specular = 0.0f;
        }
    return scene;
}

static RenderStats render(const PathTracer& tracer, const Camera& camera, std::span<const Light> lights, int spp, int threads)
{
    RenderSettings settings;
    settings.samplesPerPixel = spp;
    settings.threads = threads;
    RenderStats stats;
    const auto images = tracer.render(camera, lights, settings, &stats);
    if (!images) std::fprintf(stderr, "%s\n", images.error().message.c_str()), std::exit(1);
    return stats;
}

/// One thread, interleaved: the renderer, and its rays alone.
static void againstBareTraversal(const char* name, const PathTracer& tracer, std::span<const Light> lights)
{
    const Camera camera = benchCamera(48);
    stage::RayLog log;
    tracer.rays().setLog(&log);
    const RenderStats stats = render(tracer, camera, lights, 16, 1);
    tracer.rays().setLog(nullptr);
    const double rays = double(stats.pathRays + stats.shadowRays + stats.walkRays);
    double full = 1e30, bare = 1e30;
    for (int i = 0; i < 5; ++i) {
        full = std::min(full, secondsOf([&] { render(tracer, camera, lights, 16, 1); }));
        bare = std::min(bare, secondsOf([&] { tracer.rays().replay(log); }));
    }
    std::printf("| %s | %zu | %.2f M | %.2f M rays/s | %.2f M rays/s | %.0f %% |\n", name, lights.size(), rays * 1e-6, rays / full * 1e-6,
                rays / bare * 1e-6, 100.0 * bare / full);
    std::fflush(stdout);
}

int main(int argc, char** argv)
{
    if (argc < 2) return std::fprintf(stderr, "bench_stage MESH.glb [lights] [size] [spp]\n"), 2;
    const int lightCount = argc > 2 ? std::atoi(argv[2]) : 112, size = argc > 3 ? std::atoi(argv[3]) : 256, spp = argc > 4 ? std::atoi(argv[4]) : 64;
    Result<MeshScene> mesh = readGltf(argv[1]);
    if (!mesh) return std::fprintf(stderr, "%s\n", mesh.error().message.c_str()), 1;
    const Placement placement = placeMesh(*mesh, HairStrands{}, {0, 0, 1}, /*fit*/ true);
    transformMesh(*mesh, placement);
    StageScene asIs = sceneFrom(*mesh, false);
    asIs.unitsPerMetre = float(placement.unitsPerMetre);
    Result<PathTracer> grey = PathTracer::create(sceneFrom(*mesh, true)), own = PathTracer::create(std::move(asIs));
    if (!grey || !own) return std::fprintf(stderr, "%s\n", (grey ? own : grey).error().message.c_str()), 1;

    std::vector<Light> lights;
    for (int i = 0; i < lightCount; ++i) {
        Light l;
        const glm::dvec3 d = fibonacciDirection(i, 2 * lightCount); // the upper half
        l.position = glm::vec3(5.0 * d);
        l.intensity = glm::vec3(60.0f);
        lights.push_back(l);
    }

    std::printf("%s: %zu triangles\n\n| scene | lights | rays | renderer | the same rays alone | share |\n|---|---|---|---|---|---|\n", argv[1],
                mesh->triangleCount());
    againstBareTraversal("grey diffuse", *grey, lights);
    againstBareTraversal("grey diffuse", *grey, std::span(lights).first(4));
    againstBareTraversal("own materials", *own, lights);
    againstBareTraversal("own materials", *own, std::span(lights).first(4));

    const Camera camera = benchCamera(size);
    std::printf("\n| scene | lights | image | spp | seconds per camera | M rays/s | noise (mean of lights) |\n|---|---|---|---|---|---|---|\n");
    const auto perCamera = [&](const char* name, const PathTracer& tracer, std::span<const Light> some) {
        const RenderStats s = render(tracer, camera, some, spp, 0);
        double noise = 0;
        for (const float n : s.noise) noise += n / double(s.noise.size());
        std::printf("| %s | %zu | %d x %d | %d | %.2f | %.1f | %.4f |\n", name, some.size(), size, size, spp, s.seconds,
                    double(s.pathRays + s.shadowRays + s.walkRays) / s.seconds * 1e-6, noise);
        std::fflush(stdout);
        return s;
    };
    for (const bool diffuse : {true, false}) {
        const PathTracer& tracer = diffuse ? *grey : *own;
        const char* name = diffuse ? "grey diffuse" : "own materials";
        const RenderStats all = perCamera(name, tracer, lights);
        perCamera(name, tracer, std::span(lights).first(4));
        // One light alone takes the same paths and gives the same pixels, so the noise is equal by construction.
        double alone = 0;
        const int picked = std::min(4, lightCount);
        for (int i = 0; i < picked; ++i)
            alone += render(tracer, camera, std::span(lights).subspan(size_t(i * lightCount / picked), 1), spp, 0).seconds / picked;
        std::printf("%s: one light per pass takes %.2f s, so %d lights %.1f s: sharing the paths is %.1f times as fast at equal noise\n", name,
                    alone, lightCount, alone * lightCount, alone * lightCount / all.seconds);
    }
    return 0;
}
