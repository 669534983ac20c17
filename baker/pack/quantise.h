// From numbers to small integers: the asset of the profile `compact` (asset/compact.h) at given steps.
//
// Numbers that go together (transport, colours, codes) are rotated to the axes along which splats differ most (principal components), weighted by
// how much each splat shows; one step for all axes then spends bits where they count (reverse water-filling), and axes that never reach
// half a step are left out. Integers are chosen by what they cost as well as by how far they are off.
#pragma once

#include "asset/compact.h"
#include "splats/splat_asset.h"

#include <string>
#include <vector>

namespace nacre {

/// Numbers that are quantised with one step.
struct QuantGroup {
    std::string name;
    std::vector<BlockTarget> targets;
    BlockTransform transform = BlockTransform::kLinear;
    std::string basis;        // name of the block it shares a basis with others of this name; empty: none
    double activeNumbers = 1; // how many bits per splat a step half as large costs
    double firstStep = 0;     // about right, in the transformed numbers
    bool exact = false;       // the first step is the only one
};

/// An asset made ready: along a space-filling curve, rotations among the equal ones nearest to none, splats that are never seen gone.
struct QuantSource {
    SplatAsset asset;               // expanded; `visibility` in it is what drawnVisibility stands for, if that is set
    std::vector<float> importance;  // per splat, mean 1
    std::vector<QuantGroup> groups;
};
QuantSource prepareForQuantising(SplatAsset asset, std::vector<float> importance, int drawnVisibility);

/// `steps`: per group.
QuantisedAsset quantise(const QuantSource& source, const std::vector<double>& steps);

} // namespace nacre
