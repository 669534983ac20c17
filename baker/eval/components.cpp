#include "eval/components.h"

namespace nacre {

static Result<double> totalLuminance(const OlatSplit& split, SplatRenderer& renderer)
{
    double sum = 0;
    for (const OlatImage& source : split.images) {
        const auto lights = rendererLights(source.light);
        if (!lights) return lights.error();
        const auto image = renderer.render(split.cameras[source.camera], *lights);
        if (!image) return image.error();
        for (size_t i = 0; i < image->rgba.size(); i += 4)
            sum += 0.2126 * double(image->rgba[i]) + 0.7152 * double(image->rgba[i + 1]) + 0.0722 * double(image->rgba[i + 2]);
    }
    return sum;
}

Result<std::optional<double>> scatteredShare(const OlatSplit& split, SplatRenderer& renderer)
{
    SplatEdit none;
    none.target = EditTarget::kResidual;
    for (float& v : none.value) v = 0;
    if (Status s = renderer.setEdits({&none, 1}); !s) {
        if (s.error().code == ErrorCode::kUnsupported) return std::optional<double>();
        return s.error();
    }
    const auto surface = totalLuminance(split, renderer);
    if (Status s = renderer.setEdits({}); !s) return s.error();
    if (!surface) return surface.error();
    const auto all = totalLuminance(split, renderer);
    if (!all) return all.error();
    return std::optional<double>(*all > 0 ? (*all - *surface) / *all : 0.0);
}

} // namespace nacre
