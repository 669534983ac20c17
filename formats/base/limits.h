// What numbers of files and hosts may be at most.
#pragma once

namespace nacre {

/// Nothing lies, reaches or weighs more, so that squares of distances stay finite in float.
constexpr float kLargestNumber = 1e15f;

} // namespace nacre
