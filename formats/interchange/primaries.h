// The primaries and white of an RGB space, and the way from there to linear Rec.709.
#pragma once

#include <glm/glm.hpp>

#include <optional>

namespace nacre {

/// CIE xy chromaticities; by default those of Rec.709 and sRGB (white D65).
struct Primaries {
    glm::dvec2 red{0.64, 0.33}, green{0.30, 0.60}, blue{0.15, 0.06}, white{0.3127, 0.3290};
};

bool areRec709(const Primaries& p);

/// Linear Rec.709 from linear RGB of `p`; white stays white (Bradford adaptation). Nothing if the primaries span no colour space.
std::optional<glm::dmat3> rec709From(const Primaries& p);

} // namespace nacre
