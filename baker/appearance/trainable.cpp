#include "appearance/trainable.h"

namespace nacre {

std::unique_ptr<TrainableAppearance> makeBigsModel(const AppearanceOptions& options);
std::unique_ptr<TrainableAppearance> makeSssModel(const AppearanceOptions& options);

static constexpr struct {
    const char* name;
    std::unique_ptr<TrainableAppearance> (*make)(const AppearanceOptions&);
} kModels[] = {
    {"bigs", makeBigsModel},
    {"sss", makeSssModel},
};

std::unique_ptr<TrainableAppearance> makeTrainableAppearance(const std::string& model, const AppearanceOptions& options)
{
    for (const auto& m : kModels)
        if (model == m.name) return m.make(options);
    return nullptr;
}

} // namespace nacre
