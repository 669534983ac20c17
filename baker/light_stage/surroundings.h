// What else is in view where somebody photographs an object at home.
#pragma once

#include "light_stage/path_tracer.h"

namespace nacre {

/// Puts a table under the object, which has the unit sphere as its bounding sphere and +Z up, and both into a room without a ceiling: floor and four
/// walls. All have patterns, as what a camera finds its place by.
void addSurroundings(StageScene& scene);

} // namespace nacre
