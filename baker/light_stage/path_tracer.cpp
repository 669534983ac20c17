// The integrator of the light stage: the scene prepared once, then passes over the pixels of a camera on all threads. What a pass does:
// pass_tracer.cpp.
#include "light_stage/path_tracer.h"

#include "base/hash.h"
#include "light_stage/film.h"
#include "light_stage/pass_tracer.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <mutex>

namespace nacre {

using namespace stage;

// Both roughnesses of a fibre seen by another, towards lamps without size. Measured on brown fur (beta 0.3) under a lamp: half of the
// variance, means within 3 %; at 0.6 a fifth of it, but means 10 to 20 % off.
static constexpr float kIndirectFiberRoughness = 0.4f;

PathTracer::PathTracer(std::unique_ptr<State> state) : state_(std::move(state)) {}
PathTracer::PathTracer(PathTracer&&) noexcept = default;
PathTracer& PathTracer::operator=(PathTracer&&) noexcept = default;
PathTracer::~PathTracer() = default;
const RayScene& PathTracer::rays() const { return *state_->rays; }
const std::vector<std::string>& PathTracer::warnings() const { return state_->warnings; }

Result<PathTracer> PathTracer::create(StageScene scene)
{
    auto state = std::make_unique<State>();
    state->scene = std::move(scene);
    Result<SurfaceTable> surfaces = SurfaceTable::create(state->scene, state->warnings);
    if (!surfaces) return surfaces.error();
    state->surfaces = std::make_unique<SurfaceTable>(std::move(*surfaces));
    const HairStrands& hair = state->scene.hair;
    state->fiber = makeHairFiber(hair.longitudinalRoughness, hair.azimuthalRoughness, hair.cuticleTiltRadians, hair.ior);
    state->indirectFiber = makeHairFiber(std::max(hair.longitudinalRoughness, kIndirectFiberRoughness),
                                         std::max(hair.azimuthalRoughness, kIndirectFiberRoughness), hair.cuticleTiltRadians, hair.ior);
    state->rays = std::make_unique<RayScene>(state->scene.mesh, state->scene.hair, 0);
    const RayScene::Body& all = state->rays->everything();
    state->offset = 4e-6f * std::max(maxOf(glm::abs(all.lower)), maxOf(glm::abs(all.upper)));
    for (size_t i = 0; i < state->scene.mesh.materials.size(); ++i)
        if (state->surfaces->body(int(i)).scatters) state->rays->prepareBody(int(i));
    return PathTracer(std::move(state));
}

size_t PathTracer::memoryBytes() const
{
    size_t bytes = state_->rays->memoryBytes();
    for (const TriangleMesh& m : state_->scene.mesh.meshes)
        bytes += m.positions.size() * 12 + m.normals.size() * 12 + m.tangents.size() * 16 + m.texcoords[0].size() * 8 +
                 m.texcoords[1].size() * 8 + m.colors.size() * 16 + m.triangles.size() * 12;
    for (const MeshTexture& t : state_->scene.mesh.textures) bytes += t.rgba.size();
    return bytes + state_->scene.hair.controlPoints.size() * 16;
}

Result<std::vector<Image>> PathTracer::render(const Camera& camera, std::span<const Light> lights, const RenderSettings& settings,
                                              RenderStats* stats) const
{
    const auto start = std::chrono::steady_clock::now();
    Result<LightSet> set = gatherLights(lights);
    if (!set) return set.error();
    for (LightSet::Delta& light : set->deltas)
        if (light.point) light.axis = -glm::vec3(camera.worldFromCamera[2]), light.beam = settings.optics.beam;
    const size_t pixels = size_t(camera.width) * size_t(camera.height), lightCount = lights.size();
    const int passes = std::max(1, (settings.samplesPerPixel + kLanes - 1) / kLanes);
    Film film(pixels, lightCount);

    // The camera is part of the seed, so that two cameras do not share their noise.
    const uint64_t key = fnv1a(&camera.worldFromCamera, sizeof camera.worldFromCamera, fnv1a(&settings.seed, sizeof settings.seed));
    const uint32_t imageSeed = hashBits(uint32_t(key) ^ hashBits(uint32_t(key >> 32)));

    tbb::enumerable_thread_specific<Counters> counters;
    std::mutex reporting;
    size_t pixelsDone = 0;
    const auto stopped = [&] { return settings.stop && settings.stop->load(std::memory_order_relaxed); };

    const auto renderPasses = [&](int first, int last) {
        const double before = double(first) / passes, share = double(last - first) / passes;
        pixelsDone = 0;
        tbb::parallel_for(tbb::blocked_range<size_t>(0, pixels, 64), [&](const tbb::blocked_range<size_t>& range) {
            if (stopped()) return;
            PassTracer tracer(*state_, *set, settings);
            std::vector<float> radiance(lightCount * 3);
            for (size_t p = range.begin(); p < range.end(); ++p) {
                const uint32_t pixelSeed = hashCombine(imageSeed, uint32_t(p));
                const PixelRays rays = raysOf(camera, settings.optics.lens, int(p % size_t(camera.width)), int(p / size_t(camera.width)));
                for (int pass = first; pass < last; ++pass) {
                    std::fill(radiance.begin(), radiance.end(), 0.0f);
                    const float hits = tracer.trace(camera, rays, hashCombine(pixelSeed, uint32_t(pass)), radiance.data());
                    film.add(p, radiance.data(), hits);
                }
            }
            counters.local().add(tracer.counters);
            if (settings.progress) {
                std::lock_guard lock(reporting);
                pixelsDone += range.size();
                settings.progress(before + share * double(pixelsDone) / double(pixels));
            }
        });
    };

    int done = 0;
    std::vector<float> noise;
    tbb::task_arena arena(settings.threads > 0 ? settings.threads : tbb::task_arena::automatic);
    while (done < passes && !stopped()) {
        // Without a target all passes run at once; with one, the samples grow by half between checks.
        const int next = settings.noiseTarget > 0.0f ? std::min(passes, std::max(done + done / 2, done + 4)) : passes;
        arena.execute([&] { renderPasses(done, next); });
        done = next;
        noise = film.noise(done);
        if (settings.noiseTarget > 0.0f && *std::max_element(noise.begin(), noise.end()) <= settings.noiseTarget) break;
    }
    if (stopped()) return Error{ErrorCode::kCancelled, "rendering was stopped"};

    std::vector<Image> images = film.images(camera.width, camera.height, done);
    if (stats) {
        Counters all;
        for (const Counters& c : counters) all.add(c);
        stats->samplesPerPixel = done * kLanes;
        stats->noise = std::move(noise);
        stats->pathRays = all.pathRays, stats->shadowRays = all.shadowRays, stats->walkRays = all.walkRays;
        stats->seesObject = all.cameraHits > 0;
        stats->backFaces = all.backFaces ? double(all.backFaces) / double(all.cameraHits + all.holes) : 0.0;
        stats->leakedWalks = all.walks ? double(all.leaked) / double(all.walks) : 0.0;
        stats->cutWalks = all.walks ? double(all.cut) / double(all.walks) : 0.0;
        stats->seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    }
    return images;
}

} // namespace nacre
