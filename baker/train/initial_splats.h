// Splats from elsewhere that a bake starts from instead of the visual hull.
#pragma once

#include "base/result.h"
#include "splats/splat_asset.h"

#include <cstdint>
#include <string>
#include <vector>

namespace nacre {

struct InitialSplats {
    std::string name;              // of the file
    SplatCloud cloud;
    std::vector<glm::vec3> colors; // linear, up to a factor
    AssetFrame frame;              // where the cloud lies in the dataset
    uint64_t hash = 0;             // of the file
    std::vector<std::string> warnings;
};

/// A 3DGS .ply in axes and units of the dataset, or an asset that was baked from it (or from one in the same place). Errors name the file.
Result<InitialSplats> readInitialSplats(const std::string& path);

/// The splats in the frame of a dataset, of which at most `most`: those that cover most (opacity times area); with colours whose mean
/// luminance is 1. `center` and `size` say where the object is, in that frame. Error kBadInput: the splats are somewhere else.
Result<InitialSplats> placedFor(const AssetFrame& frame, const glm::vec3& center, float size, size_t most, const InitialSplats& splats);

} // namespace nacre
