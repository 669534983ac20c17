// Where the lights of a capture really stood, and how bright they were: small corrections, found from the images while the splats train.
//
// Each distinct light has three unknowns x: the logarithm of its gain, and a turn about the object's centre as a tangent vector in radians
// (a point light keeps its distance). A view of the light gives the error r = Γ(reference) - Γ(render), in display values, and its
// derivatives J with respect to x: the render itself for the gain, differences of renders under displaced lights for the turn; nothing
// needs to be known of the appearance model. x minimises
//
//   sum over views, mean over pixels and channels, of w (r - J (x - x at the view))^2  +  prior (x_k / sigma_k)^2,   w = 1 / (|r| + a little),
//
// which is an absolute error, as in the training loss, so that highlights and shadows that the splats cannot hold count little. Old views
// are forgotten exponentially, because the splats that were rendered then are gone.
//
// Splats with a coefficient per light could hold any error of a light; only what many lights force upon them is left to see. With few
// lights, or one image of each, the prior therefore keeps the corrections near zero.
//
// What all lights have in common cannot be told from the look of the object: the gains keep the geometric mean 1, and the turns contain
// no rotation of the light stage as a whole.
#pragma once

#include "dataset/olat_dataset.h"
#include "train/loss.h"

#include <functional>
#include <span>
#include <vector>

namespace nacre {

/// What is known of one light. Doubles only, without padding: checkpoints hold it as it stands.
struct LightEvidence {
    double x[3] = {0, 0, 0};       // the correction: log gain, turn along the two tangents
    double hessian[6] = {};        // sums over views of the mean of w J_i J_k: 00, 01, 02, 11, 12, 22
    double gradient[3] = {};       // the same of w J_i (r + J x)
    double error = 0, recent = 0;  // sums of |r| and of 1
    double views = 0;              // so far, none forgotten
};

/// A light as the dataset has it, and how the bake has corrected it.
struct RefinedLight {
    Light stated, refined;
    double degrees = 0, gain = 1;
    int views = 0;                 // that the correction was estimated from
};

class LightRefinement {
public:
    /// The lights of `split` that are not exactly in the same place; `center` is what they turn about. `split` must outlive this object.
    LightRefinement(const OlatSplit& split, const glm::vec3& center);

    /// The light of a punctual image, corrected.
    Light light(uint32_t image) const;

    /// Renders one camera under at most kMaxLightsPerStep lights; planes as Trainer::render.
    using Render = std::function<void(std::span<const Light> lights, std::vector<float>& planes)>;
    /// Improves the lights of up to kMaxLightsPerStep images of one camera. Deterministic for any thread count.
    void observe(std::span<const uint32_t> images, const PreparedImage* const* references, const Render& render);

    std::vector<RefinedLight> lights() const;

    const std::vector<LightEvidence>& evidence() const { return evidence_; }
    bool restore(std::vector<LightEvidence> evidence); // false if it is not of these lights

private:
    struct Place {
        Light stated;
        glm::dvec3 direction, tangents[2]; // from the centre, unit
        double distance;                   // point lights only
    };
    Light moved(const Light& light, size_t place, const double x[3]) const;
    void solve(LightEvidence& e) const;
    void removeCommon();

    const OlatSplit& split_;
    glm::dvec3 center_;
    std::vector<uint32_t> placeOfImage_; // ~0u: not a punctual light
    std::vector<Place> places_;
    std::vector<LightEvidence> evidence_; // of each place
    std::vector<float> planes_, shifted_[4]; // working memory: the render; +-displaced along each tangent
};

} // namespace nacre
