// Who is photographed from where under which lights: the stage's own plan, or that of another dataset.
#pragma once

#include "base/hash.h"
#include "base/image.h"
#include "dataset/olat_dataset.h"
#include "light_stage/placement.h"
#include "light_stage/capture_plan.h"
#include "synth_arguments.h"

#include <optional>
#include <string>
#include <vector>

namespace nacre::cli {

/// A file of the dataset that is not an image: copied, or else made.
struct EnvironmentFile {
    std::string source, name;
    Image (*make)() = nullptr;
};

struct StageWork {
    OlatDataset plan; // environment paths are those of `maps`, in the output folder
    std::vector<EnvironmentFile> maps;
    std::string likeText; // what the plan was copied from, for the settings
};

/// The options of the stage, read and checked.
Status readStageOptions(SynthArguments& args);
/// Whether a map of --environment can be read; warns about its shape.
Status checkMap(const std::string& path);
void warnIfCut(const StageOptions& stage);

/// The plan of the stage, all splits; a phone has a train split of its own. `stage.environments` become paths in the output folder.
StageWork planOwn(const SynthArguments& args, const Placement& placement, const std::optional<CaptureOptions>& capture);
/// The plan of another dataset, whole.
Result<StageWork> planLike(const SynthArguments& args);
Status keepSplits(OlatDataset& plan, const std::vector<std::string>& wanted);

Result<uint64_t> hashMap(const EnvironmentFile& file);
/// Writes the maps that the plan uses and that are not there yet.
Status writeMaps(const std::string& folder, const OlatDataset& plan, const std::vector<EnvironmentFile>& maps);

template <class T>
uint64_t hashOf(const std::vector<T>& values, uint64_t hash)
{
    const uint64_t count = values.size();
    return fnv1a(values.data(), values.size() * sizeof(T), fnv1a(&count, sizeof count, hash));
}
std::string hexText(uint64_t hash);

} // namespace nacre::cli
