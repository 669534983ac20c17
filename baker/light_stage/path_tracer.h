// A unidirectional path tracer that renders one camera under many lights at once: every light is evaluated from the same path
// vertices, so that an OLAT image costs little more than its shadow rays. See pass_tracer.cpp for the method.
#pragma once

#include "base/camera.h"
#include "base/image.h"
#include "base/light.h"
#include "base/result.h"
#include "dataset/olat_dataset.h"
#include "light_stage/hair_strands.h"
#include "mesh/mesh_scene.h"

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nacre {

namespace stage {
class RayScene;
}

/// What lies beneath a surface that scatters light inside (random walk after Chiang, Kutz and Burley 2016).
enum class SubsurfaceBoundary : uint8_t {
    kDiffuse,    // light enters and leaves with a cosine distribution under the material's specular layer (Chiang et al.; Cycles)
    kNone,       // index-matched: light goes straight through the surface
    kDielectric, // rough GGX dielectric of the material's roughness and ior
};

/// Makes a material a scattering volume, in place of what the glTF file says.
struct SubsurfaceOverride {
    std::string material;               // name, or "#index", or "*" for all
    glm::vec3 albedo{-1.0f};            // multiple-scattering (diffuse reflectance) albedo of a half space, [0, 1]
    glm::vec3 singleScatterAlbedo{-1.0f}; // sigma_s / sigma_t; one of the two albedos is given
    glm::vec3 meanFreePath{0.01f};      // 1 / sigma_t, in the units of the mesh file (metres)
    float anisotropy = 0.0f;            // Henyey-Greenstein g, (-1, 1)
    SubsurfaceBoundary boundary = SubsurfaceBoundary::kDiffuse;
};

/// All geometry in one world frame. `unitsPerMetre` scales lengths of materials (attenuation distance, mean free path) to it.
struct StageScene {
    MeshScene mesh;
    HairStrands hair;
    std::vector<SubsurfaceOverride> subsurface;
    float unitsPerMetre = 1.0f;
};

/// What real cameras and lamps have that a pinhole and a point have not.
struct StageOptics {
    std::optional<FileCamera> lens; // in place of the camera's intrinsics
    float beam = 0.0f;              // intensity of points falls as cos^beam from the direction in which the camera looks
};

struct RenderSettings {
    int samplesPerPixel = 64;      // rounded up to a multiple of kSamplesPerPass
    float noiseTarget = 0.0f;      // > 0: stop before samplesPerPixel when every image's estimated error is below it (RenderStats::noise)
    uint64_t seed = 0;             // same seed, camera and lights: same bytes, for any number of threads
    /// After a diffuse bounce, surfaces count as at least this rough (path space regularisation, Kaplanyan and Dachsbacher 2013): a lamp
    /// without size in a mirror seen by a diffuse surface is a caustic that no sample finds but by a rare, glaring accident. Keeps
    /// the energy but for what rougher microfacets lose, blurs caustics; at the boundary of a medium and on fibres it concerns only lamps without size
    /// (on fur, means stay within 3 %).
    /// 0 switches it off (unbiased, noisy).
    float indirectRoughness = 0.25f;
    int maxBounces = 64;           // path vertices on surfaces; Russian roulette ends most paths long before
    StageOptics optics;
    int threads = 0;               // 0: all
    const std::atomic<bool>* stop = nullptr;            // polled; a stopped render is an error kCancelled
    std::function<void(double fraction)> progress;      // called from one thread at a time, fraction of the samples done
};
constexpr int kSamplesPerPass = 16;

struct RenderStats {
    int samplesPerPixel = 0;       // taken
    std::vector<float> noise;      // per light: standard error of the object's pixels, root mean square, over their mean (0.05 at least); of
                                   // luminance as shown, 1 at most: the inside of a highlight does not count
    double seconds = 0;
    uint64_t pathRays = 0, shadowRays = 0, walkRays = 0;
    bool seesObject = true;        // something is in the picture
    double backFaces = 0;          // share of the camera rays towards the object that pass a back face of a single-sided material first
    double leakedWalks = 0;        // share of random walks that left through a hole of an open surface
    double cutWalks = 0;           // share of random walks cut at the step limit
};

/// As glTF wants it, cameras do not see the backs of materials that are not double-sided: their rays go on to what is behind. Light does:
/// backs throw shadows and reflect, so that a room or a jar that is open towards the camera is lit like one that is not. The boundary
/// of a volume has both sides for all.
class PathTracer {
public:
    /// Builds the ray acceleration structures. Errors kBadInput: an override that matches no material, an environment map that does
    /// not load (at render). Warnings name what is rendered differently from what was asked.
    static Result<PathTracer> create(StageScene scene);
    PathTracer(PathTracer&&) noexcept;
    PathTracer& operator=(PathTracer&&) noexcept;
    ~PathTracer();

    /// One image per light, linear premultiplied radiance over black, alpha = coverage. Lights of any type may be mixed; an environment
    /// without a map has its intensity's radiance all around.
    /// Errors: kBadInput (environment map), kCancelled.
    Result<std::vector<Image>> render(const Camera& camera, std::span<const Light> lights, const RenderSettings& settings,
                                      RenderStats* stats = nullptr) const;

    const std::vector<std::string>& warnings() const;
    size_t memoryBytes() const;    // of geometry, textures and acceleration structures

    const stage::RayScene& rays() const;

    struct State; // tracer_state.h
private:
    std::unique_ptr<State> state_;
    explicit PathTracer(std::unique_ptr<State> state);
};

} // namespace nacre
