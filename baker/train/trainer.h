// One bake in progress: geometry and appearance of all splats, where they start, split and end; and the engine whose steps improve them.
#pragma once

#include "splat/visual_hull.h"
#include "train/object_region.h"
#include "train/step_engine.h"

#include <memory>

namespace nacre {

struct TrainerOptions {
    size_t maxSplats = 10000;
    float lowPassVariance = 0.1f;  // px^2
    float sceneSize = 1.0f;        // half-size of the object, scales the rate of positions
    std::optional<ObjectRegion> region; // of the object: few splats are spent on the surroundings
    LossOptions loss;
    bool ambient = false;          // images hold light of the surroundings, too: each splat learns how much, and it is not exported
    uint64_t seed = 1;
};

class Trainer {
public:
    Trainer(const TrainerOptions& options, std::unique_ptr<TrainableAppearance> appearance, const MakeStepEngine& makeEngine = makeCpuEngine);

    /// Splats at the points, `spacing` apart: discs across the normals, or balls if not `flat`.
    void initialize(std::span<const OrientedPoint> points, float spacing, bool flat, float opacity = 0.5f);

    /// Splats as they are, each `tints` times the brightness of a new one.
    void initialize(const SplatCloud& cloud, std::span<const glm::vec3> tints);

    using Moment = StepMoment;
    /// TrainableAppearance::prepareStep: call before a step that one may want to give up.
    bool prepareStep(double progress, const std::function<bool()>& goOn);
    /// These three as StepEngine.
    LossStats step(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references, const Moment& moment,
                   double* splatErrors = nullptr)
    {
        return engine_->step(camera, lights, references, moment, splatErrors);
    }
    void render(const Camera& camera, std::span<const Light> lights, std::vector<float>& planes) { engine_->render(camera, lights, planes); }
    ViewEvidence evidence(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references)
    {
        return engine_->evidence(camera, lights, references);
    }
    void useEvidence(double progress, std::span<const ViewEvidence> views);
    /// TrainableAppearance::leaveOut.
    void leaveOut(const std::string& part, std::span<const uint8_t> kept);

    /// Splits the splats whose image gradient is largest: into the places of those that contribute nothing, and `grow` new ones.
    void densify(size_t grow);
    /// Drops the splats that are too faint to be drawn or have contributed to no pixel since resetStatistics. Returns how many.
    size_t prune();
    void resetStatistics();
    /// LossOptions::alphaWeight from here on.
    void weighAlpha(float weight);
    /// Cuts off everything but the object.
    ObjectCut keepObject(const ObjectRegion& region, const std::vector<Camera>& cameras);

    size_t count() const { return state_->count(); }
    const TrainableAppearance& appearance() const { return *state_->appearance; }
    void exportTo(SplatAsset& asset) const;
    void save(ByteWriter& out) const;
    bool load(ByteReader& in);
    /// What save writes, to go back to after a trial.
    std::vector<std::byte> snapshot() const;
    Status restore(std::span<const std::byte> snapshot);

    StepEngine& engine() { return *engine_; }

private:
    SplatGeometry& geometry() { return state_->geometry; }
    void finishInitialize();
    void resizeAmbient(size_t count);
    void splitSplat(size_t parent, size_t child);
    void permute(const std::vector<uint32_t>& order);
    void keepRows(const std::vector<uint32_t>& kept, const std::vector<uint32_t>& dropped);
    SplatCloud cloud() const;

    void startEngine();

    TrainerOptions options_;
    MakeStepEngine makeEngine_;
    std::unique_ptr<SplatState> state_; // where it is, so that the engine finds it when the trainer moves
    std::unique_ptr<StepEngine> engine_;
};

} // namespace nacre
