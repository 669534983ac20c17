// One bake in progress: geometry and appearance of all splats, and the step that improves them on one view.
#pragma once

#include "appearance/evidence.h"
#include "appearance/trainable.h"
#include "render/raster.h"
#include "splat/geometry.h"
#include "splat/visual_hull.h"
#include "train/loss.h"
#include "train/object_region.h"

#include <array>
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

enum Stage { kStageProject, kStageBin, kStageShade, kStageBlend, kStageResolve, kStageLoss, kStageBlendBack, kStageGeometryBack, kStageShadeBack, kStageCount };
const char* stageName(Stage stage);

class Trainer {
public:
    Trainer(const TrainerOptions& options, std::unique_ptr<TrainableAppearance> appearance);

    /// Splats at the points, `spacing` apart: discs across the normals, or balls if not `flat`.
    void initialize(std::span<const OrientedPoint> points, float spacing, bool flat, float opacity = 0.5f);

    /// Splats as they are, each `tints` times the brightness of a new one.
    void initialize(const SplatCloud& cloud, std::span<const glm::vec3> tints);

    /// Where a step stands in the bake.
    struct Moment {
        int step = 1;        // from 1
        double progress = 0; // [0, 1]: of the bake; what is in use depends on it
        double rate = 1;     // scales all learning rates
    };
    /// TrainableAppearance::prepareStep: call before a step that one may want to give up.
    bool prepareStep(double progress, const std::function<bool()>& goOn) { return appearance_->prepareStep(progress, geometry_.activated, goOn); }
    /// One camera under up to kMaxLightsPerStep lights. splatErrors, if given, [count()]: adds the squared error of the object's pixels
    /// before the step, each pixel's shared out among the splats by their blending weights.
    LossStats step(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references, const Moment& moment,
                   double* splatErrors = nullptr);

    /// Renders without learning; planes as rasterForward, three per light plus alpha.
    void render(const Camera& camera, std::span<const Light> lights, std::vector<float>& planes);

    /// What the images of one view show beyond the render without highlights.
    ViewEvidence evidence(const Camera& camera, std::span<const Light> lights, const PreparedImage* const* references);
    void useEvidence(double progress, std::span<const ViewEvidence> views) { appearance_->useEvidence(progress, geometry_.activated, views); }

    /// Splits the splats whose image gradient is largest: into the places of those that contribute nothing, and `grow` new ones.
    void densify(size_t grow);
    /// Drops the splats that are too faint to be drawn or have contributed to no pixel since resetStatistics. Returns how many.
    size_t prune();
    void resetStatistics();
    /// Cuts off everything but the object.
    ObjectCut keepObject(const ObjectRegion& region, const std::vector<Camera>& cameras);

    size_t count() const { return geometry_.count(); }
    TrainableAppearance& appearance() { return *appearance_; }
    void exportTo(SplatAsset& asset) const;
    void save(ByteWriter& out) const;
    bool load(ByteReader& in);

    std::array<double, kStageCount> stageSeconds{}; // accumulated by step()
    size_t lastVisible = 0, lastActive = 0, lastEntries = 0; // of the last step; entries are (splat, tile) pairs
    size_t lastBlocks() const;                               // its (splat, 4x4 block) pairs, counted here

private:
    VisibleView project(const Camera& camera, int channels);
    void shareOutErrors(const Camera& camera, const float* image, const PreparedImage* const* references, int imageCount, double* splatErrors);
    void splitSplat(size_t parent, size_t child);
    void permute(const std::vector<uint32_t>& order);
    void keepRows(const std::vector<uint32_t>& kept, const std::vector<uint32_t>& dropped);
    SplatCloud cloud() const;

    TrainerOptions options_;
    std::unique_ptr<TrainableAppearance> appearance_;
    SplatGeometry geometry_;
    /// Colour that does not depend on the light, with Adam's state: logarithms. Empty: none.
    struct AmbientRow { std::array<float, 3> value, momentum, second; };
    std::vector<AmbientRow> ambient_;
    bool hasAmbient(size_t lights) const { return !ambient_.empty() && appearance_->channels(int(lights)) == 3 * int(lights); }
    void addAmbient(size_t lights);
    void stepAmbient(size_t lights, float rate);
    void resizeAmbient(size_t count);

    std::vector<float> gradientSum_; // per splat, since resetStatistics: |d loss / d mean| in pixels, and how often it was active
    std::vector<uint32_t> seen_;

    // Working memory of a step, reused.
    View<float> view_{};
    TileBuilder builder_;
    RasterScratch rasterScratch_;
    ImageLoss loss_;
    std::vector<uint32_t> visibleFromSplat_;
    std::vector<uint8_t> active_;
    std::vector<float> colors_, dColors_, dDistances_, planes_, dImage_;
    std::vector<ScreenGradient<float>> dSplats_;
};

} // namespace nacre
