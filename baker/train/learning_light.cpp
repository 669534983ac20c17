#include "train/learning_light.h"

#include "dataset/normalise.h"

#include <algorithm>
#include <iterator>

namespace nacre {

// Apparent reflectance (normalise.h). bigs is linear in light, but its start and its steps are not. Short bakes from few images learn
// bright objects best (bunny_wax_tiny, 1000 steps, 1.5 k splats, masked, for 0.023, 0.12, 0.23 and 0.46: 24.6, 25.5, 26.8 and 27.0 dB),
// long ones do not (0.2 against 0.45: bunny_wax, 6000 steps, 30.14 and 30.04; knob_marble, 3000 steps, 28.30 and 28.14): between the two.
static constexpr double kLearntReflectance = 0.3;
// The base colour of sss ends at 1, which few objects reach: from here on it is the lights that are stated too dark. (Likewise, for 0.23 and
// 0.46: 26.9 and 25.4 dB.) Dark objects are left as they are: a sheen of 4 % on black is not one of 40 % on grey.
static constexpr double kBrightestSss = 0.4;

static bool isLinear(const std::string& model) { return model == "bigs"; }

Result<double> learningGain(const OlatDataset& dataset, const std::string& model)
{
    const OlatSplit* train = dataset.find("train");
    if (!train) return 1.0;
    ImageCache images(dataset, 0); // each is needed once
    const auto reflectance = apparentReflectance(dataset, *train, frameCameras(dataset.splits), images);
    if (!reflectance) return reflectance.error();
    if (!*reflectance) return 1.0;
    if (isLinear(model)) return **reflectance / kLearntReflectance;
    return **reflectance > kBrightestSss ? **reflectance / kUsualReflectance : 1.0;
}

OlatDataset underGain(OlatDataset dataset, double gain)
{
    const AssetFrame step{1, glm::dvec3(0.0), gain};
    dataset.frame.lightGain *= gain;
    for (OlatSplit& split : dataset.splits)
        for (OlatImage& image : split.images) image.light = lightInAsset(step, image.light);
    return dataset;
}

void absorbGain(SplatAsset& asset, double gain, const AssetFrame& stated)
{
    if (!isLinear(asset.model)) return;
    asset.frame = stated;
    constexpr struct { const char* name; size_t first; } kColors[] = {{"rho", 0}, {"s", 0}, {"tInd", 0}, {"lobe", 4}, {"forward", 1}}; // from which component on
    for (Channel& channel : asset.channels) {
        const auto color = std::find_if(std::begin(kColors), std::end(kColors), [&](const auto& c) { return channel.name == c.name; });
        if (color == std::end(kColors)) continue;
        for (size_t i = 0; i < channel.values.size(); ++i)
            if (i % channel.components >= color->first) channel.values[i] = float(channel.values[i] * gain);
    }
}

} // namespace nacre
