// From a ray hit to what scatters there: geometry, textures and the glTF material become a SurfaceBsdf and, beneath it, a medium.
#pragma once

#include "base/result.h"
#include "light_stage/medium.h"
#include "light_stage/path_tracer.h"
#include "light_stage/ray_scene.h"
#include "light_stage/surface_bsdf.h"

#include <string>
#include <vector>

namespace nacre::stage {

/// What a material means to the integrator, beyond its surface lobes.
struct Body {
    bool scatters = false;     // kDiffuse: a random walk starts beneath the surface
    float walkShare = 1.0f;    // of the diffuse light that goes in; the rest is reflected by the surface
    bool boundary = false;     // the surface leads into `medium` (kNone and kDielectric)
    bool invisible = false;    // kNone: light passes straight through the surface
    bool albedoFromBaseColor = false; // the walk's colour is the base colour at the point of entry
    glm::vec3 diffuseAlbedo{0.0f};    // of the walk, for choosing lobes
    Medium medium;
};

/// One point of a surface, seen from `wo`.
struct SurfacePoint {
    glm::vec3 position, geometricNormal; // unit, out of the closed side
    glm::vec3 lift{0.0f};                // to the surface that the vertex normals describe, where that bulges, else 0
    int material = 0;
    bool fromInside = false;
    SurfaceBsdf bsdf;
    float chanceSubsurface = 0.0f;
    float opacity = 1.0f;                // alpha after mask and blend
    Medium walk;                         // if chanceSubsurface > 0
    glm::vec3 walkWeight{0.0f};          // what enters the walk; leaving multiplies by 1 - specular F(cos)
};

class SurfaceTable {
public:
    /// Checks and repairs bodies (orientation, holes: `warnings`). Errors kBadInput: an override that matches no material.
    static Result<SurfaceTable> create(StageScene& scene, std::vector<std::string>& warnings);

    const Body& body(int material) const { return bodies_[size_t(material)]; }
    bool seeThrough() const { return seeThrough_; } // some surface lets straight light through: alpha, or an index-matched boundary
    /// `leastAlpha`: microfacets are at least that rough, but for the boundary of a medium: light inside meets it many times, and rough
    /// microfacets (single scattering) lose a little each time.
    SurfacePoint evaluate(const MeshScene& scene, const RayHit& hit, const glm::vec3& wo, float leastAlpha = kMinAlpha) const;

private:
    std::vector<Body> bodies_;
    bool seeThrough_ = false;
};

/// 1 - specular F: what a walk keeps on its way out.
inline float walkExitFactor(const SurfaceBsdf& surface, float cosine)
{
    return 1.0f - maxOf(surface.specular * surface.dielectricFresnel(cosine));
}

} // namespace nacre::stage
