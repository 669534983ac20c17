// The texts and the JSON file by which `nacre synth` takes scattering materials, sizes and counts.
#pragma once

#include "base/result.h"
#include "light_stage/fur.h"
#include "light_stage/path_tracer.h"
#include "scene_spec.h"

#include <string>
#include <vector>

namespace nacre::cli {

/// MATERIAL:albedo=r,g,b:mfp=r,g,b:g=0:boundary=diffuse. One number stands for three channels; alpha= in place of albedo= gives the
/// single-scattering albedo. The name may contain colons.
Result<SubsurfaceOverride> parseSubsurface(const std::string& text);

/// [{"material": ..., "albedo": [r, g, b] or number, "mfp": ..., "g": ..., "boundary": ...}, ...], or one such object.
Result<std::vector<SubsurfaceOverride>> readSubsurfaceFile(const std::string& path);

/// Error if the override names no material of the mesh ("name", "#index", "*"); it lists those there are.
Status checkMaterial(const SubsurfaceOverride& override, const MeshScene& mesh);

/// One line that says everything, in the form of --sss: for comparing settings.
std::string textOf(const SubsurfaceOverride& override);

/// DENSITY,LENGTH,RADIUS[:material=NAME][:variation=V][:tip=T][:lean=L][:disorder=D][:clump=C], see FurSettings; metres.
Result<FurSettings> parseFur(const std::string& text);
std::string textOf(const FurSettings& fur);

/// "256": that many samples; "4x": so many times `trainSamples`.
Result<int> parseTestSamples(const std::string& text, int trainSamples);

/// "256" (square) or "640x480"; each side 1 to 8192.
Result<PixelSize> parseStageSize(const std::string& text);

/// "all" (0) or a number from 1.
Result<int> parseLightsPerCamera(const std::string& text);

/// "2/8": shard 2 of 8.
struct Shard { int index = 1, count = 1; };
Result<Shard> parseShard(const std::string& text);

} // namespace nacre::cli
