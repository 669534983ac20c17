// One draw: relight, project, sort, raster, inside the host's frame.
#include "view.h"

#include "projection.h"
#include "shader_sources.h"
#include "splat_shadows.h"
#include "base/half.h"
#include "base/text.h"
#include "splats/blend.h"
#include "stopwatch.h"
#include "target.h"

#include <glm/gtc/matrix_transform.hpp>

#include <algorithm>
#include <cmath>

namespace nacre {

/// Known to be false in a build without the model that is, so that the linker drops what shades.
static bool isShaded(const Asset& asset) { return NACRE_WITH_SSS && asset.model->shadesPixels(); }

void View::forget(uint32_t serial)
{
    entries_.erase(serial);
    list_.remove(serial);
}

static bool allowed(const Instance& instance, uint32_t viewMask) { return !instance.hidden && (instance.viewMask & viewMask) != 0 && instance.asset->complete(); }

/// What this draw is to show, with a place in the list.
Failure View::collect(const ViewFrame& frame, std::span<const std::shared_ptr<Instance>> instances)
{
    collected_.clear();
    for (const std::shared_ptr<Instance>& instance : instances) {
        if (!allowed(*instance, mask)) continue;
        if (!instance->model) instance->model = instance->asset->model->makeInstance(*instance);
        Entry& entry = entries_[instance->handle.serial];
        if (entry.drawnIn == context_.passes.now()) return invalid("an instance is drawn twice in one draw; create a second one");
        entry.drawnIn = context_.passes.now();
        entry.instance = instance.get();
        entry.frame = makeInstanceFrame(frame, instance->placement);
        if (!entry.model) entry.model = instance->model->makeView();
        if (Failure f = list_.place(instance->handle.serial, instance->asset->grid.count, &entry.rows)) return f;
        collected_.push_back(&entry);
    }
    for (Entry* entry : collected_) // a later one may have made the list wider
        if (Failure f = list_.place(entry->instance->handle.serial, entry->instance->asset->grid.count, &entry->rows)) return f;
    return {};
}

/// Lights of what is drawn, and what splats hold up of them.
Failure View::updateShadows()
{
    std::vector<Instance*> receivers;
    for (const Entry* entry : drawn_) {
        if (Failure f = entry->instance->updateLights()) return f;
        receivers.push_back(entry->instance);
    }
    return context_.splatShadows->update(receivers, stats_);
}

/// Brings instances up to date as far as the budget goes, the longest outdated first.
Failure View::relight(uint64_t budget)
{
    RelightBudget relit{budget ? budget : ~uint64_t(0), &stats_};
    std::vector<Entry*> turn = drawn_;
    std::stable_sort(turn.begin(), turn.end(), [](const Entry* a, const Entry* b) { return a->doneIn < b->doneIn; });
    if (Failure f = updateShadows()) return f;
    for (Entry* entry : turn) {
        Instance& instance = *entry->instance;
        if (Failure f = instance.shadows.run(instance, stats_)) return f;
        stats_.lightsUsed += uint32_t(instance.lightCount());
        stats_.lightsSkipped += uint32_t(instance.lights.skipped);
        bool done = false;
        if (Failure f = instance.model->relight(relit, &done)) return f;
        if (done)
            if (Failure f = entry->model->relight(entry->frame, list_, entry->rows, relit, &done)) return f;
        if (done) entry->doneIn = context_.passes.now(), entry->litList = list_.revision();
    }
    return {};
}

Failure View::projectProgram(const Program** program)
{
    return projectProgram_.find(program, [&](const Program** made) { return projectionProgram(context_, made); });
}

/// Writes the records of instances that stand otherwise than in the last draw, all of them if the camera does. Casters keep their opacity
/// however small they are in the picture: many that cover a texel together would each be too faint alone.
Failure View::project(const ViewFrame& frame, bool casters)
{
    const bool all = !(projectedFor_ == frame) || projectedCasters_ != casters || projectedRevision_ != list_.revision();
    projectedFor_ = frame, projectedCasters_ = casters, projectedRevision_ = list_.revision();
    const Program* program = nullptr;
    if (Failure f = projectProgram(&program)) return f;
    bool begun = false;
    for (Entry* entry : drawn_) {
        const Instance& instance = *entry->instance;
        const bool lit = casters || entry->litList == list_.revision(); // else it has nothing to show yet
        stats_.instancesDrawn += lit;
        if (!all && entry->projectedLit == lit && entry->projected == entry->frame && entry->projectedLooks == instance.looksRevision && entry->projectedList == list_.revision() &&
            context_.passes.sure(entry->projectedIn))
            continue;
        if (!begun) {
            begun = true;
            beginProjection(*program, frame, casters);
            list_.beginProjected();
        }
        projectInstance(*program, instance, entry->frame, lit, list_, entry->rows);
        entry->projected = entry->frame, entry->projectedLooks = instance.looksRevision, entry->projectedLit = lit;
        entry->projectedList = list_.revision(), entry->projectedIn = context_.passes.now();
        stats_.projected = 1;
    }
    return {};
}

/// The eye is found through the host's matrices, which are float: it jitters by their rounding while the camera turns.
static float eyeRounding(const ViewFrame& frame) { return float(4e-7 * glm::length(frame.eye)); }

Failure View::sort(const ViewFrame& frame)
{
    std::sort(collected_.begin(), collected_.end(), [](const Entry* a, const Entry* b) { return a->rows.first < b->rows.first; });
    std::vector<OrderInstance> instances;
    for (const Entry* entry : collected_) {
        const Asset& asset = *entry->instance->asset;
        const InstanceFrame& f = entry->frame;
        instances.push_back({asset.positions.data(), asset.maxScales.data(), asset.grid.count, list_.firstIndex(entry->rows), f.worldFromAsset, f.fromEye, f.viewFromAsset,
                             f.viewTranslation, f.viewScale, asset.lowPassVariance, asset.handle.serial});
    }
    const OrderCamera camera{frame.clipFromView, frame.viewport, frame.nearW, frame.orthographic, glm::vec3(frame.towardsEye), eyeRounding(frame)};
#if NACRE_WITH_GL43
    if (context_.gl.computesPictures()) return sortOnGpu(instances, camera);
#endif
    const bool changed = order_.update(instances, camera);
    if (changed || orderedIn_ != list_.revision()) list_.upload(order_.farToNear());
    orderedIn_ = list_.revision();
    stats_.sorted = changed && order_.hasSorted();
    stats_.splatsDrawn = uint32_t(order_.farToNear().size());
    drawn_.clear(); // those that have splats in the frame: the others cost nothing
    for (size_t k = 0; k < collected_.size(); ++k)
        if (order_.drawnOf()[k] > 0) drawn_.push_back(collected_[k]);
    return growIndexBuffer(context_, order_.farToNear().size());
}

#if NACRE_WITH_GL43
Failure View::sortOnGpu(std::span<const OrderInstance> instances, const OrderCamera& camera)
{
    std::vector<OrderGeometry> geometry;
    for (const Entry* entry : collected_) geometry.push_back({&entry->instance->asset->geometry, &entry->instance->asset->grid});
    if (Failure f = gpuOrder_.update(instances, geometry, camera, list_.order, orderedIn_ != list_.revision())) return f;
    orderedIn_ = list_.revision();
    stats_.sorted = gpuOrder_.hasSorted();
    stats_.splatsDrawn = gpuOrder_.count();
    drawn_ = collected_; // only the GPU knows better
    return growIndexBuffer(context_, gpuOrder_.count());
}
#endif

void View::begin(GlStateGuard& state)
{
    stats_ = {};
    drawn_.clear();
    context_.passes.begin();
    context_.gl.BindVertexArray(context_.vertexArray);
    state.beginPasses();
}

Failure View::update(const ViewFrame& frame, uint64_t relightBudget, std::span<const std::shared_ptr<Instance>> instances, GlStateGuard& state, Stopwatch& watch)
{
    begin(state);
    if (Failure f = collect(frame, instances)) return f;
    if (collected_.empty()) return {};
    if (Failure f = sort(frame)) return f;
    stats_.sortSeconds = watch.lap();
    if (Failure f = relight(relightBudget)) return f;
    stats_.relightSeconds = watch.lap();
    if (Failure f = project(frame, false)) return f;
    stats_.rasterSeconds = watch.lap();
    return {};
}

/// Splats whose colour is known.
Failure View::raster(const ViewFrame& frame, bool depthTest, GlStateGuard& state)
{
#if NACRE_WITH_GL43
    bool drawn = false;
    if (context_.gl.computesPictures())
        if (Failure f = tiles_.draw(frame, list_, stats_.splatsDrawn, depthTest, state, &drawn); f || drawn) return f;
#endif
    return rasterQuads(frame, depthTest, state);
}

Failure View::rasterQuads(const ViewFrame& frame, bool depthTest, GlStateGuard& state)
{
    const Gl& gl = context_.gl;
    const Program* program = nullptr;
    if (Failure f = splatProgram(&program)) return f;
    state.beginDraw(depthTest);
    program->use();
    list_.projected0.bind(0), list_.projected1.bind(1), list_.order.bind(2), list_.color.bind(3);
    program->set("uListWidth", list_.width());
    program->set("uViewport", frame.viewport);
    program->set("uMaxColor", largestColor(gl));
    gl.DrawElements(GL_TRIANGLES, GLsizei(6 * stats_.splatsDrawn), GL_UNSIGNED_INT, nullptr);
    return {};
}

Failure View::splatProgram(const Program** program)
{
    return splatProgram_.find(program, [&](const Program** made) { return findProgram(context_, {"splat", std::string(shaders::kListGlsl) + shaders::kSplatVertGlsl, shaders::kSplatFragGlsl,
                                  {"uProjected0", "uProjected1", "uOrder", "uColor"}}, made); });
}

/// Those of any instance that is shaded.
ViewLights View::collectLights(const ViewFrame& frame) const
{
    ViewLights lights;
    const std::vector<LightPoint>& points = context_.lights.points();
    std::vector<bool> used(points.size());
    for (const Entry* entry : drawn_)
        if (isShaded(*entry->instance->asset))
            for (const uint32_t p : entry->instance->lights.point) used[p] = true;
    const InstancePlace eye{glm::translate(glm::dmat4(1), -frame.eye)};
    for (uint32_t p = 0; p < used.size(); ++p)
        if (used[p]) lights.points.push_back(p), lights.packed.push_back(packPoint(points[p], eye));
    return lights;
}

/// Slots of the instance's lights by light of the view.
static std::vector<int> slotsOf(const Instance& instance, const ViewLights& lights)
{
    std::vector<int> slots(lights.points.size(), -1);
    for (size_t s = 0; s < instance.lights.point.size(); ++s) {
        const auto found = std::lower_bound(lights.points.begin(), lights.points.end(), instance.lights.point[s]);
        if (found != lights.points.end() && *found == instance.lights.point[s]) slots[size_t(found - lights.points.begin())] = int(s);
    }
    return slots;
}

/// Surfaces and incident shares of all instances into the list.
Failure View::gather(const ViewFrame& frame)
{
    lights_ = collectLights(frame);
    if (Failure f = list_.growAttributes(3 + (int(lights_.points.size()) + 2) / 3)) return f;
    for (Entry* entry : drawn_) {
        const bool shaded = isShaded(*entry->instance->asset);
        if (Failure f = entry->model->gather(entry->frame, list_, entry->rows, shaded ? slotsOf(*entry->instance, lights_) : std::vector<int>())) return f;
    }
    return {};
}

Failure View::rasterShaded(const ViewFrame& frame, bool depthTest, GlStateGuard& state)
{
    GbufferInput input{frame, list_, lights_, stats_.splatsDrawn, false, depthTest, false, glm::vec3(INFINITY), glm::vec3(-INFINITY), INFINITY};
    for (const Entry* entry : drawn_) {
        const Instance& instance = *entry->instance;
        const bool shaded = isShaded(*instance.asset);
        input.mixed = input.mixed || !shaded;
        input.bright = input.bright || instance.arriving * double(instance.model->brightest()) > double(kMaxHalf);
        if (!shaded) continue;
        const glm::vec3 low = instance.asset->boundsMin, high = instance.asset->boundsMax, size = (high - low) * entry->frame.worldScale;
        for (int corner = 0; corner < 8; ++corner) {
            const glm::vec3 p(corner & 1 ? high.x : low.x, corner & 2 ? high.y : low.y, corner & 4 ? high.z : low.z);
            const glm::vec3 world = entry->frame.worldFromAsset * p + entry->frame.fromEye;
            input.low = glm::min(input.low, world), input.high = glm::max(input.high, world);
        }
        input.smallest = std::min(input.smallest, std::max({size.x, size.y, size.z}));
    }
    return gbuffer_.draw(input, state);
}

static Failure checkDepthAlpha(const NacreDrawDesc& desc)
{
    if (desc.depthAlpha >= 0 && desc.depthAlpha <= 1) return {};
    return invalid("depthAlpha must be from 0 to 1, found " + numberText(desc.depthAlpha));
}
static float depthAlpha(const NacreDrawDesc& desc) { return desc.depthAlpha > 0 ? desc.depthAlpha : 0.5f; }

static Failure checkViewport(const NacreDrawDesc& desc)
{
    if (desc.viewportWidth >= 0 && desc.viewportHeight >= 0) return {};
    return invalid("the viewport is " + std::to_string(desc.viewportWidth) + " x " + std::to_string(desc.viewportHeight) + " pixels, neither may be negative");
}

/// A minimised window, whose aspect ratio and targets need not be valid.
static bool isEmpty(const NacreDrawDesc& desc) { return desc.viewportWidth == 0 || desc.viewportHeight == 0; }

Failure View::draw(const NacreDrawDesc& desc, std::span<const std::shared_ptr<Instance>> instances)
{
    if (Failure f = checkViewport(desc)) return f;
    if (isEmpty(desc)) return stats_ = {}, Failure{};
    if (Failure f = checkGlContext(context_)) return f;
    ViewFrame frame;
    if (Failure f = makeViewFrame(desc, clipControl(context_.gl), &frame)) return f;
    if (Failure f = checkTarget(context_.gl)) return f;
    if (desc.depthWrite)
        if (Failure f = checkDepthAlpha(desc)) return f;
    if (desc.depthWrite)
        if (Failure f = depth_.check()) return f;

    Stopwatch watch(context_);
    GlStateGuard state(context_.gl, context_.hostState);
    Failure failure = update(frame, desc.maxRelightSplats, instances, state, watch);
    const bool shades = std::any_of(drawn_.begin(), drawn_.end(), [](const Entry* e) { return isShaded(*e->instance->asset); });
    if (!failure && shades && stats_.splatsDrawn > 0) failure = gather(frame);
    context_.passes.end();
    if (failure) return failure;
    if (stats_.splatsDrawn > 0)
        if (Failure f = shades ? rasterShaded(frame, desc.depthTest != 0, state) : raster(frame, desc.depthTest != 0, state)) return f;
    if (desc.depthWrite && stats_.splatsDrawn > 0)
        if (Failure f = depth_.write(frame, list_, stats_.splatsDrawn, desc.depthTest != 0, depthAlpha(desc), state)) return f;
    stats_.rasterSeconds += watch.lap();
    return {};
}

Failure View::drawDepth(const NacreDrawDesc& desc, std::span<const std::shared_ptr<Instance>> instances)
{
    if (Failure f = checkViewport(desc)) return f;
    if (isEmpty(desc)) return stats_ = {}, Failure{};
    if (Failure f = checkDepthAlpha(desc)) return f;
    if (Failure f = checkGlContext(context_)) return f;
    ViewFrame frame;
    if (Failure f = makeViewFrame(desc, clipControl(context_.gl), &frame)) return f;
    if (Failure f = checkTarget(context_.gl, false)) return f;

    Stopwatch watch(context_);
    GlStateGuard state(context_.gl, context_.hostState);
    begin(state);
    Failure failure = collect(frame, instances);
    drawn_ = collected_;
    if (!failure) failure = project(frame, true);
    context_.passes.end();
    if (failure) return failure;
    std::vector<ListSpan> spans;
    for (const Entry* entry : drawn_) spans.push_back({list_.firstIndex(entry->rows), entry->instance->asset->grid.count});
    if (Failure f = depth_.drawCasters(frame, list_, spans, depthAlpha(desc), state)) return f;
    for (const ListSpan& span : spans) stats_.splatsDrawn += span.count;
    stats_.rasterSeconds = watch.lap();
    return {};
}

Failure View::prepare(const NacreDrawDesc* desc, std::span<const std::shared_ptr<Instance>> instances, int mostLights)
{
    if (Failure f = checkGlContext(context_)) return f;
    if (desc)
        if (Failure f = checkViewport(*desc)) return f;
    if (desc && isEmpty(*desc)) desc = nullptr;
    ViewFrame frame;
    if (desc)
        if (Failure f = makeViewFrame(*desc, clipControl(context_.gl), &frame)) return f;
    Stopwatch watch(context_);
    GlStateGuard state(context_.gl, context_.hostState);
    bool shades = false, emits = false;
    for (const std::shared_ptr<Instance>& instance : instances) {
        AssetModel& model = *instance->asset->model;
        if (!allowed(*instance, mask)) continue;
        (isShaded(*instance->asset) ? shades : emits) = true;
        if (Failure f = model.compileAhead(mostLights)) return f;
    }
    const Program* program = nullptr;
    if (Failure f = projectProgram(&program)) return f;
    if (emits && !shades)
        if (Failure f = splatProgram(&program)) return f;
#if NACRE_WITH_GL43
    if (context_.gl.computesPictures()) {
        if (Failure f = gpuOrder_.compile()) return f;
        if (Failure f = emits && !shades ? tiles_.compile() : Failure{}) return f;
    }
#endif
    if (shades)
        if (Failure f = gbuffer_.compileAhead(mostLights, emits)) return f;
    if (!desc) return {};
    const Failure failure = update(frame, desc->maxRelightSplats, instances, state, watch);
    context_.passes.end();
    return failure;
}

} // namespace nacre
