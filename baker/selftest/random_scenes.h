// Scenes in which everything that may be extreme is, at random: what no list of cases thinks of.
#pragma once

#include "selftest/scene.h"

namespace nacre::selftest {

/// The same for the same seed and index. Small: at most 24 splats and 9 x 9 pixels. Reference and float32 are both finite for all of them.
Scene randomScene(uint64_t seed, uint64_t index);

} // namespace nacre::selftest
