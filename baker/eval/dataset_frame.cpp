// A renderer in the units of the dataset around one in those of the asset.
#include "eval/splat_renderer.h"

#include <vector>

namespace nacre {
namespace {

class DatasetFrameRenderer final : public SplatRenderer {
public:
    DatasetFrameRenderer(const AssetFrame& frame, std::unique_ptr<SplatRenderer> inner) : frame_(frame), inner_(std::move(inner)) {}

    Result<Image> render(const Camera& camera, std::span<const Light> lights) override { return inner_->render(cameraInAsset(frame_, camera), inAsset(lights)); }

    Result<RenderTimes> time(const Camera& camera, std::span<const Light> lights, int warmup, int frames) override
    {
        return inner_->time(cameraInAsset(frame_, camera), inAsset(lights), warmup, frames);
    }

    Status setEdits(std::span<const SplatEdit> edits) override
    {
        std::vector<SplatEdit> out(edits.begin(), edits.end());
        for (SplatEdit& edit : out) {
            const bool box = edit.region == EditRegion::kBox, sphere = edit.region == EditRegion::kSphere;
            if (box || sphere) move(edit.low);
            if (box) move(edit.high);
            if (sphere) edit.high[0] = float(edit.high[0] / frame_.scale);
        }
        return inner_->setEdits(out);
    }

    std::string description() const override { return inner_->description(); }

private:
    std::vector<Light> inAsset(std::span<const Light> lights) const
    {
        std::vector<Light> out;
        for (const Light& light : lights) out.push_back(lightInAsset(frame_, light));
        return out;
    }
    void move(float p[3]) const
    {
        const glm::dvec3 moved = frame_.positionInAsset({p[0], p[1], p[2]});
        for (int k = 0; k < 3; ++k) p[k] = float(moved[k]);
    }

    AssetFrame frame_;
    std::unique_ptr<SplatRenderer> inner_;
};

} // namespace

std::unique_ptr<SplatRenderer> inDatasetFrame(const AssetFrame& frame, std::unique_ptr<SplatRenderer> renderer)
{
    if (frame == AssetFrame{}) return renderer;
    return std::make_unique<DatasetFrameRenderer>(frame, std::move(renderer));
}

} // namespace nacre
