#include "eval/components.h"

#include <algorithm>

namespace nacre {

constexpr size_t kMostImages = 16; // the share of a material hardly depends on the view

Result<std::optional<double>> scatteredShare(const OlatSplit& split, const EvalResult& evaluated, SplatRenderer& renderer)
{
    SplatEdit none;
    none.target = EditTarget::kResidual;
    for (float& v : none.value) v = 0;
    if (Status s = renderer.setEdits({&none, 1}); !s) {
        if (s.error().code == ErrorCode::kUnsupported) return std::optional<double>();
        return s.error();
    }
    double all = 0, surface = 0;
    Status drawn = ok();
    const size_t count = std::min(evaluated.indices.size(), kMostImages);
    for (size_t k = 0; k < count && drawn; ++k) {
        const size_t i = k * evaluated.indices.size() / count;
        const OlatImage& source = split.images[evaluated.indices[i]];
        const auto lights = rendererLights(source.light);
        const auto image = lights ? renderer.render(split.cameras[source.camera], *lights) : lights.error();
        if (!image) drawn = image.error();
        else all += evaluated.luminance[i], surface += totalLuminance(*image);
    }
    if (Status s = renderer.setEdits({}); !s) return s.error();
    if (!drawn) return drawn.error();
    return std::optional<double>(all > 0 ? (all - surface) / all : 0.0);
}

} // namespace nacre
