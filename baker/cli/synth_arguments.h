// What the options of nacre synth say.
#pragma once

#include "light_stage/path_tracer.h"
#include "light_stage/stage_plan.h"

#include <string>
#include <vector>

namespace nacre::cli {

struct SynthArguments {
    std::string mesh, output, like, json, subsurfaceFile, fur, capture;
    std::string lightsPerCamera = "4", layout = "rings", hemisphere = "upper", size, testSamples = "4x", convention = "canonical", shard = "1/1";
    std::vector<std::string> splits, subsurface;
    StageOptions stage;
    int samples = 64, threads = 0;
    double noise = 0, indirectRoughness = double(RenderSettings().indirectRoughness);
    bool keepScale = false, hasCameras = false;
};

} // namespace nacre::cli
