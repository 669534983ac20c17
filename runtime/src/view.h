// A view: what a camera makes of the instances it sees, and the steps of a draw.
#pragma once

#include "depth_raster.h"
#include "draw_list.h"
#include "gbuffer.h"
#include "gpu_order.h"
#include "instance.h"
#include "order.h"
#include "tile_raster.h"

#include <unordered_map>

namespace nacre {

class Stopwatch;

class View {
public:
    explicit View(Context& context) : context_(context), list_(context), gbuffer_(context), gpuOrder_(context), tiles_(context), depth_(context) {}

    Failure draw(const NacreDrawDesc& desc, std::span<const std::shared_ptr<Instance>> instances);
    /// Depth alone.
    Failure drawDepth(const NacreDrawDesc& desc, std::span<const std::shared_ptr<Instance>> instances);
    /// Ahead of draws: their programs and, with `desc`, passes and order.
    Failure prepare(const NacreDrawDesc* desc, std::span<const std::shared_ptr<Instance>> instances, int mostLights);
    const NacreDrawStats& stats() const { return stats_; }
    /// What was kept of an instance that is gone.
    void forget(uint32_t instanceSerial);

    Handle handle;
    uint32_t mask = ~0u;

private:
    /// An instance in this view.
    struct Entry {
        Instance* instance = nullptr; // of the draw that runs
        std::unique_ptr<ViewModel> model;
        ListRows rows;
        InstanceFrame frame, projected{};
        uint64_t drawnIn = 0, doneIn = 0, projectedIn = 0;  // draws; done: when nothing of it was outdated
        uint64_t litList = 0, projectedList = 0, projectedLooks = 0; // revisions
        bool projectedLit = false;
    };

    Failure update(const ViewFrame& frame, uint64_t relightBudget, std::span<const std::shared_ptr<Instance>> instances, GlStateGuard& state, Stopwatch& watch);
    Failure collect(const ViewFrame& frame, std::span<const std::shared_ptr<Instance>> instances);
    Failure updateShadows();
    Failure relight(uint64_t budget);
    void begin(GlStateGuard& state);
    Failure project(const ViewFrame& frame, bool casters);
    Failure sort(const ViewFrame& frame);
    Failure sortOnGpu(std::span<const OrderInstance> instances, const OrderCamera& camera);
    Failure projectProgram(const Program** program);
    Failure splatProgram(const Program** program);
    Failure raster(const ViewFrame& frame, bool depthTest, GlStateGuard& state);
    Failure rasterQuads(const ViewFrame& frame, bool depthTest, GlStateGuard& state);
    ViewLights collectLights(const ViewFrame& frame) const;
    Failure gather(const ViewFrame& frame);
    Failure rasterShaded(const ViewFrame& frame, bool depthTest, GlStateGuard& state);

    Context& context_;
    DrawList list_;
    Gbuffer gbuffer_;
    Order order_;
    GpuOrder gpuOrder_;
    TileRaster tiles_;
    DepthRaster depth_;
    std::unordered_map<uint32_t, Entry> entries_; // by serial of the instance
    std::vector<Entry*> collected_, drawn_;       // of this draw, in its order: all, and those with splats in the frame
    ViewFrame projectedFor_;
    bool projectedCasters_ = false;               // for depth alone
    uint64_t projectedRevision_ = 0, orderedIn_ = 0; // of the list
    ViewLights lights_;
    ProgramOnce projectProgram_, splatProgram_;
    NacreDrawStats stats_{};
};

} // namespace nacre
